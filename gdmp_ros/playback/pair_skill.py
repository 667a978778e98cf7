"""
A skill of two arms as a source of references: its points are those of two skills of a tool.

Its targets are two of `gdmp_ros.control.target`, one after the other, and its places two poses.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.dmp.changes import half, related
from gdmp_ros.dmp.integrator import advance
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ManifoldError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.poses import POSE_SIZE
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.playback.streamed_skill import Bounds, Kind, StreamedSkill, Way
from gdmp_ros.playback.tool_skill import ToolSkill


def is_of_two_arms(skill: Skill) -> bool:
    """Whether a skill has the poses of two tools: its second half begins as the first one does."""
    factors = skill.manifold.factors
    count = len(factors) // 2
    pose = [Euclidean(3), UnitQuaternion()]
    return (isinstance(skill.manifold, Product) and len(factors) % 2 == 0
            and list(factors[:2]) == pose and list(factors[count:count + 2]) == pose)


def one_of_two(pose: np.ndarray, side: int) -> np.ndarray:
    """
    Place of two tools of which the other one follows the couplings: its numbers are NaN.

    :param side: of the tool that is at the pose: 0 or 1
    """
    place = np.full(2 * POSE_SIZE, np.nan)
    place[side * POSE_SIZE:(side + 1) * POSE_SIZE] = pose
    return place


class PairSkill(StreamedSkill):
    """
    A skill of two tools.

    :ivar sides: both as skills of a tool
    """

    kind = Kind.TWO_TOOLS

    def __init__(self, skill: Skill, settings: PlayerSettings):
        """:raises DataError: unless both halves are skills of a tool"""
        super().__init__(skill, settings)
        if not is_of_two_arms(skill):
            raise DataError(f'the skill is on {skill.manifold!r}, expected the poses of two tools')
        self.sides = [ToolSkill(half(skill, number), settings) for number in (0, 1)]
        self._points = self.sides[0].manifold.point_size
        tangents = self.sides[0].manifold.tangent_size
        velocity = 2 + skill.manifold.point_size
        # Where point, velocity and acceleration of each side are among the numbers of a state.
        self._parts = [(2, velocity, velocity + skill.manifold.tangent_size)]
        self._parts.append((2 + self._points, velocity + tangents,
                            velocity + skill.manifold.tangent_size + tangents))

    def _halves(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return point[:self._points], point[self._points:]

    def options(self, speed: float, tolerances: tuple[float, float] | None) -> Options:
        """Options of a roll-out of the skill."""
        first, second = (side.options(speed, tolerances) for side in self.sides)
        return Options(speed, first.speed_rate,
                       [*(first.tolerances or ()), *(second.tolerances or ())],
                       [*(first.goal_speed or ()), *(second.goal_speed or ())],
                       first.phase_stopping,
                       [*(first.error_weights or ()), *(second.error_weights or ())])

    def changed(self, point: np.ndarray, place: np.ndarray | None = None,
                stiffness: np.ndarray | None = None) -> np.ndarray:
        """
        Point with other poses: of both tools, or of one, which the other one follows.

        :param place: of both, or `one_of_two`
        :param stiffness: of both
        """
        places: list[np.ndarray | None] = [None, None]
        if place is not None:
            places = [None if np.isnan(item[0]) else item
                      for item in (place[:POSE_SIZE], place[POSE_SIZE:])]
        moved = np.concatenate([side.changed(part, to, stiffness) for side, part, to in zip(
            self.sides, self._halves(point), places)])
        given = [number for number, place in enumerate(places) if place is not None]
        return related(self.skill, moved, given[0]) if len(given) == 1 else moved

    def whole(self, place: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Place with what it leaves open."""
        return self.place_of(self.changed(self.changed(self.skill.goal, near), place))

    def place_of(self, point: np.ndarray) -> np.ndarray:
        """Place of a point."""
        return np.concatenate([half_point[:POSE_SIZE] for half_point in self._halves(point)])

    def place_in(self, target: np.ndarray) -> np.ndarray:
        """Place of a reference; a part of it; a copy."""
        return np.concatenate([target[:POSE_SIZE], target[TARGET_SIZE:TARGET_SIZE + POSE_SIZE]])

    def point_of(self, target: np.ndarray) -> np.ndarray:
        """Point of a reference."""
        return np.concatenate([side.point_of(item) for side, item in self._of_each(target)])

    def _of_each(self, target: np.ndarray) -> list[tuple[ToolSkill, np.ndarray]]:
        return [(self.sides[0], target[:TARGET_SIZE]), (self.sides[1], target[TARGET_SIZE:])]

    def start_at(self, place: np.ndarray | None) -> np.ndarray | None:
        """Point at which a motion starts at a place; None for the skill's own start."""
        if place is None:
            return None
        parts = (side.start_at(item) for side, item in zip(
            self.sides, (place[:POSE_SIZE], place[POSE_SIZE:])))
        return np.concatenate([part for part in parts if part is not None])

    def first_target(self, place: np.ndarray) -> np.ndarray:
        """Reference that rests at a place."""
        return np.concatenate([side.first_target(item) for side, item in zip(
            self.sides, (place[:POSE_SIZE], place[POSE_SIZE:]))])

    def take_over(self, target: np.ndarray) -> None:
        """Write what a motion of this skill does not change to a reference."""
        for side, item in self._of_each(target):
            side.take_over(item)

    @property
    def releases(self) -> bool:
        """Whether something of an earlier motion is to decrease (`release`)."""
        return self.sides[0].releases

    def release(self, target: np.ndarray, dt: float) -> bool:
        """Let it decrease; whether there is some left."""
        left = [side.release(item, dt) for side, item in self._of_each(target)]
        return any(left)

    def stop(self, target: np.ndarray) -> None:
        """Let a reference rest."""
        for side, item in self._of_each(target):
            side.stop(item)

    def motion_of(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Velocity and acceleration of a reference as tangents; None at rest."""
        motions = [(side, side.motion_of(item)) for side, item in self._of_each(target)]
        if all(motion is None for _, motion in motions):
            return None
        rest = [np.zeros(side.manifold.tangent_size) for side, _ in motions]
        velocity, acceleration = (np.concatenate([
            zero if motion is None else motion[k] for zero, (_, motion) in zip(rest, motions)])
            for k in (0, 1))
        return velocity, acceleration

    def tangent_of_twist(self, twist: np.ndarray) -> np.ndarray:
        """:raises ManifoldError: always: two arms do not follow a goal that moves on"""
        raise ManifoldError('a skill of two arms does not follow a goal that moves on')

    def approach(self, target: np.ndarray, place: np.ndarray) -> Way:
        """Motion from a reference at rest to a place."""
        return _BothWays([side.approach(item, to) for (side, item), to in zip(
            self._of_each(target), (place[:POSE_SIZE], place[POSE_SIZE:]))])

    def is_near(self, target: np.ndarray, place: np.ndarray) -> bool:
        """Whether a reference is so close to where the robot is that a motion may start there."""
        return all(side.is_near(item, to) for (side, item), to in zip(
            self._of_each(target), (place[:POSE_SIZE], place[POSE_SIZE:])))

    def distance(self, first: np.ndarray, second: np.ndarray) -> Distance:
        """The larger one of both tools."""
        parts = [side.distance(first[cut], second[cut]) for side, cut in zip(
            self.sides, (slice(POSE_SIZE), slice(POSE_SIZE, None)))]
        return Distance(*map(max, *parts))

    def distances(self, target: np.ndarray, goal: np.ndarray) -> list[float]:
        """Distance of each factor of a reference from a goal."""
        return [offset for (side, item), to in zip(self._of_each(target), self._halves(goal))
                for offset in side.distances(item, to)]

    def stiffness_factor(self, numbers: Any) -> np.ndarray:
        """Check a stiffness goal and return the skill's factor of it."""
        return self.sides[0].stiffness_factor(numbers)

    def bounds(self, settings: StreamSettings) -> Bounds:
        """Bounds of a stream of its references."""
        return _BothBounds([side.bounds(settings) for side in self.sides])

    def advance(self, rollout: Rollout, dt: float, numbers: np.ndarray, target: np.ndarray
                ) -> None:
        """Let ``dt`` seconds pass and write the reference."""
        numbers[0] = dt
        advance(rollout.memory, numbers)
        for (side, item), part in zip(self._of_each(target), self._parts):
            side.write_target(numbers, *part, item)


class _BothWays:
    """Ways of two tools; the one that arrives first waits."""

    def __init__(self, ways: list[Any]):
        self._ways = ways

    def advance(self, dt: float, target: np.ndarray) -> bool:
        """Let ``dt`` seconds pass and write the target; whether the end is reached."""
        parts = target[:TARGET_SIZE], target[TARGET_SIZE:]
        arrived = [way.advance(dt, part) for way, part in zip(self._ways, parts)]
        return all(arrived)


class _BothBounds:
    """Bounds of two streams."""

    def __init__(self, both: list[Any]):
        self._both, self._out = both, np.empty(2 * TARGET_SIZE)
        self.bounded = 0

    def configure(self, settings: StreamSettings) -> None:
        """Use other bounds from now on."""
        for item in self._both:
            item.configure(settings)

    def apply(self, target: np.ndarray, dt: float) -> np.ndarray:
        """Bound the reference of a tick; the same array every time."""
        for item, cut in zip(self._both, (slice(TARGET_SIZE), slice(TARGET_SIZE, None))):
            self._out[cut] = item.apply(target[cut], dt)
        self.bounded = sum(item.bounded for item in self._both)
        return self._out
