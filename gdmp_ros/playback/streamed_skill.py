"""A skill whose points are streamed as targets: of a tool, of two tools, or of the joints."""
from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np

from gdmp_ros.dmp.changes import related
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ManifoldError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.playback.approach import Approach
from gdmp_ros.playback.channels import (
    advance_references,
    APPROACH_ACCELERATION,
    APPROACH_SPEED,
    Channel,
    JointChannel,
    OF_TOOL,
    ToolChannel,
)
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.settings import PlayerSettings

#: Time in which the shortest way to the robot is gone, at least [s].
_SHORTEST_S = 0.02


class Kind(Enum):
    """What places and references are of."""

    TOOL = 'the tool'
    JOINTS = 'the joints'
    TWO_TOOLS = 'two tools'


def is_of_joints(skill: Skill | Demonstration) -> bool:
    """Whether a skill or a take is one of the joints: R^n with the factor ``joints``."""
    return skill.manifold.names == ('joints',) and isinstance(skill.manifold.factors[0], Euclidean)


def is_of_two_arms(skill: Skill) -> bool:
    """Whether a skill has the poses of two tools: its second half begins as the first one does."""
    factors = skill.manifold.factors
    count = len(factors) // 2
    pose = [Euclidean(3), UnitQuaternion()]
    return (isinstance(skill.manifold, Product) and len(factors) % 2 == 0
            and list(factors[:2]) == pose and list(factors[count:count + 2]) == pose)


class StreamedSkill:
    """
    A skill as a list of channels.

    A *place* is where the robot is: a pose (x, y, z, qw, qx, qy, qz), positions of the joints, or
    the poses of two tools. A *reference* has the targets of all channels, one after the other.

    :ivar kind: what its places and references are of
    :ivar channels: of its references
    :ivar table: where their parts are (`gdmp_ros.playback.channels.KIND`)
    :ivar has_wrench: whether the skill has a wrench that the tool is to exert
    """

    def __init__(self, skill: Skill, settings: PlayerSettings):
        """:raises DataError: if the skill is neither one of a pose, nor of two, nor of joints"""
        self.skill, self.manifold, self.settings = skill, skill.manifold, settings
        factors = skill.manifold.factors
        self.channels: list[Channel]
        if is_of_joints(skill):
            self.kind, self.channels = Kind.JOINTS, [JointChannel(factors[0], settings)]
        elif is_of_two_arms(skill):
            count = len(factors) // 2
            self.kind = Kind.TWO_TOOLS
            self.channels = [ToolChannel(part, settings)
                             for part in (factors[:count], factors[count:])]
        else:
            self.kind, self.channels = Kind.TOOL, [ToolChannel(factors, settings)]
        self.has_wrench = any(channel.has_wrench for channel in self.channels)
        count = len(factors) // len(self.channels)
        points, tangents, targets, places, velocities = ([0] for _ in range(5))
        for number, channel in enumerate(self.channels):
            own = factors[number * count:(number + 1) * count]
            for ends, size in ((points, sum(factor.point_size for factor in own)),
                               (tangents, sum(factor.tangent_size for factor in own)),
                               (targets, channel.target_size), (places, channel.place_size),
                               (velocities, channel.count)):
                ends.append(ends[-1] + size)
        self._points, self._tangents, self._targets, self._places = (
            [slice(*pair) for pair in zip(ends, ends[1:])]
            for ends in (points, tangents, targets, places))
        self.table = np.array([[
            channel.kind, channel.count, 2 + points[k], 2 + points[-1] + tangents[k],
            2 + points[-1] + tangents[-1] + tangents[k], targets[k], velocities[k], channel.rows,
            2 + points[k + 1] - 6 if channel.has_wrench else 0]
            for k, channel in enumerate(self.channels)], dtype=np.int64)

    def options(self, speed: float, tolerances: tuple[float, float] | None) -> Options:
        """
        Options of a roll-out of the skill.

        :param speed: initial tempo
        :param tolerances: at the goal [m, rad]
        """
        parts = [channel.options(tolerances) for channel in self.channels]
        limits, goal_speed, weights = ([number for part in parts for number in part[k]]
                                       for k in range(3))
        return Options(speed, self.settings.speed_rate, limits, goal_speed,
                       self.settings.phase_stopping, weights)

    # Points

    def changed(self, point: np.ndarray, place: np.ndarray | None = None,
                stiffness: np.ndarray | None = None, side: int | None = None) -> np.ndarray:
        """
        Point with another place or stiffness.

        :param place: of all channels
        :param stiffness: of all channels (`stiffness_factor`)
        :param side: the place is that of one of two tools only, and the other one follows
        """
        result = np.array(point)
        for number, (channel, part) in enumerate(zip(self.channels, self._points)):
            if place is not None and side in (None, number):
                own = place if side is not None else place[self._places[number]]
                result[part][:channel.place_size] = own
            if stiffness is not None:
                channel.change_stiffness(result[part], stiffness)
        return result if side is None else related(self.skill, result, side)

    def place_of(self, point: np.ndarray) -> np.ndarray:
        """Place of a point."""
        return np.concatenate([point[part][:channel.place_size]
                               for channel, part in zip(self.channels, self._points)])

    def start_at(self, place: np.ndarray | None) -> np.ndarray | None:
        """Point at which a motion starts at a place; None for the skill's own start."""
        if place is None:
            return None
        point = self.changed(self.skill.start, place)
        for channel, part in zip(self.channels, self._points):
            channel.begin(point[part])
        return point

    def tangent_of_twist(self, twist: np.ndarray) -> np.ndarray:
        """
        Tangent with a linear and an angular velocity or acceleration of the tool.

        :raises ManifoldError: if the skill is not one of one tool
        """
        channel = self.channels[0]
        if self.kind is not Kind.TOOL or not isinstance(channel, ToolChannel):
            raise ManifoldError(f'a skill of {self.kind.value} does not follow a goal that moves '
                                'on')
        return channel.tangent_of_twist(twist)

    def stiffness_factor(self, numbers: Any) -> np.ndarray:
        """
        Check a stiffness goal and return the skill's factor of it.

        :raises ManifoldError: if it does not fit the skill
        """
        return self.channels[0].stiffness_factor(numbers)

    # References

    def _of_each(self, reference: np.ndarray) -> list[tuple[Channel, np.ndarray]]:
        return [(channel, reference[part]) for channel, part in zip(self.channels, self._targets)]

    def place_in(self, reference: np.ndarray) -> np.ndarray:
        """Place of a reference; a part of it if there is one channel."""
        if len(self.channels) == 1:
            return self.channels[0].place_in(reference)
        return np.concatenate([channel.place_in(target)
                               for channel, target in self._of_each(reference)])

    def point_of(self, reference: np.ndarray) -> np.ndarray:
        """Point of a reference."""
        return np.concatenate([channel.point_of(target)
                               for channel, target in self._of_each(reference)])

    def first_target(self, place: np.ndarray) -> np.ndarray:
        """Reference that rests at a place, with the initial stiffness of the skill."""
        return np.concatenate([
            channel.resting(place[cut], self.skill.start[part])
            for channel, cut, part in zip(self.channels, self._places, self._points)])

    def take_over(self, reference: np.ndarray) -> None:
        """Write what a motion of this skill does not change to a reference."""
        for channel, target in self._of_each(reference):
            channel.take_over(target)

    @property
    def releases(self) -> bool:
        """Whether a wrench of an earlier motion is to decrease (`release`)."""
        return self.kind is not Kind.JOINTS and not self.has_wrench

    def release(self, reference: np.ndarray, dt: float) -> bool:
        """Let it decrease; whether there is some left."""
        left = [channel.release(target, dt) for channel, target in self._of_each(reference)]
        return any(left)

    def stop(self, reference: np.ndarray) -> None:
        """Let a reference rest."""
        for channel, target in self._of_each(reference):
            channel.stop(target)

    def motion_of(self, reference: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Velocity and acceleration of a reference as tangents; None at rest."""
        parts = [channel.tangents_of(target) for channel, target in self._of_each(reference)]
        velocity, acceleration = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
        return (velocity, acceleration) if velocity.any() else None

    def approach(self, reference: np.ndarray, place: np.ndarray) -> Approach:
        """Way from a reference at rest to a place."""
        way = np.concatenate([channel.way(target, place[cut]) for (channel, target), cut in zip(
            self._of_each(reference), self._places)])
        fastest, largest, first = 1.0 / _SHORTEST_S, 1.0 / _SHORTEST_S ** 2, 0
        for channel in self.channels:
            lengths = {'joints': float(np.abs(way[first:first + channel.count]).max())}
            if channel.kind == OF_TOOL:
                lengths = {'position': float(np.linalg.norm(way[first:first + 3])),
                           'rotation': float(np.linalg.norm(way[first + 3:first + 6]))}
            for name, length in lengths.items():
                if length > 0.0:
                    fastest = min(fastest, APPROACH_SPEED[name] / length)
                    largest = min(largest, APPROACH_ACCELERATION[name] / length)
            first += channel.count
        return Approach(reference, way, self.table, fastest, largest)

    def is_near(self, reference: np.ndarray, place: np.ndarray) -> bool:
        """Whether a reference is so close to where the robot is that a motion may start there."""
        return all(channel.is_near(target, place[cut]) for (channel, target), cut in zip(
            self._of_each(reference), self._places))

    def distance(self, first: np.ndarray, second: np.ndarray) -> Distance:
        """Distance between two places; of two tools, the larger one."""
        parts = [channel.distance(first[cut], second[cut])
                 for channel, cut in zip(self.channels, self._places)]
        return parts[0] if len(parts) == 1 else Distance(*map(max, *parts))

    def error(self, first: np.ndarray, second: np.ndarray) -> float:
        """
        e² of phase stopping between two places.

        Stiffness and wrench are not measured: they do not count.
        """
        return sum(channel.error(first[cut], second[cut])
                   for channel, cut in zip(self.channels, self._places))

    def distances(self, reference: np.ndarray, goal: np.ndarray) -> list[float]:
        """Distance of each factor of a reference from a goal: m, rad, geodesic, N and Nm."""
        point = self.point_of(reference)
        offset = self.manifold.factor_distances(point.reshape(1, -1), goal.reshape(1, -1))[0]
        if self.kind is Kind.JOINTS:
            return [self.distance(point, goal).rotation]
        for number, factor in enumerate(self.manifold.factors):
            if isinstance(factor, UnitQuaternion):
                # The distance on S³ is half the angle; q and -q are the same orientation.
                offset[number] = 2.0 * min(offset[number], np.pi - offset[number])
        return [float(item) for item in offset]

    def advance(self, rollout: Rollout, dt: float, numbers: np.ndarray, reference: np.ndarray
                ) -> None:
        """
        Let ``dt`` seconds pass and write the reference.

        :param rollout: of this skill
        :param numbers: scratch memory, shape ``(rollout.state_size,)``
        """
        numbers[0] = dt
        advance_references(rollout.memory, numbers, self.table, reference)
