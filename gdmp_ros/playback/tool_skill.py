"""A skill as a source of impedance references: where pose, stiffness, wrench are in its points."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gdmp_ros.control.reference_check import LARGEST_WRENCH_GAIN
from gdmp_ros.control.target import (
    ACCELERATION,
    POSE,
    resting_target,
    STIFFNESS,
    TWIST,
    WRENCH,
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
from gdmp_ros.util.settings import setting

#: A motion starts at the present reference if it is this close to the measured pose [m, rad].
NEAR_M, NEAR_RAD = 0.02, 0.1
#: A wrench is that of the goal if it is this close [N, Nm].
WRENCH_TOLERANCE = 0.1


@dataclass(frozen=True)
class PlayerSettings:
    """What a reference needs besides the skill."""

    damping_ratio: float = setting(
        0.7, 'damping ratio of the reference; 1 is critical', '', 0.0, 2.0)
    stiffness: tuple[float, float, float] = setting(
        (400.0, 400.0, 400.0), 'translational stiffness if the skill has none', 'N/m', 1.0, 5000.0)
    rotational_stiffness: tuple[float, float, float] = setting(
        (30.0, 30.0, 30.0), 'rotational stiffness if the skill has none', 'Nm/rad', 0.1, 500.0)
    wrench_gain: float = setting(
        0.0, 'rate at which the measured wrench is corrected to that of the skill, if it has one; '
        '0: never', '1/s', 0.0, LARGEST_WRENCH_GAIN)
    speed_rate: float = setting(5.0, 'largest rate of change of the tempo', '1/s', 0.1, 100.0)
    goal_speed: float = setting(
        0.0, 'largest speed of the goal position after a goal switch; 0: no limit', 'm/s', 0.0,
        10.0)
    goal_angular_speed: float = setting(
        0.0, 'largest angular speed of the goal orientation after a goal switch; 0: no limit',
        'rad/s', 0.0, 50.0)
    phase_stopping: float = setting(
        1.0, 'kappa: the tempo is divided by 1 + kappa e^2 while the measured pose lags behind; '
        '0: never', '', 0.0, 1000.0)
    phase_stopping_weights: tuple[float, float] = setting(
        (400.0, 4.0), 'weights in e^2: first x position error^2 [m^2] + second x rotation '
        'error^2 [rad^2]', '1/m^2, 1/rad^2', 0.0, 1e6)

    @property
    def stiffness_matrix(self) -> np.ndarray:
        """6×6 stiffness for skills without one; its rotational block is also used with SPD(3)."""
        return np.diag([*self.stiffness, *self.rotational_stiffness])


class ToolSkill:
    """
    A skill of a pose, with or without stiffness and wrench; other manifolds are refused.

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
        self.skill = skill
        self.manifold = skill.manifold
        self.stiffness_size = matrix[0].size if matrix else 0
        self.settings = settings
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

    def changed(self, point: np.ndarray, pose: np.ndarray | None = None,
                stiffness: np.ndarray | None = None) -> np.ndarray:
        """Point with another pose (x, y, z, qw, qx, qy, qz) or stiffness factor."""
        parts = list(self.manifold.split(point))
        if pose is not None:
            parts[:2] = pose[:3], pose[3:7]
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

    def start_at(self, pose: np.ndarray | None) -> np.ndarray | None:
        """
        Point with a pose and the skill's initial stiffness, without a wrench.

        :returns: None for the skill's own start
        """
        if pose is None:
            return None
        parts = list(self.manifold.split(self.changed(self.skill.start, pose)))
        if self.has_wrench:
            parts[-1] = np.zeros(6)
        return self.manifold.join(*parts)

    def first_target(self, pose: np.ndarray) -> np.ndarray:
        """Reference that rests at a pose, with the initial stiffness of the skill."""
        stiffness, size = self.settings.stiffness_matrix, self.stiffness_size
        if size:
            stiffness[:size, :size] = self.manifold.split(self.skill.start)[2]
        return resting_target(pose, stiffness, self.settings.damping_ratio)

    def tangent_of(self, target: np.ndarray, first: int) -> np.ndarray:
        """Tangent with the velocity or acceleration that begins at an index of a reference."""
        return self.tangent_of_twist(target[first:first + 6])

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
        away = self.manifold.factor_distances(point.reshape(1, -1), goal.reshape(1, -1))[0]
        # The distance on S³ is half the angle; q and -q are the same orientation.
        away[1] = min(2.0 * away[1], 2.0 * (np.pi - away[1]))
        return [float(one) for one in away]

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


def is_near(target: np.ndarray, measured: np.ndarray) -> bool:
    """Whether a reference is so close to the measured pose that a motion may start there."""
    distance, angle = pose_distance(target, measured)
    return bool(distance < NEAR_M and angle < NEAR_RAD)


@kernel
def _advance(memory, numbers, velocity, acceleration, stiffness_size, wrench, target):
    """`Rollout.advance_to` and `_write_target` in one call: a call from Python takes 1 µs."""
    advance(memory, numbers)
    _write_target(numbers, velocity, acceleration, stiffness_size, wrench, target)


@kernel
def _write_target(numbers, velocity, acceleration, stiffness_size, wrench, target):
    """
    Write the numbers of a state to a target.

    :param numbers: time, phase, point, velocity, acceleration
    :param velocity: index of the velocity in them
    :param acceleration: index of the acceleration in them
    :param wrench: index of the wrench in them; 0 if there is none
    """
    for i in range(7):
        target[POSE + i] = numbers[2 + i]
    for i in range(6):
        # Half-angle to rotation vector.
        factor = 1.0 if i < 3 else 2.0
        target[TWIST + i] = factor * numbers[velocity + i]
        target[ACCELERATION + i] = factor * numbers[acceleration + i]
    for i in range(stiffness_size):
        for j in range(stiffness_size):
            target[STIFFNESS + 6 * i + j] = numbers[9 + stiffness_size * i + j]
    if wrench > 0:
        for i in range(6):
            target[WRENCH + i] = numbers[wrench + i]
