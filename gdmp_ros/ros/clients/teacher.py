"""Guides the simulated arm by hand along a motion, and operates the take recorder."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

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
from gdmp_ros.ros.clients.client import Client
from gdmp_ros.ros.gripper import COMMAND, command_message
from gdmp_ros.util.profiles import smoothstep

SIM, RECORDER = 'panda_sim', 'take_recorder'
#: Period of the hand poses [s].
HAND_PERIOD_S = 0.005
#: Speed at which the hand moves the tool to the start of a motion [m/s, rad/s].
APPROACH_SPEED, APPROACH_ANGULAR_SPEED = 0.15, 0.8
#: Rest of the hand before and after a motion, and before that for the arm to settle [s].
REST_S, SETTLE_S = 0.4, 1.0


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
        self.wait('the arm to subscribe to the hand',
                  lambda: self._hand.subscribers() > 0, 30.0)

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
            raise GdmpError('the arm has no gripper: gdmp teach --gripper')
        message = command_message(command)
        message.header.stamp = messages.stamp_of(self.clock.wall())
        self._gripper.publish(message)
        return 'the gripper closes' if command.force else 'the gripper opens'

    def take(self, shown: Demonstration,
             commands: Sequence[tuple[float, GripperCommand]] = ()) -> str:
        """
        Guide the tool along a motion and record it; returns the message of the recorder.

        :param commands: for the gripper, with the time of the motion at which each is given [s]
        """
        begin, end = shown.points[0][:7], shown.points[-1][:7]
        self.move_to(begin)
        self.hold(begin, SETTLE_S)
        self.record()
        self.hold(begin, REST_S)
        waiting = list(commands)

        def at(t: float) -> np.ndarray:
            while waiting and t >= waiting[0][0]:
                self.command_gripper(waiting.pop(0)[1])
            return np.asarray(shown.at(np.array([min(t, shown.duration)]))[0][:7])
        self._guide(at, shown.duration)
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
        message = PoseStamped()
        message.header.frame_id = self.frame
        begun = self.now()
        due = begun
        while due - begun <= seconds:
            messages.set_pose(message.pose, at(due - begun))
            self._hand.publish(message)
            due = max(due + HAND_PERIOD_S, self.now())
            self.spend(due - self.now())
