"""
Limits of the governed reference as rows ``a · q̇ ≤ b`` of its joint velocities.

The bound of a row decreases with the distance d from its limit, so that half of the acceleration
that is allowed suffices to stop there. It is never negative: to stop is always allowed, and so is
every way back. What is beyond a limit is not led back, but may only go inwards.
"""
from __future__ import annotations

from collections.abc import Sequence
import math

from gdmp_ros.control.settings import LIMIT_NUMBERS
from gdmp_ros.control.singularity import singular_rate, singular_value
from gdmp_ros.kernels import kernel, local_numbers, local_zeros, noinline, records_at

#: Time constant of the last way to a limit [s]: a few ticks.
LAST_S = 0.005
#: Time constant of the approach to a singularity [s].
SINGULAR_S = 0.25
#: Rows beside those of the joints: six walls, and the singular direction.
OTHER_ROWS = 7
#: Share of the speed that a robot allows near the limits of its joints.
SLOWING_SHARE = 0.9


def row_name(index: int, joints: int, parts: Sequence[str], links: Sequence[str] = (),
             volumes: Sequence[str] = ()) -> str:
    """
    Name of a limit, as `ids` of `limit_rows` numbers them; own body and volumes are behind.

    :param parts: names of the pairs of the own body
    :param links: names of the links of its capsules
    :param volumes: names of what is around the arm
    """
    if index < 2 * joints:
        return (f'joint {index % joints + 1} at its '
                f'{"lower" if index < joints else "upper"} limit')
    if index < 2 * joints + 6:
        axis, side = divmod(index - 2 * joints, 2)
        return f'the {("lower", "upper")[side]} wall of the workspace in {"xyz"[axis]}'
    if index < 2 * joints + OTHER_ROWS:
        return 'a singularity'
    index -= 2 * joints + OTHER_ROWS
    if index < len(parts):
        return f'the body of the arm itself ({parts[index]})'
    volume, link = divmod(index - len(parts), len(links))
    return f'{volumes[volume]} ({links[link]} is near it)'


@kernel
def approach(distance, deceleration):
    """Largest speed towards a limit that is ``distance`` away; 0 at the limit, and beyond it."""
    if distance <= 0.0:
        return 0.0
    return min(math.sqrt(2.0 * deceleration * distance), distance / LAST_S)


@kernel
def limit_rows(position, pose, jacobian, joint_limits, limit_numbers, rows, bounds, ids):
    """
    Write the rows that may bind.

    :param position: of the joints of the reference [rad], shape (n,)
    :param pose: of the tool there
    :param jacobian: there, shape (6, n)
    :param joint_limits: see `gdmp_ros.control.memory.ArmMemory`, shape (5, n)
    :param limit_numbers: `LimitSettings` as numbers
    :param rows: written, shape (2 n + `OTHER_ROWS`, n)
    :param bounds: written
    :param ids: written: which limit each is (`row_name`)
    :returns: number of rows, and the smallest singular value, if it is small [m]
    """
    noinline()
    n, count = position.size, 0
    limits = records_at(limit_numbers, 0, 1, LIMIT_NUMBERS)[0]
    for side in range(2):
        for i in range(n):
            away = (position[i] - joint_limits[0, i] if side == 0
                    else joint_limits[1, i] - position[i])
            bound = approach(away - limits.joint_margin, 0.5 * limits.joint_acceleration)
            if joint_limits[4, i] > 0.0:
                allowed = math.sqrt(2.0 * joint_limits[4, i] * max(away, 0.0)) - joint_limits[3, i]
                bound = min(bound, SLOWING_SHARE * max(allowed, 0.0))
            if bound < joint_limits[2, i]:
                for k in range(n):
                    rows[count, k] = 0.0
                rows[count, i] = 1.0 if side == 1 else -1.0
                bounds[count], ids[count] = bound, side * n + i
                count += 1
    for axis in range(3):
        for side in range(2):
            away = (pose[axis] - limits.workspace_min[axis] if side == 0
                    else limits.workspace_max[axis] - pose[axis])
            bound = approach(away, 0.5 * limits.acceleration)
            if bound < limits.speed:
                sign = 1.0 if side == 1 else -1.0
                for k in range(n):
                    rows[count, k] = sign * jacobian[axis, k]
                bounds[count], ids[count] = bound, 2 * n + 2 * axis + side
                count += 1
    direction = local_numbers(6)
    value = singular_value(jacobian, direction)
    if value < limits.singularity_start:
        unit = local_zeros(n)
        for k in range(n):
            unit[k] = 1.0
            rows[count, k] = -singular_rate(jacobian, unit, direction) / max(value, 1e-6)
            unit[k] = 0.0
        bounds[count] = max(value - limits.singularity_stop, 0.0) / SINGULAR_S
        ids[count] = 2 * n + 6
        count += 1
    return count, value
