"""The second arm of a skill of two arms: where it is, and its references."""
from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from std_msgs.msg import Header

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.target import target_in_frame, TARGET_SIZE
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import IDENTITY
from gdmp_ros.ros.frame_tree import FrameError
from gdmp_ros.ros.frames import BaseFrame
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.server.reference_publisher import ReferencePublisher
from gdmp_ros.ros.server.robot_inputs import RobotInputs

#: Prefix of the topics of the second arm.
SECOND = '~/second'


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
