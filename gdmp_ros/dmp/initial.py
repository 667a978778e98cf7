"""How a roll-out begins: its memory, scalars, relations; a start anywhere and in motion."""
from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.forcing import basis, forcing, periodic_basis
from gdmp_ros.dmp.goal import STILL_TOLERANCES, switch_goal
from gdmp_ros.dmp.layout import blank, Motion, parts, RELATION, SCALARS
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.primitive import carry_frame, Primitive
from gdmp_ros.dmp.relations import Term
from gdmp_ros.dmp.segments import targets
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import Manifold

#: A start with a given velocity is corrected over this part of a duration.
_CORRECTION = 0.1


class Start(NamedTuple):
    """
    Where a roll-out begins; see `gdmp_ros.dmp.Rollout`.

    :ivar point: None for the skill's own start
    :ivar velocity: tangent at the point [1/s]
    :ivar acceleration: tangent at the point [1/s²]
    :ivar speed: of the phase; None for that of the options
    """

    point: np.ndarray | None = None
    velocity: np.ndarray | None = None
    acceleration: np.ndarray | None = None
    speed: float | None = None


def new_memory(skill: Primitive, options: Options) -> np.ndarray:
    """Memory with everything that does not change while a skill is executed."""
    manifold, segments = skill.manifold, skill.segments
    memory = blank(manifold.factor_table, skill.n_basis, len(segments.ends),
                   _obstacle_factor(manifold), relation_count(skill.couplings, manifold))
    motion = parts(memory)
    motion.split[:] = segments.split or [False] * len(manifold.factors)
    motion.basis[:] = (periodic_basis(skill.n_basis) if skill.rhythmic
                       else basis(skill.n_basis, skill.gains.alpha_x))
    motion.weights[:] = skill.weights
    motion.tolerances[:] = options.tolerances_of(manifold)
    motion.still_speeds[:] = [STILL_TOLERANCES * factor.goal_tolerance
                              for factor in manifold.factors]
    if len(segments) > 1:
        motion.segment_ends[:] = segments.ends
        motion.waypoints[:] = segments.waypoints
    write_relations(motion, skill.couplings, manifold)
    decay = -skill.gains.alpha_z / skill.steps
    motion.decay[:] = math.exp(decay)
    motion.pull[:] = -math.expm1(decay) * skill.gains.beta_z
    return memory


def _obstacle_factor(manifold: Manifold) -> int:
    """Number of the first factor that is a position, -1 without one."""
    return next((i for i, factor in enumerate(manifold.factors)
                 if factor.is_flat and factor.size in (2, 3)), -1)


def initialise(motion: Motion, skill: Primitive, options: Options, goal: np.ndarray,
               duration: float, start: Start) -> None:
    """
    Write everything that changes while a skill is executed, as it is at the beginning.

    :param goal: point
    :raises ParameterError: if a number is not finite, or a velocity is given at speed 0
    """
    manifold, parallel = skill.manifold, skill.connection == 'parallel'
    first, frame, opposite = skill.start, skill.frame, False
    if start.point is not None:
        first = start.point
        frame, opposite = carry_frame(manifold, skill.frame, first)
    _reset_scalars(motion, skill, options, duration)
    if start.speed is not None:
        motion.scalars.speed = motion.scalars.speed_ramp = motion.scalars.speed_goal = start.speed
    motion.scalars.cut_locus = int(opposite)
    motion.frames.start[:] = frame
    for point in (motion.points.start, motion.points.node):
        point[:] = first.reshape(-1)
    for point in (motion.points.goal, motion.points.anchor):
        point[:] = goal.reshape(-1)
    motion.frames.anchor[:] = motion.frames.goal[:] = manifold.frame(goal)
    for tangent in (motion.tangents.goal_offset, motion.tangents.target_velocity,
                    motion.tangents.goal_velocity, motion.tangents.lead, motion.peaks):
        tangent[:] = 0.0
    motion.tangents.velocity[:] = (skill.velocity if parallel
                                   else manifold.from_frame(frame, skill.velocity))
    if skill.rhythmic:
        _begin_cycle(motion, skill, options, goal, start)
    # On the cut locus both logarithms then begin along the same one of the shortest ways.
    target = targets(manifold, skill.segments, motion.points.goal, np.array([-1.0]))[0]
    target = target.reshape(manifold.point_shape)
    motion.tangents.to_goal[:] = (manifold.log_in_frame(frame, target) if parallel
                                  else manifold.log_anyway(first, target))[0]
    write_deviations(motion, skill.couplings, manifold, first)
    if start.velocity is not None:
        _correct_start(motion, skill, frame, start)
    elif start.acceleration is not None:
        raise ParameterError('an initial acceleration needs an initial velocity')


def _begin_cycle(motion: Motion, skill: Primitive, options: Options, centre: np.ndarray,
                 start: Start) -> None:
    """
    Begin a rhythmic motion: on its cycle, or anywhere else from rest.

    From rest the centre moves there from the start while the amplitude grows, so that the
    acceleration begins at zero.
    """
    manifold, scalars, frames = skill.manifold, motion.scalars, motion.frames
    scalars.amplitude_goal = options.amplitude
    frame, opposite = carry_frame(manifold, manifold.frame(skill.goal), centre)
    if start.point is None and start.velocity is None and np.array_equal(centre, skill.goal):
        scalars.amplitude = 1.0
        frames.anchor[:] = frames.goal[:] = frame
        return
    motion.tangents.velocity[:] = 0.0
    first = motion.points.start.reshape(manifold.point_shape)
    frames.anchor[:], far = carry_frame(manifold, frame, first)
    motion.points.anchor[:] = motion.points.goal[:] = motion.points.start
    switch_goal(manifold, motion, centre, None, options.goal_speed)
    scalars.cut_locus = int(opposite or far or scalars.cut_locus)


def finite_tangent(manifold: Manifold, name: str, tangent: np.ndarray) -> np.ndarray:
    """
    Return a tangent as a float64 vector.

    :param name: what it is, for messages
    :raises ManifoldError: if the shape is wrong
    :raises ParameterError: if an entry is not finite
    """
    vector = manifold.vector(tangent)
    if not np.isfinite(vector).all():
        raise ParameterError(f'the {name} has an entry that is NaN or infinite')
    return vector


def recover(manifold: Manifold, motion: Motion, point: np.ndarray) -> None:
    """
    Let a roll-out whose last step was not finite go on from rest where it is held.

    Its goal is this point, until it is switched.

    :param point: where it is held
    """
    scalars, tangents, frames = motion.scalars, motion.tangents, motion.frames
    if scalars.interval >= 0.0 and scalars.parallel:
        # From the middle of the interval to the point that is held.
        frames.mid[:] = manifold.transport_frame(
            np.array(frames.mid), 0.5 / scalars.steps * tangents.velocity)
    for tangent in (tangents.velocity, tangents.velocity_before, tangents.target_velocity,
                    tangents.goal_velocity, tangents.goal_offset, tangents.lead):
        tangent[:] = 0.0
    for goal in (motion.points.anchor, motion.points.goal):
        goal[:] = point.reshape(-1)
    frames.anchor[:] = frames.goal[:] = manifold.frame(point)
    scalars.goal_is_moving = scalars.target_is_moving = scalars.target_by_progress = 0
    scalars.held = 0
    scalars.progress = (scalars.interval + 1.0) / scalars.steps
    scalars.speed = scalars.speed_ramp = scalars.speed_slope = 0.0


def _reset_scalars(motion: Motion, skill: Primitive, options: Options, duration: float) -> None:
    scalars, gains = motion.scalars, skill.gains
    for name in SCALARS.names or ():
        if not name.startswith('obstacle'):
            setattr(scalars, name, 0.0)
    scalars.interval = -1.0
    scalars.speed = scalars.speed_ramp = scalars.speed_goal = options.speed
    scalars.slowdown, scalars.speed_rate = 1.0, options.speed_rate
    scalars.duration, scalars.steps = duration, skill.steps
    scalars.time_per_progress = duration / options.speed if options.speed > 0.0 else duration
    scalars.alpha_x, scalars.alpha_g = gains.alpha_x, gains.alpha_g
    scalars.stiffness = gains.alpha_z * gains.beta_z
    scalars.goal_rate, scalars.settle_by, scalars.arrived_at = math.inf, 2.0, -1.0
    scalars.parallel = int(skill.connection == 'parallel')
    scalars.rhythmic = int(skill.rhythmic)


def _correct_start(motion: Motion, skill: Primitive, frame: np.ndarray, start: Start) -> None:
    """
    Begin with a velocity and an acceleration, whatever the skill would begin with.

    A term that fades over `_CORRECTION` of a duration makes up the difference: at s = 0 both
    logarithms cancel, ``Z' = α_z (β_z (F + term) - Z)``. A rhythmic motion begins with F = 0.
    """
    scalars, tangents, manifold = motion.scalars, motion.tangents, skill.manifold
    velocity = np.zeros(manifold.tangent_size) if start.velocity is None else start.velocity
    acceleration = (np.zeros(manifold.tangent_size) if start.acceleration is None
                    else start.acceleration)
    if not scalars.speed > 0.0:
        raise ParameterError('an initial velocity needs an initial speed above 0')
    velocity = finite_tangent(manifold, 'initial velocity', velocity)
    acceleration = finite_tangent(manifold, 'initial acceleration', acceleration)
    scale = scalars.duration / scalars.speed
    first, second = (manifold.to_frame(frame, v) if scalars.parallel else manifold.vector(v)
                     for v in (scale * velocity, scale * scale * acceleration))
    begins = np.zeros(manifold.tangent_size)
    if not skill.rhythmic:
        forcing(motion.basis, motion.weights, 0.0, 1.0, begins)
    tangents.velocity[:] = first
    tangents.start_correction[:] = ((second + skill.gains.alpha_z * first) / scalars.stiffness
                                    - begins)
    scalars.correction_end = _CORRECTION


def relation_count(couplings: Sequence[Coupling], manifold: Manifold) -> int:
    """How many relations between two factors they are."""
    return sum(len(coupling.terms(manifold)) for coupling in couplings)


def write_relations(motion: Motion, couplings: Sequence[Coupling], manifold: Manifold) -> None:
    """Write couplings to the memory of a motion (`relation_count`)."""
    for row, (coupling, term) in enumerate(_terms(couplings, manifold)):
        values = (term.kind, term.first, term.second, term.carrier, int(coupling.leads),
                  term.distance, 0.0, 0.0)
        for name, value in zip(RELATION.names or (), values):
            setattr(motion.relations[row], name, value)
        motion.related[row, manifold.point_slices[term.second]] = term.element


def write_deviations(motion: Motion, couplings: Sequence[Coupling], manifold: Manifold,
                     start: np.ndarray) -> None:
    """Write the deviations at a start, which fade out, and gains that are stable with them."""
    for row, (coupling, term) in enumerate(_terms(couplings, manifold)):
        deviation = term.deviation(manifold, manifold.flat(start))
        motion.deviations[row] = deviation
        # How fast the relative motion answers to a force: the inverse masses add.
        mobility = 1.0 if coupling.leads else 2.0
        if term.carrier >= 0 and not coupling.leads:
            begins = term.element + deviation[manifold.tangent_slices[term.second]]
            mobility += 4.0 * max(float(lever @ lever) for lever in (term.element, begins))
        motion.relations[row].stiffness = coupling.rate ** 2 / mobility
        motion.relations[row].damping = 2.0 * coupling.rate / mobility


def _terms(couplings: Sequence[Coupling], manifold: Manifold) -> list[tuple[Coupling, Term]]:
    return [(coupling, term) for coupling in couplings for term in coupling.terms(manifold)]
