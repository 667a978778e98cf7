"""SO(m): rotation matrices."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.linalg import (
    copy_into,
    multiply,
    multiply_transposed,
    set_identity,
    sinc,
    symmetric_eigen,
    transposed_multiply,
)
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.sphere import orthonormalise

#: Below this sine a plane counts as turned by exactly pi (far inside `ops.CUT_LOCUS_LIMIT`).
_HALF_TURN = 1e-9


@compiled
def _skew(v, out):
    """Skew matrix of coordinates: rotation vector for m = 3, else upper triangle by rows."""
    m = out.shape[0]
    for i in range(m):
        out[i, i] = 0.0
    if m == 3:
        out[0, 1], out[0, 2], out[1, 2] = -v[2], v[1], -v[0]
    else:
        k = 0
        for i in range(m):
            for j in range(i + 1, m):
                # SO(2): the coordinate is the angle, counter-clockwise.
                out[i, j] = -v[k] if m == 2 else v[k]
                k += 1
    for i in range(m):
        for j in range(i):
            out[i, j] = -out[j, i]


@compiled
def _vee(s, out):
    """Coordinates of the skew part of ``s`` (the inverse of `_skew`)."""
    m = s.shape[0]
    if m == 3:
        out[0] = 0.5 * (s[2, 1] - s[1, 2])
        out[1] = 0.5 * (s[0, 2] - s[2, 0])
        out[2] = 0.5 * (s[1, 0] - s[0, 1])
        return
    sign = -0.5 if m == 2 else 0.5
    k = 0
    for i in range(m):
        for j in range(i + 1, m):
            out[k] = sign * (s[i, j] - s[j, i])
            k += 1


@compiled
def _exp3(v, scale, out):
    """Rodrigues' formula, [GDMP] eq. (A.10), with 1 - cos from the half angle."""
    x, y, z = scale * v[0], scale * v[1], scale * v[2]
    angle = math.sqrt(x * x + y * y + z * z)
    s = sinc(angle)
    half = sinc(0.5 * angle)
    c = 0.5 * half * half
    out[0, 0], out[1, 1], out[2, 2] = (1.0 - c * (y * y + z * z), 1.0 - c * (x * x + z * z),
                                       1.0 - c * (x * x + y * y))
    out[0, 1], out[1, 0] = c * x * y - s * z, c * x * y + s * z
    out[0, 2], out[2, 0] = c * x * z + s * y, c * x * z - s * y
    out[1, 2], out[2, 1] = c * y * z - s * x, c * y * z + s * x


@compiled
def _log3(r, out):
    """[GDMP] eq. (A.9), through the quaternion's largest component: right also near pi."""
    q = np.empty(4)
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    largest = 0
    best = trace
    for i in range(3):
        if r[i, i] > best:
            best, largest = r[i, i], i + 1
    if largest == 0:
        q[0] = 1.0 + trace
        q[1], q[2], q[3] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i + 1] = 1.0 + r[i, i] - r[j, j] - r[k, k]
        q[j + 1] = r[i, j] + r[j, i]
        q[k + 1] = r[i, k] + r[k, i]
        q[0] = r[k, j] - r[j, k]
        if q[0] < 0.0:
            for n in range(4):
                q[n] = -q[n]
    norm = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    angle = 2.0 * math.atan2(norm, q[0])
    scale = angle / norm if norm > 1e-300 else 0.0
    for n in range(3):
        out[n] = scale * q[n + 1]
    return math.pi - angle


@compiled
def _exp_general(v, scale, out):
    """``exp(V) = cos(Ω) + sinc(Ω) V`` with Ω² = -V²: one symmetric eigenproblem."""
    m = out.shape[0]
    skew, square, vectors, values = (np.empty((m, m)), np.empty((m, m)), np.empty((m, m)),
                                     np.empty(m))
    _skew(v, skew)
    for i in range(m):
        for j in range(m):
            skew[i, j] *= scale
    transposed_multiply(skew, skew, square)
    symmetric_eigen(square, values, vectors)
    factor = np.empty((m, m))
    for i in range(m):
        for j in range(m):
            cosine, sine = 0.0, 0.0
            for k in range(m):
                angle = math.sqrt(max(values[k], 0.0))
                weight = vectors[i, k] * vectors[j, k]
                half = math.sin(0.5 * angle)
                cosine -= 2.0 * half * half * weight
                sine += sinc(angle) * weight
            out[i, j] = cosine + (1.0 if i == j else 0.0)
            factor[i, j] = sine
    multiply(factor, skew, square)
    for i in range(m):
        for j in range(m):
            out[i, j] += square[i, j]


@compiled
def _log_general(r, out):
    """
    ``log R = f(S) A`` with S, A the symmetric and skew parts of R and f = angle / sine.

    The sine of each plane is read off A, not off S, which keeps the error near pi at eps / gap.
    """
    m = r.shape[0]
    skew, work, vectors, cosines = (np.empty((m, m)), np.empty((m, m)), np.empty((m, m)),
                                    np.empty(m))
    for i in range(m):
        for j in range(m):
            skew[i, j] = 0.5 * (r[i, j] - r[j, i])
            work[i, j] = 0.5 * (r[i, j] + r[j, i])
    symmetric_eigen(work, cosines, vectors)
    largest, open_plane = 0.0, -1
    result = np.zeros((m, m))
    for k in range(m):
        total = 0.0
        image = np.empty(m)
        for i in range(m):
            image[i] = 0.0
            for j in range(m):
                image[i] += skew[i, j] * vectors[j, k]
            total += image[i] * image[i]
        sine = math.sqrt(total)
        angle = math.atan2(sine, cosines[k])
        largest = max(largest, angle)
        if cosines[k] < 0.0 and sine < _HALF_TURN:
            if open_plane < 0:
                open_plane = k
                continue
            for i in range(m):
                for j in range(m):
                    result[i, j] += math.pi * (vectors[i, k] * vectors[j, open_plane]
                                               - vectors[i, open_plane] * vectors[j, k])
            open_plane = -1
            continue
        ratio = angle / sine if sine > 1e-300 else 1.0
        for i in range(m):
            for j in range(m):
                result[i, j] += ratio * image[i] * vectors[j, k]
    _vee(result, out)
    return math.pi - largest


@compiled
def _exp_identity(v, scale, out):
    m = out.shape[0]
    if m == 2:
        angle = scale * v[0]
        out[0, 0], out[0, 1] = math.cos(angle), -math.sin(angle)
        out[1, 0], out[1, 1] = math.sin(angle), math.cos(angle)
    elif m == 3:
        _exp3(v, scale, out)
    else:
        _exp_general(v, scale, out)


@compiled
def _log_identity(r, out):
    m = r.shape[0]
    if m == 2:
        out[0] = math.atan2(r[1, 0] - r[0, 1], r[0, 0] + r[1, 1])
        return math.pi - abs(out[0])
    if m == 3:
        return _log3(r, out)
    return _log_general(r, out)


@compiled
def _conjugate(turn, v, forward, out):
    """Coordinates of ``T V Tᵀ`` (forward) or ``Tᵀ V T``."""
    m = turn.shape[0]
    skew, work = np.empty((m, m)), np.empty((m, m))
    _skew(v, skew)
    if forward:
        multiply(turn, skew, work)
        multiply_transposed(work, turn, skew)
    else:
        transposed_multiply(turn, skew, work)
        multiply(work, turn, skew)
    _vee(skew, out)


@compiled
def apply(op, m, a, b, out):
    """Answer one of the operations; a frame is (A, C) with the point at A C."""
    size = m * m
    first = a[:size].reshape(m, m)
    if op == ops.TANGENT:
        copy_into(b, out)
        return 0.0
    if op == ops.MEND_POINT:
        orthonormalise(first)
        return 0.0
    if op == ops.FRAME:
        set_identity(out[:size].reshape(m, m))
        copy_into(a, out[size:2 * size])
        return 0.0
    work = np.empty((m, m))
    if op == ops.LOG:
        multiply_transposed(b.reshape(m, m), first, work)
        return _log_identity(work, out)
    if op == ops.EXP:
        _exp_identity(b, 1.0, work)
        multiply(work, first, out.reshape(m, m))
        return 0.0
    second = a[size:2 * size].reshape(m, m)
    if op == ops.FRAME_LOG:
        relative = np.empty((m, m))
        transposed_multiply(first, b.reshape(m, m), work)
        multiply_transposed(work, second, relative)
        return _log_identity(relative, out)
    if op == ops.MOVE:
        half = np.empty((m, m))
        _exp_identity(b, 0.5, half)
        multiply(first, half, work)
        copy_into(work.reshape(size), a[:size])
        multiply(half, second, work)
        copy_into(work.reshape(size), a[size:2 * size])
    elif op == ops.POINT:
        multiply(first, second, out.reshape(m, m))
    elif op == ops.VECTOR:
        if m == 3:
            for i in range(3):
                work[0, i] = first[i, 0] * b[0] + first[i, 1] * b[1] + first[i, 2] * b[2]
            copy_into(work[0], out)
        else:
            _conjugate(first, b, True, out)
    elif op == ops.COORDS:
        _conjugate(first, b, False, out)
    elif op == ops.MEND:
        orthonormalise(first)
        orthonormalise(second)
    return 0.0


class SpecialOrthogonal(Manifold):
    """
    Rotation matrices of R^m with ``Log_U(Q) = logm(Q Uᵀ)``, [GDMP] eqs. (A.9), (A.10) for m = 3.

    A point has shape ``(m, m)``; a tangent the ``m (m - 1) / 2`` coordinates of a skew matrix in
    the base frame [rad]: the rotation vector for m = 3, the angle for m = 2, otherwise the upper
    triangle row by row.
    """

    kind = 'rotation'
    kernel = staticmethod(apply)

    def __init__(self, m: int):
        """:param m: size of the matrices, at least 2"""
        self._size(m, least=2)
        dim = m * (m - 1) // 2
        super().__init__(m, dim=dim, point_shape=(m, m), tangent_size=dim, frame_size=2 * m * m)

    def _project(self, array: np.ndarray) -> np.ndarray:
        left, _, right = np.linalg.svd(array)
        left[:, -1] *= np.sign(np.linalg.det(left @ right))
        return np.ascontiguousarray(left @ right)

    def _defect(self, point: np.ndarray) -> str | None:
        error = float(np.abs(point @ point.T - np.eye(self.m)).max())
        if not error <= self.tolerance:
            return f'R Rᵀ differs from I by {error:.3g}, expected at most {self.tolerance:g}'
        if np.linalg.det(point) < 0.0:
            return 'determinant is -1 (a reflection), expected +1'
        return None

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw uniformly (Haar measure)."""
        q, r = np.linalg.qr(rng.standard_normal((self.m, self.m)))
        q = q * np.sign(np.diag(r))
        if np.linalg.det(q) < 0.0:
            q[:, 0] = -q[:, 0]
        return np.ascontiguousarray(q)
