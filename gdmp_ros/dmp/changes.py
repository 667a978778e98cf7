"""A primitive changed: between other ends, turned, joined to another, with more functions."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
import functools
from typing import Any
import warnings

import numpy as np

from gdmp_ros.choices import SCALES
from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.forcing import basis, design_matrix
from gdmp_ros.dmp.frames import actions_of, nearest_turn, placed, poses_of, View
from gdmp_ros.dmp.fusion import MOVES
from gdmp_ros.dmp.primitive import carry_frame, change_of_frame, frame_of, P, Primitive
from gdmp_ros.dmp.variation import Variation
from gdmp_ros.errors import DataError, GdmpWarning, ParameterError
from gdmp_ros.manifolds import Euclidean, Manifold, Product
from gdmp_ros.util.names import indices_of
from gdmp_ros.util.numeric import numbers

#: Largest deviation of a turn from an orthogonal matrix.
_TOLERANCE = 1e-6
#: Samples of the forcing term for each basis function.
_SAMPLES = 20
#: A start that is moved further than this for a coupling is reported [m, rad, …].
_FAR = 0.05
#: Start and goal are at one place below this distance [m], and part of the one that is wanted.
_NEAREST_ENDS = 1e-3


def between(primitive: P, start: np.ndarray | None = None, goal: np.ndarray | None = None) -> P:
    """
    Return a primitive with another start and goal; it moves as a roll-out between them would.

    To pass via points there, call `Skill.through` after. The goal of a rhythmic one is the centre
    of its cycle.

    :param start: point; its own by default
    :param goal: point; its own by default
    :raises ManifoldError: if a point is not on the manifold
    :raises ParameterError: for another start of a rhythmic one
    """
    primitive.check_plain('another start or goal')
    if primitive.rhythmic:
        return _around(primitive, start, goal)
    first, last = (own if given is None else primitive.manifold.align(
        primitive.manifold.check_point(given), own)
                   for own, given in ((primitive.start, start), (primitive.goal, goal)))
    return _carried(primitive, first, last)


def _carried(primitive: P, start: np.ndarray, goal: np.ndarray) -> P:
    """A primitive between other ends: its numbers in the frames there."""
    moved = replace(primitive, start=start, frame=primitive.manifold.frame(start), goal=goal)
    by = frame_changes(primitive, moved)
    variation, weights = primitive.variation, primitive.weights
    if primitive.connection == 'parallel':  # the published one has no frame for them
        weights = weights @ by[0].T
    return replace(moved, weights=weights, velocity=by[0] @ primitive.velocity,
                   variation=None if variation is None else _turned_variation(variation, by))


def _around(primitive: P, start: np.ndarray | None, centre: np.ndarray | None) -> P:
    if start is not None:
        primitive.check_ends('another start')
    if centre is None:
        return primitive
    manifold = primitive.manifold
    centre = manifold.align(manifold.check_point(centre), primitive.goal)
    frame = carry_frame(manifold, manifold.frame(primitive.goal), centre)[0]
    return moved_cycle(primitive, centre, frame, lambda coordinates: coordinates)


def moved_cycle(primitive: P, centre: np.ndarray, frame: np.ndarray,
                coordinates: Callable[[np.ndarray], np.ndarray]) -> P:
    """
    Return a rhythmic primitive around another centre.

    :param frame: at the new centre
    :param coordinates: coordinates in it of those in the canonical frame of the old centre
    """
    manifold, old = primitive.manifold, primitive.manifold.frame(primitive.goal)
    offset, _ = manifold.log_in_frame(old, primitive.start)
    moved = coordinates(offset)
    before, after = manifold.transport_frame(old, offset), manifold.transport_frame(frame, moved)
    start = manifold.exp(centre, manifold.from_frame(frame, moved))
    velocity = manifold.to_frame(before, manifold.from_frame(primitive.frame, primitive.velocity))
    canonical = change_of_frame(manifold, frame, manifold.frame(centre))
    weights = np.array([canonical @ coordinates(row) for row in primitive.weights])
    return replace(primitive, start=start, goal=centre, frame=manifold.frame(start),
                   weights=weights, velocity=manifold.to_frame(
                       manifold.frame(start), manifold.from_frame(after, coordinates(velocity))))


def frame_changes(before: Primitive, after: Primitive) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from coordinates before a shift to those after it: at the start, at the goal."""
    manifold = before.manifold
    carried = frame_of(before, after.start)
    start = change_of_frame(manifold, carried, after.frame)
    goal_frame = frame_of(before, before.goal)
    carried = carry_frame(manifold, goal_frame, after.goal)[0]
    goal = change_of_frame(manifold, carried, frame_of(after, after.goal))
    return start, goal


def shifted(primitive: P, shift: np.ndarray) -> P:
    """
    Return a primitive with another start, goal and weights; what varies is carried along.

    :param shift: of the start in the frame there, of the goal in the frame carried there, and
        of the weights row by row, shape ``((2 + n_basis) n,)``
    """
    manifold = primitive.manifold
    size = manifold.tangent_size
    start = manifold.exp(primitive.start, manifold.from_frame(primitive.frame, shift[:size]))
    goal_frame = frame_of(primitive, primitive.goal)
    goal = manifold.exp(primitive.goal, manifold.from_frame(goal_frame, shift[size:2 * size]))
    weights = primitive.weights + shift[2 * size:].reshape(-1, size)
    return _carried(replace(primitive, weights=weights), start, goal)


def _turned_variation(variation: Variation, by: tuple[np.ndarray, np.ndarray]) -> Variation:
    """
    The variation in the coordinates of a shifted primitive.

    :param by: see `frame_changes`
    """
    start, goal = by

    def turned(rows: np.ndarray) -> np.ndarray:
        parts = rows.reshape(-1, len(start), rows.shape[1])
        result = np.einsum('ij,kjr->kir', start, parts)
        result[1] = goal @ parts[1]
        return np.asarray(result.reshape(rows.shape))

    return variation.mapped(turned)


def with_frames(primitive: P, frames: Mapping[str, Any], scale: str = 'none') -> P:
    """
    Return a skill with its task frames somewhere else: as if it had been shown there.

    A roll-out of it begins and ends where these frames have the start and the goal; a player, a
    server or a check executes it there without knowing of frames.

    :param frames: poses by name, as `gdmp_ros.dmp.Rollout` takes them; the others stay. Of an
        object with a free yaw, the turn nearest to the present one is taken
    :param scale: ``none``: the shape keeps its size; ``distance``: positions are scaled by the
        distance from start to goal, divided by the present one, about the start in the frame of
        the start and about the goal in that of the goal
    :raises ParameterError: if a frame is not one of the skill, or no pose; for ``distance`` if
        start and goal are now at the same place
    """
    if not primitive.views:
        raise ParameterError('frames: the skill was learned without task frames')
    if scale not in SCALES:
        raise ParameterError(f'scale is {scale!r}, expected one of {", ".join(SCALES)}')
    names = [view.name for view in primitive.views]
    for name in frames:
        if name not in names:
            raise ParameterError(f'frame {name!r}: the skill has no such frame, expected one of '
                                 f'{", ".join(names)}')
    manifold = primitive.manifold
    dimension, _ = actions_of(manifold)

    def moved(view: View) -> View:
        if view.name not in frames:
            return view
        pose = poses_of(view.name, frames[view.name], dimension)
        return replace(view, pose=nearest_turn(pose, view.pose) if view.free_yaw else pose)
    views = [moved(view) for view in primitive.views]
    start, goal = _ends(manifold, views)
    if scale == 'distance':
        factors = _scales(primitive, _ends(manifold, primitive.views), (start, goal))
        for k, centre in ((0, views[0].skill.start), (-1, views[-1].skill.goal)):
            views[k] = replace(views[k], skill=_scaled(views[k].skill, centre, factors))
    return replace(primitive, views=tuple(views), start=start, frame=manifold.frame(start),
                   goal=manifold.align(goal, primitive.goal))


def _ends(manifold: Manifold, views: Sequence[View]) -> tuple[np.ndarray, np.ndarray]:
    """Where the frame of the start has the start, and that of the goal the goal."""
    start, goal = (placed(manifold, view.pose, point[None])[0] for view, point in (
        (views[0], views[0].skill.start), (views[-1], views[-1].skill.goal)))
    return start, goal


def _scales(primitive: Primitive, before: tuple[np.ndarray, np.ndarray],
            now: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Factor for each number of a flat point: ratio of distances for positions, 1 for others."""
    manifold = primitive.manifold
    factors = np.ones(manifold.point_size)
    for part, action in zip(manifold.point_slices, actions_of(manifold)[1]):
        if action == MOVES:
            shown, wanted = (float(np.linalg.norm((goal - start).reshape(-1)[part]))
                             for start, goal in (before, now))
            if shown < _NEAREST_ENDS * max(wanted, 1.0):
                raise ParameterError(f'scale: start and goal are {shown:.2g} m apart, so that the '
                                     'shape cannot be scaled by their distance')
            factors[part] = wanted / shown
    return factors


def _scaled(primitive: P, centre: np.ndarray, factors: np.ndarray) -> P:
    """A primitive whose positions are scaled about a point; in R^m it is linear in them."""
    manifold = primitive.manifold
    tangent = np.ones(manifold.tangent_size)
    for part, flat in zip(manifold.tangent_slices, manifold.point_slices):
        tangent[part] = factors[flat.start]

    def scaled(points: np.ndarray) -> np.ndarray:
        rows = points.reshape(-1, manifold.point_size)
        middle = centre.reshape(-1)
        moves = factors != 1.0  # other factors stay as they are, to the last digit
        return np.where(moves, middle + factors * (rows - middle), rows).reshape(points.shape)
    segments, start = primitive.segments, scaled(primitive.start)
    return replace(primitive, start=start, goal=scaled(primitive.goal),
                   frame=carry_frame(manifold, primitive.frame, start)[0],
                   weights=primitive.weights * tangent, velocity=primitive.velocity * tangent,
                   segments=replace(segments, waypoints=scaled(segments.waypoints)
                                    if len(segments.waypoints) else segments.waypoints))


def turned(primitive: P, turn: np.ndarray) -> P:
    """
    Return the primitive with its frame turned: every coordinate c becomes ``R c``.

    The path is turned exactly where R belongs to an isometry that keeps the start: every rotation
    of R^m, S^m and S³, of SO(m) that of a conjugation, of SPD matrices that of a congruence.

    :param turn: R, orthogonal, shape ``(n, n)``; on S^m it keeps the direction of the start, of a
        cycle that of its centre
    :raises ParameterError: if it is not orthogonal, or turns tangents out of the tangent space;
        for a skill with couplings
    """
    primitive.check_plain('turning')
    if primitive.couplings:
        raise ParameterError('frame: a skill with couplings cannot be turned about its start: '
                             'each side would turn about its own')
    manifold, size = primitive.manifold, primitive.manifold.tangent_size
    origin = primitive.goal if primitive.rhythmic else primitive.start
    frame = manifold.frame(primitive.goal) if primitive.rhythmic else primitive.frame
    matrix = numbers('frame', turn)
    if (matrix.shape != (size, size) or not np.isfinite(matrix).all()
            or np.abs(matrix @ matrix.T - np.eye(size)).max() > _TOLERANCE):
        raise ParameterError(f'frame: expected an orthogonal matrix of shape {(size, size)}')

    def coordinates(vector: np.ndarray) -> np.ndarray:
        tangent = manifold.from_frame(frame, matrix @ vector)
        inside = manifold.to_frame(frame, tangent)
        if np.abs(inside - matrix @ vector).max() > 1e-9 + _TOLERANCE * np.abs(vector).max():
            raise ParameterError('frame: it turns tangents out of the tangent space')
        return inside

    def point(given: np.ndarray) -> np.ndarray:
        offset, _ = manifold.log_in_frame(frame, given)
        return manifold.exp(origin, manifold.from_frame(frame, coordinates(offset)))
    if primitive.rhythmic:
        return moved_cycle(primitive, primitive.goal, frame, coordinates)
    shape = manifold.point_shape
    waypoints = [point(row.reshape(shape)).reshape(-1) for row in primitive.segments.waypoints]
    segments = primitive.segments
    if waypoints:
        segments = replace(segments, waypoints=np.array(waypoints))
    variation = primitive.variation
    return replace(
        primitive, goal=point(primitive.goal), velocity=coordinates(primitive.velocity),
        weights=_turned_weights(primitive, matrix), segments=segments,
        variation=None if variation is None else _turned_variation(variation, (matrix, matrix)))


def _turned_weights(primitive: Primitive, matrix: np.ndarray) -> np.ndarray:
    """Weights are coordinates in a frame, or with the published connection tangents as stored."""
    if primitive.connection == 'parallel':
        return np.asarray(primitive.weights @ matrix.T)
    manifold, frame = primitive.manifold, primitive.frame
    result = np.empty_like(primitive.weights)
    for row, weights in zip(result, primitive.weights):
        inside = manifold.to_frame(frame, weights)
        # What is normal to a sphere at the start is not turned about it.
        normal = weights - manifold.from_frame(frame, inside)
        row[:] = manifold.from_frame(frame, matrix @ inside) + normal
    return result


def with_functions(primitive: P, count: int) -> P:
    """
    Return the primitive with ``count`` basis functions, or itself if it has as many.

    The forcing term stays the same up to what the functions can describe. So does its variation.
    """
    if primitive.n_basis >= count:
        return primitive
    primitive.check_ends('basis functions')
    matrix = _change(primitive.n_basis, count, primitive.gains.alpha_x)
    variation = primitive.variation
    return replace(primitive, weights=matrix @ primitive.weights,
                   variation=None if variation is None else _changed(
                       variation, matrix, primitive.manifold.tangent_size))


def _changed(variation: Variation, matrix: np.ndarray, size: int) -> Variation:
    """The variation with its rows for other weights."""
    def changed(rows: np.ndarray) -> np.ndarray:
        ends, weights = rows[:2 * size], rows[2 * size:].reshape(matrix.shape[1], -1)
        return np.vstack([ends, (matrix @ weights).reshape(-1, rows.shape[1])])

    return variation.mapped(changed)


@functools.lru_cache(maxsize=8)
def _change(before: int, after: int, alpha_x: float) -> np.ndarray:
    """Matrix from weights to weights of more functions."""
    progress = np.linspace(0.0, 1.0, _SAMPLES * after)
    few, many = (np.empty((len(progress), count)) for count in (before, after))
    for count, matrix in ((before, few), (after, many)):
        design_matrix(basis(count, alpha_x), alpha_x, progress, matrix)
    # Every moment counts alike, although the forcing term decays with the phase.
    scale = np.exp(alpha_x * progress)[:, None]
    return np.asarray(np.linalg.lstsq(scale * many, scale * few, rcond=1e-10)[0])


def joined(first: P, second: P, names: Sequence[str] = ('first', 'second'),
           duration: float | None = None) -> P:
    """
    Return one primitive of two, executed in one motion with one phase.

    Its points are those of both, one after the other. How takes vary is not kept.

    :param names: with which the names of the factors begin: ``left`` gives ``left_position``
    :param duration: [s]; the longer one by default
    :raises ParameterError: if their gains or connections differ, or one is split at the cut locus,
        rhythmic, or has couplings or commands for a gripper
    """
    for one in (first, second):
        one.check_plain('joining')
    for name, item in zip(names, (first, second)):
        for what, given in (('is split at the cut locus', len(item.segments.ends)),
                            ('is rhythmic', item.rhythmic), ('has couplings', item.couplings),
                            ('has commands for a gripper', item.events)):
            if given:
                raise ParameterError(f'{name}: the skill {what}, so it cannot be joined with '
                                     'another one')
    if first.gains != second.gains or first.connection != second.connection:
        raise ParameterError(f'skills to be joined need the same gains and connection, got '
                             f'{first.gains} and {second.gains}, {first.connection} and '
                             f'{second.connection}')
    count = max(first.n_basis, second.n_basis)
    parts = [with_functions(item, count) for item in (first, second)]
    manifold = Product(*(factor for part in parts for factor in part.manifold.factors),
                       names=[f'{side}_{name}' for side, part in zip(names, parts)
                              for name in part.manifold.names])
    def together(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name).reshape(-1) for part in parts])
    return replace(
        parts[0], manifold=manifold, steps=max(part.steps for part in parts),
        start=together('start'), goal=together('goal'), frame=together('frame'),
        velocity=together('velocity'),
        duration=max(part.duration for part in parts) if duration is None else duration,
        weights=np.hstack([part.weights for part in parts]), via=(), variation=None,
        provenance={'joined': {name: dict(part.provenance) for name, part in zip(names, parts)}})


def coupled(primitive: P, coupling: Coupling) -> P:
    """
    Return the primitive with a coupling between factors, such as two arms that carry a tray.

    The second side begins and ends where the coupling asks for. A start that moves far is reported
    with a `GdmpWarning`: the demonstrations differ from the coupling then.

    :raises ParameterError: if it does not fit the manifold
    """
    primitive.check_plain('a coupling')
    manifold = primitive.manifold
    coupling.check(manifold, primitive.steps)
    ends = [coupling.related(manifold, point) for point in (primitive.start, primitive.goal)]
    for name, shown in (('start', primitive.start), ('goal', primitive.goal)):
        deviation = float(coupling.deviation(manifold, shown).max())
        if deviation > _FAR:
            warnings.warn(f'the {name} of {", ".join(coupling.second)} is {deviation:.3g} '
                          '(m, rad) from where the coupling asks for it, and was moved there: the '
                          'demonstrations do not keep the relation', GdmpWarning, stacklevel=2)
    moved = between(primitive, *ends)
    return replace(moved, couplings=(*primitive.couplings, coupling))


def joints_in_order(primitive: P, names: Sequence[str]) -> P:
    """
    Return a primitive of joints with the joints of an arm, in its order.

    Joints are known by their names, which its provenance has (``joints``); one without names, or
    of something else, is returned as it is. The fingers of a hand are left out, with a warning.

    :param names: of the joints of the arm
    :raises DataError: if a joint is missing, there twice, or unknown to the arm
    """
    known = list(getattr(primitive, 'provenance', {}).get('joints', ()))
    if primitive.manifold.names != ('joints',) or not known or known == list(names):
        return primitive
    chosen = indices_of(names, known, 'the joint')
    left = [name for index, name in enumerate(known) if index not in chosen]
    unknown = [name for name in left if 'finger' not in name.lower()]
    if unknown or len(set(chosen)) < len(chosen):
        raise DataError(f'the skill is of the joints {", ".join(known)}; the arm has '
                        f'{", ".join(names)}')
    if left:
        warnings.warn(f'{", ".join(left)}: left out, no joint of the arm', GdmpWarning,
                      stacklevel=2)
    size, manifold = len(known), Product(Euclidean(len(chosen)), names=('joints',))
    variation = primitive.variation
    if variation is not None:
        def rows(array: np.ndarray) -> np.ndarray:
            blocks = array.reshape(-1, size, *array.shape[1:])[:, chosen]
            return blocks.reshape(-1, *array.shape[1:])
        variation = replace(variation.mapped(rows), noise=variation.noise[chosen])
    segments = primitive.segments
    if len(segments.ends):
        segments = replace(segments, waypoints=segments.waypoints[:, chosen])
    start = primitive.start[chosen]
    return replace(primitive, manifold=manifold, start=start, goal=primitive.goal[chosen],
                   frame=manifold.frame(start), velocity=primitive.velocity[chosen],
                   weights=primitive.weights[:, chosen], segments=segments, variation=variation,
                   provenance={**primitive.provenance, 'joints': [known[k] for k in chosen]})


def half(primitive: P, number: int) -> P:
    """
    Return the first (0) or second (1) half of the factors of a primitive as a primitive.

    :raises ParameterError: if it has an odd number of factors
    """
    primitive.check_plain('a part of the motion')
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


def related(primitive: Primitive, point: np.ndarray, given: int = 0) -> np.ndarray:
    """
    Return a point in which one side follows the other one, such as a goal for both.

    :param point: of the manifold
    :param given: side of the couplings that stays: 0 the first one, 1 the second one
    """
    point = primitive.manifold.check_point(point)
    for coupling in primitive.couplings:
        point = coupling.related(primitive.manifold, point, given)
    return point
