"""A robot behind running nodes: trajectory server, arm, and take recorder."""
from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from functools import partial
from pathlib import Path
import queue
from tempfile import TemporaryDirectory
import threading
import time
from typing import Any, TypeVar

from gdmp_msgs.msg import RecorderState, RobotState, ServerState
from gdmp_msgs.srv import LoadSkill, SetSpeed
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.joints_client import move_joints
from gdmp_ros.ros.clients.server_client import ServerClient
from gdmp_ros.ros.lifecycle import reliable, SILENT_S
from gdmp_ros.ros.polling import PolledGroup, take_latest
from gdmp_ros.studio.robot import RobotView

#: Interval at which the states are read, and the pose of a hand is sent [s].
PERIOD_S = 0.02
#: Longest time for an answer of the nodes [s].
ANSWER_S = 30.0
RECORDER = 'take_recorder'
T = TypeVar('T')


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
        self._client = ServerClient(server)
        node = self._client.node
        self._robots = node.create_subscription(RobotState, f'{arm}/state', lambda _: None,
                                                reliable(1), callback_group=PolledGroup())
        self._hand = node.create_publisher(PoseStamped, f'{arm}/hand_pose', reliable(1))
        node.create_subscription(RecorderState, f'{RECORDER}/state', self._on_recorder,
                                 reliable(1))
        self._robot: RobotState | None = None
        self._recorder: RecorderState | None = None
        self._received, self._problem = 0.0, ''
        self._skill: tuple[Skill, str] | None = None
        self._pulled: np.ndarray | None = None
        self._executing = False
        self._folder = TemporaryDirectory(prefix='gdmp-studio-')
        self._commands: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name='nodes', daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ends.set()
        self._thread.join(5.0)
        self._client.close()
        self._folder.cleanup()

    def view(self) -> RobotView | None:
        state, robot = self._client.state, self._robot
        if robot is None or time.monotonic() - self._received > SILENT_S:
            return None
        pose = messages.pose_numbers(robot.pose)
        goal = messages.pose_numbers(state.goal[0]) if state is not None and state.goal else None
        away = (0.0, 0.0) if goal is None else pose_distance(pose, goal)
        limited = np.concatenate([robot.limited, robot.limited_more])
        recorder = self._recorder
        recording = recorder is not None and recorder.status == 'recording'
        return RobotView(
            np.asarray(robot.position), pose, goal,
            'no trajectory server' if state is None else state.status,
            ArmMode(robot.mode).name.lower(),
            0.0 if state is None else state.progress, 0.0 if state is None else state.speed,
            (float(away[0]), float(away[1])), robot.tank_energy,
            tuple(f'{limit.name} by {value:.2g} {limit.unit}'
                  for limit, value in zip(LIMITS, limited) if value > 0.0),
            recorder.duration if recorder is not None and recording else None,
            self._problem or _problem_of(state), 1.0)

    # Skills

    def use(self, skill: Skill, name: str) -> None:
        self._skill = skill, name

    def start(self, goal: np.ndarray | None) -> None:
        self._problem = ''
        self._commands.put(self._start)

    def stop(self) -> None:
        self._commands.put(self._stop)

    def pause(self, paused: bool) -> None:
        self._commands.put(partial(self._request, SetBool, f'{self._server}/pause', data=paused))

    def set_tempo(self, tempo: float) -> None:
        self._commands.put(partial(self._request, SetSpeed, f'{self._server}/set_speed',
                                   scale=tempo))

    def switch_goal(self, pose: np.ndarray) -> None:
        self._commands.put(partial(self._switch, pose.copy()))

    # The arm

    def guide(self, guided: bool) -> None:
        self._pulled = None
        self._commands.put(partial(self._request, SetBool, f'{self._arm}/teach', data=guided))

    def pull(self, pose: np.ndarray | None) -> None:
        self._pulled = None if pose is None else pose.copy()

    def home(self) -> None:
        self._commands.put(lambda: move_joints(self._client, self._arm))

    def record(self, folder: Path) -> None:
        if self._recorder is None:
            raise ParameterError(f'no {RECORDER} runs: ros2 run gdmp_ros {RECORDER}')
        self._ask(lambda: self._request(Trigger, f'{RECORDER}/start'))

    def keep(self) -> Path:
        recorder = self._recorder
        if recorder is None or recorder.status != 'recording':
            raise ParameterError('no take is being recorded')
        self._ask(lambda: self._request(Trigger, f'{RECORDER}/stop'))
        return Path(recorder.folder) / str(recorder.take)

    def discard(self) -> None:
        self._commands.put(partial(self._request, Trigger, f'{RECORDER}/discard'))

    # The thread

    def _run(self) -> None:
        while not self._ends.is_set():
            try:
                while not self._commands.empty():
                    self._commands.get()()
                self._client.spend(PERIOD_S)
                self._read()
            except GdmpError as error:
                self._problem = str(error)

    def _read(self) -> None:
        message = take_latest(self._robots)
        if message is not None:
            self._robot, self._received = message, time.monotonic()
        if self._pulled is not None:
            # Repeated, because the arm counts a silent hand as released.
            self._hand.publish(self._stamped(self._pulled))
        if self._executing and self._client.done():
            self._executing = False
            self._client.check_failure()

    def _start(self) -> None:
        if self._skill is not None:
            skill, name = self._skill
            path = Path(self._folder.name) / f'{name or "skill"}.json'
            skill.save(path)
            self._request(LoadSkill, f'{self._server}/load_skill', path=str(path))
        self._client.execute()
        self._executing = True

    def _stop(self) -> None:
        self._executing = False  # that it did not reach its goal is no problem then
        self._request(Trigger, f'{self._server}/stop')

    def _switch(self, pose: np.ndarray) -> None:
        state = self._client.state
        if state is None:
            raise GdmpError(f'{self._server} is silent')
        self._client.goal_pose(pose, state.header.frame_id)

    def _stamped(self, pose: np.ndarray) -> PoseStamped:
        message, robot = PoseStamped(), self._robot
        if robot is not None:
            message.header.frame_id = robot.header.frame_id
        messages.set_pose(message.pose, pose)
        return message

    def _request(self, kind: Any, name: str, **fields: Any) -> None:
        reply = self._client.call(kind, name, **fields)
        if not reply.success:
            raise GdmpError(f'{name}: {reply.message}')

    def _on_recorder(self, message: RecorderState) -> None:
        self._recorder = message

    def _ask(self, work: Callable[[], T]) -> T:
        """Let the thread do something, and wait for its result."""
        future: Future[T] = Future()

        def carry_out() -> None:
            try:
                future.set_result(work())
            except GdmpError as error:
                future.set_exception(error)
        self._commands.put(carry_out)
        try:
            return future.result(ANSWER_S)
        except FutureTimeoutError:
            raise GdmpError(f'waited {ANSWER_S:g} s for the nodes, without success') from None


def _problem_of(state: ServerState | None) -> str:
    """What the server says of a motion that does not go on."""
    flags = [] if state is None else [flag for flag in state.flags if flag in (
        'no_robot', 'blocked', 'lagging', 'not_settled', 'held')]
    return ', '.join(flags)
