"""Limits of the torque that is sent to the motors."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.limits import JOINT_POSITION, JOINT_SPEED, TORQUE, TORQUE_RATE
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.settings import LIMIT_NUMBERS, LimitSettings
from gdmp_ros.kernels import kernel, local_numbers, records_at
from gdmp_ros.manifolds.linalg import copy_into, is_finite
from gdmp_ros.util.settings import numbers

#: A joint is braked from this fraction of its speed limit on.
SPEED_MARGIN = 0.9
#: Stiffness of a wall of the workspace for a tool that is beyond it [N/m], its largest force [N],
#: and the damping of the approach [Ns/m].
WALL_STIFFNESS, WALL_FORCE, WALL_DAMPING = 20_000.0, 100.0, 200.0
#: Repulsion has at most this share of a motor's torque.
REPULSION_SHARE = 0.5
#: A joint that is closer to its limit than this is braked as if it were this far from it [rad].
LEAST_WAY = 0.01


@kernel
def _stop_at_limit(position, velocity, lower, upper, acceleration, inertia):
    """
    What stops a joint at its limit, and how fully it has to act.

    A reference stops with half of the acceleration that is allowed. A joint that needs more than
    the whole is braked, fully from twice that on.

    :param acceleration: that is allowed [rad/s²]
    :param inertia: of the joint, while the others stand [kg m²]
    :returns: torque [Nm], and the share of it that acts; both have the sign of the way back
    """
    way = position - lower if velocity < 0.0 else upper - position
    needed = 0.5 * velocity ** 2 / max(way, LEAST_WAY)
    share = min(max(needed / acceleration - 1.0, 0.0), 1.0)
    return math.copysign(share * inertia * needed, -velocity), math.copysign(share, -velocity)


@kernel
def _guard_torque(position, velocity, inertia, lower, upper, largest, fastest, limits, relief,
                  torque, depth, violation):
    """
    Write the repulsion from joint limits and what brakes joints that are too fast.

    The repulsion is a potential of the distance from the limit; only the approach is damped, and
    braked as hard as is needed to stop at the limit.

    :param relief: depth in the zone of repulsion that does not act yet [rad]; changed
    :param depth: written: share of what drives a joint to its limit that is taken away: how deep
        it is in the zone, 1 at its limit, or how fully it is braked; negative near the upper
    """
    margin = limits.joint_margin
    for i in range(torque.size):
        torque[i] = depth[i] = 0.0
        below = max(lower[i] + margin - position[i], 0.0)
        above = max(position[i] - upper[i] + margin, 0.0)
        if below + above > 0.0:
            violation[JOINT_POSITION] = max(violation[JOINT_POSITION], below, above)
            relief[i] = min(relief[i], max(below, above))
            below, above = max(below - relief[i], 0.0), max(above - relief[i], 0.0)
            depth[i] = min(below / margin, 1.0) - min(above / margin, 1.0)
            torque[i] += depth[i] * min(limits.joint_repulsion, REPULSION_SHARE * largest[i])
            if depth[i] * velocity[i] < 0.0:
                torque[i] -= abs(depth[i]) * limits.joint_brake * velocity[i]
        else:
            relief[i] = 0.0
        brake, share = _stop_at_limit(position[i], velocity[i], lower[i], upper[i],
                                      limits.joint_acceleration, inertia[i, i])
        torque[i] += brake
        if abs(share) > abs(depth[i]):
            depth[i] = share
        too_fast = abs(velocity[i]) - SPEED_MARGIN * fastest[i]
        if too_fast > 0.0:
            violation[JOINT_SPEED] = max(violation[JOINT_SPEED], too_fast)
            torque[i] -= math.copysign(limits.joint_brake * too_fast, velocity[i])


@kernel
def distance_outside(position, limit_numbers, axis):
    """How far a tool is beyond one of the two walls across an axis, and the direction back [m]."""
    limits = records_at(limit_numbers, 0, 1, LIMIT_NUMBERS)[0]
    below = limits.workspace_min[axis] - position[axis]
    above = position[axis] - limits.workspace_max[axis]
    return max(below, above, 0.0), 1.0 if below > above else -1.0


@kernel
def push_from_walls(position, twist, jacobian, limit_numbers, outside, torque):
    """
    Write the torque that pushes a tool back which is beyond a wall: a potential of the distance.

    :param position: of the tool, measured [m]
    :param twist: of the tool, measured
    :param outside: distance beyond each pair of walls that does not act yet [m]; changed
    """
    torque[:] = 0.0
    for axis in range(3):
        deep, sign = distance_outside(position, limit_numbers, axis)
        outside[axis] = min(outside[axis], deep)
        if deep <= outside[axis]:
            continue
        force = sign * min(WALL_STIFFNESS * (deep - outside[axis]), WALL_FORCE)
        if sign * twist[axis] < 0.0:
            force -= WALL_DAMPING * twist[axis]
        for i in range(torque.size):
            torque[i] += jacobian[axis, i] * force


def outside_of(position: np.ndarray, before: LimitSettings, after: LimitSettings,
               outside: np.ndarray) -> np.ndarray:
    """
    Distance beyond each pair of walls that does not act at first, so that others move nothing [m].

    :param position: of the tool [m]
    :param outside: until now
    """
    def deep(limits: LimitSettings) -> np.ndarray:
        return np.array([distance_outside(position, numbers(limits), axis)[0]
                         for axis in range(3)])
    return np.maximum(deep(after) - np.maximum(deep(before) - outside, 0.0), 0.0)


@kernel
def _allowed_share(active, velocity, base, depth, largest, torque_share, fastest, violation):
    """
    The factor of the active torque with which no joint is too fast, or driven into its limit.

    :param base: what comes first: gravity, repulsion and brake [Nm]
    :param depth: of each joint, see `_guard_torque`
    :param torque_share: part of a motor's torque that the active torque may have
    """
    share = 1.0
    for i in range(active.size):
        slow = SPEED_MARGIN * fastest[i]
        too_fast = abs(velocity[i]) - slow
        if too_fast > 0.0 and active[i] * velocity[i] > 0.0:
            share = min(share, max(1.0 - too_fast / (fastest[i] - slow), 0.0))
        if active[i] * depth[i] < 0.0:
            share = min(share, 1.0 - abs(depth[i]))
        excess = max(abs(base[i] + active[i]) - largest[i],
                     abs(active[i]) - torque_share * largest[i])
        if excess > 0.0 and active[i] != 0.0:
            violation[TORQUE] = max(violation[TORQUE], excess)
            room = (math.copysign(largest[i], active[i]) - base[i]) / active[i]
            share = min(share, max(room, 0.0), torque_share * largest[i] / abs(active[i]))
    return share


@kernel
def limit_torque(position, velocity, inertia, bias, push, last, lower, upper, largest, fastest, dt,
                 limit_numbers, relief, torque, violation):
    """
    Apply repulsion and brake at joint limits, joint speed, torque limit and torque rate.

    The torque of a motor goes first to gravity and Coriolis, then to repulsion and brake, then to
    the active torque, which may have `torque_share` of it. The active torque is scaled as a whole:
    cut joint by joint, it would no longer belong to a wrench, and the rest would drive the null
    space. The same holds for its change in a tick. Without a finite measurement the last torque
    stays.

    :param inertia: of the joints [kg m²], shape (n, n)
    :param push: torque that comes before the active one, as `push_from_walls` [Nm]
    :param last: torque of the last tick [Nm]
    :param largest: torque limits of the motors [Nm]
    :param fastest: speed limits of the joints [rad/s]
    :param limit_numbers: `LimitSettings` as numbers
    :param relief: see `relief_of`; changed
    :param torque: requested; changed to what may be sent [Nm]
    :param violation: written: by how much each limit was exceeded (`LIMITS`)
    """
    limits = records_at(limit_numbers, 0, 1, LIMIT_NUMBERS)[0]
    n = torque.size
    base, active, depth = local_numbers(n), local_numbers(n), local_numbers(n)
    _guard_torque(position, velocity, inertia, lower, upper, largest, fastest, limits, relief,
                  base, depth, violation)
    for i in range(n):
        active[i] = torque[i] - bias[i]
        base[i] = min(max(base[i] + push[i] + bias[i], -largest[i]), largest[i])
    share = _allowed_share(active, velocity, base, depth, largest, limits.torque_share,
                           fastest, violation)
    change = 0.0
    for i in range(n):
        torque[i] = base[i] + share * active[i]
        change = max(change, abs(torque[i] - last[i]))
    if change > limits.torque_slew * dt:
        violation[TORQUE_RATE] = max(violation[TORQUE_RATE], change / dt - limits.torque_slew)
        for i in range(n):
            torque[i] = last[i] + limits.torque_slew * dt / change * (torque[i] - last[i])
    if not is_finite(torque):
        copy_into(last, torque)


def relief_of(position: np.ndarray, joints: JointLimits, before: LimitSettings,
              after: LimitSettings, relief: np.ndarray) -> np.ndarray:
    """
    Depth in the zone of repulsion that does not act at first, so that other settings move nothing.

    It decreases as the joint leaves the zone.

    :param relief: until now
    :returns: for each joint [rad]
    """
    def depth(margin: float) -> np.ndarray:
        return np.maximum(np.maximum(joints.lower - position, position - joints.upper) + margin,
                          0.0)
    if after.joint_repulsion == 0.0:
        return np.zeros_like(relief)
    share = np.clip((depth(before.joint_margin) - relief) / before.joint_margin, 0.0, 1.0)
    most = REPULSION_SHARE * joints.torque
    acts = (np.minimum(before.joint_repulsion, most) / np.minimum(after.joint_repulsion, most)
            * share * after.joint_margin)
    return np.maximum(depth(after.joint_margin) - acts, 0.0)


class TorqueLimiter:
    """Limits the torque tick by tick."""

    def __init__(self, joints: JointLimits, settings: LimitSettings):
        self._joints = joints
        self._torque = joints.torque
        self._fastest = joints.fastest(settings.joint_speed)
        self._limits = numbers(settings)
        self._last, self._relief, self._push = np.zeros((3, len(joints.torque)))

    def reset(self, torque: np.ndarray) -> None:
        """Begin at ``torque``: the next one may differ from it by the rate."""
        self._last = np.clip(torque, -self._torque, self._torque)

    def apply(self, position: np.ndarray, velocity: np.ndarray, inertia: np.ndarray,
              bias: np.ndarray, torque: np.ndarray, dt: float, violation: np.ndarray
              ) -> np.ndarray:
        """
        Return what may be sent of a torque [Nm], and remember it; see `limit_torque`.

        :param inertia: of the joints [kg m²], shape (n, n)
        :param bias: gravity and Coriolis torque [Nm]
        """
        joints, result = self._joints, torque.copy()
        limit_torque(position, velocity, inertia, bias, self._push, self._last,
                     joints.lower, joints.upper, self._torque, self._fastest,
                     min(dt, joints.cycle), self._limits, self._relief, result, violation)
        self._last = result.copy()
        return result
