"""
Relations that two factors of a motion keep: the force of their potential, compiled.

A relation has the potential ``U = ½ κ e²``, with e its deviation: ``d(Y₁ H, Y₂)`` where the points
of the factors form a group, ``|p₂ - p₁ - R₁ t|`` where an orientation carries the offset, and
``d(Y₁, Y₂) - δ`` on any manifold. ``-grad U`` and a damping of the relative velocity are added to
the accelerations of both factors, or only to that of the second one if the first one leads. Both
are computed from the middle of the interval before either velocity changes. With fixed goals,
``V + U`` decreases, where V is the Lyapunov function of [GDMP] Theorem 1. A start that does not
keep the relation begins with the relation that it has, which then becomes the wanted one.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.layout import RELATION
from gdmp_ros.kernels import always_inline, kernel, noinline, numbers_at
from gdmp_ros.manifolds import Euclidean, Manifold, UnitQuaternion
from gdmp_ros.manifolds.factors import (
    factor_exp,
    factor_from_frame,
    factor_log_in_frame,
    factor_to_frame,
    frame_point,
)
from gdmp_ros.manifolds.linalg import copy_numbers, norm
from gdmp_ros.manifolds.quaternion import conjugate_multiply, multiply_conjugate, rotate
from gdmp_ros.manifolds.quaternion import multiply as multiply_quaternions
from gdmp_ros.util.profiles import smoothstep

#: Kinds: a geodesic distance; a constant offset; a relative quaternion; a relative matrix.
DISTANCE, OFFSET, QUATERNION, MATRIX = range(4)
#: A deviation at the start fades out within this part of a duration.
_FADE = 0.25
#: Points nearer than this have no direction to each other.
_SAME = 1e-12


@kernel
def partner_points(relations, k, related, factors, point, target, work):
    """
    Write where each factor of a relation would keep it, given the other one.

    The other numbers of ``target`` do not change. With `DISTANCE` it is the other point.

    :param relations: records `gdmp_ros.dmp.layout.RELATION`
    :param k: number of the relation
    :param related: its element of a group, where the second factor has its point
    """
    noinline()
    relation = relations[k]
    first, second = factors[int(relation.first)], factors[int(relation.second)]
    count = first.point_end - first.point
    a, b = numbers_at(point, first.point, count), numbers_at(point, second.point, count)
    to_a, to_b = numbers_at(target, first.point, count), numbers_at(target, second.point, count)
    element = numbers_at(related, second.point, count)
    if relation.kind == DISTANCE:
        copy_numbers(count, b, to_a)
        copy_numbers(count, a, to_b)
    elif relation.kind == OFFSET:
        copy_numbers(count, element, to_b)
        if relation.carrier >= 0:
            rotate(numbers_at(point, factors[int(relation.carrier)].point, 4), to_b, to_b)
        for i in range(count):
            to_a[i] = b[i] - to_b[i]
            to_b[i] += a[i]
    elif relation.kind == QUATERNION:
        multiply_quaternions(a, element, to_b)
        multiply_conjugate(b, element, to_a)
        # q and -q are the same orientation: the nearer one is meant.
        if to_b[0] * b[0] + to_b[1] * b[1] + to_b[2] * b[2] + to_b[3] * b[3] < 0.0:
            for i in range(4):
                to_a[i], to_b[i] = -to_a[i], -to_b[i]
    else:
        m = first.size
        for i in range(m):
            for j in range(m):
                forth, back = 0.0, 0.0
                for n in range(m):
                    forth += a[m * i + n] * element[m * n + j]
                    back += b[m * i + n] * element[m * j + n]
                to_a[m * i + j], to_b[m * i + j] = back, forth


@always_inline
def _cross(a, b, scale, out):
    out[0] = scale * (a[1] * b[2] - a[2] * b[1])
    out[1] = scale * (a[2] * b[0] - a[0] * b[2])
    out[2] = scale * (a[0] * b[1] - a[1] * b[0])


@always_inline
def _keep_distance(damping, distance, n, ways, velocities, forces):
    """Force along the geodesic between two points; it replaces the way to the other point."""
    (to_first, to_second), (first_velocity, second_velocity) = ways, velocities
    length = norm(n, to_second)
    if length < _SAME:
        for i in range(n):
            to_first[i], to_second[i] = 0.0, 0.0
        return
    approach = 0.0
    for i in range(n):
        approach += (to_first[i] * first_velocity[i] + to_second[i] * second_velocity[i]) / length
    share = 1.0 - distance / length
    damping *= approach / length
    for i in range(n):
        forces[0][i] = -damping * to_first[i]
        forces[1][i] = -damping * to_second[i]
        to_first[i] *= share
        to_second[i] *= share


@always_inline
def _damp(motion, k, lever):
    """
    Write the damping of the relative velocity in a group, in frames, to ``rate``.

    Its tangents belong to the base frame, those of all points alike.

    :param lever: from the first point to the second one, turned by the carrier; `OFFSET` only
    """
    relation, tangents, frame = motion.relations[k], motion.tangents, motion.frames.mid
    first, second = motion.factors[int(relation.first)], motion.factors[int(relation.second)]
    n = first.tangent_end - first.tangent
    rates, work = tangents.curvature, motion.work
    factor_from_frame(first, frame, tangents.velocity_before, rates, work)
    factor_from_frame(second, frame, tangents.velocity_before, rates, work)
    a, b = numbers_at(rates, first.tangent, n), numbers_at(rates, second.tangent, n)
    for i in range(n):
        b[i] -= a[i]
    if relation.carrier >= 0:
        carrier = motion.factors[int(relation.carrier)]
        turn = numbers_at(rates, carrier.tangent, 3)
        factor_from_frame(carrier, frame, tangents.velocity_before, rates, work)
        # Tangents of quaternions are half the angular velocity.
        _cross(turn, lever, 2.0, a)
        for i in range(3):
            b[i] -= a[i]
    for i in range(n):
        b[i] *= -relation.damping
        a[i] = -b[i]
    factor_to_frame(first, frame, rates, tangents.rate, work)
    factor_to_frame(second, frame, rates, tangents.rate, work)


@always_inline
def _turn_carrier(motion, carrier, lever, force):
    """Add the torque of a force on the second point to the orientation that carries it."""
    tangents = motion.tangents
    torque = numbers_at(tangents.curvature, carrier.tangent, 3)
    _cross(lever, force, -2.0, torque)
    factor_to_frame(carrier, motion.frames.mid, tangents.curvature, tangents.rate, motion.work)
    for i in range(carrier.tangent, carrier.tangent_end):
        tangents.spare[i] += tangents.rate[i]


@always_inline
def _keep(motion, k, fade):
    """Add the accelerations of one relation to ``spare``."""
    relation, tangents, points = motion.relations[k], motion.tangents, motion.points
    first, second = motion.factors[int(relation.first)], motion.factors[int(relation.second)]
    n, p = first.tangent_end - first.tangent, motion.sizes.point
    related = numbers_at(motion.related, k * p, p)
    deviation = numbers_at(motion.deviations, k * motion.sizes.tangent, motion.sizes.tangent)
    # One element for both sides: two targets that fade by themselves would contradict each other
    # as soon as their frames have turned.
    for i in range(second.tangent, second.tangent_end):
        tangents.offset[i] = fade * deviation[i]
    if relation.kind != DISTANCE:
        factor_exp(second, related, tangents.offset, points.element, motion.work)
    partner_points(motion.relations, k, points.element, motion.factors, points.mid, points.before,
                   motion.work)
    distance = relation.distance + fade * deviation[second.tangent]
    factor_log_in_frame(first, motion.frames.mid, points.before, tangents.offset, motion.work)
    factor_log_in_frame(second, motion.frames.mid, points.before, tangents.offset, motion.work)
    way_a = numbers_at(tangents.offset, first.tangent, n)
    way_b = numbers_at(tangents.offset, second.tangent, n)
    force_a = numbers_at(tangents.rate, first.tangent, n)
    force_b = numbers_at(tangents.rate, second.tangent, n)
    lever = numbers_at(points.before, second.point, n)
    if relation.kind == DISTANCE:
        for i in range(n):
            force_a[i], force_b[i] = 0.0, 0.0
        _keep_distance(relation.damping, distance, n, (way_a, way_b),
                       (numbers_at(tangents.velocity_before, first.tangent, n),
                        numbers_at(tangents.velocity_before, second.tangent, n)),
                       (force_a, force_b))
    else:
        if relation.carrier >= 0:
            for i in range(3):
                lever[i] -= points.mid[first.point + i]
        _damp(motion, k, lever)
    for i in range(n):
        force_a[i] += relation.stiffness * way_a[i]
        force_b[i] += relation.stiffness * way_b[i]
        tangents.spare[second.tangent + i] += force_b[i]
    if relation.leads == 1:
        return
    for i in range(n):
        tangents.spare[first.tangent + i] += force_a[i]
    if relation.carrier >= 0:
        _turn_carrier(motion, motion.factors[int(relation.carrier)], lever, force_b)


@always_inline
def keep_relations(motion, s):
    """Add what the relations of the motion do within an interval to its velocity."""
    noinline()
    tangents, scalars = motion.tangents, motion.scalars
    # `mid` and `before` of the points are used by the published connection only.
    frame_point(motion.factors, motion.frames.mid, motion.points.mid, motion.work)
    fade = 1.0 - smoothstep(s / _FADE) if s < _FADE else 0.0
    for i in range(motion.sizes.tangent):
        tangents.spare[i] = 0.0
    for k in range(motion.sizes.relations):
        _keep(motion, k, fade)
    for i in range(motion.sizes.tangent):
        tangents.velocity[i] += motion.pull[i] / scalars.stiffness * tangents.spare[i]


class Term(NamedTuple):
    """
    One relation between two factors, in Python; see `gdmp_ros.dmp.layout.RELATION`.

    :ivar element: of the group, flat; zeros with `DISTANCE`
    """

    kind: int
    first: int
    second: int
    element: np.ndarray
    carrier: int = -1
    distance: float = 0.0

    def partners(self, manifold: Manifold, point: np.ndarray) -> np.ndarray:
        """
        Return a point in which each factor is where it would keep the relation, see above.

        :param point: flat
        """
        record, target = np.zeros(1, RELATION), np.array(point)
        record[0] = (self.kind, self.first, self.second, self.carrier, 0, self.distance, 0, 0)
        related = np.zeros(manifold.point_size)
        related[manifold.point_slices[self.second]] = self.element
        partner_points(record, 0, related, manifold.factor_table, point, target,
                       manifold.scratch())
        return target

    def deviation(self, manifold: Manifold, point: np.ndarray) -> np.ndarray:
        """
        Way from the relation to the one that a point has, where the second factor has its tangent.

        With `DISTANCE` the first number is the difference of the distances.

        :param point: flat
        """
        result, factor = np.zeros(manifold.tangent_size), manifold.factors[self.second]
        a, b = (point[manifold.point_slices[side]] for side in (self.first, self.second))
        columns = manifold.tangent_slices[self.second]
        if self.kind == DISTANCE:
            result[columns.start] = factor.distance(factor.unflat(a),
                                                    factor.unflat(b)) - self.distance
            return result
        here = relative_element(factor, a, b)
        if self.carrier >= 0:
            here = turned_back(point[manifold.point_slices[self.carrier]], here)
        wanted = factor.unflat(self.element)
        result[columns] = factor.log_anyway(wanted, factor.align(factor.unflat(here), wanted))[0]
        return result


def relative_element(factor: Manifold, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """``Y₁⁻¹ Y₂`` of points of a group, flat."""
    if isinstance(factor, Euclidean):
        return second - first
    if isinstance(factor, UnitQuaternion):
        result = np.empty(4)
        conjugate_multiply(first, second, result)
        return result
    m = factor.size
    return np.asarray(first.reshape(m, m).T @ second.reshape(m, m)).reshape(-1)


def turned_back(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """A vector in the frame of an orientation."""
    result = np.empty(3)
    rotate(quaternion * [1.0, -1.0, -1.0, -1.0], vector, result)
    return result


