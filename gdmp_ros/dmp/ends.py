"""The motion of a primitive between another start and another goal, or around another centre."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gdmp_ros.dmp.primitive import carry_frame, change_of_frame, frame_of, Primitive
from gdmp_ros.dmp.variation import Variation


def between(primitive: Primitive, start: np.ndarray | None = None,
            goal: np.ndarray | None = None) -> Primitive:
    """
    Return a primitive with another start and goal; it moves as a roll-out between them would.

    A rhythmic one moves around another centre.

    :param start: point; its own by default
    :param goal: point; its own by default
    :raises ManifoldError: if a point is not on the manifold
    :raises ParameterError: for another start of a rhythmic one
    """
    if primitive.rhythmic:
        return _around(primitive, start, goal)
    manifold = primitive.manifold
    first = primitive.start if start is None else manifold.check_point(start)
    last = primitive.goal if goal is None else manifold.check_point(goal)
    moved = replace(primitive, start=first, frame=manifold.frame(first), goal=last)
    by = turns(primitive, moved)
    variation = primitive.variation
    weights = primitive.weights
    if primitive.connection == 'parallel':  # the published one has no frame for them
        weights = weights @ by[0].T
    return replace(moved, weights=weights, velocity=by[0] @ primitive.velocity,
                   variation=None if variation is None else turned_variation(variation, by))


def _around(primitive: Primitive, start: np.ndarray | None, centre: np.ndarray | None
            ) -> Primitive:
    if start is not None:
        primitive.check_ends('another start')
    if centre is None:
        return primitive
    manifold = primitive.manifold
    centre = manifold.check_point(centre)
    frame = carry_frame(manifold, manifold.frame(primitive.goal), centre)[0]
    return moved_cycle(primitive, centre, frame, lambda coordinates: coordinates)


def moved_cycle(primitive: Primitive, centre: np.ndarray, frame: np.ndarray,
                coordinates: Callable[[np.ndarray], np.ndarray]) -> Primitive:
    """
    Return a rhythmic primitive around another centre.

    :param frame: at the new centre
    :param coordinates: coordinates in it of those in the canonical frame of the old centre
    """
    manifold, old = primitive.manifold, primitive.manifold.frame(primitive.goal)
    away, _ = manifold.log_in_frame(old, primitive.start)
    moved = coordinates(away)
    before, after = manifold.transport_frame(old, away), manifold.transport_frame(frame, moved)
    start = manifold.exp(centre, manifold.from_frame(frame, moved))
    velocity = manifold.to_frame(before, manifold.from_frame(primitive.frame, primitive.velocity))
    canonical = change_of_frame(manifold, frame, manifold.frame(centre))
    weights = np.array([canonical @ coordinates(row) for row in primitive.weights])
    return replace(primitive, start=start, goal=centre, frame=manifold.frame(start),
                   weights=weights, velocity=manifold.to_frame(
                       manifold.frame(start), manifold.from_frame(after, coordinates(velocity))))


def turns(before: Primitive, after: Primitive) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from coordinates before a shift to those after it: at the start, at the goal."""
    manifold = before.manifold
    carried = frame_of(before, after.start)
    start = change_of_frame(manifold, carried, after.frame)
    goal_frame = frame_of(before, before.goal)
    carried = carry_frame(manifold, goal_frame, after.goal)[0]
    goal = change_of_frame(manifold, carried, frame_of(after, after.goal))
    return start, goal


def shifted(primitive: Primitive, shift: np.ndarray) -> Primitive:
    """
    Return a primitive with another start, goal and weights.

    :param shift: of the start in the frame there, of the goal in the frame carried there, and
        of the weights row by row, shape ``((2 + n_basis) n,)``
    """
    manifold = primitive.manifold
    size = manifold.tangent_size
    start = manifold.exp(primitive.start, manifold.from_frame(primitive.frame, shift[:size]))
    goal_frame = frame_of(primitive, primitive.goal)
    goal = manifold.exp(primitive.goal, manifold.from_frame(goal_frame, shift[size:2 * size]))
    weights = primitive.weights + shift[2 * size:].reshape(-1, size)
    moved = replace(primitive, start=start, goal=goal, frame=manifold.frame(start))
    turn = turns(primitive, moved)[0]
    return replace(moved, weights=weights @ turn.T, velocity=turn @ primitive.velocity)


def turned_variation(variation: Variation, by: tuple[np.ndarray, np.ndarray]) -> Variation:
    """
    The variation in the coordinates of a shifted primitive.

    :param by: see `turns`
    """
    start, goal = by

    def turned(rows: np.ndarray) -> np.ndarray:
        parts = rows.reshape(-1, len(start), rows.shape[1])
        result = np.einsum('ij,kjr->kir', start, parts)
        result[1] = goal @ parts[1]
        return np.asarray(result.reshape(rows.shape))

    return variation.mapped(turned)
