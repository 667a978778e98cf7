"""What players and streamers know of a skill that is streamed as references."""
from __future__ import annotations

from enum import Enum
from typing import Any, Protocol

import numpy as np

from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.playback.distance import Distance
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.stream_settings import StreamSettings


class Kind(Enum):
    """What places and references are of."""

    TOOL = 'the tool'
    JOINTS = 'the joints'
    TWO_TOOLS = 'two tools'


class Way(Protocol):
    """A motion from a reference at rest to the robot."""

    def advance(self, dt: float, target: np.ndarray) -> bool:
        """Let ``dt`` seconds pass and write the target; whether the end is reached."""


class Bounds(Protocol):
    """
    Bounds of a stream.

    :ivar bounded: ticks in which they were active
    """

    bounded: int

    def configure(self, settings: StreamSettings) -> None:
        """Use other bounds from now on."""

    def apply(self, target: np.ndarray, dt: float) -> np.ndarray:
        """Bound the reference of a tick; the same array every time."""


class StreamedSkill:
    """
    A skill whose points are streamed as targets, of the tool or of the joints.

    A *place* is where the robot is: a pose (x, y, z, qw, qx, qy, qz), positions of the joints, or
    the poses of two tools.

    :ivar kind: what its places and references are of
    :ivar has_wrench: whether the skill has a wrench that the tool is to exert
    """

    kind = Kind.TOOL
    has_wrench = False

    def __init__(self, skill: Skill, settings: PlayerSettings):
        self.skill, self.manifold, self.settings = skill, skill.manifold, settings

    @property
    def releases(self) -> bool:
        """Whether something of an earlier motion is to decrease (`release`)."""
        return False

    def release(self, target: np.ndarray, dt: float) -> bool:
        """Let it decrease; whether there is some left."""
        return False

    def options(self, speed: float, tolerances: tuple[float, float] | None) -> Options:
        """
        Options of a roll-out of the skill.

        :param speed: initial tempo
        :param tolerances: at the goal [m, rad]
        """
        raise NotImplementedError

    def changed(self, point: np.ndarray, place: np.ndarray | None = None,
                stiffness: np.ndarray | None = None) -> np.ndarray:
        """Point with another place or stiffness."""
        raise NotImplementedError

    def whole(self, place: np.ndarray, near: np.ndarray) -> np.ndarray:
        """
        Place with what it leaves open.

        :param near: the place before
        """
        return place

    def place_of(self, point: np.ndarray) -> np.ndarray:
        """Place of a point."""
        raise NotImplementedError

    def place_in(self, target: np.ndarray) -> np.ndarray:
        """Place of a reference; a part of it."""
        raise NotImplementedError

    def point_of(self, target: np.ndarray) -> np.ndarray:
        """Point of a reference."""
        raise NotImplementedError

    def start_at(self, place: np.ndarray | None) -> np.ndarray | None:
        """Point at which a motion starts at a place; None for the skill's own start."""
        raise NotImplementedError

    def first_target(self, place: np.ndarray) -> np.ndarray:
        """Reference that rests at a place."""
        raise NotImplementedError

    def take_over(self, target: np.ndarray) -> None:
        """Write what a motion of this skill does not change to a reference."""
        raise NotImplementedError

    def stop(self, target: np.ndarray) -> None:
        """Let a reference rest."""
        raise NotImplementedError

    def motion_of(self, target: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Velocity and acceleration of a reference as tangents; None at rest."""
        raise NotImplementedError

    def tangent_of_twist(self, twist: np.ndarray) -> np.ndarray:
        """Tangent with a linear and an angular velocity or acceleration of the tool."""
        raise NotImplementedError

    def approach(self, target: np.ndarray, place: np.ndarray) -> Way:
        """Motion from a reference at rest to a place."""
        raise NotImplementedError

    def is_near(self, target: np.ndarray, place: np.ndarray) -> bool:
        """Whether a reference is so close to where the robot is that a motion may start there."""
        raise NotImplementedError

    def distance(self, first: np.ndarray, second: np.ndarray) -> Distance:
        """Distance between two places."""
        raise NotImplementedError

    def distances(self, target: np.ndarray, goal: np.ndarray) -> list[float]:
        """Distance of each factor of a reference from a goal."""
        raise NotImplementedError

    def stiffness_factor(self, numbers: Any) -> np.ndarray:
        """
        Check a stiffness goal and return the skill's factor of it.

        :raises ManifoldError: if it does not fit the skill
        """
        raise NotImplementedError

    def bounds(self, settings: StreamSettings) -> Bounds:
        """Bounds of a stream of its references."""
        raise NotImplementedError

    def advance(self, rollout: Rollout, dt: float, numbers: np.ndarray, target: np.ndarray
                ) -> None:
        """
        Let ``dt`` seconds pass and write the reference.

        :param rollout: of this skill
        :param numbers: scratch memory, shape ``(rollout.state_size,)``
        """
        raise NotImplementedError
