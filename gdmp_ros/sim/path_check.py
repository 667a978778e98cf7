"""Whether an arm can follow a path of its tool: reach, joint limits, singularities, collisions."""
from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.control.singularity import singular_value
from gdmp_ros.errors import DataError, ManifoldError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.reach import Reach, REACHED_M, REACHED_RAD

#: A joint that is nearer than this to its limit counts as at its limit [rad].
AT_LIMIT_RAD = 0.02
#: Links that are nearer than this to each other or to the floor count as touching [m].
TOUCHING_M = 0.005
#: Distances of links are measured up to here [m].
_FAR_M = 0.2
#: Postures from which the first one is searched.
_STARTS = 15
#: Bodies that are at most this many joints apart may touch.
_NEIGHBOURS = 2


class Margin(NamedTuple):
    """
    What must not become small along a path.

    :ivar label: what it is, with its unit
    :ivar values: one for each pose
    :ivar least: below this the path cannot be followed
    """

    label: str
    values: np.ndarray
    least: float


@dataclass(frozen=True)
class PathCheck:
    """
    What happens along a path, one row for each pose.

    :ivar times: [s], shape ``(T,)``
    :ivar postures: with which the arm follows it [rad], shape ``(T, n)``
    :ivar away: how far the tool stays from the pose [m, rad], shape ``(T, 2)``
    :ivar margin: distance of the nearest joint limit [rad]
    :ivar joint: number of that joint, from 0 on
    :ivar singular: smallest singular value of the Jacobian (rotations times 0.3 m) [m]
    :ivar clearance: smallest distance between links that are no neighbours, or to the floor [m]
    """

    times: np.ndarray
    postures: np.ndarray
    away: np.ndarray
    margin: np.ndarray
    joint: np.ndarray
    singular: np.ndarray
    clearance: np.ndarray

    @property
    def unreached(self) -> np.ndarray:
        """Whether the tool stays away from a pose."""
        return (self.away[:, 0] > REACHED_M) | (self.away[:, 1] > REACHED_RAD)

    @property
    def wrong(self) -> np.ndarray:
        """Whether a pose cannot be followed, for any reason."""
        return np.asarray(self.unreached | np.any([
            one.values < one.least for one in self.margins], axis=0))

    @property
    def margins(self) -> tuple[Margin, ...]:
        """How near the arm comes to its limits."""
        return (Margin('nearest joint limit [rad]', self.margin, AT_LIMIT_RAD),
                Margin('smallest singular value [m]', self.singular,
                       LimitSettings().singularity_stop),
                Margin('distance of links [m]', self.clearance, TOUCHING_M))

    def problems(self) -> list[str]:
        """Why the arm cannot follow the path, one line for each reason; empty if it can."""
        found = []
        times, stop = self.times, LimitSettings().singularity_stop

        def first(wrong: np.ndarray) -> str:
            at = times[wrong]
            return f'from {at[0]:.2f} to {at[-1]:.2f} s'
        if self.unreached.any():
            worst = int(np.argmax(self.away[:, 0] + 0.3 * self.away[:, 1]))
            found.append(f'out of reach {first(self.unreached)}: the tool stays up to '
                         f'{1e3 * self.away[worst, 0]:.0f} mm and {self.away[worst, 1]:.2f} rad '
                         f'away, most at {times[worst]:.2f} s')
        near = (self.margin < AT_LIMIT_RAD) & ~self.unreached
        if near.any():
            joints = ', '.join(str(one + 1) for one in np.unique(self.joint[near]))
            found.append(f'joint {joints} at its limit {first(near)}')
        singular = self.singular < stop
        if singular.any():
            found.append(f'singular {first(singular)}: smallest singular value '
                         f'{self.singular.min():.3f} m, the reference stops at {stop:g} m')
        touching = self.clearance < TOUCHING_M
        if touching.any():
            found.append(f'the arm touches itself or the floor {first(touching)}')
        return found


class PathChecker:
    """Follows paths with one arm, pose by pose, without dynamics."""

    def __init__(self, arm: Arm, tool: str = 'tcp'):
        """
        Prepare.

        :param arm: is moved
        :param tool: name of the site that follows the path
        """
        self._arm, self._reach = arm, Reach(arm, tool)
        self._pairs = _pairs(arm.model)

    def check(self, times: np.ndarray, poses: np.ndarray,
              posture: np.ndarray | None = None) -> PathCheck:
        """
        Follow a path; each posture is searched from the one before.

        :param times: of the poses [s]
        :param poses: (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``
        :param posture: with which the arm comes to the first pose is searched from here [rad];
            by default the home posture
        """
        reach = self._reach
        near = self._arm.home if posture is None else posture
        with suppress(ManifoldError):  # `away` tells how far it comes then
            near = reach.posture(poses[0], near, _STARTS)
        postures, away = [], []
        for pose in poses:
            near, *distance = reach.towards(pose, near)
            postures.append(near)
            away.append(distance)
        return self._at(times, np.array(postures), np.array(away))

    def check_postures(self, times: np.ndarray, postures: np.ndarray) -> PathCheck:
        """
        Check a path of the joints.

        :param postures: [rad], shape ``(T, n)``
        :raises DataError: if the arm has another number of joints
        """
        count = len(self._arm.names)
        if postures.shape[1] != count:
            raise DataError(f'the path is of {postures.shape[1]} joints, the arm has {count}')
        return self._at(times, postures, np.zeros((len(postures), 2)))

    def position(self, posture: np.ndarray) -> np.ndarray:
        """Position of the tool in a posture [m]."""
        return self._reach.pose_at(posture)[:3]

    def _at(self, times: np.ndarray, postures: np.ndarray, away: np.ndarray) -> PathCheck:
        arm, direction = self._arm, np.empty(6)
        margin, joint, singular, clearance = [], [], [], []
        for posture in postures:
            arm.reset(posture)
            to_limit = np.minimum(posture - arm.limits.lower, arm.limits.upper - posture)
            joint.append(int(np.argmin(to_limit)))
            margin.append(float(to_limit.min()))
            singular.append(singular_value(arm.measure().jacobian, direction))
            clearance.append(self._clearance())
        return PathCheck(np.asarray(times), postures, away, np.array(margin), np.array(joint),
                         np.array(singular), np.array(clearance))

    def _clearance(self) -> float:
        model, data = self._arm.model, self._arm.data
        return min((mujoco.mj_geomDistance(model, data, first, second, _FAR_M, None)
                    for first, second in self._pairs), default=_FAR_M)


def _pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Geoms whose distance matters: of bodies that are no neighbours, and of the floor."""
    order = _joints_before(model)
    arm = [i for i in range(model.ngeom) if model.geom_bodyid[i] != 0]
    world = [i for i in range(model.ngeom)
             if model.geom_bodyid[i] == 0 and model.geom_contype[i] != 0]
    pairs = [(a, b) for k, a in enumerate(arm) for b in arm[k + 1:]
             if abs(order[model.geom_bodyid[a]] - order[model.geom_bodyid[b]]) > _NEIGHBOURS]
    # The first links stand on the floor.
    return pairs + [(a, b) for a in arm for b in world
                    if order[model.geom_bodyid[a]] > _NEIGHBOURS]


def _joints_before(model: mujoco.MjModel) -> list[int]:
    """Number of joints between the base and each body."""
    result = [0] * model.nbody
    for body in range(1, model.nbody):
        result[body] = result[model.body_parentid[body]] + int(model.body_jntnum[body])
    return result
