"""One skill of two, executed in one motion with one phase; and each half of such a skill."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import warnings

import numpy as np

from gdmp_ros.dmp.basis_change import with_functions
from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.ends import between
from gdmp_ros.dmp.primitive import Primitive
from gdmp_ros.errors import GdmpWarning, ParameterError
from gdmp_ros.manifolds import Product

#: A start that is moved further than this for a coupling is reported [m, rad, …].
_FAR = 0.05


def joined(first: Primitive, second: Primitive, names: Sequence[str] = ('first', 'second'),
           duration: float | None = None) -> Primitive:
    """
    Return one primitive of two: its points are those of both, one after the other.

    Both begin and end together, with one phase. How takes vary is not kept.

    :param names: with which the names of the factors begin: ``left`` gives ``left_position``
    :param duration: [s]; the longer one by default
    :raises ParameterError: if their gains or connections differ, or one is split at the cut locus,
        rhythmic, or has couplings or commands for a gripper
    """
    for name, one in zip(names, (first, second)):
        for what, given in (('is split at the cut locus', len(one.segments.ends)),
                            ('is rhythmic', one.rhythmic), ('has couplings', one.couplings),
                            ('has commands for a gripper', one.events)):
            if given:
                raise ParameterError(f'{name}: the skill {what}, so it cannot be joined with '
                                     'another one')
    if first.gains != second.gains or first.connection != second.connection:
        raise ParameterError(f'skills to be joined need the same gains and connection, got '
                             f'{first.gains} and {second.gains}, {first.connection} and '
                             f'{second.connection}')
    count = max(first.n_basis, second.n_basis)
    parts = [with_functions(one, count) for one in (first, second)]
    manifold = Product(*(factor for one in parts for factor in one.manifold.factors),
                       names=[f'{side}_{name}' for side, one in zip(names, parts)
                              for name in one.manifold.names])
    def together(name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name).reshape(-1) for one in parts])
    return replace(
        parts[0], manifold=manifold, steps=max(one.steps for one in parts),
        start=together('start'), goal=together('goal'), frame=together('frame'),
        velocity=together('velocity'),
        duration=max(one.duration for one in parts) if duration is None else duration,
        weights=np.hstack([one.weights for one in parts]), via=(), variation=None,
        provenance={'joined': {name: dict(one.provenance) for name, one in zip(names, parts)}})


def coupled(primitive: Primitive, coupling: Coupling) -> Primitive:
    """
    Return the primitive with a coupling; the second side begins and ends where it asks for.

    A start that moves far is reported with a `GdmpWarning`: the demonstrations differ from the
    coupling then.

    :raises ParameterError: if it does not fit
    """
    manifold = primitive.manifold
    coupling.check(manifold, primitive.steps)
    ends = [coupling.related(manifold, point) for point in (primitive.start, primitive.goal)]
    for name, shown in (('start', primitive.start), ('goal', primitive.goal)):
        away = float(coupling.deviation(manifold, shown).max())
        if away > _FAR:
            warnings.warn(f'the {name} of {", ".join(coupling.second)} is {away:.3g} (m, rad) '
                          'from where the coupling asks for it, and was moved there: the '
                          'demonstrations do not keep the relation', GdmpWarning, stacklevel=3)
    moved = between(primitive, *ends)
    return replace(moved, couplings=(*primitive.couplings, coupling))


def half(primitive: Primitive, number: int) -> Primitive:
    """
    Return the first (0) or second (1) half of the factors of a primitive as a primitive.

    :raises ParameterError: if it has an odd number of factors
    """
    factors = primitive.manifold.factors
    if len(factors) % 2:
        raise ParameterError(f'the skill is on {primitive.manifold!r}, which has no two halves')
    count = len(factors) // 2
    chosen = slice(number * count, (number + 1) * count)
    manifold = Product(*factors[chosen], names=primitive.manifold.names[chosen])
    points, tangents, frames = (
        slice(*(sum(getattr(factor, size) for factor in factors[:end])
                for end in (chosen.start, chosen.stop)))
        for size in ('point_size', 'tangent_size', 'frame_size'))
    segments = primitive.segments
    if len(segments.ends):
        segments = replace(segments, waypoints=segments.waypoints[:, points],
                           split=segments.split[chosen])
    return replace(primitive, manifold=manifold, start=primitive.start[points],
                   goal=primitive.goal[points], frame=primitive.frame[frames],
                   velocity=primitive.velocity[tangents], weights=primitive.weights[:, tangents],
                   segments=segments, variation=None, couplings=())


def related(primitive: Primitive, point: np.ndarray, given: int) -> np.ndarray:
    """
    Return a point in which the couplings are kept: one side follows the other one.

    :param given: side that stays, 0 or 1
    """
    for coupling in primitive.couplings:
        point = coupling.related(primitive.manifold, point, given)
    return point
