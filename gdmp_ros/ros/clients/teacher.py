"""Somebody who leads the arm by hand and records takes: along a shown motion, or by your hand."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable
import time
from typing import Any

from gdmp_msgs.msg import RecorderState
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.dmp import Demonstration
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds import UnitQuaternion
from gdmp_ros.ros import messages as wire
from gdmp_ros.ros.clients.client import Client
from gdmp_ros.ros.lifecycle import reliable

SIM, RECORDER = 'panda_sim', 'take_recorder'
#: A hand says where it is so often [s].
HAND_PERIOD_S = 0.005
#: Speed at which a hand brings the tool to where a motion begins [m/s, rad/s].
APPROACH_SPEED, APPROACH_TURN = 0.15, 0.8
#: A hand rests before and after a motion [s]; the arm settles in its grip first.
REST_S, SETTLE_S = 0.4, 1.0


class Teacher(Client):
    """Leads the arm of ``panda_sim`` and operates ``take_recorder``."""

    def __init__(self, frame: str, check: Callable[[], None] | None = None):
        """:param frame: of the poses"""
        super().__init__('teacher', check)
        self.frame = frame
        self.pose: np.ndarray | None = None
        self._heard: deque[RecorderState] = deque(maxlen=2)
        self._hand = self.node.create_publisher(PoseStamped, f'{SIM}/hand_pose', reliable(1))
        self.node.create_subscription(PoseStamped, f'{SIM}/measured_pose', self._on_pose,
                                      reliable(1))
        self.node.create_subscription(RecorderState, f'{RECORDER}/state', self._on_recorder,
                                      reliable(10))

    def _on_pose(self, message: PoseStamped) -> None:
        self.pose = wire.pose_numbers(message.pose)

    def _on_recorder(self, message: RecorderState) -> None:
        self._heard.append(message)

    def ready(self, timeout: float = 120.0) -> None:
        """Make the arm weightless, and wait until the recorder can begin."""
        self.wait('the arm', lambda: self.pose is not None, timeout)
        self.asked(SetBool, f'{SIM}/teach', data=True)
        self.wait('the recorder', lambda: bool(self._heard) and self._heard[-1].status == 'ready',
                  timeout)
        self.wait('the arm to feel a hand', lambda: self._hand.get_subscription_count() > 0, 30.0)

    def asked(self, kind: Any, name: str, **fields: Any) -> str:
        """
        Call a service that succeeds or says why not.

        :returns: what it says
        :raises GdmpError: with its reason
        """
        reply = self.call(kind, name, **fields)
        if not reply.success:
            raise GdmpError(f'{name}: {reply.message}')
        return str(reply.message)

    def recording(self) -> bool:
        """Whether a take is being recorded, as the recorder says it now."""
        self._heard.clear()
        # The first may have been on its way before what was asked for last.
        self.wait('the recorder', lambda: len(self._heard) == 2, 10.0)
        return self._heard[-1].status == 'recording'

    def record(self) -> str:
        """Begin a take."""
        return self.asked(Trigger, f'{RECORDER}/start')

    def keep(self) -> str:
        """End the take and keep it."""
        return self.asked(Trigger, f'{RECORDER}/stop')

    def discard(self) -> str:
        """Drop the take that is being recorded, or put the last one aside."""
        return self.asked(Trigger, f'{RECORDER}/discard')

    def take(self, shown: Demonstration) -> str:
        """Lead the tool along a motion and record it; what the recorder says."""
        begin, end = shown.points[0][:7], shown.points[-1][:7]
        self.lead_to(begin)
        self.hold(begin, SETTLE_S)
        self.record()
        self.hold(begin, REST_S)
        self._lead(lambda t: shown.at(np.array([min(t, shown.duration)]))[0][:7], shown.duration)
        self.hold(end, REST_S)
        return self.keep()

    def lead_to(self, pose: np.ndarray) -> None:
        """Bring the tool to a pose (x, y, z, qw, qx, qy, qz), slowly and straight."""
        if self.pose is None:
            raise GdmpError('the arm has not said where it is')
        begin, manifold = self.pose.copy(), UnitQuaternion()
        target = manifold.align(pose[3:], begin[3:])
        duration = max(float(np.linalg.norm(pose[:3] - begin[:3])) / APPROACH_SPEED,
                       2.0 * manifold.distance(begin[3:], target) / APPROACH_TURN, 0.1)

        def at(t: float) -> np.ndarray:
            s = min(t / duration, 1.0)
            s = s * s * (3.0 - 2.0 * s)
            return np.concatenate([(1.0 - s) * begin[:3] + s * pose[:3],
                                   manifold.geodesic(begin[3:], target, s)])
        self._lead(at, duration)

    def hold(self, pose: np.ndarray, seconds: float) -> None:
        """Keep the hand where it is for a while."""
        self._lead(lambda _: pose, seconds)

    def _lead(self, at: Callable[[float], np.ndarray], seconds: float) -> None:
        """Move the hand along ``at(t)`` in step with wall time."""
        message = PoseStamped()
        message.header.frame_id = self.frame
        begun = time.monotonic()
        due = begun
        while due - begun <= seconds:
            wire.set_pose(message.pose, at(due - begun))
            self._hand.publish(message)
            due = max(due + HAND_PERIOD_S, time.monotonic())
            self.spend(due - time.monotonic())
