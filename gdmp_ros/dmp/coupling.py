"""Couplings of two arms, or of any two factors of a product: what a skill says of them."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gdmp_ros.choices import COUPLINGS
from gdmp_ros.dmp.relations import (
    DISTANCE,
    MATRIX,
    OFFSET,
    QUATERNION,
    relative_element,
    Term,
    turned_back,
)
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import Euclidean, Manifold, SpecialOrthogonal, UnitQuaternion
from gdmp_ros.util.numeric import numbers

#: A deviation vanishes with ``(1 + w s) e^(-w s)``, w this many per duration.
RATE = 2000.0
#: Largest w per grid interval: the integration is stable and damped up to twice as much.
_LARGEST_STEP = 0.5
#: Kinds of relations of groups.
_GROUPS: dict[type[Manifold], int] = {
    Euclidean: OFFSET, UnitQuaternion: QUATERNION, SpecialOrthogonal: MATRIX}
#: Relations of which only the size matters.
_IDENTITIES = {'pose': (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), 'distance': (0.0,)}


@dataclass(frozen=True)
class Coupling:
    """
    What two factors of a product, or two poses, keep while they move.

    ===========  ==================================  ==============================================
    kind         factors of each side                relation
    ===========  ==================================  ==============================================
    `pose`       a position in R³, a quaternion      pose (x, y, z, qw, qx, qy, qz) of the second
                                                     one in the first one
    `relative`   one in R^m, S³ or SO(m)             ``Y₁⁻¹ Y₂``, a point of the factor; in R^m the
                                                     difference
    `distance`   one on any manifold                 geodesic distance, one number; 0 for equal
                                                     points
    ===========  ==================================  ==============================================

    Its potential is ``U = ½ κ d²`` of the deviation d, and ``-grad U`` acts on both sides; only on
    the second one if the first one leads. A deviation at the start of a motion fades out within a
    quarter of its duration.

    :ivar kind: see above
    :ivar first: names of the factors of the first side
    :ivar second: names of the factors of the second side, in the same order
    :ivar relation: numbers, see above
    :ivar leads: whether the first side leads: nothing of the second one acts on it
    :ivar rate: w; a deviation vanishes with ``(1 + w s) e^(-w s)``, s from 0 to 1 in a duration
    """

    kind: str
    first: tuple[str, ...]
    second: tuple[str, ...]
    relation: tuple[float, ...]
    leads: bool = False
    rate: float = RATE

    def __post_init__(self) -> None:
        if self.kind not in COUPLINGS:
            raise ParameterError(f'coupling: kind is {self.kind!r}, expected one of '
                                 f'{", ".join(COUPLINGS)}')
        relation = numbers('coupling: relation', self.relation).reshape(-1)
        if not np.isfinite(relation).all():
            raise ParameterError('coupling: a number of the relation is not finite')
        if not (isinstance(self.rate, (int, float)) and 1.0 <= self.rate <= 1e6):
            raise ParameterError(f'coupling: rate is {self.rate!r}, expected a number from 1 to '
                                 '1e6')
        for name, value in (('relation', tuple(relation.tolist())), ('rate', float(self.rate)),
                            ('first', _names(self.first)), ('second', _names(self.second)),
                            ('leads', bool(self.leads))):
            object.__setattr__(self, name, value)

    @classmethod
    def at(cls, kind: str, first: str | Sequence[str], second: str | Sequence[str],
           manifold: Manifold, point: np.ndarray, *, leads: bool = False, rate: float = RATE
           ) -> Coupling:
        """
        Couple what is related in a point as it is there.

        :param point: of the manifold, such as the start or the goal of a skill
        :raises ParameterError: as `check`
        """
        names = _names(first), _names(second)
        blank = cls(kind, *names, _IDENTITIES.get(kind, ()), leads, rate)
        here = manifold.flat(point)
        sides = [_part(manifold, here, _numbers_of(manifold, side)) for side in names]
        _check_sides(blank, manifold)
        if kind == 'distance':
            relation = [_distance(manifold, here, *(_numbers_of(manifold, s)[0] for s in names))]
        elif kind == 'pose':
            relation = [*turned_back(sides[0][3:], sides[1][:3] - sides[0][:3]),
                        *relative_element(UnitQuaternion(), sides[0][3:], sides[1][3:])]
        else:
            factor = manifold.factors[_numbers_of(manifold, names[0])[0]]
            relation = list(relative_element(factor, sides[0], sides[1]))
        return cls(kind, *names, tuple(relation), leads, rate)

    def check(self, manifold: Manifold, steps: int) -> None:
        """
        Check that a skill can have it.

        :param steps: grid intervals per duration
        :raises ParameterError: for an unknown name, factors that do not fit, a relation that is no
            point, or a rate too large for the grid
        """
        _check_sides(self, manifold)
        factor = manifold.factors[_numbers_of(manifold, self.second)[0]]
        if self.kind == 'relative':
            factor.check_point(np.array(self.relation).reshape(factor.point_shape)
                               if len(self.relation) == factor.point_size
                               else np.array(self.relation))
        elif len(self.relation) != (7 if self.kind == 'pose' else 1):
            raise ParameterError(f'coupling {self.kind}: the relation has {len(self.relation)} '
                                 f'numbers, expected {7 if self.kind == "pose" else 1}')
        elif self.kind == 'pose':
            UnitQuaternion().check_point(np.array(self.relation[3:]))
        elif self.relation[0] < 0.0:
            raise ParameterError(f'coupling distance: {self.relation[0]:g}, expected at least 0')
        if self.rate > _LARGEST_STEP * steps:
            raise ParameterError(f'coupling: rate is {self.rate:g}, expected at most '
                                 f'{_LARGEST_STEP * steps:g} for {steps} intervals per duration')

    def terms(self, manifold: Manifold) -> list[Term]:
        """The relations between two factors of which it consists."""
        first, second = (_numbers_of(manifold, side) for side in (self.first, self.second))
        relation = np.array(self.relation)
        if self.kind == 'pose':
            return [Term(OFFSET, first[0], second[0], relation[:3], first[1]),
                    Term(QUATERNION, first[1], second[1], relation[3:])]
        if self.kind == 'distance':
            blank = np.zeros(manifold.factors[second[0]].point_size)
            return [Term(DISTANCE, first[0], second[0], blank, distance=self.relation[0])]
        return [Term(_GROUPS[type(manifold.factors[first[0]])], first[0], second[0], relation)]

    def deviation(self, manifold: Manifold, point: np.ndarray) -> np.ndarray:
        """
        How far a point is from keeping the relation.

        :returns: one number for each factor of a side: m, rad, or the geodesic distance of others
        """
        result, here = [], manifold.flat(point)
        for term in self.terms(manifold):
            first, second = term.first, term.second
            if self.kind == 'distance':
                result.append(abs(_distance(manifold, here, first, second) - self.relation[0]))
                continue
            there = term.partners(manifold, here)
            distance = float(manifold.factor_distances(here[None], there[None])[0][second])
            # Distances on S³ are half-angles.
            result.append(2.0 * distance if term.kind == QUATERNION else distance)
        return np.array(result)

    def related(self, manifold: Manifold, point: np.ndarray, given: int = 0) -> np.ndarray:
        """
        Return the point in which one side follows the other one.

        With `distance` it moves along the geodesic between the two.

        :param given: side that stays: 0 the first one, 1 the second one
        """
        here = np.array(manifold.flat(point))
        for term in reversed(self.terms(manifold)):  # an orientation that carries comes first
            moves = term.first if given else term.second
            there = term.partners(manifold, here)
            part = manifold.point_slices[moves]
            if self.kind == 'distance':
                factor, shape = manifold.factors[moves], manifold.factors[moves].point_shape
                other, own = there[part].reshape(shape), here[part].reshape(shape)
                length = factor.distance(other, own)
                if length == 0.0:
                    if self.relation[0] > 0.0:
                        raise ParameterError('coupling distance: the points are equal, so there '
                                             'is no direction in which one could move away')
                    continue
                there[part] = factor.exp(other, self.relation[0] / length * factor.log(
                    other, own)).reshape(-1)
            here[part] = there[part]
        return here.reshape(manifold.point_shape)


def _names(given: str | Sequence[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(str(name) for name in given)


def _numbers_of(manifold: Manifold, names: tuple[str, ...]) -> list[int]:
    unknown = [name for name in names if name not in manifold.names]
    if unknown or not names:
        raise ParameterError(f'coupling: there is no factor {", ".join(unknown) or "named"}; '
                             f'expected of {", ".join(manifold.names)}')
    return [manifold.names.index(name) for name in names]


def _check_sides(coupling: Coupling, manifold: Manifold) -> None:
    first, second = ([manifold.factors[i] for i in _numbers_of(manifold, side)]
                     for side in (coupling.first, coupling.second))
    both = coupling.first + coupling.second
    fits = {'pose': first == [Euclidean(3), UnitQuaternion()], 'distance': len(first) == 1,
            'relative': len(first) == 1 and type(first[0]) in _GROUPS}[coupling.kind]
    if not fits or first != second or len(set(both)) < len(both):
        expected = {'pose': 'R³ and S³', 'distance': 'one factor',
                    'relative': 'one factor R^m, S³ or SO(m)'}[coupling.kind]
        raise ParameterError(f'coupling {coupling.kind}: the factors are '
                             f'{", ".join(coupling.first)} and {", ".join(coupling.second)}; '
                             f'expected {expected} on each side, of the same kind')


def _part(manifold: Manifold, point: np.ndarray, factors: list[int]) -> np.ndarray:
    return np.concatenate([point[manifold.point_slices[i]] for i in factors])


def _distance(manifold: Manifold, point: np.ndarray, first: int, second: int) -> float:
    factor = manifold.factors[first]
    return float(factor.distance(*(factor.unflat(point[manifold.point_slices[i]])
                                   for i in (first, second))))
