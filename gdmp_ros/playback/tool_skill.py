"""A skill as a source of impedance references: where pose and stiffness lie in its points."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gdmp_ros.control.target import ACCELERATION, POSE, resting_target, STIFFNESS, TWIST
from gdmp_ros.dmp.integrator import advance
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ManifoldError
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import rotation_angles, UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.util.settings import setting

#: A motion starts at the present reference if it is this close to the measured pose [m, rad].
NEAR_M, NEAR_RAD = 0.02, 0.1


@dataclass(frozen=True)
class PlayerSettings:
    """What a reference needs besides the skill."""

    damping_ratio: float = setting(
        0.7, 'damping ratio of the reference; 1 is critical', '', 0.0, 2.0)
    stiffness: tuple[float, float, float] = setting(
        (400.0, 400.0, 400.0), 'translational stiffness if the skill has none', 'N/m', 1.0, 5000.0)
    rotational_stiffness: tuple[float, float, float] = setting(
        (30.0, 30.0, 30.0), 'rotational stiffness if the skill has none', 'Nm/rad', 0.1, 500.0)
    speed_rate: float = setting(5.0, 'largest rate of change of the tempo', '1/s', 0.1, 100.0)
    goal_speed: float = setting(
        0.0, 'largest speed of the goal position after a goal switch; 0: no limit', 'm/s', 0.0,
        10.0)
    goal_angular_speed: float = setting(
        0.0, 'largest angular speed of the goal orientation after a goal switch; 0: no limit',
        'rad/s', 0.0, 50.0)
    phase_stopping: float = setting(
        0.0, 'kappa: the tempo is divided by 1 + kappa e^2 while the measured pose lags behind; '
        '0: never', '', 0.0, 1000.0)
    phase_stopping_weights: tuple[float, float] = setting(
        (400.0, 4.0), 'weights in e^2: first x position error^2 [m^2] + second x rotation '
        'error^2 [rad^2]', '1/m^2, 1/rad^2', 0.0, 1e6)

    @property
    def stiffness_matrix(self) -> np.ndarray:
        """6×6 stiffness for skills without one; its rotational block is also used with SPD(3)."""
        return np.diag([*self.stiffness, *self.rotational_stiffness])


class ToolSkill:
    """A skill of pose and stiffness; other manifolds are refused."""

    def __init__(self, skill: Skill, settings: PlayerSettings):
        """:raises DataError: unless the skill is on R³ × S³, with or without SPD(3) or SPD(6)"""
        factors = skill.manifold.factors
        kinds = [type(f) for f in factors]
        pose = kinds[:2] == [Euclidean, UnitQuaternion] and factors[0].size == 3
        rest = factors[2:]
        matrix = (len(rest) == 1 and isinstance(rest[0], SymmetricPositiveDefinite)
                  and rest[0].size in (3, 6))
        if not pose or (rest and not matrix) or not isinstance(skill.manifold, Product):
            raise DataError(f'the skill is on {skill.manifold!r}; a pose reference needs '
                            'R³ × S³, R³ × S³ × SPD(3) or R³ × S³ × SPD(6)')
        self.skill = skill
        self.manifold = skill.manifold
        self.stiffness_size = rest[0].size if rest else 0
        self.settings = settings
        self._velocity = 2 + skill.manifold.point_size
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
                      np.inf)
        limits = None
        if tolerances is not None:
            limits = [tolerances[0], 0.5 * tolerances[1],
                      *(factor.goal_tolerance for factor in self.manifold.factors[2:])]
        position_weight, rotation_weight = settings.phase_stopping_weights
        weights = (position_weight, 4.0 * rotation_weight, 0.0)
        return Options(speed, settings.speed_rate, limits, goal_speed[:count],
                       settings.phase_stopping, weights[:count])

    def point(self, pose: np.ndarray, stiffness: np.ndarray | None) -> np.ndarray:
        """Join (x, y, z, qw, qx, qy, qz) and the stiffness factor to a point."""
        parts = [pose[:3], pose[3:7]]
        if self.stiffness_size and stiffness is not None:
            parts.append(stiffness)
        return self.manifold.join(*parts)

    def start_at(self, pose: np.ndarray | None) -> np.ndarray | None:
        """Point with a pose and the skill's initial stiffness; None for the skill's own start."""
        if pose is None:
            return None
        _, _, *stiffness = self.manifold.split(self.skill.start)
        return self.point(pose, stiffness[0] if stiffness else None)

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

    def stiffness_of(self, target: np.ndarray) -> np.ndarray | None:
        """The stiffness factor of a reference; None if the skill has no stiffness."""
        size = self.stiffness_size
        if not size:
            return None
        matrix = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)[:size, :size]
        return np.ascontiguousarray(matrix)

    def distances(self, target: np.ndarray, goal: np.ndarray) -> list[float]:
        """Distance of each factor of a reference from a goal: m, rad, geodesic."""
        point, matrix = np.empty((1, self.manifold.point_size)), self.stiffness_of(target)
        point[0, :7] = target[POSE:POSE + 7]
        if matrix is not None:
            point[0, 7:] = matrix.reshape(-1)
        away = self.manifold.factor_distances(point, goal.reshape(1, -1))[0]
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
        Let ``dt`` seconds pass; write the state as pose, twist, acceleration and 6×6 stiffness.

        :param rollout: of this skill
        :param numbers: scratch memory, shape ``(rollout.state_size,)``
        """
        numbers[0] = dt
        _advance(rollout.memory, numbers, self._velocity, self._acceleration, self.stiffness_size,
                 target)


def is_near(target: np.ndarray, measured: np.ndarray) -> bool:
    """Whether a reference is so close to the measured pose that a motion may start there."""
    return bool(np.linalg.norm(target[:3] - measured[:3]) < NEAR_M
                and rotation_angles(target[3:7], measured[3:7]) < NEAR_RAD)


@kernel
def _advance(memory, numbers, velocity, acceleration, stiffness_size, target):
    """`Rollout.advance_to` and `_write_target` in one call: a call from Python takes 1 µs."""
    advance(memory, numbers)
    _write_target(numbers, velocity, acceleration, stiffness_size, target)


@kernel
def _write_target(numbers, velocity, acceleration, stiffness_size, target):
    """
    Write the numbers of a state to a target.

    :param numbers: time, phase, point, velocity, acceleration
    :param velocity: index of the velocity in them
    :param acceleration: index of the acceleration in them
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
