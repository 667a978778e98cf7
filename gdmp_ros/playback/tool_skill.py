"""A skill seen as an impedance reference: where pose and stiffness lie in its points."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gdmp_ros.control.impedance import ACCELERATION, POSE, STIFFNESS, TWIST
from gdmp_ros.dmp import Options, Skill, State
from gdmp_ros.errors import DataError, ManifoldError
from gdmp_ros.manifolds import Euclidean, Product, SymmetricPositiveDefinite, UnitQuaternion


@dataclass(frozen=True)
class PlayerSettings:
    """
    What completes a skill to an impedance reference.

    :ivar stiffness: 6×6 used where the skill has none; its rotational block also goes with SPD(3)
    :ivar damping_ratio: 1 is critical
    :ivar speed_rate: largest change of the tempo [1/s]
    :ivar goal_speed: fastest a goal position moves after a switch [m/s]; 0 for no limit
    :ivar goal_turn_speed: fastest a goal orientation turns [rad/s]; 0 for no limit
    :ivar phase_stopping: κ of `gdmp_ros.dmp.Rollout.observe`
    :ivar error_weights: of the squared position [1/m²] and rotation error [1/rad²] in it
    """

    stiffness: np.ndarray
    damping_ratio: float = 0.7
    speed_rate: float = 5.0
    goal_speed: float = 0.0
    goal_turn_speed: float = 0.0
    phase_stopping: float = 0.0
    error_weights: tuple[float, float] = (400.0, 4.0)


class ToolSkill:
    """Where pose and stiffness lie in a skill's points; refuses other manifolds."""

    def __init__(self, skill: Skill, settings: PlayerSettings):
        """:raises DataError: unless the skill is on R³ × S³, with or without SPD(3) or SPD(6)"""
        factors = skill.manifold.factors
        kinds = [type(f) for f in factors]
        pose = kinds[:2] == [Euclidean, UnitQuaternion] and factors[0].m == 3
        rest = factors[2:]
        matrix = (len(rest) == 1 and isinstance(rest[0], SymmetricPositiveDefinite)
                  and rest[0].m in (3, 6))
        if not pose or (rest and not matrix) or not isinstance(skill.manifold, Product):
            raise DataError(f'the skill is on {skill.manifold!r}; a pose reference needs '
                            'R³ × S³, R³ × S³ × SPD(3) or R³ × S³ × SPD(6)')
        self.skill = skill
        self.manifold = skill.manifold
        self.stiffness_size = rest[0].m if rest else 0
        self.settings = settings

    def options(self, speed: float, tolerances: tuple[float, float] | None) -> Options:
        """
        Options of a roll-out of the skill.

        :param speed: tempo to begin with
        :param tolerances: at the goal [m, rad]
        """
        settings, count = self.settings, len(self.manifold.factors)
        # Turns are half-angles on S³.
        goal_speed = (settings.goal_speed or np.inf, 0.5 * settings.goal_turn_speed or np.inf,
                      np.inf)
        limits = None
        if tolerances is not None:
            limits = [tolerances[0], 0.5 * tolerances[1], 0.0025][:count]
        weights = (settings.error_weights[0], 4.0 * settings.error_weights[1], 0.0)
        return Options(speed, settings.speed_rate, limits, goal_speed[:count],
                       settings.phase_stopping, weights[:count])

    def point(self, pose: np.ndarray, stiffness: np.ndarray | None) -> np.ndarray:
        """Join (x, y, z, qw, qx, qy, qz) and the stiffness factor to a point."""
        parts = [pose[:3], pose[3:7]]
        if self.stiffness_size and stiffness is not None:
            parts.append(stiffness)
        return self.manifold.join(*parts)

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
            raise ManifoldError('stiffness goal couples translation and rotation; this skill has '
                                'a 3×3 translational stiffness only')
        if np.abs(full[3:, 3:] - self.settings.stiffness[3:, 3:]).max() > scale:
            raise ManifoldError('stiffness goal has another rotational block than the parameter '
                                'rotational_stiffness; this skill can change the 3×3 '
                                'translational stiffness only')
        return np.ascontiguousarray(full[:3, :3])

    def fill(self, state: State, target: np.ndarray) -> None:
        """Write a state as pose, twist, acceleration and 6×6 stiffness."""
        point, v, a = state.point, state.velocity, state.acceleration
        target[POSE:POSE + 7] = point[:7]
        target[TWIST:TWIST + 6] = v[:6]
        target[ACCELERATION:ACCELERATION + 6] = a[:6]
        # Half-angle to rotation vector.
        target[TWIST + 3:TWIST + 6] *= 2.0
        target[ACCELERATION + 3:ACCELERATION + 6] *= 2.0
        if self.stiffness_size == 6:
            target[STIFFNESS:STIFFNESS + 36] = point[7:]
        elif self.stiffness_size == 3:
            target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)[:3, :3] = point[7:].reshape(3, 3)
