"""S^m, the unit sphere in R^(m+1): directions."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled, kept_apart
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.linalg import scratch, set_identity, sinc
from gdmp_ros.manifolds.manifold import Manifold


@compiled
def _normalise(v):
    total = 0.0
    for i in range(v.size):
        total += v[i] * v[i]
    scale = 1.0 / math.sqrt(total)
    for i in range(v.size):
        v[i] *= scale


@compiled
def _project_tangent(base, v, out):
    dot = 0.0
    for i in range(base.size):
        dot += base[i] * v[i]
    for i in range(base.size):
        out[i] = v[i] - dot * base[i]


@compiled
def _exp(base, v, out):
    total = 0.0
    for i in range(base.size):
        total += v[i] * v[i]
    angle = math.sqrt(total)
    c, s = math.cos(angle), sinc(angle)
    for i in range(base.size):
        out[i] = c * base[i] + s * v[i]
    _normalise(out)


@compiled
def _log(base, point, out):
    """[GDMP] eq. (A.3), with the angle from atan2: right also near 0 and near pi."""
    cosine = 0.0
    for i in range(base.size):
        cosine += base[i] * point[i]
    # Twice: the first pass leaves a residue along the base as large as the rounding of the points.
    _project_tangent(base, point, out)
    _project_tangent(base, out, out)
    total = 0.0
    for i in range(base.size):
        total += out[i] * out[i]
    sine = math.sqrt(total)
    angle = math.atan2(sine, cosine)
    if sine > 1e-300:
        for i in range(base.size):
            out[i] *= angle / sine
    elif cosine < 0.0:
        _any_tangent(base, out)
        for i in range(base.size):
            out[i] *= angle
    return math.pi - angle


@compiled
def _any_tangent(base, out):
    least = 0
    for i in range(base.size):
        if abs(base[i]) < abs(base[least]):
            least = i
    for i in range(base.size):
        out[i] = (1.0 if i == least else 0.0) - base[least] * base[i]
    _normalise(out)


@compiled
def _rotate(turn, origin, coordinates):
    """Turn ``turn`` on the right in the plane (origin, coordinates)."""
    kept_apart()
    size = origin.size
    total = 0.0
    for i in range(size):
        total += coordinates[i] * coordinates[i]
    angle = math.sqrt(total)
    if angle < 1e-300:
        return
    sine, cosine1 = math.sin(angle), -2.0 * math.sin(0.5 * angle) ** 2
    for row in range(0, size * size, size):
        along, across = 0.0, 0.0
        for i in range(size):
            along += turn[row + i] * origin[i]
            across += turn[row + i] * coordinates[i] / angle
        for i in range(size):
            unit = coordinates[i] / angle
            turn[row + i] += (sine * (across * origin[i] - along * unit)
                              + cosine1 * (across * unit + along * origin[i]))


@compiled
def orthonormalise(size, turn, work):
    """One Newton-Schulz step towards the nearest orthogonal matrix."""
    kept_apart()
    correction, row = scratch(work, 0, size), work[size * size:size * size + size]
    for i in range(size):
        for j in range(size):
            total = 0.0
            for k in range(size):
                total += turn[k * size + i] * turn[k * size + j]
            correction[i * size + j] = (1.5 if i == j else 0.0) - 0.5 * total
    for i in range(size):
        for j in range(size):
            total = 0.0
            for k in range(size):
                total += turn[i * size + k] * correction[k * size + j]
            row[j] = total
        for j in range(size):
            turn[i * size + j] = row[j]


@compiled
def apply(op, m, a, b, out, work):
    """Answer one of the operations; a frame is (origin, P) with the point at P origin."""
    kept_apart()
    size = m + 1
    if op == ops.LOG:
        return _log(a, b, out)
    if op == ops.EXP:
        _exp(a, b, out)
        return 0.0
    if op == ops.TANGENT:
        _project_tangent(a, b, out)
        return 0.0
    if op == ops.MEND_POINT:
        _normalise(a)
        return 0.0
    if op == ops.FRAME:
        for i in range(size):
            out[i] = a[i]
        set_identity(size, out[size:])
        return 0.0
    origin, turn = a[:size], a[size:]
    if op == ops.MOVE:
        _rotate(turn, origin, b)
    elif op == ops.MEND:
        orthonormalise(size, turn, work)
    elif op == ops.POINT or op == ops.VECTOR:
        vector = origin if op == ops.POINT else b
        for i in range(size):
            total = 0.0
            for k in range(size):
                total += turn[i * size + k] * vector[k]
            out[i] = total
    elif op == ops.FRAME_LOG or op == ops.COORDS:
        image = work[:size]
        for i in range(size):
            total = 0.0
            for k in range(size):
                total += turn[k * size + i] * b[k]
            image[i] = total
        if op == ops.FRAME_LOG:
            return _log(origin, image, out)
        _project_tangent(origin, image, out)
    return 0.0


class Sphere(Manifold):
    """
    Unit vectors of R^(m+1), [GDMP] eqs. (A.3), (A.4).

    A point has shape ``(m + 1,)``; a tangent is the ambient vector [rad], shape ``(m + 1,)``,
    orthogonal to its base.
    """

    kind = 'sphere'
    kernel = staticmethod(apply)

    def __init__(self, m: int):
        """:param m: dimension of the sphere, at least 1"""
        super().__init__(self._size(m, least=1), dim=m, point_shape=(m + 1,), tangent_size=m + 1,
                         frame_size=(m + 1) * (m + 2))

    def _project(self, array: np.ndarray) -> np.ndarray:
        norm = np.linalg.norm(array)
        if norm < 1e-12:
            raise self._no_point('the zero vector has no direction')
        return np.asarray(array / norm)

    def _defect(self, point: np.ndarray) -> str | None:
        return self._unit_defect(point, 'norm')

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw uniformly from the sphere."""
        return self._project(rng.standard_normal(self.m + 1))
