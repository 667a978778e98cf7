"""A robot behind running nodes: trajectory server, arm, and take recorder."""
from __future__ import annotations

from contextlib import suppress
from functools import partial
import math
from pathlib import Path
from typing import Any

from gdmp_msgs.action import MoveJoints
from gdmp_msgs.msg import GripperCommand as CommandMessage
from gdmp_msgs.msg import GripperState as StateMessage
from gdmp_msgs.msg import RecorderState, RobotState, ServerState
from gdmp_msgs.srv import LoadSkill, RefineSkill, SetSpeed
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.control.limits import described
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.data.runs import limited
from gdmp_ros.dmp.sequence import SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.learning.correction import FollowedMotion
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.realtime.loop import Loop
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.server_client import (
    followed_motion,
    problem_of,
    SentGoal,
    ServerClient,
)
from gdmp_ros.ros.gripper import COMMAND, command_message, STATE
from gdmp_ros.ros.lifecycle import SILENT_S
from gdmp_ros.ros.scene.messages import markers_of
from gdmp_ros.scene import Scene
from gdmp_ros.studio.commands import Commands
from gdmp_ros.studio.robot import RobotView

#: Interval at which the states are read, and the pose of a hand is sent [s].
PERIOD_S = 0.02
#: Longest time for an answer of the nodes [s].
ANSWER_S = 10.0
#: Longest time in which a service is found [s].
AVAILABLE_S = 5.0
#: Longest time for the end of everything [s].
CLOSING_S = 3.0
RECORDER = 'take_recorder'


class NodesRobot:
    """A `gdmp_ros.studio.robot.Robot` whose nodes run on this machine."""

    def __init__(self, server: str = 'trajectory_server', arm: str = 'panda_sim'):
        """
        Subscribe.

        :param server: name of the trajectory server, with its namespace
        :param arm: name of the node of the arm
        """
        self.name = f'{arm}, {server}'
        self._server, self._arm = server, arm
        self._closing = False
        client = self._client = ServerClient(server, self._check_open)
        self._robots = client.subscribe(RobotState, f'{arm}/state', depth=1)
        self._hand = client.publisher(PoseStamped, f'{arm}/hand_pose', 1)
        self._scene_out = client.publisher(MarkerArray, f'{arm}/scene', 10)
        near = arm.rpartition('/')[0]
        self._gripper_out = client.publisher(CommandMessage, f'{near}/{COMMAND}', 10)
        client.subscribe(StateMessage, f'{near}/{STATE}', self._on_gripper, 1)
        self._width: float | None = None
        self._scene: Scene | None = None
        self._around = set[str]()
        client.subscribe(RecorderState, f'{RECORDER}/state', self._on_recorder, 1)
        # From the beginning, so that the nodes know them when they are called.
        self._services = {name: client.participant.client(kind, name) for name, kind in (
            *((f'{server}/{name}', kind) for name, kind in (
                ('load_skill', LoadSkill), ('set_speed', SetSpeed), ('stop', Trigger),
                ('pause', SetBool), ('refine_skill', RefineSkill))),
            *((f'{arm}/{name}', kind) for name, kind in (
                ('teach', SetBool),)),
            *((f'{RECORDER}/{name}', Trigger) for name in ('start', 'stop', 'discard')))}
        self._move = client.participant.action_client(MoveJoints, f'{arm}/move_joints')
        self._robot: RobotState | None = None
        self._recorder: RecorderState | None = None
        self._state: ServerState | None = None
        self._received = {'server': -math.inf, 'arm': -math.inf}
        self._problem, self._tempo = '', 1.0
        self._skill: tuple[Skill, str] | None = None
        self._pulled: np.ndarray | None = None
        self._executing = self._guided = self._records = False
        self._homing: SentGoal | None = None
        self._commands = Commands(client.clock)
        self._running = client.clock.start(self._work())

    def close(self) -> None:
        """Stop what this studio has begun: a motion, hand guiding, a take."""
        self._pulled = None
        self._commands.drop()
        with suppress(GdmpError):
            self._commands.ask(self._finish, CLOSING_S)
        self._closing = True
        self._running.end()
        self._client.close()

    def _check_open(self) -> None:
        """:raises GdmpError: if nothing is to be waited for any more"""
        if self._closing:
            raise GdmpError('the connection to the nodes is being closed')

    def view(self) -> RobotView | None:
        robot, state = self._robot, self._state
        now = self._client.now()
        if robot is None or now - self._received['arm'] > SILENT_S:
            return None
        if now - self._received['server'] > SILENT_S:
            state = None
        pose = messages.pose_numbers(robot.pose)
        goal = messages.pose_numbers(state.goal[0]) if state is not None and state.goal else None
        offset = (0.0, 0.0) if goal is None else pose_distance(pose, goal)
        recorder = self._recorder
        recording = recorder is not None and recorder.status == 'recording'
        return RobotView(
            np.asarray(robot.position), pose, goal,
            'no trajectory server' if state is None else state.status,
            ArmMode(robot.mode).name.lower(),
            0.0 if state is None else state.progress, 0.0 if state is None else state.speed,
            (float(offset[0]), float(offset[1])), robot.tank_energy,
            tuple(described(limited(robot))),
            recorder.duration if recorder is not None and recording else None,
            self._problem or problem_of(state), 1.0,
            None if state is None or not state.rhythmic else (state.frequency, state.amplitude),
            None if state is None or not state.sequence else
            (state.step, state.steps, state.step_name), self._width)

    # Skills

    def use(self, skill: Skill, name: str) -> None:
        self._skill = skill, name

    def start(self) -> None:
        self._problem = ''
        self._commands.put(self._start)

    def stop(self) -> None:
        self._pulled = None
        self._commands.drop()
        self._commands.put(self._stop)

    def pause(self, paused: bool) -> None:
        self._commands.put(partial(self._request, f'{self._server}/pause', data=paused))

    def set_tempo(self, tempo: float) -> None:
        self._tempo = tempo
        self._commands.put(partial(self._request, f'{self._server}/set_speed', scale=tempo))

    def set_amplitude(self, amplitude: float) -> None:
        self._commands.put(partial(self._client.amplitude, amplitude))

    def start_sequence(self, sequence: SkillSequence, first: int) -> None:
        self._problem = ''
        self._commands.put(partial(self._start_sequence, sequence.name, first))

    def signal(self, name: str) -> None:
        self._commands.put(partial(self._client.signal, name))

    def switch_goal(self, pose: np.ndarray) -> None:
        self._commands.put(partial(self._switch, pose.copy()))

    def move_object(self, name: str, pose: np.ndarray) -> None:
        pass  # it is where /tf has it

    # The arm

    def surround(self, scene: Scene) -> None:
        self._commands.put(lambda: self._surround(scene.copy()))

    def guide(self, guided: bool) -> None:
        self._pulled = None
        self._commands.put(partial(self._guide, guided))

    def pull(self, pose: np.ndarray | None) -> None:
        self._pulled = None if pose is None else pose.copy()

    def followed(self) -> FollowedMotion:
        reply = self._commands.ask(lambda: self._call(
            f'{self._server}/refine_skill', action=RefineSkill.Request.PROPOSE), ANSWER_S)
        return followed_motion(reply)

    def home(self) -> None:
        self._problem = ''
        self._commands.put(self._go_home)

    def grip(self, command: GripperCommand) -> None:
        if self._width is None:
            raise ParameterError('the arm has no gripper')
        stamp = messages.stamp_of(self._client.clock.wall())
        self._gripper_out.publish(command_message(command, stamp))  # the recorder listens too

    def record(self, folder: Path) -> None:
        if self._recorder is None:
            raise ParameterError(f'no {RECORDER} runs: ros2 run gdmp_ros {RECORDER}')
        if self._recorder.status == 'waiting':
            raise ParameterError(f'{RECORDER} waits for the pose of the arm: see its parameter '
                                 'pose_topic')
        self._commands.ask(lambda: self._request(f'{RECORDER}/start'), ANSWER_S)
        self._records = True

    def keep(self) -> Path:
        recorder = self._recording()
        self._commands.ask(lambda: self._request(f'{RECORDER}/stop'), ANSWER_S)
        self._records = False
        return Path(recorder.folder) / str(recorder.take)

    def discard(self) -> None:
        self._recording()  # otherwise the recorder would put the last take aside
        self._records = False
        self._commands.put(partial(self._request, f'{RECORDER}/discard'))

    def _recording(self) -> RecorderState:
        recorder = self._recorder
        if recorder is None or recorder.status != 'recording':
            raise ParameterError('no take is being recorded')
        return recorder

    # The loop

    def _work(self) -> Loop:
        while True:
            try:
                self._commands.carry_out()
                self._client.spend(PERIOD_S)
                self._read()
            except GdmpError as error:
                self._problem = str(error)
            yield 0

    def _read(self) -> None:
        message, now = self._robots.newest_message(), self._client.now()
        if message is not None:
            silent = now - self._received['arm'] > SILENT_S
            self._robot, self._received['arm'] = message, now
            if silent and self._scene is not None:
                self._surround(self._scene)  # an arm that was started again knows none
        if self._client.state is not self._state:
            self._state, self._received['server'] = self._client.state, now
        if self._pulled is not None:
            # Repeated, because the arm counts a silent hand as released.
            robot = self._robot
            self._hand.publish(messages.stamped_pose(
                self._pulled, '' if robot is None else robot.header.frame_id))
        if self._homing is not None and self._homing.done():
            result, self._homing = self._homing.result(0.0), None
            if not result.success:
                raise GdmpError(f'{self._arm}/move_joints: {result.message}')
        if self._executing and self._client.done():
            self._executing = False
            self._client.check_failure()

    def _start(self) -> None:
        if self._skill is not None:
            skill, name = self._skill
            self._request(f'{self._server}/load_skill', path=name or 'skill',
                          contents=skill.text())
        self._request(f'{self._server}/set_speed', scale=self._tempo)
        self._client.execute(timeout=ANSWER_S)
        self._executing = True

    def _start_sequence(self, path: str, first: int) -> None:
        self._request(f'{self._server}/set_speed', scale=self._tempo)
        self._client.execute_sequence(path, first + 1, ANSWER_S)
        self._executing = True

    def _stop(self) -> None:
        self._executing = False  # that it did not reach its goal is no problem then
        homing, self._homing = self._homing, None
        if homing is not None:
            homing.cancel()
        self._request(f'{self._server}/stop')

    def _go_home(self) -> None:
        self._homing = self._client.send(self._move, MoveJoints.Goal(), AVAILABLE_S)
        self._homing.accepted(ANSWER_S)

    def _guide(self, guided: bool) -> None:
        self._request(f'{self._arm}/teach', data=guided)
        self._guided = guided

    def _finish(self) -> None:
        for begun, work in (
                (self._executing or self._homing is not None, self._stop),
                (self._guided, partial(self._guide, False)),
                (self._records, partial(self._request, f'{RECORDER}/stop'))):
            if begun:
                with suppress(GdmpError):
                    work()

    def _switch(self, pose: np.ndarray) -> None:
        state = self._state
        if state is None:
            raise GdmpError(f'{self._server} is silent')
        self._client.goal_pose(pose, state.header.frame_id)

    def _surround(self, scene: Scene) -> None:
        """Tell the arm; the server has it from there."""
        self._scene = scene
        if self._robot is None:
            return  # it is told when it is there
        message = markers_of(scene, self._robot.header.frame_id, self._robot.header.stamp)
        shown = {marker.text for marker in message.markers}
        message.markers += [Marker(action=Marker.DELETE, text=name)
                            for name in sorted(self._around - shown)]
        self._around = shown
        self._scene_out.publish(message)

    def _ready(self, name: str) -> Any:
        service = self._services[name]
        self._client.wait(f'the service {name}', service.service_is_ready, AVAILABLE_S)
        return service

    def _call(self, name: str, **fields: Any) -> Any:
        service = self._ready(name)
        future = service.call_async(service.srv_type.Request(**fields))
        self._client.wait(f'the reply of {name}', future.done, ANSWER_S)
        return future.result()

    def _request(self, name: str, **fields: Any) -> None:
        reply = self._call(name, **fields)
        if not reply.success:
            raise GdmpError(f'{name}: {reply.message}')

    def _on_gripper(self, message: StateMessage) -> None:
        self._width = message.width

    def _on_recorder(self, message: RecorderState) -> None:
        self._recorder = message
