"""Publishes references on three topics, and those of a second arm."""
from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import secrets
from typing import Any

from gdmp_msgs.msg import Reference
import numpy as np
from std_msgs.msg import Header

from gdmp_ros.control.joint_target import joint_target_size
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.target import POSE, STIFFNESS, target_in_frame, TARGET_SIZE
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import IDENTITY
from gdmp_ros.ros.frames import BaseFrame, FrameError
from gdmp_ros.ros.lifecycle import (
    CHECK_EVERY,
    check_subscribers,
    ManagedNode,
    pose_stream,
    stiffness_stream,
    Stream,
)
from gdmp_ros.ros.messages import fill_joint_reference, fill_reference
from gdmp_ros.ros.middleware import DEEP
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.ros.server.inputs import RobotInputs

#: Prefix of the topics of the second arm.
SECOND = '~/second'


def first_sequence() -> int:
    """
    Number before the first of a stream of references.

    It is random, so that a subscriber can distinguish two publishers, and below 2^52: tools that
    use double precision count correctly.
    """
    return secrets.randbelow(1 << 52)


class ReferencePublisher:
    """
    Publishes ``~/reference``, ``~/reference_pose`` and ``~/reference_stiffness``.

    :ivar streams: those of the tool: reference, pose and stiffness
    :ivar sequence: number of the last reference
    """

    def __init__(self, node: ManagedNode, frame: str, prefix: str = '~'):
        """
        Publish; nothing before `publish`.

        :param frame: ``frame_id`` of the references
        :param prefix: of the topics
        """
        self._out = node.add_publisher(Reference, f'{prefix}/reference', DEEP)
        self._frame = frame
        self._whole = self._stream(TARGET_SIZE, fill_reference)
        #: Streams of references of the joints, by their number.
        self._joints: dict[int, Stream] = {}
        self._pose = pose_stream(node, f'{prefix}/reference_pose', frame)
        self._stiffness = stiffness_stream(node, f'{prefix}/reference_stiffness')
        self.streams = self._whole, self._pose, self._stiffness
        self.sequence = first_sequence()
        self._ticks = 0
        self._last: tuple[np.ndarray, int, int] | None = None

    def _stream(self, count: int, fill: Callable[[Reference, np.ndarray], None]) -> Stream:
        reference = Reference()
        reference.header.frame_id = self._frame
        return Stream(self._out, SerializedTemplate(reference, count, fill))

    def publish(self, target: np.ndarray, stamp_ns: int,
                mode: StreamMode = StreamMode.STREAMING, joints: int = 0) -> None:
        """
        Publish the reference of a tick.

        :param target: `TARGET_SIZE` numbers, more are not used; or those of
            `gdmp_ros.playback.joint_skill`
        :param joints: number of joints, if it is one of the joints
        """
        if self._ticks % CHECK_EVERY == 0:
            check_subscribers(*self.streams)
        self._ticks += 1
        self._last = target, stamp_ns, joints
        self.sequence += 1
        if joints:
            self._publish_joints(target, stamp_ns, mode, joints)
            return
        if self._whole.has_subscribers:
            self._whole.publish(target[:TARGET_SIZE], stamp_ns, self.sequence, mode)
        if mode is StreamMode.ENDED:
            return
        if self._pose.has_subscribers:
            self._pose.publish(target[POSE:POSE + 7], stamp_ns)
        if self._stiffness.has_subscribers:
            self._stiffness.publish(target[STIFFNESS:STIFFNESS + 36])

    def catch_up(self, target: np.ndarray, count: int, stamp_ns: int) -> None:
        """
        Know what a kernel has sent; it counts on with `sequence`.

        :param target: the last one
        """
        self.sequence += count
        self._last = target, stamp_ns, 0

    def end(self) -> None:
        """Publish that the stream ends here."""
        if self._last is not None:
            target, stamp_ns, joints = self._last
            self.publish(target, stamp_ns, StreamMode.ENDED, joints)
            self._last = None

    def _publish_joints(self, target: np.ndarray, stamp_ns: int, mode: StreamMode, joints: int
                        ) -> None:
        if not self._whole.has_subscribers:
            return
        size = joint_target_size(joints)
        if joints not in self._joints:
            self._joints[joints] = self._stream(size, fill_joint_reference)
        self._joints[joints].publish(target[:size], stamp_ns, self.sequence, mode)


class SecondArm:
    """
    Topics of the second arm; its references are in the frame of its own base.

    That frame must not move in the frame of the first arm: it is looked up once.

    :ivar pose: measured pose of its tool in the frame of the first arm
    """

    def __init__(self, node: ManagedNode, parameters: Any, base: BaseFrame, inputs: RobotInputs):
        """
        Subscribe and publish.

        :param base: frame of the first arm
        :param inputs: read the measured pose
        """
        self._frame, self._common = parameters.second_frame_id, base
        self.pose = inputs.pose_of(node, parameters.second_measured_pose_topic)
        self._references = ReferencePublisher(node, self._frame, SECOND)
        self._base = IDENTITY if self._frame == base.name else None
        self._target = np.empty(TARGET_SIZE)
        # Loads the kernel: in a tick that would take too long.
        target_in_frame(np.zeros(TARGET_SIZE), IDENTITY, self._target)
        node.add_report(self._find)

    def base(self) -> np.ndarray:
        """
        Pose of its base in the frame of the first arm.

        :raises ParameterError: as long as that is not known
        """
        if self._base is None:
            raise ParameterError(f'where {self._frame!r} is in {self._common.name!r} is not known '
                                 'from /tf yet')
        return self._base

    def _find(self) -> None:
        if self._base is None:
            # A start is refused with the reason until it is known.
            with suppress(FrameError):
                self._base = self._common.place_of(Header(frame_id=self._frame))

    def publish(self, target: np.ndarray, stamp_ns: int, mode: StreamMode) -> None:
        """
        Publish its reference of a tick.

        :param target: those of both arms
        """
        if self._base is not None:
            target_in_frame(target[TARGET_SIZE:], self._base, self._target)
            self._references.publish(self._target, stamp_ns, mode)

    def end(self) -> None:
        """Publish that its stream ends here, if there is one."""
        self._references.end()
