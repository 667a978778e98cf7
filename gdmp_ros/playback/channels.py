"""
What a stream is made of: the tool of an arm, or its joints.

A stream is a list of channels. Each knows its slice of the points of a skill and its slice of the
targets, and translates between them. The work of a tick is done by kernels for all channels at
once; they read where everything is from a table of integers, one row for each channel.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    resting_target,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
    WRENCH,
    WRENCH_GAIN,
)
from gdmp_ros.dmp.integrator import advance
from gdmp_ros.errors import DataError, ManifoldError, ParameterError
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.poses import POSE_SIZE
from gdmp_ros.manifolds.quaternion import pose_distance, rotation_between, UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.settings import PlayerSettings

#: A motion starts at the present reference if it is this close to the robot [m, rad].
NEAR_M, NEAR_RAD, NEAR_JOINT_RAD = 0.02, 0.1, 0.05
#: A wrench is that of the goal if it is this close [N, Nm].
WRENCH_TOLERANCE = 0.1
#: A wrench that nothing asks for any more decreases with this time constant [s], to this [N, Nm].
RELEASE_S, RELEASED = 0.1, 1e-3
#: Largest speed and acceleration on the way to the robot: position, rotation, joints.
APPROACH_SPEED = {'position': 0.4, 'rotation': 0.8, 'joints': 0.5}
APPROACH_ACCELERATION = {'position': 2.0, 'rotation': 4.0, 'joints': 2.5}
_AT_REST = 1e-6  # m/s, rad/s
#: Columns of the table of a stream: what a channel is; number of its velocities; indices of its
#: point, velocity and acceleration in the numbers of a state, of its target in the targets, of its
#: velocities among those of all channels; rows of the stiffness in its point (0: none); index of
#: the wrench in the numbers of a state (0: none).
KIND, COUNT, POINT, VELOCITY, STATE_ACCELERATION, TARGET, FIRST, ROWS, WRENCH_AT = range(9)
OF_TOOL, OF_JOINTS = 0, 1


class Tolerances(NamedTuple):
    """Numbers of a roll-out for each factor of a channel (`gdmp_ros.dmp.options.Options`)."""

    tolerances: list[float]
    goal_speed: list[float]
    error_weights: list[float]


class Channel(Protocol):
    """
    One arm of a stream.

    ``point`` and ``target`` are the channel's own parts of the points and targets everywhere.

    :ivar kind: `OF_TOOL` or `OF_JOINTS`
    :ivar place_size: numbers of its place: 7 of a pose, or one for each joint
    :ivar target_size: numbers of its target
    :ivar count: of its velocities
    :ivar rows: of the stiffness in its points; 0 without one
    :ivar has_wrench: whether its points have a wrench
    """

    kind: int
    place_size: int
    target_size: int
    count: int
    rows: int
    has_wrench: bool

    def options(self, tolerances: tuple[float, float] | None) -> Tolerances:
        """Numbers of a roll-out; the tolerances at the goal are in m and rad."""

    def change_stiffness(self, point: np.ndarray, stiffness: np.ndarray) -> None:
        """Write a stiffness (`stiffness_factor`) to a point."""

    def begin(self, point: np.ndarray) -> None:
        """Write what every motion begins with to a point."""

    def place_in(self, target: np.ndarray) -> np.ndarray:
        """Place of a target; a part of it."""

    def point_of(self, target: np.ndarray) -> np.ndarray:
        """Point of a target."""

    def resting(self, place: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Target that rests at a place, with the stiffness of a point."""

    def take_over(self, target: np.ndarray) -> None:
        """Write what a motion does not change to a target."""

    def stop(self, target: np.ndarray) -> None:
        """Let a target rest."""

    def release(self, target: np.ndarray, dt: float) -> bool:
        """Let what no motion asks for decrease; whether there is some left."""

    def tangents_of(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and acceleration of a target, as tangents; zero at rest."""

    def way(self, target: np.ndarray, place: np.ndarray) -> np.ndarray:
        """From a target to a place: one number for each velocity."""

    def distance(self, first: np.ndarray, second: np.ndarray) -> Distance:
        """Distance between two places."""

    def error(self, first: np.ndarray, second: np.ndarray) -> float:
        """Weighted square of the distance between two places (`gdmp_ros.dmp.Rollout.observe`)."""

    def is_near(self, target: np.ndarray, place: np.ndarray) -> bool:
        """Whether a motion may start at a target if the robot is at a place."""

    def stiffness_factor(self, numbers: Any) -> np.ndarray:
        """
        Check a stiffness goal and return what the points have of it.

        :raises ManifoldError: if it does not fit the skill
        """


class ToolChannel:
    """The tool of an arm: pose, stiffness and wrench. See `Channel`."""

    kind, place_size, target_size, count = OF_TOOL, POSE_SIZE, TARGET_SIZE, 6

    def __init__(self, factors: Sequence[Manifold], settings: PlayerSettings):
        """
        Look at the factors.

        :raises DataError: unless they are R³ × S³, followed or not by SPD(3) or SPD(6), and by R⁶
        """
        kinds = [type(f) for f in factors]
        pose = kinds[:2] == [Euclidean, UnitQuaternion] and factors[0].size == 3
        rest = list(factors[2:])
        self.has_wrench = bool(rest) and rest[-1] == Euclidean(6)
        matrix = rest[:-1] if self.has_wrench else rest
        if not pose or (matrix and not (
                len(matrix) == 1 and isinstance(matrix[0], SymmetricPositiveDefinite)
                and matrix[0].size in (3, 6))):
            raise DataError(f'the skill is on {" x ".join(map(repr, factors))}; a pose reference '
                            'needs R³ × S³, with SPD(3) or SPD(6) for a stiffness and R⁶ for a '
                            'wrench')
        self._factors, self._settings = factors, settings
        self.rows = matrix[0].size if matrix else 0
        self._stiffness = slice(7, 7 + self.rows ** 2)
        self._tangent_size = sum(factor.tangent_size for factor in factors)

    def options(self, tolerances: tuple[float, float] | None) -> Tolerances:
        """Numbers of a roll-out; the tolerances at the goal are in m and rad."""
        settings, count = self._settings, len(self._factors)
        limits = [factor.goal_tolerance for factor in self._factors]
        if tolerances is not None:
            limits[:2] = tolerances[0], 0.5 * tolerances[1]
        if self.has_wrench:
            limits[-1] = WRENCH_TOLERANCE
        # Distances on S³ are half-angles.
        position_weight, rotation_weight = settings.phase_stopping_weights
        return Tolerances(
            limits, [settings.goal_speed or np.inf, 0.5 * settings.goal_angular_speed or np.inf,
                     np.inf, np.inf][:count],
            [position_weight, 4.0 * rotation_weight, 0.0, 0.0][:count])

    def change_stiffness(self, point: np.ndarray, stiffness: np.ndarray) -> None:
        """Write a stiffness (`stiffness_factor`) to a point."""
        if self.rows:
            point[self._stiffness] = stiffness.reshape(-1)

    def begin(self, point: np.ndarray) -> None:
        """Write what every motion begins with to a point: no wrench."""
        if self.has_wrench:
            point[-6:] = 0.0

    def place_in(self, target: np.ndarray) -> np.ndarray:
        """Pose of a target; a part of it."""
        return target[POSE:POSE + 7]

    def point_of(self, target: np.ndarray) -> np.ndarray:
        """Point of a target."""
        block = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)[:self.rows, :self.rows]
        return np.concatenate([target[POSE:POSE + 7], block.reshape(-1),
                               target[WRENCH:WRENCH + 6] if self.has_wrench else ()])

    def resting(self, place: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Target that rests at a pose, with the stiffness of a point."""
        stiffness = self._settings.stiffness_matrix
        if self.rows:
            stiffness[:self.rows, :self.rows] = start[self._stiffness].reshape(self.rows, -1)
        return resting_target(place, stiffness, self._settings.damping_ratio)

    def take_over(self, target: np.ndarray) -> None:
        """Write what a motion does not change to a target."""
        if self.rows < 6:
            # With SPD(3) the skill changes the translational block only.
            target[STIFFNESS:STIFFNESS + 36] = self._settings.stiffness_matrix.reshape(-1)
        target[DAMPING_RATIO] = self._settings.damping_ratio
        target[WRENCH_GAIN:] = self._settings.wrench_gain if self.has_wrench else 0.0

    def stop(self, target: np.ndarray) -> None:
        """Let a target rest."""
        target[TWIST:STIFFNESS] = 0.0

    def release(self, target: np.ndarray, dt: float) -> bool:
        """Let a wrench that no motion asks for decrease; whether there is some left."""
        wrench = target[WRENCH:WRENCH + 6]
        wrench *= max(1.0 - dt / RELEASE_S, 0.0)
        if np.abs(wrench).max() > RELEASED:
            return True
        target[WRENCH:] = 0.0
        return False

    def tangents_of(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and acceleration of a target, as tangents; zero at rest."""
        if np.abs(target[TWIST:TWIST + 6]).max() < _AT_REST:
            return np.zeros(self._tangent_size), np.zeros(self._tangent_size)
        return (self.tangent_of_twist(target[TWIST:TWIST + 6]),
                self.tangent_of_twist(target[ACCELERATION:ACCELERATION + 6]))

    def tangent_of_twist(self, twist: np.ndarray) -> np.ndarray:
        """Tangent with a linear and an angular velocity or acceleration."""
        tangent = np.zeros(self._tangent_size)
        tangent[:3] = twist[:3]
        # Tangents on S³ are half the rotation vector.
        tangent[3:6] = 0.5 * twist[3:6]
        return tangent

    def way(self, target: np.ndarray, place: np.ndarray) -> np.ndarray:
        """From a target to a pose: displacement and rotation vector."""
        result = np.empty(6)
        result[:3] = place[:3] - target[POSE:POSE + 3]
        rotation_between(target[POSE + 3:POSE + 7], np.ascontiguousarray(place[3:7]), result[3:])
        return result

    def distance(self, first: np.ndarray, second: np.ndarray) -> Distance:
        """Distance between two poses."""
        return Distance(*pose_distance(first, second))

    def error(self, first: np.ndarray, second: np.ndarray) -> float:
        """Weighted square of the distance between two poses."""
        distance, weights = self.distance(first, second), self._settings.phase_stopping_weights
        return weights[0] * distance.position ** 2 + weights[1] * distance.rotation ** 2

    def is_near(self, target: np.ndarray, place: np.ndarray) -> bool:
        """Whether a motion may start at a target if the robot is at a pose."""
        return self.distance(self.place_in(target), place).within(NEAR_M, NEAR_RAD)

    def stiffness_factor(self, numbers: Any) -> np.ndarray:
        """
        Check a stiffness goal (9 or 36 numbers row-major) and return what the points have of it.

        :raises ManifoldError: if it is not positive definite or does not fit the skill
        """
        values = np.asarray(numbers, dtype=float).reshape(-1)
        size = self.rows
        if size == 0:
            raise ManifoldError('the skill has no stiffness, so it has no stiffness goal')
        matrix = self._factors[2]
        if values.size == 9 and size == 3:
            return matrix.check_point(values.reshape(3, 3))
        if values.size != 36:
            expected = ('9 or 36 (9: the 3×3 translational stiffness)' if size == 3
                        else '36')
            raise ManifoldError(f'stiffness goal has {values.size} numbers, expected {expected}')
        full = SymmetricPositiveDefinite(6).check_point(values.reshape(6, 6))
        if size == 6:
            return full
        scale = 1e-6 * np.abs(full).max()
        instead = '; or give 9 numbers, the 3×3 translational stiffness'
        if np.abs(full[:3, 3:]).max() > scale:
            raise ManifoldError('stiffness goal couples translation and rotation; this skill '
                                'has a 3×3 translational stiffness only: expected 0 '
                                f'there{instead}')
        own = self._settings.stiffness_matrix[3:, 3:]
        if np.abs(full[3:, 3:] - own).max() > scale:
            diagonal = ', '.join(f'{number:g}' for number in own.diagonal())
            raise ManifoldError(
                'the rotational block of the stiffness goal differs from the parameter '
                'rotational_stiffness; this skill can change the 3×3 translational stiffness '
                f'only: expected diag({diagonal}) Nm/rad there{instead}')
        return np.ascontiguousarray(full[:3, :3])


class JointChannel:
    """The joints of an arm; targets are followed by the accelerations. See `Channel`."""

    kind, rows, has_wrench = OF_JOINTS, 0, False

    def __init__(self, factor: Manifold, settings: PlayerSettings):
        """:raises ParameterError: if the stiffness of the joints is of another number of them"""
        n = self.place_size = self.count = factor.point_size
        self.target_size = 4 * n + 1
        given = np.array(settings.joint_stiffness, dtype=float)
        if given.shape not in ((1,), (n,)):
            raise ParameterError(f'joint_stiffness has {given.size} numbers, expected 1 or {n}')
        self._factor, self._settings = factor, settings
        self._stiffness = np.broadcast_to(given, n).copy()

    def options(self, tolerances: tuple[float, float] | None) -> Tolerances:
        """Numbers of a roll-out; the tolerance of the rotation is that of each joint."""
        limit = self._factor.goal_tolerance if tolerances is None else tolerances[1]
        return Tolerances([limit], [self._settings.goal_angular_speed or np.inf],
                          [self._settings.phase_stopping_weights[1]])

    def change_stiffness(self, point: np.ndarray, stiffness: np.ndarray) -> None:
        """Write a stiffness to a point: it has none."""

    def begin(self, point: np.ndarray) -> None:
        """Write what every motion begins with to a point: nothing."""

    def place_in(self, target: np.ndarray) -> np.ndarray:
        """Positions of a target; a part of it."""
        return target[:self.count]

    def point_of(self, target: np.ndarray) -> np.ndarray:
        """Point of a target."""
        return target[:self.count].copy()

    def resting(self, place: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Target that rests at positions of the joints."""
        return np.concatenate([
            resting_joints(np.asarray(place, dtype=float), self._stiffness,
                           self._settings.damping_ratio), np.zeros(self.count)])

    def take_over(self, target: np.ndarray) -> None:
        """Write what a motion does not change to a target."""
        target[2 * self.count:3 * self.count] = self._stiffness
        target[3 * self.count] = self._settings.damping_ratio

    def stop(self, target: np.ndarray) -> None:
        """Let a target rest."""
        target[self.count:2 * self.count] = target[3 * self.count + 1:] = 0.0

    def release(self, target: np.ndarray, dt: float) -> bool:
        """Nothing is to decrease."""
        return False

    def tangents_of(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and acceleration of a target; zero at rest."""
        velocity = target[self.count:2 * self.count]
        if np.abs(velocity).max() < _AT_REST:
            return np.zeros(self.count), np.zeros(self.count)
        return velocity.copy(), target[3 * self.count + 1:].copy()

    def way(self, target: np.ndarray, place: np.ndarray) -> np.ndarray:
        """From a target to positions of the joints."""
        return np.asarray(place - target[:self.count])

    def distance(self, first: np.ndarray, second: np.ndarray) -> Distance:
        """Distance between two postures: the largest of a joint."""
        return Distance(0.0, float(np.abs(first - second).max()))

    def error(self, first: np.ndarray, second: np.ndarray) -> float:
        """Weighted square of the distance between two postures."""
        way = first - second
        return float(self._settings.phase_stopping_weights[1] * (way @ way))

    def is_near(self, target: np.ndarray, place: np.ndarray) -> bool:
        """Whether a motion may start at a target if the robot is at a posture."""
        return self.distance(self.place_in(target), place).rotation < NEAR_JOINT_RAD

    def stiffness_factor(self, numbers: Any) -> np.ndarray:
        """:raises ManifoldError: always"""
        raise ManifoldError('a skill of the joints has no stiffness goal')


@kernel
def advance_references(memory, numbers, table, targets):
    """
    Advance a roll-out, and write the targets of all channels.

    One kernel: a call from Python takes 1 µs.

    :param memory: of the roll-out
    :param numbers: the time to pass [s] first; becomes the state
    :param table: see `KIND`
    """
    advance(memory, numbers)
    for row in table:
        at, point, velocity, acceleration = (
            row[TARGET], row[POINT], row[VELOCITY], row[STATE_ACCELERATION])
        n = row[COUNT]
        if row[KIND] == OF_JOINTS:
            for i in range(n):
                targets[at + i] = numbers[point + i]
                targets[at + n + i] = numbers[velocity + i]
                targets[at + 3 * n + 1 + i] = numbers[acceleration + i]
            continue
        for i in range(7):
            targets[at + POSE + i] = numbers[point + i]
        for i in range(6):
            # Half-angle to rotation vector.
            factor = 1.0 if i < 3 else 2.0
            targets[at + TWIST + i] = factor * numbers[velocity + i]
            targets[at + ACCELERATION + i] = factor * numbers[acceleration + i]
        size = row[ROWS]
        for i in range(size):
            for j in range(size):
                targets[at + STIFFNESS + 6 * i + j] = numbers[point + 7 + size * i + j]
        if row[WRENCH_AT] > 0:
            for i in range(6):
                targets[at + WRENCH + i] = numbers[row[WRENCH_AT] + i]
