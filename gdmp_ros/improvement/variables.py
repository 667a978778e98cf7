"""
What a search may change of a skill: weights, via points, stiffness, tempo.

Its numbers are in units of a first standard deviation that is given in the units of the skill.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Protocol

import numpy as np

from gdmp_ros.dmp.changes import between
from gdmp_ros.dmp.response import responses
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.dmp.via import through
from gdmp_ros.errors import ParameterError
from gdmp_ros.learning.regression import smoother
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Of the motion, where a spiral is fitted.
SAMPLES = 401
#: Basis functions in one turn of a spiral, at least.
FUNCTIONS_PER_TURN = 4


class Variable(Protocol):
    """Something that varies."""

    def names(self, skill: Skill) -> list[str]:
        """
        Names of its numbers, for people.

        :raises ParameterError: if the skill has no such thing
        """

    def apply(self, skill: Skill, values: np.ndarray) -> Skill:
        """
        Return a skill that is changed by some numbers; 0 changes nothing.

        :raises GdmpError: if there is no such skill
        """


@dataclass(frozen=True)
class Weights:
    """
    The forcing term: bumps along the motion.

    :param count: of bumps for each coordinate; with as many as basis functions each is one of them
    :param deviations: by factor: largest displacement of the path by one bump, in the unit of
        the tangents of the factor (m; half-angles on S³)
    :param axes: coordinates of each factor that vary; by default all
    """

    count: int
    deviations: Mapping[str, float]
    axes: Sequence[int] = ()

    def names(self, skill: Skill) -> list[str]:
        """Names of its numbers, for people."""
        skill.check_plain('improvement')
        columns, _ = _coordinates(skill.manifold, self.deviations, self.axes)
        return [f'weight {k + 1} {name}' for k in range(self.count) for name in columns]

    def apply(self, skill: Skill, values: np.ndarray) -> Skill:
        """Return a skill that is changed by some numbers; 0 changes nothing."""
        _, (columns, deviations) = _coordinates(skill.manifold, self.deviations, self.axes)
        place = np.arange(skill.n_basis) / max(skill.n_basis - 1, 1)
        centres = np.linspace(0.0, 1.0, self.count)
        width = 1.0 / max(self.count - 1, 1)
        # Neighbouring bumps add up to a constant.
        bumps = np.maximum(1.0 - np.abs(place[:, None] - centres) / width, 0.0)
        moved = responses(skill.n_basis, skill.gains).motion[:, 1:] @ bumps
        bumps /= np.abs(moved).max(axis=0)
        weights = np.array(skill.weights)
        weights[:, columns] += bumps @ (values.reshape(self.count, -1) * deviations)
        return replace(skill, weights=weights)


@dataclass(frozen=True)
class Spiral:
    """
    A search along a spiral around the path, which covers a disk: its radius.

    It begins on the path, grows evenly, and returns to the path at the end.

    :param turns: of the spiral
    :param deviation: of the radius, in the unit of the tangents of the factor (m)
    :param first: progress where it begins, and ``last`` where it is widest
    :param axes: the two coordinates of the factor that span the disk
    :param factor: name of the factor of the manifold
    """

    turns: int
    deviation: float
    first: float = 0.35
    last: float = 0.9
    axes: tuple[int, int] = (0, 1)
    factor: str = 'position'

    def names(self, skill: Skill) -> list[str]:
        """Name of its number, for people."""
        skill.check_plain('improvement')
        _coordinates(skill.manifold, {self.factor: self.deviation}, self.axes)
        least = math.ceil(FUNCTIONS_PER_TURN * self.turns / (self.last - self.first))
        if skill.n_basis < least:
            raise ParameterError(f'a spiral of {self.turns} turns needs a skill of {least} basis '
                                 f'functions, this one has {skill.n_basis}')
        return [f'radius of a spiral of {self.factor}']

    def apply(self, skill: Skill, values: np.ndarray) -> Skill:
        """Return a skill whose path winds; 0 and less change nothing."""
        radius = self.deviation * max(float(values[0]), 0.0)
        if radius == 0.0:
            return skill
        columns = _coordinates(skill.manifold, {self.factor: 1.0}, self.axes)[1][0]
        progress = np.linspace(0.0, 1.0, SAMPLES)
        grown = np.clip((progress - self.first) / (self.last - self.first), 0.0, 1.0)
        left = np.clip((1.0 - progress) / (1.0 - self.last), 0.0, 1.0)
        angle = 2.0 * np.pi * self.turns * grown
        target = (radius * grown * left)[:, None] * np.column_stack([np.cos(angle),
                                                                     np.sin(angle)])
        weights = np.array(skill.weights)
        maps = smoother(skill.n_basis, skill.gains, progress, 0.01)
        weights[:, columns] += maps.weights @ target
        return replace(skill, weights=weights)


@dataclass(frozen=True)
class ViaPoints:
    """
    Points of the path, equally spaced in progress between its ends, or where they are given.

    :param at: progress of each, above 0 and below 1
    :param deviations: by factor, in the unit of the tangents (m; half-angles on S³)
    """

    at: Sequence[float]
    deviations: Mapping[str, float]

    def names(self, skill: Skill) -> list[str]:
        """Names of its numbers, for people."""
        columns, _ = _coordinates(skill.manifold, self.deviations)
        return [f'via point {s:g} {name}' for s in self.at for name in columns]

    def apply(self, skill: Skill, values: np.ndarray) -> Skill:
        """Return a skill that is changed by some numbers; 0 changes nothing."""
        manifold, (columns, deviations) = skill.manifold, _coordinates(
            skill.manifold, self.deviations)[1]
        path = Rollout(skill).sample(skill.duration * np.asarray(self.at)).points
        coordinates = np.zeros((len(self.at), manifold.tangent_size))
        coordinates[:, columns] = values.reshape(len(self.at), -1) * deviations
        return through(skill, [
            (s, manifold.exp(point, manifold.from_frame(manifold.frame(point), coordinate)))
            for s, point, coordinate in zip(self.at, path, coordinates)], list(self.deviations))


@dataclass(frozen=True)
class Stiffness:
    """
    The stiffness along the motion: factors of its axes at equally spaced progress.

    :param count: of places, from the start to the goal; 1: the same factors everywhere
    :param deviation: of the logarithms of the factors
    :param axes: groups of axes that share a factor; by default each has its own
    :param factor: name of the factor of the manifold
    """

    count: int
    deviation: float = 0.5
    axes: Sequence[Sequence[int]] = ()
    factor: str = 'stiffness'

    def _groups(self, skill: Skill) -> Sequence[Sequence[int]]:
        part = _factor(skill.manifold, self.factor)
        if not isinstance(part, SymmetricPositiveDefinite):
            raise ParameterError(f'{self.factor} is on {part!r}, expected SPD matrices')
        return self.axes or [[axis] for axis in range(part.point_shape[0])]

    def names(self, skill: Skill) -> list[str]:
        """Names of its numbers, for people."""
        return [f'{self.factor} {k + 1} axes {" ".join(str(axis + 1) for axis in group)}'
                for k in range(self.count) for group in self._groups(skill)]

    def apply(self, skill: Skill, values: np.ndarray) -> Skill:
        """Return a skill that is changed by some numbers; 0 changes nothing."""
        groups, manifold = self._groups(skill), skill.manifold
        size = _factor(manifold, self.factor).point_shape[0]
        logarithms = np.zeros((self.count, size))
        for column, group in enumerate(groups):
            logarithms[:, list(group)] = self.deviation * values.reshape(self.count, -1)[
                :, column, None]
        part = manifold.point_slices[manifold.names.index(self.factor)]

        def scaled(point: np.ndarray, row: np.ndarray) -> np.ndarray:
            root, moved = np.exp(0.5 * row), point.copy()
            moved[part] = (root[:, None] * point[part].reshape(size, size) * root).reshape(-1)
            return moved
        inner = np.linspace(0.0, 1.0, self.count)[1:-1]
        changed = between(skill, scaled(skill.start, logarithms[0]),
                          scaled(skill.goal, logarithms[-1]))
        if not len(inner):
            return changed
        path = Rollout(skill).sample(skill.duration * inner).points.reshape(len(inner), -1)
        return through(changed, [(s, scaled(point, row)) for s, point, row in zip(
            inner, path, logarithms[1:-1])], [self.factor])


@dataclass(frozen=True)
class Tempo:
    """
    The duration.

    :param deviation: of its logarithm
    """

    deviation: float = 0.2

    def names(self, skill: Skill) -> list[str]:
        """Names of its numbers, for people."""
        return ['tempo']

    def apply(self, skill: Skill, values: np.ndarray) -> Skill:
        """Return a skill that is changed by some numbers; 0 changes nothing."""
        return replace(skill, duration=skill.duration * float(np.exp(-self.deviation * values[0])))


class Variables:
    """
    Several variables of a skill, whose numbers lie one after the other.

    :ivar skill: unchanged
    :ivar names: of all numbers, for people
    """

    def __init__(self, skill: Skill, parts: Sequence[Variable]):
        """:raises ParameterError: without variables, or if the skill does not have them"""
        if not parts:
            raise ParameterError('nothing varies: expected weights, via points, stiffness or '
                                 'tempo')
        if skill.rhythmic:
            raise ParameterError('a rhythmic skill cannot be improved: it has no end')
        self.skill, self._parts = skill, parts
        names = [part.names(skill) for part in parts]
        self._sizes = [len(name) for name in names]
        self.names = [name for item in names for name in item]

    def __repr__(self) -> str:
        return f'{type(self).__name__}({self._parts!r})'

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return len(self.names)

    def apply(self, values: np.ndarray) -> Skill:
        """
        Return the changed skill.

        :param values: in units of their first standard deviations, shape ``(size,)``
        :raises GdmpError: if there is no such skill
        """
        if np.shape(values) != (self.size,) or not np.isfinite(values).all():
            raise ParameterError(f'expected {self.size} finite numbers, got {values!r}')
        changed, ends = self.skill, np.cumsum(self._sizes)
        for part, item in zip(self._parts, np.split(np.asarray(values, float), ends[:-1])):
            changed = part.apply(changed, item)
        return replace(changed, variation=None)


def _factor(manifold: Manifold, name: str) -> Manifold:
    if name not in manifold.names:
        raise ParameterError(f'no factor is called {name!r}, there are '
                             f'{", ".join(manifold.names)}')
    return manifold.factors[manifold.names.index(name)]


def _coordinates(manifold: Manifold, deviations: Mapping[str, float], axes: Sequence[int] = ()
                 ) -> tuple[list[str], tuple[np.ndarray, np.ndarray]]:
    """Names of the coordinates of factors, their indices and standard deviations."""
    names, columns, spread = [], [], []
    for name, deviation in deviations.items():
        _factor(manifold, name)
        part = manifold.tangent_slices[manifold.names.index(name)]
        size = part.stop - part.start
        for k in axes or range(size):
            if not 0 <= k < size:
                raise ParameterError(f'axis is {k}, {name} has the axes 0 to {size - 1}')
            names.append(f'{name} {k + 1}')
            columns.append(part.start + k)
            spread.append(deviation)
    return names, (np.array(columns, dtype=int), np.array(spread))
