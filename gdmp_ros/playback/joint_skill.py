"""
A skill of the joints as a source of references of the joints.

Its targets are those of `gdmp_ros.control.joint_target`, followed by the accelerations.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.dmp.integrator import advance
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ManifoldError, ParameterError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.playback.bounds import JointBounds
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill

#: A motion starts at the present reference if no joint is further from it than this [rad].
NEAR_RAD = 0.05
#: Largest speed of a joint on the way to the robot [rad/s].
SPEED = 0.5
_AT_REST = 1e-6  # rad/s


def is_of_joints(skill: Skill) -> bool:
    """Whether a skill is one of the joints: R^n with the factor ``joints``."""
    return skill.manifold.names == ('joints',) and isinstance(skill.manifold.factors[0], Euclidean)


class JointApproach:
    """A straight motion of the joints from rest to rest."""

    def __init__(self, start: np.ndarray, end: np.ndarray):
        self._start, self._way, self._time = start.copy(), end - start, 0.0
        # A cubic has 1.5 times its mean speed in the middle.
        self._seconds = max(1.5 * float(np.abs(self._way).max()) / SPEED, 1e-3)

    def advance(self, dt: float, target: np.ndarray) -> bool:
        """Let ``dt`` seconds pass and write the target; whether the end is reached."""
        n = len(self._start)
        self._time += dt
        x = min(self._time / self._seconds, 1.0)
        target[:n] = self._start + x * x * (3.0 - 2.0 * x) * self._way
        target[n:2 * n] = 6.0 * x * (1.0 - x) / self._seconds * self._way
        target[3 * n + 1:] = (6.0 - 12.0 * x) / self._seconds ** 2 * self._way
        if x < 1.0:
            return False
        target[n:2 * n] = target[3 * n + 1:] = 0.0
        return True


class JointSkill(StreamedSkill):
    """A skill on R^n with the factor ``joints``; its places are positions of the joints [rad]."""

    kind = Kind.JOINTS

    def __init__(self, skill: Skill, settings: PlayerSettings):
        """:raises DataError: unless the manifold is R^n with the factor ``joints``"""
        super().__init__(skill, settings)
        if not is_of_joints(skill):
            raise DataError(f'the skill is on {skill.manifold!r}, expected R^n of the joints')
        n = self._n = skill.manifold.point_size
        given = np.array(settings.joint_stiffness, dtype=float)
        if given.shape not in ((1,), (n,)):
            raise ParameterError(f'joint_stiffness has {given.size} numbers, expected 1 or {n}')
        self._stiffness = np.broadcast_to(given, n).copy()

    def options(self, speed: float, tolerances: tuple[float, float] | None) -> Options:
        """Options of a roll-out; the tolerance of the rotation is that of each joint."""
        settings = self.settings
        limit = self.manifold.factors[0].goal_tolerance if tolerances is None else tolerances[1]
        return Options(speed, settings.speed_rate, [limit],
                       (settings.goal_angular_speed or np.inf,), settings.phase_stopping,
                       (settings.phase_stopping_weights[1],))

    def changed(self, point: np.ndarray, place: np.ndarray | None = None,
                stiffness: np.ndarray | None = None) -> np.ndarray:
        """Point with another place or stiffness."""
        return np.array(point if place is None else place)

    def place_of(self, point: np.ndarray) -> np.ndarray:
        """Place of a point."""
        return np.array(point)

    def place_in(self, target: np.ndarray) -> np.ndarray:
        """Place of a reference; a part of it."""
        return target[:self._n]

    def point_of(self, target: np.ndarray) -> np.ndarray:
        """Point of a reference."""
        return target[:self._n].copy()

    def start_at(self, place: np.ndarray | None) -> np.ndarray | None:
        """Point at which a motion starts at a place; None for the skill's own start."""
        return place

    def first_target(self, place: np.ndarray) -> np.ndarray:
        """Reference that rests at a place."""
        return np.concatenate([
            resting_joints(np.asarray(place, dtype=float), self._stiffness,
                           self.settings.damping_ratio), np.zeros(self._n)])

    def take_over(self, target: np.ndarray) -> None:
        """Write what a motion of this skill does not change to a reference."""
        target[2 * self._n:3 * self._n] = self._stiffness
        target[3 * self._n] = self.settings.damping_ratio

    def stop(self, target: np.ndarray) -> None:
        """Let a reference rest."""
        target[self._n:2 * self._n] = target[3 * self._n + 1:] = 0.0

    def motion_of(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Velocity and acceleration of a reference as tangents; None at rest."""
        velocity = target[self._n:2 * self._n]
        if np.abs(velocity).max() < _AT_REST:
            return None
        return velocity.copy(), target[3 * self._n + 1:].copy()

    def tangent_of_twist(self, twist: np.ndarray) -> np.ndarray:
        """:raises ManifoldError: always: a goal of the joints does not move on with a twist"""
        raise ManifoldError('a skill of the joints does not follow a goal that moves on')

    def approach(self, target: np.ndarray, place: np.ndarray) -> JointApproach:
        """Motion from a reference at rest to a place."""
        return JointApproach(target[:self._n], place)

    def is_near(self, target: np.ndarray, place: np.ndarray) -> bool:
        """Whether a reference is so close to where the robot is that a motion may start there."""
        return self.distance(target[:self._n], place).rotation < NEAR_RAD

    def distance(self, first: np.ndarray, second: np.ndarray) -> Distance:
        """Distance between two places."""
        return Distance(0.0, float(np.abs(first - second).max()))

    def distances(self, target: np.ndarray, goal: np.ndarray) -> list[float]:
        """Largest distance of a joint from its goal [rad]."""
        return [self.distance(target[:self._n], goal).rotation]

    def stiffness_factor(self, numbers: Any) -> np.ndarray:
        """:raises ManifoldError: always"""
        raise ManifoldError('a skill of the joints has no stiffness goal')

    def bounds(self, settings: StreamSettings) -> JointBounds:
        """Bounds of a stream of its references."""
        return JointBounds(settings, self._n)

    def advance(self, rollout: Rollout, dt: float, numbers: np.ndarray, target: np.ndarray
                ) -> None:
        """Let ``dt`` seconds pass and write the reference."""
        n = self._n
        numbers[0] = dt
        advance(rollout.memory, numbers)
        # Time, phase, point, velocity, acceleration.
        target[:2 * n] = numbers[2:2 + 2 * n]
        target[3 * n + 1:] = numbers[2 + 2 * n:2 + 3 * n]
