"""What a trajectory server does, without ROS: skills, the robot's pose, ticks, refusals."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import threading
import time
from typing import Any, TypeAlias

import numpy as np

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ManifoldError, ParameterError
from gdmp_ros.playback.bounds import StreamBounds
from gdmp_ros.playback.goal_tracker import GoalTracker, moved_on
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.refusals import Refusals
from gdmp_ros.playback.rehearsal import rehearse
from gdmp_ros.playback.requests import Status
from gdmp_ros.playback.robot_watch import RobotSettings, RobotWatch
from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.playback.tool_skill import PlayerSettings
from gdmp_ros.realtime.shared_loop import Member
from gdmp_ros.realtime.statistics import LatenessRecorder

NS = 1_000_000_000
#: Ticks between two readings of the measured pose.
READ_EVERY = 50
#: Reads the measured pose: (x, y, z, qw, qx, qy, qz) and its age [s]; None if there is no new one.
PoseSource: TypeAlias = Callable[[], tuple[np.ndarray, float] | None]


class Streamer:
    """
    Streams a skill as references.

    One thread calls `tick`; the other methods may be called from any thread.

    :ivar player: None before there is a skill
    :ivar robot: what is known of the robot
    :ivar bounds: of speed and acceleration
    :ivar active: whether ticks are made
    :ivar member: the task in the real-time loop; None with simulated time
    :ivar ticks: number of calls of `tick`
    :ivar time: that the motions have had, without jumps [s]
    :ivar time_jumps: [s], not reported yet
    """

    def __init__(self, period_ns: int, read_pose: PoseSource, measured_from: str,
                 settings: StreamSettings, player_settings: PlayerSettings,
                 robot_settings: RobotSettings | None = None,
                 reach: Callable[[np.ndarray], str] = lambda _: ''):
        """
        Prepare to stream.

        :param read_pose: called when the measured pose is needed, by any thread
        :param measured_from: source of the measured pose, for messages
        :param reach: why the robot cannot reach a pose; empty if it can
        """
        self.settings = settings
        self.bounds = StreamBounds(settings)
        self.robot = RobotWatch(robot_settings or RobotSettings())
        self.player: Player | None = None
        self.skill_name = ''
        self.refusals = Refusals()
        self.lateness = LatenessRecorder(period_ns)
        self.member: Member | None = None
        self.active = False
        self.time_jumps: deque[float] = deque(maxlen=10)
        self._player_settings = player_settings
        self._read_pose, self._measured_from = read_pose, measured_from
        self._reach = reach
        self._reading = threading.Lock()
        self._measured: tuple[np.ndarray, float] | None = None
        self._used: tuple[np.ndarray, float] | None = None
        self._last_tick, self.ticks, self.time = 0, 0, 0.0
        self._tracker = GoalTracker()

    def configure(self, settings: StreamSettings, player_settings: PlayerSettings,
                  robot_settings: RobotSettings) -> None:
        """Use other settings from now on; those of the player from the next motion on."""
        self.settings, self._player_settings = settings, player_settings
        self.robot.settings = robot_settings
        self.bounds.configure(settings)
        if self.player is not None:
            self.player.configure(player_settings)

    @property
    def mode(self) -> StreamMode:
        """What the stream of references says of itself."""
        return StreamMode.HOLDING if self.player is None else self.player.mode

    def use(self, skill: Skill, name: str) -> None:
        """
        Use a skill for the next start.

        :raises DataError: if it is not one of pose and stiffness; the present skill stays
        """
        rehearse(skill, self._player_settings)
        if self.player is None:
            self.player = Player(skill, self._player_settings, self.refusals)
        else:
            self.player.load(skill)
        self.skill_name = name

    def load(self, path: str) -> None:
        """
        Use a skill file for the next start.

        :raises DataError: if it cannot be loaded; the present skill stays
        """
        self.use(Skill.load(path), path)

    def loaded(self) -> Player:
        """
        Return the player.

        :raises ParameterError: if there is no skill
        """
        if self.player is None:
            raise ParameterError('no skill is loaded: set the parameter skill or demonstrations, '
                                 'or call ~/load_skill or ~/learn_skill')
        return self.player

    def begin(self, goal_pose: np.ndarray | None = None, goal_stiffness: Any = None,
              duration: float | None = None,
              tolerances: tuple[float, float] | None = None) -> int:
        """
        Start the loaded skill.

        :param goal_stiffness: 9 or 36 numbers; None or empty for that of the skill
        :returns: number of the motion (`Player.start`)
        :raises GdmpError: if it cannot start; what is streamed does not change
        """
        player = self.loaded()
        if not self.active:
            raise ParameterError('the node is not active')
        factor = None
        if goal_stiffness is not None and len(goal_stiffness):
            factor = player.tool.stiffness_factor(goal_stiffness)
        measured = self._start_pose()
        problem = self._reach(player.tool.skill.goal[:7] if goal_pose is None else goal_pose)
        if problem:
            raise ParameterError(f'the goal cannot be reached: {problem}')
        self._tracker.reset()
        self.robot.begin()
        return player.start(measured, goal_pose, factor, duration, tolerances)

    def switch_goal_pose(self, pose: np.ndarray, age: float = 0.0) -> None:
        """
        Switch the pose goal; one that keeps moving is followed with its velocity.

        :param age: time since the goal was there [s]
        :raises GdmpError: if it lies outside the workspace, or no skill is being executed
        """
        player = self._executing()
        self.check_goal(pose)
        now = self._last_tick / NS
        goal = self._tracker.update(pose, now - age, now)
        player.goal_pose(goal.pose, goal.twist)

    def follow_goal(self, pose: np.ndarray, twist: np.ndarray, age: float = 0.0) -> None:
        """
        Switch the pose goal to one that moves on with a given twist, until the next goal.

        :param twist: linear and angular velocity [m/s, rad/s]
        :param age: time since the goal was there [s]
        :raises GdmpError: as `switch_goal_pose`, or if a number is not finite
        """
        player = self._executing()
        self.check_goal(pose)
        if not np.isfinite(twist).all():
            raise ManifoldError('the twist of the goal has a NaN or infinite number')
        self._tracker.reset()
        player.goal_pose(moved_on(pose, twist, age), twist)

    def switch_goal_stiffness(self, numbers: Sequence[float]) -> None:
        """
        Switch the stiffness goal.

        :raises GdmpError: if it does not fit the skill, or no skill is being executed
        """
        player = self._executing()
        player.goal_stiffness(player.tool.stiffness_factor(numbers))

    def check_goal(self, pose: np.ndarray) -> None:
        """:raises ManifoldError: if a goal position lies outside the workspace"""
        for axis, value, least, most in zip('xyz', pose, self.settings.workspace_min,
                                            self.settings.workspace_max):
            if not least <= value <= most:
                raise ManifoldError(f'goal {axis} is {value:.3f} m, outside the workspace '
                                    f'{least:g} to {most:g} m')

    def robot_is_known(self) -> bool:
        """Whether the robot's pose is recent enough to start a motion; True while inactive."""
        measured = self._measured
        if measured is not None and _age(measured) <= self.settings.measured_pose_age:
            return True
        try:
            self._start_pose()
        except ParameterError:
            return not self.active
        return True

    def activate(self, period_ns: int) -> None:
        """Begin to tick; what was held before is forgotten: the robot may be elsewhere now."""
        if self.player is not None:
            self.player.forget()
        self._measured = self._used = None
        self.robot.reset()
        self.bounds.reset()
        self.lateness = LatenessRecorder(period_ns)
        self._last_tick = 0
        self.active = True

    def stop(self) -> None:
        """Stop a motion smoothly, and wait until it has stopped."""
        player = self.player
        if player is None or player.status in (Status.IDLE, Status.HOLDING):
            return
        player.stop()
        latest = time.monotonic() + 2.0 / player.speed_rate + 1.0
        while player.status is Status.STOPPING and time.monotonic() < latest:
            time.sleep(0.005)

    def tick(self, now_ns: int, longest_s: float) -> np.ndarray | None:
        """
        Advance the motion to the present time.

        :param longest_s: a longer step is a jump of the time: the motion does not advance then [s]
        :returns: see `Player.tick`; None without a skill
        """
        self.ticks += 1
        dt = (now_ns - self._last_tick) / NS if self._last_tick else 0.0
        self._last_tick = now_ns
        if not 0.0 <= dt <= longest_s:
            self.time_jumps.append(dt)
            dt = 0.0
        self.time += dt
        player = self.player
        if player is None:
            return None
        if self.ticks % READ_EVERY == 0:
            self._use_pose(player)
            ended = self._tracker.expired(now_ns / NS)
            if ended is not None:
                player.goal_pose(ended.pose)
        target = player.tick(dt)
        return None if target is None else self.bounds.apply(target, dt)

    def _use_pose(self, player: Player) -> None:
        """Let the player and the watch use the measured pose."""
        measured, reference = self._newest_pose(), player.target
        known = measured is not None and _age(measured) <= self.settings.measured_pose_age
        if reference is not None:
            self.robot.update(self.time, measured[0] if measured is not None and known else None,
                              reference, player.status is Status.MOVING)
        if measured is None or measured is self._used:
            return
        self._used = measured
        if reference is None and player.status is Status.IDLE:
            player.hold(measured[0])
        elif player.stops_phase:
            player.observe(measured[0])

    def _newest_pose(self) -> tuple[np.ndarray, float] | None:
        """The newest measured pose, and when it arrived (`time.monotonic`)."""
        with self._reading:
            newest = self._read_pose()
            if newest is not None:
                self._measured = newest[0], time.monotonic() - newest[1]
            return self._measured

    def _executing(self) -> Player:
        player = self.loaded()
        status = player.status
        if status is Status.IDLE or (player.rollout is None and status is Status.HOLDING):
            raise ParameterError('no skill is being executed; start one first')
        return player

    def _start_pose(self) -> np.ndarray | None:
        if self.settings.start_from == 'skill':
            return None
        measured = self._newest_pose()
        if measured is None:
            raise ParameterError(f'no measured pose has arrived on {self._measured_from} (with '
                                 'start_from: skill none is needed)')
        age = _age(measured)
        if age > self.settings.measured_pose_age:
            raise ParameterError(f'the last measured pose on {self._measured_from} is {age:.2f} s '
                                 f'old, expected at most {self.settings.measured_pose_age:g} s')
        return measured[0]


def _age(measured: tuple[np.ndarray, float]) -> float:
    return time.monotonic() - measured[1]  # s since it arrived
