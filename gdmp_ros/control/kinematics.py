"""Kinematics of a chain of revolute joints."""
from __future__ import annotations

import math

from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.manifolds.quaternion import multiply, rotate


@kernel
def add_lever(jacobian, lever):
    """
    Change a Jacobian to that of a point which is ``lever`` away, in the base frame.

    :param jacobian: linear over angular, shape ``(6, n)``; changed
    :param lever: [m], shape ``(3,)``
    """
    for i in range(jacobian.shape[1]):
        x, y, z = jacobian[3, i], jacobian[4, i], jacobian[5, i]
        jacobian[0, i] += y * lever[2] - z * lever[1]
        jacobian[1, i] += z * lever[0] - x * lever[2]
        jacobian[2, i] += x * lever[1] - y * lever[0]


@kernel
def constant_velocity_acceleration(jacobian, velocity, acceleration):
    """
    Write J̇ q̇: the acceleration of the tool at constant joint velocities.

    Joint k turns everything beyond it: the derivative of column i of the linear part is
    ``z_k × j_i`` for k ≤ i, and ``z_i × j_k`` otherwise; that of axis i is ``z_k × z_i`` for
    k < i, and 0 otherwise.

    :param jacobian: linear over angular, shape ``(6, n)``
    :param velocity: of the joints [rad/s]
    :param acceleration: written [m/s², rad/s²], shape ``(6,)``
    """
    acceleration[:] = 0.0
    n = velocity.size
    for k in range(n):
        x, y, z = jacobian[3, k], jacobian[4, k], jacobian[5, k]
        for i in range(k, n):
            # The pairs (k, i) and (i, k) give the same linear part.
            rate = velocity[k] * velocity[i] * (1.0 if i == k else 2.0)
            acceleration[0] += rate * (y * jacobian[2, i] - z * jacobian[1, i])
            acceleration[1] += rate * (z * jacobian[0, i] - x * jacobian[2, i])
            acceleration[2] += rate * (x * jacobian[1, i] - y * jacobian[0, i])
            if i > k:
                rate = velocity[k] * velocity[i]
                acceleration[3] += rate * (y * jacobian[5, i] - z * jacobian[4, i])
                acceleration[4] += rate * (z * jacobian[3, i] - x * jacobian[5, i])
                acceleration[5] += rate * (x * jacobian[4, i] - y * jacobian[3, i])


@kernel
def chain_pose(frames, axes, position, end, pose):
    """
    Write the pose of the end of a chain of revolute joints.

    :param frames: pose of each joint in the frame of the last one, at zero, shape ``(n, 7)``
    :param axes: of the joints in their frames, shape ``(n, 3)``
    :param position: of the joints [rad]
    :param end: pose in the frame of the last joint
    :param pose: written
    """
    step, moved, turn = local_numbers(4), local_numbers(3), pose[3:]
    for i in range(7):
        pose[i] = 1.0 if i == 3 else 0.0
    for k in range(position.size + 1):
        frame = frames[k] if k < position.size else end
        rotate(turn, frame[:3], moved)
        for i in range(3):
            pose[i] += moved[i]
        multiply(turn, frame[3:], turn)
        if k == position.size:
            break
        half = 0.5 * position[k]
        step[0] = math.cos(half)
        for i in range(3):
            step[1 + i] = math.sin(half) * axes[k, i]
        multiply(turn, step, turn)
