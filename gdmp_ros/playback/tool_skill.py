"""A skill as a source of impedance references: where pose, stiffness, wrench are in its points."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    resting_target,
    STIFFNESS,
    TWIST,
    WRENCH,
    WRENCH_GAIN,
)
from gdmp_ros.dmp.integrator import advance
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ManifoldError
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import pose_distance, UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.playback.approach import Approach
from gdmp_ros.playback.bounds import StreamBounds
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.playback.streamed_skill import StreamedSkill

#: A motion starts at the present reference if it is this close to the measured pose [m, rad].
NEAR_M, NEAR_RAD = 0.02, 0.1
#: A wrench is that of the goal if it is this close [N, Nm].
WRENCH_TOLERANCE = 0.1
#: A wrench that nothing asks for any more decreases with this time constant [s], to this [N, Nm].
RELEASE_S, RELEASED = 0.1, 1e-3
_AT_REST = 1e-6  # m/s, rad/s


class ToolSkill(StreamedSkill):
    """
    A skill of a pose, with or without stiffness and wrench; other manifolds are refused.

    Its places are poses (x, y, z, qw, qx, qy, qz).

    :ivar stiffness_size: 3, 6, or 0 without a stiffness
    :ivar has_wrench: whether the skill has a wrench that the tool is to exert
    """

    def __init__(self, skill: Skill, settings: PlayerSettings):
        """
        Look at the manifold.

        :raises DataError: unless it is R³ × S³, followed or not by SPD(3) or SPD(6), and by R⁶
        """
        factors = skill.manifold.factors
        kinds = [type(f) for f in factors]
        pose = kinds[:2] == [Euclidean, UnitQuaternion] and factors[0].size == 3
        rest = list(factors[2:])
        self.has_wrench = bool(rest) and rest[-1] == Euclidean(6)
        matrix = rest[:-1] if self.has_wrench else rest
        if not pose or not isinstance(skill.manifold, Product) or (matrix and not (
                len(matrix) == 1 and isinstance(matrix[0], SymmetricPositiveDefinite)
                and matrix[0].size in (3, 6))):
            raise DataError(f'the skill is on {skill.manifold!r}; a pose reference needs R³ × S³, '
                            'with SPD(3) or SPD(6) for a stiffness and R⁶ for a wrench')
        super().__init__(skill, settings)
        self.manifold: Product = skill.manifold
        self.stiffness_size = matrix[0].size if matrix else 0
        self._velocity = 2 + skill.manifold.point_size
        self._wrench = self._velocity - 6 if self.has_wrench else 0
        self._acceleration = self._velocity + skill.manifold.tangent_size

    def options(self, speed: float, tolerances: tuple[float, float] | None) -> Options:
        """
        Options of a roll-out of the skill.

        :param speed: initial tempo
        :param tolerances: at the goal [m, rad]
        """
        settings, count = self.settings, len(self.manifold.factors)
        # Distances on S³ are half-angles.
        goal_speed = (settings.goal_speed or np.inf, 0.5 * settings.goal_angular_speed or np.inf,
                      np.inf, np.inf)
        limits = [factor.goal_tolerance for factor in self.manifold.factors]
        if tolerances is not None:
            limits[:2] = tolerances[0], 0.5 * tolerances[1]
        if self.has_wrench:
            limits[-1] = WRENCH_TOLERANCE
        position_weight, rotation_weight = settings.phase_stopping_weights
        weights = (position_weight, 4.0 * rotation_weight, 0.0, 0.0)
        return Options(speed, settings.speed_rate, limits, goal_speed[:count],
                       settings.phase_stopping, weights[:count])

    def changed(self, point: np.ndarray, place: np.ndarray | None = None,
                stiffness: np.ndarray | None = None) -> np.ndarray:
        """Point with another pose (x, y, z, qw, qx, qy, qz) or stiffness factor."""
        parts = list(self.manifold.split(point))
        if place is not None:
            parts[:2] = place[:3], place[3:7]
        if stiffness is not None and self.stiffness_size:
            parts[2] = stiffness
        return self.manifold.join(*parts)

    def point_of(self, target: np.ndarray) -> np.ndarray:
        """Point of a reference."""
        parts, size = [target[POSE:POSE + 3], target[POSE + 3:POSE + 7]], self.stiffness_size
        if size:
            parts.append(target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)[:size, :size])
        if self.has_wrench:
            parts.append(target[WRENCH:WRENCH + 6])
        return self.manifold.join(*(np.array(part) for part in parts))

    def start_at(self, place: np.ndarray | None) -> np.ndarray | None:
        """Point with a pose and the skill's initial stiffness, without a wrench."""
        if place is None:
            return None
        parts = list(self.manifold.split(self.changed(self.skill.start, place)))
        if self.has_wrench:
            parts[-1] = np.zeros(6)
        return self.manifold.join(*parts)

    def place_of(self, point: np.ndarray) -> np.ndarray:
        """Pose of a point."""
        return np.array(point[:7])

    def place_in(self, target: np.ndarray) -> np.ndarray:
        """Pose of a reference; a part of it."""
        return target[POSE:POSE + 7]

    def first_target(self, place: np.ndarray) -> np.ndarray:
        """Reference that rests at a pose, with the initial stiffness of the skill."""
        stiffness, size = self.settings.stiffness_matrix, self.stiffness_size
        if size:
            stiffness[:size, :size] = self.manifold.split(self.skill.start)[2]
        return resting_target(place, stiffness, self.settings.damping_ratio)

    def take_over(self, target: np.ndarray) -> None:
        """Write what a motion of this skill does not change."""
        if self.stiffness_size < 6:
            # With SPD(3) the skill changes the translational block only.
            block = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
            block[:] = self.settings.stiffness_matrix
        target[DAMPING_RATIO] = self.settings.damping_ratio
        target[WRENCH_GAIN:] = self.settings.wrench_gain if self.has_wrench else 0.0

    @property
    def releases(self) -> bool:
        """Whether a wrench of an earlier motion is to decrease."""
        return not self.has_wrench

    def release(self, target: np.ndarray, dt: float) -> bool:
        """Let the wrench of a reference decrease; whether there is some left."""
        wrench = target[WRENCH:WRENCH + 6]
        wrench *= max(1.0 - dt / RELEASE_S, 0.0)
        if np.abs(wrench).max() > RELEASED:
            return True
        target[WRENCH:] = 0.0
        return False

    def stop(self, target: np.ndarray) -> None:
        """Let a reference rest."""
        target[TWIST:STIFFNESS] = 0.0

    def motion_of(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Velocity and acceleration of a reference as tangents; None at rest."""
        if np.abs(target[TWIST:TWIST + 6]).max() < _AT_REST:
            return None
        return (self.tangent_of_twist(target[TWIST:TWIST + 6]),
                self.tangent_of_twist(target[ACCELERATION:ACCELERATION + 6]))

    def approach(self, target: np.ndarray, place: np.ndarray) -> Approach:
        """Motion from a reference at rest to a pose."""
        return Approach(target, place)

    def is_near(self, target: np.ndarray, place: np.ndarray) -> bool:
        """Whether a reference is so close to the measured pose that a motion may start there."""
        return self.distance(target, place).within(NEAR_M, NEAR_RAD)

    def distance(self, first: np.ndarray, second: np.ndarray) -> Distance:
        """Distance between two poses."""
        return Distance(*pose_distance(first, second))

    def bounds(self, settings: StreamSettings) -> StreamBounds:
        """Bounds of a stream of poses."""
        return StreamBounds(settings)

    def tangent_of_twist(self, twist: np.ndarray) -> np.ndarray:
        """Tangent with a linear and an angular velocity or acceleration."""
        tangent = np.zeros(self.manifold.tangent_size)
        tangent[:3] = twist[:3]
        # Tangents on S³ are half the rotation vector.
        tangent[3:6] = 0.5 * twist[3:6]
        return tangent

    def distances(self, target: np.ndarray, goal: np.ndarray) -> list[float]:
        """Distance of each factor of a reference from a goal: m, rad, geodesic, N and Nm."""
        point = self.point_of(target)
        offset = self.manifold.factor_distances(point.reshape(1, -1), goal.reshape(1, -1))[0]
        # The distance on S³ is half the angle; q and -q are the same orientation.
        offset[1] = min(2.0 * offset[1], 2.0 * (np.pi - offset[1]))
        return [float(item) for item in offset]

    def stiffness_factor(self, numbers: Any) -> np.ndarray:
        """
        Check a stiffness goal (9 or 36 numbers row-major) and return the skill's factor of it.

        :raises ManifoldError: if it is not positive definite or does not fit the skill
        """
        values = np.asarray(numbers, dtype=float).reshape(-1)
        size = self.stiffness_size
        if size == 0:
            raise ManifoldError('the skill has no stiffness, so it has no stiffness goal')
        if values.size == 9 and size == 3:
            return self.manifold.factors[2].check_point(values.reshape(3, 3))
        if values.size != 36:
            expected = '9 or 36' if size == 3 else '36'
            raise ManifoldError(f'stiffness goal has {values.size} numbers, expected {expected}')
        full = SymmetricPositiveDefinite(6).check_point(values.reshape(6, 6))
        if size == 6:
            return full
        scale = 1e-6 * np.abs(full).max()
        if np.abs(full[:3, 3:]).max() > scale:
            raise ManifoldError('stiffness goal couples translation and rotation; this skill '
                                'has a 3×3 translational stiffness only')
        if np.abs(full[3:, 3:] - self.settings.stiffness_matrix[3:, 3:]).max() > scale:
            raise ManifoldError('the rotational block of the stiffness goal differs from the '
                                'parameter rotational_stiffness; this skill can change the 3×3 '
                                'translational stiffness only')
        return np.ascontiguousarray(full[:3, :3])

    def advance(self, rollout: Rollout, dt: float, numbers: np.ndarray, target: np.ndarray
                ) -> None:
        """
        Let ``dt`` seconds pass; write pose, twist, acceleration, 6×6 stiffness and wrench.

        :param rollout: of this skill
        :param numbers: scratch memory, shape ``(rollout.state_size,)``
        """
        numbers[0] = dt
        _advance(rollout.memory, numbers, self._velocity, self._acceleration, self.stiffness_size,
                 self._wrench, target)

    def write_target(self, numbers: np.ndarray, point: int, velocity: int, acceleration: int,
                     target: np.ndarray) -> None:
        """
        Write a reference from the numbers of a state of which this skill is a part.

        :param numbers: of the state (`gdmp_ros.dmp.primitive.State.numbers`)
        :param point: index of the point of this skill in them
        :param velocity: of its velocity
        :param acceleration: of its acceleration
        """
        wrench = point + self.manifold.point_size - 6 if self.has_wrench else 0
        _write_target(numbers, point, velocity, acceleration, self.stiffness_size, wrench, target)


@kernel
def _advance(memory, numbers, velocity, acceleration, stiffness_size, wrench, target):
    """`Rollout.advance_to` and `_write_target` in one call: a call from Python takes 1 µs."""
    advance(memory, numbers)
    _write_target(numbers, 2, velocity, acceleration, stiffness_size, wrench, target)


@kernel
def _write_target(numbers, point, velocity, acceleration, stiffness_size, wrench, target):
    """
    Write the numbers of a state to a target.

    :param numbers: time, phase, point, velocity, acceleration
    :param point: index of the point in them
    :param velocity: index of the velocity in them
    :param acceleration: index of the acceleration in them
    :param wrench: index of the wrench in them; 0 if there is none
    """
    for i in range(7):
        target[POSE + i] = numbers[point + i]
    for i in range(6):
        # Half-angle to rotation vector.
        factor = 1.0 if i < 3 else 2.0
        target[TWIST + i] = factor * numbers[velocity + i]
        target[ACCELERATION + i] = factor * numbers[acceleration + i]
    for i in range(stiffness_size):
        for j in range(stiffness_size):
            target[STIFFNESS + 6 * i + j] = numbers[point + 7 + stiffness_size * i + j]
    if wrench > 0:
        for i in range(6):
            target[WRENCH + i] = numbers[wrench + i]
