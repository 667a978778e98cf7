"""Avoidance of point obstacles."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.dmp.layout import Motion, OBSTACLE_CAPACITY
from gdmp_ros.dmp.options import check_range
from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import always_inline, kernel, noinline, numbers_at
from gdmp_ros.manifolds.linalg import limit_norm
from gdmp_ros.util.numeric import numbers

#: How fast the avoidance decreases with the angle between motion and obstacle [1/rad].
_ANGLE_DECAY = 3.0


@kernel
def obstacle_acceleration(size, position, velocity, count, obstacles, gain, reach, out):
    """
    Acceleration perpendicular to ``velocity`` away from the obstacles.

    ``γ |v| e^(-β θ) (1 - d/r)²`` for each obstacle nearer than r, with θ the angle between the
    velocity and the obstacle, d its distance: largest when the motion heads for it, zero when it
    is behind or at rest. If it is straight ahead, one side is chosen.

    :param size: of a position, 2 or 3
    :param velocity: derivative by s, as is the acceleration
    :param count: number of obstacles
    :param obstacles: their positions one after another

    Source: after Hoffmann, Pastor, Park, Schaal 2009 (ICRA), eqs. (9), (10), with a finite reach.
    """
    noinline()
    speed2, least = 0.0, 0
    for i in range(size):
        out[i] = 0.0
        speed2 += velocity[i] * velocity[i]
        if abs(velocity[i]) < abs(velocity[least]):
            least = i
    speed = math.sqrt(speed2)
    if speed < 1e-9:
        return
    for k in range(0, count * size, size):
        distance2, along = 0.0, 0.0
        for i in range(size):
            difference = obstacles[k + i] - position[i]
            distance2 += difference * difference
            along += difference * velocity[i] / speed
        distance = math.sqrt(distance2)
        if distance >= reach or distance < 1e-12:
            continue
        # The direction of the obstacle has a part along the velocity and one across it.
        across = math.sqrt(max(distance2 - along * along, 0.0))
        angle = math.atan2(across, along)
        strength = gain * speed * math.exp(-_ANGLE_DECAY * angle) * (1.0 - distance / reach) ** 2
        if across > 1e-9 * distance:
            for i in range(size):
                side = obstacles[k + i] - position[i] - along * velocity[i] / speed
                out[i] -= strength * side / across
        else:
            share = velocity[least] / speed
            length = math.sqrt(1.0 - share * share)
            for i in range(size):
                unit = (1.0 if i == least else 0.0) - share * velocity[i] / speed
                out[i] += strength * unit / length


@always_inline
def avoid_obstacles(motion):
    """Add the avoidance to the attraction by the target, on the factor that has obstacles."""
    scalars, tangents = motion.scalars, motion.tangents
    factor = motion.factors[motion.sizes.obstacle_factor]
    first, size = factor.tangent, factor.tangent_end - factor.tangent
    # The frame of a flat factor begins with its point.
    if scalars.parallel == 1:
        position = numbers_at(motion.frames.mid, factor.frame_start, size)
    else:
        position = numbers_at(motion.points.mid, factor.point, size)
    avoidance = numbers_at(tangents.spare, first, size)
    obstacle_acceleration(size, position, numbers_at(tangents.velocity, first, size),
                          int(scalars.obstacles), motion.obstacles, scalars.obstacle_gain,
                          scalars.obstacle_reach, avoidance)
    limit_norm(size, avoidance, scalars.obstacle_limit)
    for i in range(size):
        tangents.to_goal[first + i] += avoidance[i] / scalars.stiffness


def store_obstacles(motion: Motion, positions: np.ndarray, gain: float, reach: float,
                    limit: float) -> None:
    """
    Avoid these obstacles from now on; see `gdmp_ros.dmp.Rollout.set_obstacles`.

    :raises ParameterError: without a position to avoid them with, or for too many obstacles
    """
    size, scalars = int(motion.sizes.position), motion.scalars
    positions = numbers('obstacles', positions)
    if size == 0:
        raise ParameterError('the skill has no position (R² or R³) that could avoid obstacles')
    shape = positions.reshape(-1, size).shape if positions.size % size == 0 else (-1, size)
    if positions.size and (positions.shape != shape or len(positions) > OBSTACLE_CAPACITY
                           or not np.isfinite(positions).all()):
        raise ParameterError(f'obstacles: expected up to {OBSTACLE_CAPACITY} finite positions of '
                             f'{size} numbers, got shape {positions.shape}')
    gain, reach, limit = (check_range(name, value, low, 1e6) for name, value, low in (
        ('gain', gain, 0.0), ('reach', reach, 1e-6), ('bound', limit, 0.0)))
    # Nothing has changed until all of it is checked.
    motion.obstacles[:positions.size] = positions.reshape(-1)
    scalars.obstacle_gain, scalars.obstacle_reach = gain, reach
    scalars.obstacle_limit = limit * scalars.duration ** 2
    scalars.obstacles = positions.size // size
