"""Whether an arm can reach a pose: inverse kinematics within the joint limits."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.errors import ManifoldError, ParameterError
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.sim.arm import Arm

#: A pose is reached if the tool comes this close [m, rad].
REACHED_M, REACHED_RAD = 3e-3, 0.02
#: Postures from which the search begins, and steps of each.
STARTS, STEPS = 60, 100
#: Squared damping of the least squares: least, and share of the squared error.
DAMPING, DAMPING_SHARE = 1e-6, 0.01
#: Largest step of a joint [rad].
LARGEST_STEP = 0.3


class Reach:
    """Inverse kinematics of one arm; a call takes some milliseconds."""

    def __init__(self, arm: Arm, tool: str = 'tcp'):
        """:param tool: name of the site that is to reach"""
        self._arm = arm
        self._model, self._data = arm.model, mujoco.MjData(arm.model)
        self._site = arm.model.site(tool).id
        finite = np.isfinite(arm.limits.lower) & np.isfinite(arm.limits.upper)
        self._lower = np.where(finite, arm.limits.lower, -np.pi)
        self._upper = np.where(finite, arm.limits.upper, np.pi)
        self._limited = finite
        self._first = np.clip(arm.data.qpos, self._lower, self._upper)

    def problem(self, pose: np.ndarray) -> str:
        """
        Why the arm cannot reach a pose; empty if it can.

        :param pose: (x, y, z, qw, qx, qy, qz) of the tool in the base frame
        """
        return self._reached(pose, self._first)[1]

    def problem_of_joints(self, position: np.ndarray) -> str:
        """Why positions are not within the limits of the joints; empty if they are [rad]."""
        try:
            self._arm.limits.check(position)
        except ParameterError as error:
            return str(error)
        return ''

    def posture(self, pose: np.ndarray, near: np.ndarray, starts: int = STARTS) -> np.ndarray:
        """
        Positions of the joints with which the tool is at a pose [rad].

        :param near: where the search begins: of several postures one near to it is found first
        :param starts: postures from which it is searched before it counts as out of reach
        :raises ManifoldError: if the arm does not reach it
        """
        found, problem = self._reached(pose, near, starts)
        if problem:
            raise ManifoldError(problem)
        return found

    def towards(self, pose: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, float, float]:
        """
        Come as near to a pose as one search from a posture does; for paths, sample by sample.

        :param near: where the search begins [rad]
        :returns: positions of the joints [rad], and how far the tool is from the pose [m, rad]
        """
        return self._search(np.clip(near, self._lower, self._upper), pose)

    def pose_at(self, position: np.ndarray) -> np.ndarray:
        """Pose of the tool (x, y, z, qw, qx, qy, qz) at positions of the joints [rad]."""
        return self._arm.pose_at(position)

    def _reached(self, pose: np.ndarray, first: np.ndarray, starts: int = STARTS
                 ) -> tuple[np.ndarray, str]:
        """The first posture that reaches a pose, and why there is none."""
        best, random = (np.inf, np.inf), np.random.default_rng(0)
        for start in range(starts):
            q, *away = self._search(
                (first if start == 0 else random.uniform(self._lower, self._upper)).copy(), pose)
            best = min(best, (away[0], away[1]), key=lambda one: one[0] + 0.3 * one[1])
            if best[0] <= REACHED_M and best[1] <= REACHED_RAD:
                return q, ''
        return first, (f'within its joint limits the arm comes within {1e3 * best[0]:.0f} mm and '
                       f'{best[1]:.2f} rad of ({pose[0]:.3f}, {pose[1]:.3f}, {pose[2]:.3f}) m')

    def _search(self, q: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Improve a posture; the last one that was tried, and its distance and angle."""
        model, data, n = self._model, self._data, len(q)
        jacobian, error, measured = np.zeros((6, n)), np.zeros(6), np.empty(7)
        for _ in range(STEPS):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            measured[:3] = data.site_xpos[self._site]
            mujoco.mju_mat2Quat(measured[3:], data.site_xmat[self._site])
            error[:3] = pose[:3] - measured[:3]
            self._turn(measured[3:], pose[3:], error[3:])
            if (np.abs(error[:3]).max() < 0.1 * REACHED_M
                    and np.abs(error[3:]).max() < 0.1 * REACHED_RAD):
                break
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._site)
            damping = DAMPING + DAMPING_SHARE * float(error @ error)
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping * np.eye(6), error)
            step *= min(1.0, LARGEST_STEP / max(np.abs(step).max(), 1e-12))
            q = np.where(self._limited, np.clip(q + step, self._lower, self._upper), q + step)
        return (data.qpos.copy(), float(np.linalg.norm(error[:3])),
                float(rotation_angles(measured[3:], pose[3:])))

    @staticmethod
    def _turn(start: np.ndarray, end: np.ndarray, out: np.ndarray) -> None:
        inverse, between = np.empty(4), np.empty(4)
        mujoco.mju_negQuat(inverse, start)
        mujoco.mju_mulQuat(between, end, inverse)
        if between[0] < 0.0:
            between *= -1.0
        mujoco.mju_quat2Vel(out, between, 1.0)
