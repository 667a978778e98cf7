"""The relations of a skill in the memory of a motion."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.layout import Motion, RELATION
from gdmp_ros.dmp.relations import DISTANCE
from gdmp_ros.manifolds import Manifold


def relation_count(couplings: Sequence[Coupling], manifold: Manifold) -> int:
    """How many relations between two factors they are."""
    return sum(len(coupling.terms(manifold)) for coupling in couplings)


def write_relations(motion: Motion, couplings: Sequence[Coupling], manifold: Manifold) -> None:
    """Write couplings to the memory of a motion (`relation_count`)."""
    row = 0
    for coupling in couplings:
        for term in coupling.terms(manifold):
            # How fast the relative motion answers to a force: the inverse masses add.
            mobility = 1.0 if coupling.leads else 2.0
            if term.carrier >= 0 and not coupling.leads:
                mobility += 4.0 * float(term.element @ term.element)
            values = (term.kind, term.first, term.second, term.carrier, int(coupling.leads),
                      term.distance, coupling.rate ** 2 / mobility, 2.0 * coupling.rate / mobility)
            for name, value in zip(RELATION.names or (), values):
                setattr(motion.relations[row], name, value)
            motion.related[row, manifold.point_slices[term.second]] = term.element
            row += 1


def write_deviations(motion: Motion, couplings: Sequence[Coupling], manifold: Manifold,
                     frame: np.ndarray, start: np.ndarray) -> None:
    """
    Write the deviations at a start, which fade out.

    :param frame: at the start
    """
    row = 0
    for coupling in couplings:
        for term in coupling.terms(manifold):
            there = term.partners(manifold, manifold.flat(start))
            way, _ = manifold.log_in_frame(frame, there)
            if term.kind == DISTANCE:
                length = np.linalg.norm(way[manifold.tangent_slices[term.second]])
                way *= 1.0 - term.distance / length if length > 0.0 else 0.0
            motion.deviations[row] = way
            row += 1
