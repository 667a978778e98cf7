"""A teaching session: simulation and take recorder as processes, a hand that guides the arm."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
import select
import sys
import tempfile

from gdmp_msgs.msg import GripperCommand as CommandMessage
from gdmp_msgs.msg import RecorderState
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.server_client import Client
from gdmp_ros.ros.clients.testbed import ARM, MODULES, TAKE_RECORDER
from gdmp_ros.ros.gripper import COMMAND, command_message
from gdmp_ros.util.dds_network import default_environment, Domain
from gdmp_ros.util.processes import ChildProcesses, interrupt_on_sigterm
from gdmp_ros.util.profiles import smoothstep
from gdmp_ros.util.terminal import progress

SIM, RECORDER = 'panda_sim', 'take_recorder'
#: Period of the hand poses [s].
HAND_PERIOD_S = 0.005
#: Speed at which the hand moves the tool to the start of a motion [m/s, rad/s].
APPROACH_SPEED, APPROACH_ANGULAR_SPEED = 0.15, 0.8
#: Rest of the hand before and after a motion, and before that for the arm to settle [s].
REST_S, SETTLE_S = 0.4, 1.0
KEYS = 'Enter: start or stop a take; d Enter: discard it; q Enter: end the session'
GRIPPER_KEYS = 'o Enter: open the gripper; c Enter: close it, and hold with 20 N'
#: Commands of these keys: width [m] and force [N].
GRIPPER = {'o': GripperCommand(0.08), 'c': GripperCommand(0.0, 20.0)}


class Teacher(Client):
    """Guides the arm of ``panda_sim`` and operates ``take_recorder``."""

    def __init__(self, frame: str, check: Callable[[], None] | None = None):
        """:param frame: of the poses"""
        super().__init__('teacher', check)
        self.frame = frame
        self.pose: np.ndarray | None = None
        self._states: deque[RecorderState] = deque(maxlen=2)
        self._hand = self.publisher(PoseStamped, f'{SIM}/hand_pose', 1)
        self._gripper = self.publisher(CommandMessage, COMMAND)
        self.subscribe(PoseStamped, f'{SIM}/measured_pose', self._on_pose, 1)
        self.subscribe(RecorderState, f'{RECORDER}/state', self._on_recorder)

    def _on_pose(self, message: PoseStamped) -> None:
        self.pose = messages.pose_numbers(message.pose)

    def _on_recorder(self, message: RecorderState) -> None:
        self._states.append(message)

    def ready(self, timeout: float = 120.0) -> None:
        """Start hand guiding, and wait until the recorder is ready."""
        self.wait('the arm', lambda: self.pose is not None, timeout)
        self.request(SetBool, f'{SIM}/teach', data=True)
        self.wait('the recorder',
                  lambda: bool(self._states) and self._states[-1].status == 'ready',
                  timeout)
        self.wait('the arm to subscribe to the hand', lambda: self._hand.subscribers() > 0, 30.0)

    def recording(self) -> bool:
        """Whether a take is being recorded now."""
        self._states.clear()
        # The first one may have been sent before the last request.
        self.wait('the recorder', lambda: len(self._states) == 2, 10.0)
        return self._states[-1].status == 'recording'

    def record(self) -> str:
        """Start a take."""
        return self.request(Trigger, f'{RECORDER}/start')

    def keep(self) -> str:
        """Stop the take and keep it."""
        return self.request(Trigger, f'{RECORDER}/stop')

    def discard(self) -> str:
        """Discard the take that is being recorded, or else the last one."""
        return self.request(Trigger, f'{RECORDER}/discard')

    def command_gripper(self, command: GripperCommand) -> str:
        """
        Let the gripper begin a command; the recorder records it.

        :raises GdmpError: if there is no gripper
        """
        # The recorder listens too.
        if self._gripper.subscribers() < 2:
            raise GdmpError('the arm has no gripper: gdmp record --gripper')
        message = command_message(command)
        message.header.stamp = messages.stamp_of(self.clock.wall())
        self._gripper.publish(message)
        return 'the gripper closes' if command.force else 'the gripper opens'

    def take(self, demo: Demonstration,
             commands: Sequence[tuple[float, GripperCommand]] = ()) -> str:
        """
        Guide the tool along a motion and record it; returns the message of the recorder.

        :param commands: for the gripper, with the time of the motion at which each is given [s]
        """
        begin, end = demo.points[0][:7], demo.points[-1][:7]
        self.move_to(begin)
        self.hold(begin, SETTLE_S)
        self.record()
        self.hold(begin, REST_S)
        waiting = list(commands)

        def at(t: float) -> np.ndarray:
            while waiting and t >= waiting[0][0]:
                self.command_gripper(waiting.pop(0)[1])
            return np.asarray(demo.at(np.array([min(t, demo.duration)]))[0][:7])
        self._guide(at, demo.duration)
        for _, command in waiting:
            self.command_gripper(command)
        self.hold(end, REST_S)
        return self.keep()

    def move_to(self, pose: np.ndarray) -> None:
        """Guide the tool slowly and straight to a pose (x, y, z, qw, qx, qy, qz)."""
        if self.pose is None:
            raise GdmpError('no pose of the arm has been received')
        begin, manifold = self.pose.copy(), UnitQuaternion()
        target = manifold.align(pose[3:], begin[3:])
        duration = max(float(np.linalg.norm(pose[:3] - begin[:3])) / APPROACH_SPEED,
                       2.0 * manifold.distance(begin[3:], target) / APPROACH_ANGULAR_SPEED, 0.1)

        def at(t: float) -> np.ndarray:
            s = smoothstep(min(t / duration, 1.0))
            return np.concatenate([(1.0 - s) * begin[:3] + s * pose[:3],
                                   manifold.geodesic(begin[3:], target, s)])
        self._guide(at, duration)

    def hold(self, pose: np.ndarray, seconds: float) -> None:
        """Keep the hand at a pose for a time."""
        self._guide(lambda _: pose, seconds)

    def _guide(self, at: Callable[[float], np.ndarray], seconds: float) -> None:
        """Move the hand along ``at(t)`` in steady time."""
        begun = self.now()
        due = begun
        while due - begun <= seconds:
            self._hand.publish(messages.stamped_pose(at(due - begun), self.frame))
            due = max(due + HAND_PERIOD_S, self.now())
            self.spend(due - self.now())


@dataclass(frozen=True)
class TeachingSettings:
    """
    Where and how takes are recorded.

    :ivar folder: for the takes
    :ivar frame: ``frame_id`` of the poses
    :ivar window: whether the simulation has a window
    :ivar gripper: whether the arm has a gripper
    """

    folder: Path
    storage: str
    frame: str
    window: bool
    gripper: bool = False


def teach(settings: TeachingSettings, demos: Sequence[Demonstration]) -> None:
    """
    Teach: a scripted hand guides the arm along each motion; without motions the user does.

    :raises GdmpError: if a process ends early or something does not happen in time
    """
    interrupt_on_sigterm()
    # With the user's own hand the nodes are in the user's domain, for RViz.
    domain = Domain() if demos else None
    environment = domain.environment() if domain else {**os.environ, **default_environment()}
    os.environ.update(environment)
    try:
        with _session(settings, environment) as teacher:
            if demos:
                with progress('teaching', len(demos)) as step:
                    for demo in demos:
                        print(teacher.take(demo), flush=True)
                        step()
            else:
                _by_hand(teacher, settings.gripper)
    finally:
        if domain:
            domain.release()
    print(f'compare them: gdmp takes {settings.folder}')
    print(f'learn from them: gdmp learn {settings.folder} -o skill.json')


@contextmanager
def _session(settings: TeachingSettings, environment: dict[str, str]) -> Iterator[Teacher]:
    with tempfile.TemporaryDirectory(prefix='gdmp-teach-') as logs, ChildProcesses(
            environment, Path(logs)) as children:
        print('starting the simulation and the recorder', flush=True)
        children.start_node(ARM, MODULES[ARM], {
            'headless': not settings.window, 'frame_id': settings.frame,
            'gripper': settings.gripper})
        children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
            'folder': str(settings.folder), 'storage': settings.storage})
        teacher = Teacher(settings.frame, check=children.check)
        try:
            teacher.ready()
            yield teacher
        finally:
            teacher.close()


def _by_hand(teacher: Teacher, gripper: bool) -> None:
    """Let the user start, stop and discard takes."""
    print(f'the arm can be guided by hand. {KEYS}'
          + (f'; {GRIPPER_KEYS}' if gripper else ''), flush=True)
    word: str | None = ''
    while word not in ('q', None):
        word = _line(teacher)
        try:
            print(_carry_out(teacher, word), flush=True)
        except GdmpError as error:
            print(error, flush=True)


def _carry_out(teacher: Teacher, word: str | None) -> str:
    """Carry out a line of the user; returns the answer."""
    # Asked each time, because a take can also end without the user.
    recording = teacher.recording()
    if word in ('q', None):
        return teacher.keep() if recording else 'done'
    if word == 'd':
        return teacher.discard()
    if word in GRIPPER:
        return teacher.command_gripper(GRIPPER[word])
    if word == '':
        return teacher.keep() if recording else teacher.record()
    return KEYS


def _line(teacher: Teacher) -> str | None:
    """Next line from the terminal, while messages are received; None at the end of input."""
    teacher.wait('a key', lambda: bool(select.select([sys.stdin], [], [], 0.0)[0]), 86400.0,
                 silent=True)
    line = sys.stdin.readline()
    return line.strip() if line else None
