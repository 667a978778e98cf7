"""
SPD matrices with explicit parallel transport by matrix square roots, in every cycle.

Two methods: [18] transports all vectors to the start; the textbook method transports them along
with the point.
"""
from __future__ import annotations

import math

import numpy as np

from experiments.baselines.baseline import (
    accelerate,
    ALPHA_G,
    Baseline,
    forcing_term,
    H,
    integrate_spring,
)
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import (
    congruence,
    copy_into,
    from_mandel,
    multiply,
    scratch,
    to_mandel,
)
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.manifolds.spectral import compose_pair, symmetric_eigen

exp, log = SymmetricPositiveDefinite.kernels.exp, SymmetricPositiveDefinite.kernels.log


@kernel
def _root(m, a, root, inverse, work):
    """Symmetric square root of ``a`` and its inverse."""
    vectors, values, left = scratch(work, 0, m), work[m * m:m * m + m], work[m * m + m:]
    copy_into(a, root)
    symmetric_eigen(m, root, values, vectors, left)
    for i in range(m):
        values[i] = math.sqrt(values[i])
    compose_pair(m, values, vectors, root, inverse)


@kernel
def _transporter(m, source, target, out, work):
    """``E = (T S⁻¹)^½`` with ``v ↦ E v Eᵀ``, through the square roots of S and of S^-½ T S^-½."""
    root, inverse, white, half = (scratch(work, 0, m), scratch(work, 1, m), scratch(work, 2, m),
                                  scratch(work, 3, m))
    rest = work[4 * m * m:]
    _root(m, source, root, inverse, rest)
    congruence(m, inverse, target, white, half)
    _root(m, white, half, out, rest)
    multiply(m, root, half, white)
    multiply(m, white, inverse, out)


@kernel
def transport(m, source, target, vector, work):
    """Transport a tangent (Mandel coordinates) from one point to another."""
    way, matrix, moved, half = (scratch(work, 0, m), scratch(work, 1, m), scratch(work, 2, m),
                                scratch(work, 3, m))
    _transporter(m, source, target, way, work[4 * m * m:])
    from_mandel(m, vector, 1.0, matrix)
    congruence(m, way, matrix, moved, half)
    to_mandel(m, moved, vector)


@kernel
def move(m, point, vector, fraction, work):
    """``point ← Exp(fraction vector)``."""
    step, rest = work[:vector.size], work[vector.size:]
    for i in range(vector.size):
        step[i] = fraction * vector[i]
    exp(m, point, step, point, rest)


@kernel
def filter_goal(m, numbers, goal, new_goal, vector, work):
    """Move the goal towards a new one for one cycle."""
    log(m, goal, new_goal, vector, work)
    move(m, goal, vector, numbers[H] * numbers[ALPHA_G], work)


@kernel
def _step_at_start(m, functions, weights, numbers, error, offset, scale, velocity, force, point,
                   goal, new_goal, start, work):
    """Transport the error to the start, and the velocity back to the point."""
    log(m, point, goal, error, work)
    transport(m, point, start, error, work)
    accelerate(functions, weights, numbers, error, offset, scale, velocity, force)
    copy_into(velocity, force)
    transport(m, start, point, force, work)
    move(m, point, force, numbers[H], work)
    filter_goal(m, numbers, goal, new_goal, force, work)


@kernel
def _step_along(m, functions, weights, numbers, error, offset, scale, velocity, force, point,
                goal, new_goal, start, work):
    """Transport the velocity along with the point, and the forcing from the start."""
    log(m, point, goal, error, work)
    forcing_term(functions, weights, numbers, offset, scale, force)
    transport(m, start, point, force, work)
    integrate_spring(numbers, error, force, velocity)
    before, rest = scratch(work, 0, m), work[m * m:]
    copy_into(point, before)
    move(m, point, velocity, numbers[H], rest)
    transport(m, before, point, velocity, rest)
    filter_goal(m, numbers, goal, new_goal, force, work)


class _Transported(Baseline):
    spaces = ('spd',)

    @property
    def _matrices(self) -> np.ndarray:
        return self._shown.reshape(-1, *self.manifold.point_shape)

    def _transported(self, source: np.ndarray, target: np.ndarray, vector: np.ndarray
                     ) -> np.ndarray:
        out = np.array(vector)
        transport(self.manifold.size, self.manifold.flat(source), self.manifold.flat(target), out,
                  self._work)
        return out

    def start_error(self) -> np.ndarray:
        """Tangent at the start to the goal."""
        shape = self.manifold.point_shape
        return self.manifold.log(self._start.reshape(shape), self._goal.reshape(shape))

    def _logs(self) -> np.ndarray:
        """Tangents at each sample to the next one."""
        matrices = self._matrices
        return np.array([self.manifold.log(a, b) for a, b in zip(matrices, matrices[1:])])


class TransportedToStart(_Transported):
    """
    The SPD primitive of Abu-Dakka and Kyrki: all vectors are tangents at the start.

    Every cycle transports the logarithm of the goal to the start along the geodesic, and the
    velocity back. The forcing term is scaled by ``Log_{Y_0}(G)``.
    """

    name = '[18] SPD, transport to the start'
    source = 'Abu-Dakka, Kyrki 2020'
    scaled = True

    def errors(self) -> np.ndarray:
        """Tangents to the goal, transported to the start."""
        matrices = self._matrices
        return np.array([self._transported(a, matrices[0], self.manifold.log(a, matrices[-1]))
                         for a in matrices])

    def rates(self) -> np.ndarray:
        """Tangents to the next sample, transported to the start [1/s]."""
        matrices = self._matrices
        return np.array([self._transported(a, matrices[0], v)
                         for a, v in zip(matrices, self._logs())]) / self.dt

    def _step(self) -> None:
        _step_at_start(self.manifold.size, *self._cycle(), self._point, self._goal,
                       self._new_goal, self._start, self._work)


class TransportedAlong(_Transported):
    """
    The covariant derivative of the textbook: the velocity is transported along with the point.

    Its derivatives are always matched to the integration.
    """

    name = 'SPD, transport along the path'
    source = '[GDMP] section 4.1, transport in every cycle'

    def errors(self) -> np.ndarray:
        """Tangents at each sample to the goal."""
        matrices = self._matrices
        return np.array([self.manifold.log(a, matrices[-1]) for a in matrices])

    def rates(self) -> np.ndarray:
        """Tangents at each sample to the next one [1/s]."""
        return self._logs() / self.dt

    def _changes(self) -> tuple[np.ndarray, np.ndarray]:
        matrices, after = self._matrices, self.duration * self.rates()
        back = self._transported(matrices[1], matrices[0], after[1])
        before = [2.0 * after[0] - back]
        before += [self._transported(a, b, v)
                   for a, b, v in zip(matrices, matrices[1:], after[:-1])]
        return np.array(before), after - before

    def _to_weights(self, vectors: np.ndarray) -> np.ndarray:
        matrices = self._matrices
        return np.array([self._transported(a, matrices[0], v) for a, v in zip(matrices, vectors)])

    def _step(self) -> None:
        _step_along(self.manifold.size, *self._cycle(), self._point, self._goal, self._new_goal,
                    self._start, self._work)
