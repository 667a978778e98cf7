"""Avoidance of volumes and points by the tool."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.dmp.layout import Motion, OBSTACLE_CAPACITY, OBSTACLE_SIZE
from gdmp_ros.dmp.options import check_range
from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import (
    always_inline,
    kernel,
    local_numbers,
    local_zeros,
    noinline,
    numbers_at,
)
from gdmp_ros.manifolds.linalg import limit_norm
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.scene.distance import distance_within
from gdmp_ros.scene.scene import Scene
from gdmp_ros.scene.volume import MARGIN, POSE, RADIUS
from gdmp_ros.util.numeric import numbers

#: How fast the avoidance decreases with the angle between motion and obstacle [1/rad].
_ANGLE_DECAY = 3.0
#: What is left of it beside the motion: there the avoidance ends.
_BESIDE = math.exp(-_ANGLE_DECAY * math.pi / 2.0)
#: Distance to keep, and radius of the sphere around an obstacle and it, among its numbers.
_KEEP, _AROUND = 11, 12


@kernel
def _angle_of(cosine):
    """
    Angle of a cosine of 0 … 1 [rad], to 7e-5.

    Source: Abramowitz, Stegun, Handbook of Mathematical Functions, 4.4.45.
    """
    c = min(cosine, 1.0)
    return math.sqrt(1.0 - c) * (1.5707288 + c * (-0.2121144 + c * (0.0742610 - 0.0187293 * c)))


@kernel
def obstacle_acceleration(size, position, velocity, count, obstacles, gain, reach, out):
    """
    Acceleration perpendicular to ``velocity`` away from the obstacles.

    ``γ |v| (e^(-β θ) - e^(-β π/2)) (1 - d/r)²`` for each obstacle ahead that is nearer than r,
    with θ the angle between the velocity and the nearest point of the obstacle, d the distance
    from it, less that to keep: largest when the motion heads for it, zero when it is beside or
    behind, or at rest. If it is straight ahead, one side is chosen. Perpendicular to the velocity,
    it does no work: the motion converges as without it.

    :param size: of a position, 2 or 3
    :param velocity: derivative by s, as is the acceleration
    :param count: number of obstacles
    :param obstacles: one after another, `OBSTACLE_SIZE` numbers each: the first ones of a packed
        volume (`gdmp_ros.scene.volume`), the distance to keep, and the radius of the sphere around
        both [m]

    Source: after Hoffmann, Pastor, Park, Schaal 2009 (ICRA), eqs. (9), (10), with a finite reach,
    and the distance from a volume instead of that from a point.
    """
    noinline()
    speed2, least = 0.0, 0
    place, way, heading = local_zeros(3), local_numbers(3), local_zeros(3)
    for i in range(size):
        out[i], place[i] = 0.0, position[i]
        speed2 += velocity[i] * velocity[i]
        if abs(velocity[i]) < abs(velocity[least]):
            least = i
    speed = math.sqrt(speed2)
    if speed < 1e-9:
        return
    for i in range(size):
        heading[i] = velocity[i] / speed
    for k in range(count):
        obstacle = numbers_at(obstacles, k * OBSTACLE_SIZE, OBSTACLE_SIZE)
        between = in_front = 0.0
        for i in range(3):
            apart = obstacle[POSE + i] - place[i]
            between += apart * apart
            in_front += apart * heading[i]
        # Out of reach, or all of it behind.
        if between >= (reach + obstacle[_AROUND]) ** 2 or in_front <= -obstacle[_AROUND]:
            continue
        distance = distance_within(obstacle, place, way) - obstacle[_KEEP]
        if distance >= reach:
            continue
        rotate(numbers_at(obstacle, POSE + 3, 4), way, way)
        # The direction of the obstacle has a part along the velocity and one across it.
        along, square = 0.0, 0.0
        for i in range(size):
            along -= way[i] * heading[i]
            square += way[i] * way[i]
        if along <= 0.0:
            continue
        across = math.sqrt(max(square - along * along, 0.0))
        near = 1.0 - max(distance, 0.0) / reach
        cosine = along if size == 3 else along / math.sqrt(square)
        ahead = math.exp(-_ANGLE_DECAY * _angle_of(cosine)) - _BESIDE
        strength = gain * speed * ahead * near * near
        if across > 1e-9:
            strength /= across
            for i in range(size):
                out[i] += strength * (way[i] + along * heading[i])
        else:
            share = heading[least]
            length = math.sqrt(1.0 - share * share)
            for i in range(size):
                unit = (1.0 if i == least else 0.0) - share * heading[i]
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


def store_obstacles(motion: Motion, obstacles: np.ndarray | Scene, gain: float, reach: float,
                    limit: float, keep: float) -> None:
    """
    Avoid these obstacles from now on; see `gdmp_ros.dmp.Rollout.set_obstacles`.

    :raises ParameterError: without a position to avoid them with, or for too many obstacles
    """
    size, scalars = int(motion.sizes.position), motion.scalars
    if size == 0:
        raise ParameterError('the skill has no position (R² or R³) that could avoid obstacles')
    gain, reach, limit, keep = (check_range(name, value, low, 1e6) for name, value, low in (
        ('gain', gain, 0.0), ('reach', reach, 1e-6), ('bound', limit, 0.0), ('keep', keep, 0.0)))
    rows = _volumes(obstacles) if isinstance(obstacles, Scene) else _points(obstacles, size)
    rows[:, _KEEP] += keep
    rows[:, _AROUND] = np.linalg.norm(rows[:, :3], axis=1) + rows[:, RADIUS] + rows[:, _KEEP]
    # Nothing has changed until all of it is checked.
    motion.obstacles[:rows.size] = rows.reshape(-1)
    scalars.obstacle_gain, scalars.obstacle_reach = gain, reach
    scalars.obstacle_limit = limit * scalars.duration ** 2
    scalars.obstacles = len(rows)


def _volumes(scene: Scene) -> np.ndarray:
    packed = scene.packed()
    return np.column_stack([packed[:, :_KEEP], packed[:, MARGIN], np.zeros(len(packed))])


def _points(positions: np.ndarray, size: int) -> np.ndarray:
    """Points are spheres without a size."""
    positions = numbers('obstacles', positions)
    shape = positions.reshape(-1, size).shape if positions.size % size == 0 else (-1, size)
    if positions.size and (positions.shape != shape or len(positions) > OBSTACLE_CAPACITY
                           or not np.isfinite(positions).all()):
        raise ParameterError(f'obstacles: expected up to {OBSTACLE_CAPACITY} finite positions of '
                             f'{size} numbers, got shape {positions.shape}')
    positions = positions.reshape(-1, size)
    rows = np.zeros((len(positions), OBSTACLE_SIZE))
    rows[:, POSE:POSE + size], rows[:, POSE + 3] = positions, 1.0
    return rows
