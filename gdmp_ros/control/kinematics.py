"""Kinematics of a chain of revolute joints."""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.kernels import kernel, local_matrix, local_numbers, noinline
from gdmp_ros.manifolds.quaternion import multiply, rotate, rotation_between

#: Steps of `Chain.near`, and the damping of each [m, rad].
NEAR_STEPS, NEAR_DAMPING = 20, 0.01


@kernel
def chain_state(frames, axes, end, position, pose, jacobian):
    """
    Write the pose of the end of a chain of revolute joints, and its Jacobian.

    :param frames: pose of each joint in the frame of the last one, at zero, shape ``(n, 7)``
    :param axes: of the joints in their frames, shape ``(n, 3)``
    :param end: pose in the frame of the last joint
    :param position: of the joints [rad]
    :param pose: written, in the frame of the base
    :param jacobian: written, linear over angular, shape ``(6, n)``
    """
    noinline()
    n = position.size
    links, turns, lever = local_matrix(n + 1, 7), local_matrix(n, 3), local_numbers(3)
    place_links(frames, axes, position, links, turns)
    rotate(links[n, 3:], end[:3], lever)
    for i in range(3):
        pose[i] = links[n, i] + lever[i]
    multiply(links[n, 3:], end[3:], pose[3:])
    for k in range(n):
        for i in range(3):
            lever[i] = pose[i] - links[k + 1, i]
            jacobian[3 + i, k] = turns[k, i]
        x, y, z = turns[k, 0], turns[k, 1], turns[k, 2]
        jacobian[0, k] = y * lever[2] - z * lever[1]
        jacobian[1, k] = z * lever[0] - x * lever[2]
        jacobian[2, k] = x * lever[1] - y * lever[0]


@kernel
def place_links(frames, axes, position, links, turns):
    """
    Write the pose of each link, the base first, and the axis of the joint that moves it.

    :param frames: see `chain_state`, as ``axes``
    :param position: of the joints [rad], shape ``(n,)``
    :param links: written, at the joint and turned with it, shape ``(n + 1, 7)``
    :param turns: written, shape ``(n, 3)``
    """
    step, moved = local_numbers(4), local_numbers(3)
    for i in range(7):
        links[0, i] = 1.0 if i == 3 else 0.0
    for k in range(position.size):
        link, last = links[k + 1], links[k]
        rotate(last[3:], frames[k, :3], moved)
        for i in range(3):
            link[i] = last[i] + moved[i]
        multiply(last[3:], frames[k, 3:], link[3:])
        rotate(link[3:], axes[k], turns[k])
        half = 0.5 * position[k]
        step[0] = math.cos(half)
        for i in range(3):
            step[1 + i] = math.sin(half) * axes[k, i]
        multiply(link[3:], step, link[3:])


class Chain(NamedTuple):
    """
    The revolute joints between the base of an arm and its tool.

    :ivar frames: pose of each joint in the frame of the last one, at zero, shape ``(n, 7)``
    :ivar axes: of the joints in their frames, shape ``(n, 3)``
    """

    frames: np.ndarray
    axes: np.ndarray

    def pose_at(self, position: np.ndarray, end: np.ndarray) -> np.ndarray:
        """
        Pose (x, y, z, qw, qx, qy, qz) of the end of the chain.

        :param position: of the joints [rad]
        :param end: pose of the end in the frame of the last joint
        """
        return self._state(position, end)[0]

    def near(self, pose: np.ndarray, position: np.ndarray, end: np.ndarray) -> np.ndarray:
        """
        Joint positions near others with which the end comes as close to a pose as it can [rad].
        """
        position, error = position.copy(), np.empty(6)
        for _ in range(NEAR_STEPS):
            now, jacobian = self._state(position, end)
            error[:3] = pose[:3] - now[:3]
            rotation_between(now[3:], pose[3:], error[3:])
            square = jacobian @ jacobian.T + NEAR_DAMPING ** 2 * np.eye(6)
            position += jacobian.T @ np.linalg.solve(square, error)
        return position

    def _state(self, position: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pose, jacobian = np.empty(7), np.empty((6, len(position)))
        chain_state(self.frames, self.axes, end, position, pose, jacobian)
        return pose, jacobian
