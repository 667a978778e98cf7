"""A teaching session: an arm and a take recorder as processes, a hand that guides the arm."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack, suppress
from dataclasses import dataclass, field
import os
from pathlib import Path
import tempfile

from gdmp_msgs.msg import ArmStatus, RecorderState
from gdmp_msgs.msg import GripperCommand as CommandMessage
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import GdmpError
from gdmp_ros.franka.protocol_server import move_hand
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.ros import messages
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.server_client import Client, START_UP_S
from gdmp_ros.ros.clients.testbed import ARM, MODULES, start_arm, TAKE_RECORDER
from gdmp_ros.ros.gripper import COMMAND, command_message
from gdmp_ros.util.dds_network import default_environment, Domain
from gdmp_ros.util.processes import ChildProcesses, interrupt_on_sigterm
from gdmp_ros.util.profiles import smoothstep
from gdmp_ros.util.terminal import Keys, progress

#: Period of the hand poses [s].
HAND_PERIOD_S = 0.005
#: Speed at which the hand moves the tool to the start of a motion [m/s, rad/s].
APPROACH_SPEED, APPROACH_ANGULAR_SPEED = 0.15, 0.8
#: Rest of the hand before and after a motion, and before that for the arm to settle [s].
REST_S, SETTLE_S = 0.4, 1.0
#: Keys of a person who teaches, and what they do.
KEYS = {
    'Enter': 'start a take; stop and keep it (the space bar, too)',
    'p': 'pause the take; go on with it, near the same pose',
    'd': 'discard the take that is being recorded, or else the last one',
    'f': 'free the arm: it can be guided by hand; hold it',
    'h': 'move the joints to the home posture',
    'o': 'open the gripper',
    'c': 'close the gripper, and hold with 20 N',
    'r': 'recover the arm from a fault; it holds',
    'q': 'end the session: a take that is being recorded is kept, the arm holds'}
#: Commands of these keys: width [m] and force [N].
GRIPPER = {'o': GripperCommand(0.08), 'c': GripperCommand(0.0, 20.0)}


class Teacher(Client):
    """
    Guides an arm and operates a take recorder.

    :ivar pose: newest pose of the tool, None before the first
    :ivar arm_state: newest state of the arm, as `ArmStatus` names it
    :ivar arm_reason: reason of a stop or a fault of the arm; empty if there is none
    """

    def __init__(self, frame: str, check: Callable[[], None] | None = None, arm: str = ARM,
                 recorder: str = TAKE_RECORDER,
                 hand: Callable[[np.ndarray], None] | None = None):
        """
        Take part.

        :param frame: of the poses
        :param arm: name of its node, with its namespace
        :param recorder: name of its node
        :param hand: moves the hand of a simulated robot; by default the topic ``hand_pose`` of
            the arm does
        """
        super().__init__('teacher', check)
        self.frame, self._arm, self._recorder = frame, arm, recorder
        self.pose: np.ndarray | None = None
        self.arm_state = self.arm_reason = self._told = ''
        self._states: deque[RecorderState] = deque(maxlen=2)
        self._topic = self.publisher(PoseStamped, f'{arm}/hand_pose', 1)
        self._hand = hand or self._publish_hand
        if hand is not None:
            self.subscribe(PoseStamped, f'{arm}/hand_pose',
                           lambda message: hand(messages.pose_numbers(message.pose)), 1)
        self._gripper = self.publisher(CommandMessage, arm.rpartition('/')[0] + f'/{COMMAND}')
        self.subscribe(PoseStamped, f'{arm}/measured_pose', self._on_pose, 1)
        self.subscribe(ArmStatus, f'{arm}/status', self._on_arm, 1)
        self.subscribe(RecorderState, f'{recorder}/state', self._on_recorder)

    def _on_pose(self, message: PoseStamped) -> None:
        self.pose = messages.pose_numbers(message.pose)

    def _on_arm(self, message: ArmStatus) -> None:
        self.arm_state, self.arm_reason = message.state, message.reason

    def _on_recorder(self, message: RecorderState) -> None:
        self._states.append(message)

    def await_nodes(self, timeout: float = START_UP_S) -> None:
        """Wait until arm and recorder are ready."""
        self.wait(f'the pose of {self._arm}', lambda: self.pose is not None, timeout)
        self.wait('the recorder',
                  lambda: bool(self._states) and self._states[-1].status == 'ready',
                  timeout)

    def ready(self) -> None:
        """Wait for arm and recorder, and start hand guiding by `take` and `move_to`."""
        self.await_nodes()
        self.free(True)
        self.wait('the arm to subscribe to the hand', lambda: self._topic.subscribers() > 0, 30.0)

    def free(self, is_free: bool) -> str:
        """
        Let the arm be guided by hand, or hold it.

        :raises GdmpError: if the arm refuses
        """
        return self.request(SetBool, f'{self._arm}/teach', data=is_free)

    def move_home(self) -> str:
        """Move the joints to the home posture; hand guiding ends."""
        if self.arm_state == 'guided':
            self.free(False)
        move_joints(self, self._arm)
        return 'the arm is in its home posture, and holds'

    def recover(self) -> str:
        """Recover the arm from a fault."""
        return self.request(Trigger, f'{self._arm}/recover')

    def news(self) -> str:
        """State and reason of a stop or a fault of the arm, told once; empty without news."""
        before, self._told = self._told, self.arm_reason
        is_new = self.arm_reason not in ('', before)
        return f'{self.arm_state}: {self.arm_reason}' if is_new else ''

    def recorder_status(self) -> str:
        """What the recorder does now."""
        self._states.clear()
        # The first one may have been sent before the last request.
        self.wait('the recorder', lambda: len(self._states) == 2, 10.0)
        return str(self._states[-1].status)

    def record(self) -> str:
        """Start a take."""
        return self.request(Trigger, f'{self._recorder}/start')

    def pause(self, is_paused: bool) -> str:
        """Pause the take, or go on with it."""
        return self.request(SetBool, f'{self._recorder}/pause', data=is_paused)

    def keep(self) -> str:
        """Stop the take and keep it."""
        return self.request(Trigger, f'{self._recorder}/stop')

    def discard(self) -> str:
        """Discard the take that is being recorded, or else the last one."""
        return self.request(Trigger, f'{self._recorder}/discard')

    def command_gripper(self, command: GripperCommand) -> str:
        """
        Let the gripper begin a command; the recorder records it.

        :raises GdmpError: if there is no gripper
        """
        # The recorder listens too.
        if self._gripper.subscribers() < 2:
            raise GdmpError('the arm has no gripper: gdmp record --gripper')
        self._gripper.publish(command_message(command, messages.stamp_of(self.clock.wall())))
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

    def _publish_hand(self, pose: np.ndarray) -> None:
        self._topic.publish(messages.stamped_pose(pose, self.frame))

    def _guide(self, at: Callable[[float], np.ndarray], seconds: float) -> None:
        """Move the hand along ``at(t)`` in steady time."""
        begun = self.now()
        due = begun
        while due - begun <= seconds:
            self._hand(at(due - begun))
            due = max(due + HAND_PERIOD_S, self.now())
            self.spend(due - self.now())


@dataclass(frozen=True)
class TeachingSettings:
    """
    Where and how takes are recorded.

    :ivar folder: for the takes
    :ivar frame: ``frame_id`` of the poses
    :ivar arm: that is started
    :ivar node: name of an arm that runs already, with its namespace; empty: ``arm`` is started
    :ivar window: whether the simulation has a window
    :ivar gripper: whether the arm that is started has a gripper
    :ivar transforms: whether /tf and /tf_static are recorded, too
    :ivar model: of a simulated arm; empty: the built-in one
    """

    folder: Path
    storage: str
    frame: str
    arm: ArmChoice = field(default_factory=ArmChoice)
    node: str = ''
    window: bool = False
    gripper: bool = False
    transforms: bool = False
    model: str = ''


def teach(settings: TeachingSettings, demos: Sequence[Demonstration]) -> None:
    """
    Teach: a scripted hand guides the arm along each motion; without motions a person does.

    :raises GdmpError: if a process ends early or something does not happen in time
    """
    interrupt_on_sigterm()
    # With a person's hand the nodes are in the user's domain, for RViz.
    domain = Domain() if demos else None
    environment = domain.environment() if domain else {**os.environ, **default_environment()}
    os.environ.update(environment)
    try:
        with _session(settings, environment) as teacher:
            if demos:
                if settings.arm.kind != 'sim':
                    teacher.await_nodes()
                    teacher.move_home()
                teacher.ready()
                with progress('teaching', len(demos)) as step:
                    for demo in demos:
                        print(teacher.take(demo), flush=True)
                        step()
            else:
                teacher.await_nodes()
                with Keys() as keys:
                    _by_hand(teacher, keys)
    finally:
        if domain:
            domain.release()
    print(f'compare them: gdmp takes {settings.folder}')
    print(f'learn from them: gdmp learn {settings.folder} -o skill.json')


@contextmanager
def _session(settings: TeachingSettings, environment: dict[str, str]) -> Iterator[Teacher]:
    arm = settings.arm
    # A recorder of another session may run beside an arm that runs.
    node, recorder = settings.node or arm.node, (
        f'{TAKE_RECORDER}_{os.getpid()}' if settings.node else TAKE_RECORDER)
    with ExitStack() as stack:
        logs = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='gdmp-teach-')))
        if not settings.node:
            stack.enter_context(arm.robot(logs, settings.gripper, hand=True))
        children = stack.enter_context(ChildProcesses(environment, logs))
        if settings.node:
            print(f'starting a recorder for {node}', flush=True)
        else:
            print('starting the arm and the recorder', flush=True)
            start_arm(children, arm, settings.gripper, {
                'frame_id': settings.frame,
                **({'model': settings.model} if settings.model else {})}, settings.window)
        namespace = node.rpartition('/')[0].strip('/')
        children.start_node(recorder, MODULES[TAKE_RECORDER], {
            'folder': str(settings.folder.absolute()), 'storage': settings.storage,
            'pose_topic': f'/{node.strip("/")}/measured_pose',
            'transforms': settings.transforms},
            ['-r', f'__node:={recorder}', '-r', f'__ns:=/{namespace}'])
        teacher = Teacher(settings.frame, children.check, f'/{node.strip("/")}',
                          '/'.join(['', *filter(None, [namespace]), recorder]),
                          move_hand if arm.protocol_server else None)
        stack.callback(teacher.close)
        yield teacher


def _by_hand(teacher: Teacher, keys: Keys) -> None:
    """Let a person record takes with keys; the arm holds at the end."""
    print('\n'.join(f'  {key:6} {text}' for key, text in KEYS.items()), flush=True)
    key: str | None = ''
    try:
        while key not in ('q', None):
            key = _key(teacher, keys)
            try:
                print(press(teacher, key), flush=True)
            except GdmpError as error:
                print(error, flush=True)
    finally:
        if teacher.arm_state == 'guided':
            with suppress(GdmpError):  # it may have ended
                teacher.free(False)


def press(teacher: Teacher, key: str | None) -> str:
    """
    Do what a key of `KEYS` says, None as ``q``; returns the answer.

    :raises GdmpError: if arm or recorder refuse
    """
    # Asked each time, because a take can also end without the user.
    status = teacher.recorder_status()
    is_recording = status in ('recording', 'paused')
    if key in ('q', None):
        return teacher.keep() if is_recording else 'done'
    if key in ('', ' '):
        return teacher.keep() if is_recording else teacher.record()
    if key == 'h' and is_recording:
        raise GdmpError('a take is being recorded: stop it first')
    if key in GRIPPER:
        return teacher.command_gripper(GRIPPER[key])
    actions: dict[str, Callable[[], str]] = {
        'p': lambda: teacher.pause(status != 'paused'), 'd': teacher.discard,
        'f': lambda: teacher.free(teacher.arm_state != 'guided'), 'h': teacher.move_home,
        'r': teacher.recover}
    if key not in actions:
        return '; '.join(f'{name}: {text}' for name, text in KEYS.items())
    return actions[key]()


def _key(teacher: Teacher, keys: Keys) -> str | None:
    """Next key, while messages are received; what happens to the arm is said."""
    def pressed() -> bool:
        news = teacher.news()
        if news:
            print(f'the arm: {news}', flush=True)
        return keys.pressed()
    teacher.wait('a key', pressed, 86400.0, silent=True)
    return keys.read()
