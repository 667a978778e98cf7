"""Example skills: handwriting and constructed motions."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gdmp_ros.choices import GALLERY
from gdmp_ros.data import lasa
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.util.profiles import minimum_jerk

_SAMPLES = 400


class Example(NamedTuple):
    """
    One skill of the gallery.

    :ivar shows: purpose of the example
    :ivar make: makes its demonstrations
    """

    title: str
    shows: str
    make: Callable[[], Sequence[Demonstration]]


def _smooth() -> np.ndarray:
    return np.asarray(minimum_jerk(np.linspace(0.0, 1.0, _SAMPLES)))


def _down(angle: np.ndarray) -> np.ndarray:
    """Orientations of a tool that points down, rotated about the vertical [rad]."""
    zero = np.zeros_like(angle)
    return np.column_stack([zero, np.cos(0.5 * angle), np.sin(0.5 * angle), zero])


def _pose(seconds: float, positions: np.ndarray, angles: np.ndarray,
          stiffness: np.ndarray | None = None) -> Sequence[Demonstration]:
    points = [positions, _down(angles)]
    if stiffness is not None:
        points.append(stiffness.reshape(len(positions), 9))
    return [Demonstration(np.linspace(0.0, seconds, len(positions)), np.hstack(points),
                          tool_manifold(None if stiffness is None else 3))]


def _pick_and_place() -> Sequence[Demonstration]:
    s = _smooth()
    height = 0.30 + 0.18 * np.sin(np.pi * s) ** 2
    positions = np.column_stack([0.45 + 0.05 * s, -0.2 + 0.4 * s, height])
    return _pose(3.0, positions, 0.5 * np.pi * s)


def _polish() -> Sequence[Demonstration]:
    """Circles over a table: stiff along it, compliant normal to it."""
    s = _smooth()
    angle = 6.0 * np.pi * s
    positions = np.column_stack([0.45 + 0.06 * np.sin(angle), 0.06 * (1.0 - np.cos(angle)),
                                 np.full(len(s), 0.25)])
    softened = 800.0 * np.exp(-1.6 * np.sin(np.pi * s))
    stiffness = np.zeros((len(s), 3, 3))
    stiffness[:, 0, 0] = stiffness[:, 1, 1] = 800.0
    stiffness[:, 2, 2] = softened
    return _pose(6.0, positions, 0.0 * s, stiffness)


def _screw() -> Sequence[Demonstration]:
    """One and a half turns while moving down: more than half a turn."""
    s = _smooth()
    positions = np.column_stack([np.full(len(s), 0.45), np.zeros(len(s)), 0.35 - 0.08 * s])
    return _pose(4.0, positions, 3.0 * np.pi * s)


EXAMPLES = dict(zip(GALLERY, (
    Example('A letter, with stiffness', 'seven strokes become one skill of pose and stiffness: '
            'stiff where they agree', lambda: lasa.robot_demonstrations('GShape')),
    Example('Another letter', 'the same from another class of strokes',
            lambda: lasa.robot_demonstrations('Sshape')),
    Example('Pick and place', 'one demonstration of a pose, without stiffness; the goal can be '
            'switched during the motion', _pick_and_place),
    Example('Polishing', 'stiff along the table, compliant normal to it', _polish),
    Example('Turning a screw', 'one and a half turns: the orientation passes its cut locus, and '
            'is split into segments automatically', _screw),
    Example('A curve on a sphere', 'a direction in space: S²',
            lambda: lasa.data_set('Worm', 'S2')),
    Example('Rotation matrices', 'a curve on SO(3)', lambda: lasa.data_set('Leaf_1', 'SO3')),
    Example('A covariance profile', 'symmetric positive definite matrices over time: SPD(2)',
            lambda: lasa.data_set('Angle', lasa.COVARIANCES)),
), strict=True))


def learned(name: str) -> Skill:
    """Learn a skill of the gallery (`EXAMPLES`)."""
    piece = EXAMPLES[name]
    return Skill.learn(piece.make(), provenance={'gallery': name, 'title': piece.title})
