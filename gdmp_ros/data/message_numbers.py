"""Numbers of messages, as rclpy or as rosbags reads them."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
    WRENCH,
    WRENCH_GAIN,
)
from gdmp_ros.errors import DataError


def pose_numbers(pose: Any) -> list[float]:
    """(x, y, z, qw, qx, qy, qz) of a pose."""
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]


def vector_numbers(first: Any, second: Any) -> list[float]:
    """Six numbers of two vectors, as of a twist or a wrench."""
    return [first.x, first.y, first.z, second.x, second.y, second.z]


def reference_target(message: Any) -> np.ndarray:
    """The numbers of a reference as a target (`gdmp_ros.control.target`)."""
    target = np.zeros(TARGET_SIZE)
    target[POSE:TWIST] = pose_numbers(message.pose)
    target[TWIST:ACCELERATION] = vector_numbers(message.twist.linear, message.twist.angular)
    target[ACCELERATION:STIFFNESS] = vector_numbers(message.acceleration.linear,
                                                    message.acceleration.angular)
    target[STIFFNESS:DAMPING_RATIO] = message.stiffness
    target[DAMPING_RATIO] = message.damping_ratio
    if hasattr(message, 'wrench'):  # older recordings have none
        target[WRENCH:WRENCH_GAIN] = vector_numbers(message.wrench.force, message.wrench.torque)
        target[WRENCH_GAIN:] = message.wrench_gain
    return target


def joint_target(message: Any) -> np.ndarray:
    """The numbers of a reference of the joints (`gdmp_ros.control.joint_target`)."""
    joints = message.joints[0]
    return np.concatenate([joints.position, joints.velocity, joints.stiffness,
                           [message.damping_ratio]])


def joint_positions(message: Any, names: Sequence[str] = ()) -> np.ndarray:
    """
    Positions of a JointState [rad].

    :param names: of the joints that are wanted, in their order; by default all as they come
    :raises DataError: if one is missing, or a number is not finite
    """
    found = dict(zip(message.name, message.position))
    missing = [name for name in names if name not in found]
    if missing:
        raise DataError(f'joint {missing[0]!r} is missing; there are '
                        f'{", ".join(message.name) or "none"}')
    position = np.array([found[name] for name in names] if names else message.position, float)
    if not np.isfinite(position).all():
        raise DataError('a position of a joint is NaN or infinite')
    return position
