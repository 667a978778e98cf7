"""A simulated arm in a loop of this process, with the server's streamer. No ROS."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import traceback

import numpy as np

from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.gripper import check_command, GripperCommand
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.joint_target import joint_target_size
from gdmp_ros.control.limits import described, LIMITS
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.target import resting_target
from gdmp_ros.data import recordings, takes
from gdmp_ros.dmp.demonstration import Demonstration, MIN_SAMPLES
from gdmp_ros.dmp.sequence import SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.learning.correction import FollowedMotion
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.states import Status
from gdmp_ros.playback.streamed_skill import Kind
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.realtime.loop import Clock, Loop, NS, SystemClock
from gdmp_ros.scene import Scene
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.gripper import arm_with_gripper, GripperOfLoop, STRONGEST
from gdmp_ros.sim.path_check import Reach
from gdmp_ros.sim.teaching import Hand
from gdmp_ros.sim.tool_shape import tool_of
from gdmp_ros.studio.commands import Commands
from gdmp_ros.studio.robot import RobotView

#: Longest take [s].
LONGEST_TAKE_S = 600.0
#: Ticks are computed in batches, so that the loop wakes 100 times a second [s].
BATCH_S = 0.01
#: A pause of the computer is not made up for [s].
LONGEST_S = 0.1
#: Samples of a take: every so many ticks.
SAMPLE_EVERY = 2
#: A limit is shown for this time after it acted [s].
SHOWN_S = 0.5
#: Largest speed of a joint on the way home [rad/s].
HOME_SPEED = 0.5
#: Time over which the rate to real time is measured [s].
_RATE_S = 1.0


class RecordedTake:
    """
    Poses of the tool, positions of the joints, commands for the gripper.

    One thread adds, and afterwards another one writes.
    """

    def __init__(self, folder: Path, names: Sequence[str], start_ns: int):
        """
        Begin.

        :param folder: for the bag; it is made here, so that it fails before the work
        :param names: of the joints
        :param start_ns: time of day [ns since 1970]
        :raises DataError: if the folder cannot be written
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self.path = folder / takes.next_name(folder)
            self.path.mkdir()
            self.path.rmdir()
        except OSError as error:
            raise DataError(f'{folder}: cannot write takes: {error.strerror}') from None
        self._names, self._start_ns = names, start_ns
        self._times: list[float] = []
        self._poses: list[np.ndarray] = []
        self._joints: list[np.ndarray] = []
        self._commands: list[tuple[float, GripperCommand]] = []

    @property
    def duration(self) -> float:
        """[s]."""
        return self._times[-1] - self._times[0] if self._times else 0.0

    def add(self, time_s: float, pose: np.ndarray, joints: np.ndarray) -> None:
        """Add a sample; later than `LONGEST_TAKE_S` nothing is added."""
        if self.duration < LONGEST_TAKE_S:
            self._poses.append(pose)
            self._joints.append(joints)
            self._times.append(time_s)

    def grip(self, command: GripperCommand) -> None:
        """Add a command for the gripper, at the time of the last sample."""
        if self._times:
            self._commands.append((self._times[-1], command))

    def write(self) -> Path:
        """
        Write the bag.

        :raises DataError: without samples, or if it cannot be written
        """
        count = min(len(self._times), len(self._poses))
        if count < MIN_SAMPLES:
            raise DataError('the take is not kept: it has no samples')
        times = np.array(self._times[:count])
        demo = Demonstration(times - times[0], np.array(self._poses[:count]), tool_manifold(None))
        recordings.write(self.path, demo, recordings.FRAME, self._start_ns,
                         joints=(self._names, np.array(self._joints[:count])),
                         commands=[(time - times[0], command)
                                   for time, command in self._commands])
        return self.path


class SimulatedRobot:
    """A `gdmp_ros.studio.robot.Robot`: an arm in MuJoCo with its controller, in real time."""

    def __init__(self, model: str = '', clock: Clock | None = None):
        """
        Start the simulation.

        :param clock: by default that of the system
        :raises DataError: if the model cannot be loaded
        """
        self._clock = clock or SystemClock()
        arm, self._gripper = arm_with_gripper(model)
        self.name = f'simulated {model or "Panda"}'
        self._loop = ClosedLoop(arm, gripper=self._gripper)
        self._loop.warm_up(arm.measure(), arm.period)
        self._pose, self._joints = arm.measure().pose.copy(), arm.measure().position.copy()
        pose = MeasuredInput(self._clock, lambda: (self._pose.copy(), 0.0), 'the simulation')
        joints = MeasuredInput(self._clock, lambda: (self._joints.copy(), 0.0), 'the simulation',
                               'positions of the joints')
        self._streamer = Streamer(round(arm.period * NS), MeasuredInputs(pose, joints),
                                  StreamSettings(), PlayerSettings(),
                                  kinematics=Reach(Arm(model)),
                                  gripper=None if self._gripper is None
                                  else GripperOfLoop(self._gripper))
        self._streamer.surroundings.tool = tool_of(Arm(model))
        self._streamer.activate(round(arm.period * NS))
        self._take: RecordedTake | None = None
        self._acted, self._acted_at = np.zeros(len(LIMITS)), np.full(len(LIMITS), -np.inf)
        self._problem, self._refused, self._guard_refused, self._tempo = '', 0, 0, 1.0
        self._in_sequence = False
        self._view: RobotView | None = None
        self._commands = Commands(self._clock)
        self._rate = 1.0
        self._running = self._clock.start(self._simulate())

    def close(self) -> None:
        self._running.end()

    def view(self) -> RobotView | None:
        view = self._view
        return view if view is None else replace(view, problem=self._problem)

    # Skills

    def use(self, skill: Skill, name: str) -> None:
        self._streamer.use(skill, name)

    def start(self) -> None:
        self._check_free()
        self._streamer.loaded().set_speed(self._tempo)
        self._streamer.begin()

    def start_sequence(self, sequence: SkillSequence, first: int) -> None:
        self._check_free()
        self._streamer.begin_sequence(sequence, first)
        self._streamer.loaded().set_speed(self._tempo)

    def signal(self, name: str) -> None:
        self._streamer.sequence.signal(name)

    def _check_free(self) -> None:
        if self._busy():
            raise ParameterError('the arm is guided by hand, or on its way home: wait, or end it')
        self._problem = ''

    def _busy(self) -> bool:
        """Whether something else moves the arm."""
        return self._loop.states.state is State.GUIDED or self._loop.moves_joints

    def stop(self) -> None:
        self._commands.put(self._end_joint_motion)
        player, sequence = self._streamer.player, self._streamer.sequence.status
        runs = sequence is not None and sequence.running
        if player is not None and (runs or player.status in (Status.MOVING, Status.PAUSED)):
            self._streamer.stop_motion()

    def pause(self, paused: bool) -> None:
        if self._streamer.player is None:
            raise ParameterError('nothing moves: press start first')
        self._streamer.pause(paused)

    def set_tempo(self, tempo: float) -> None:
        self._tempo = tempo
        if self._streamer.player is not None:
            self._streamer.player.set_speed(tempo)

    def set_amplitude(self, amplitude: float) -> None:
        self._streamer.commands.amplitude(amplitude)

    def switch_goal(self, pose: np.ndarray) -> None:
        self._streamer.commands.goal_pose(pose, self._streamer.now)

    def move_object(self, name: str, pose: np.ndarray) -> None:
        self._streamer.loaded().move_frame(name, pose, self._streamer.time)

    def followed(self) -> FollowedMotion:
        return FollowedMotion(*self._streamer.record.arrays())

    # The arm

    def surround(self, scene: Scene) -> None:
        self._loop.controller.surround(scene)
        self._streamer.surround(scene)

    def guide(self, guided: bool) -> None:
        self.stop()
        self._commands.put(lambda: self._guide(guided))

    def pull(self, pose: np.ndarray | None) -> None:
        hand = None if pose is None else Hand(pose)
        self._commands.put(lambda: self._pull(hand))

    def home(self) -> None:
        if self._take is not None:
            raise ParameterError('a take is being recorded: keep or discard it first')
        self.stop()
        self._commands.put(self._go_home)

    def grip(self, command: GripperCommand) -> None:
        if self._gripper is None:
            raise ParameterError('the arm has no gripper')
        check_command(command, self._gripper.widest, STRONGEST)
        self._commands.put(lambda: self._grip(command))

    def record(self, folder: Path) -> None:
        if self._take is not None:
            raise ParameterError('a take is being recorded: keep or discard it first')
        self._take = RecordedTake(folder, self._loop.arm.names, self._clock.wall())

    def keep(self) -> Path:
        if self._take is None:
            raise ParameterError('no take is being recorded')
        take, self._take = self._take, None
        return take.write()

    def discard(self) -> None:
        self._take = None

    # The loop

    def _simulate(self) -> Loop:
        period, due = self._loop.arm.period, self._now()
        begun, ticks = due, 0
        while True:
            yield round(due * NS)
            due += BATCH_S
            if self._now() - due > LONGEST_S:
                due = self._now()
            try:
                self._commands.carry_out()
                for _ in range(round(BATCH_S / period)):
                    tick = self._tick()
            except GdmpError as error:
                self._recover(str(error))
                continue
            except Exception:
                self._view = None  # the page says that the robot is silent
                traceback.print_exc()
                raise
            ticks += round(BATCH_S / period)
            now = self._now()
            if now - begun > _RATE_S:
                self._rate, begun, ticks = ticks * period / (now - begun), now, 0
            self._view = self._viewed(tick)

    def _now(self) -> float:
        return self._clock.now() / NS

    def _tick(self) -> Tick:
        loop, arm = self._loop, self._loop.arm
        target = self._streamer.tick(round((arm.time + 1.0) * NS), LONGEST_S)
        if target is not None and not self._busy():
            if self._of_joints():
                target = target[:joint_target_size(len(arm.names))]
            loop.follow(target, self._streamer.mode)
        moved = loop.moves_joints
        tick = loop.tick()
        if moved and not loop.moves_joints:
            self._problem = loop.joint_motion_problem
            self._hold()
        self._pose, self._joints = tick.measurement.pose.copy(), tick.measurement.position.copy()
        acts = tick.violation > 0.0
        self._acted[acts], self._acted_at[acts] = tick.violation[acts], arm.time
        take = self._take  # the page may end it meanwhile
        if take is not None and self._streamer.ticks % SAMPLE_EVERY == 0:
            take.add(arm.time, self._pose, self._joints)
        return tick

    def _of_joints(self) -> bool:
        """Whether the present motion is one of the joints."""
        player = self._streamer.player
        return player is not None and player.playing.kind is Kind.JOINTS

    def _viewed(self, tick: Tick) -> RobotView:
        streamer, now = self._streamer, self._loop.arm.time
        player, take = streamer.player, self._take
        if streamer.refusals.count > self._refused:
            self._refused, self._problem = streamer.refusals.count, streamer.refusals.last
        guard = self._loop.controller.guard
        if guard.refused > self._guard_refused:
            self._problem = guard.last_refusal
        self._guard_refused = guard.refused
        moves = player is not None and player.rollout is not None
        goal = player.goal if player is not None and moves else None
        if goal is not None and self._of_joints():
            goal = self._loop.arm.pose_at(goal)
        offset = None if goal is None else pose_distance(self._pose, goal)
        limited = tuple(described(np.where(now - self._acted_at < SHOWN_S, self._acted, 0.0)))
        rollout = None if player is None else player.rollout
        sequence = streamer.sequence.status
        if sequence is not None and not sequence.running and self._in_sequence:
            self._problem = sequence.problem
        self._in_sequence = sequence is not None and sequence.running
        return RobotView(
            self._joints, self._pose, goal,
            'idle' if player is None else str(player.status), tick.mode.name.lower(),
            0.0 if rollout is None else rollout.progress,
            0.0 if rollout is None else rollout.speed,
            (0.0, 0.0) if offset is None else (float(offset[0]), float(offset[1])),
            float(tick.tank), limited, None if take is None else take.duration, self._problem,
            self._rate,
            None if rollout is None or not rollout.skill.rhythmic
            else (rollout.frequency, rollout.amplitude),
            None if sequence is None or not sequence.running else
            (sequence.step, sequence.steps, sequence.step_name),
            None if self._gripper is None else self._gripper.state.width)

    def _grip(self, command: GripperCommand) -> None:
        if self._gripper is not None:
            self._gripper.command(command)
        take = self._take  # the page may end it meanwhile
        if take is not None:
            take.grip(command)

    def _guide(self, guided: bool) -> None:
        if guided is (self._loop.states.state is State.GUIDED):
            return
        self._loop.do(Request.GUIDE if guided else Request.RELEASE)
        self._pull(None)
        if not guided:
            self._hold()

    def _end_joint_motion(self) -> None:
        if self._loop.moves_joints:
            self._loop.controller.guard.stop('stopped')

    def _hold(self) -> None:
        """Hold the arm where it is, and let the streamer begin there."""
        measured = self._loop.arm.measure()
        self._loop.hold(measured)
        # The next motion is a stream of its own.
        self._loop.follow(resting_target(measured.pose), StreamMode.ENDED)
        self._streamer.activate(round(self._loop.arm.period * NS))

    def _pull(self, hand: Hand | None) -> None:
        self._loop.driver.release()
        self._loop.driver.hand = hand

    def _go_home(self) -> None:
        self._guide(False)
        loop = self._loop
        loop.controller.guard.stop()
        loop.move(PostureMotion(loop.joints, loop.arm.home[None], HOME_SPEED))

    def _recover(self, problem: str) -> None:
        """Put the arm back to its first posture after its simulation has become unstable."""
        self._problem = problem
        self._loop.reset()
        self._streamer.activate(round(self._loop.arm.period * NS))
