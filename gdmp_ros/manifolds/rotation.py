"""SO(m): rotation matrices."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled, kept_apart
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.linalg import (
    copy_into,
    multiply,
    multiply_transposed,
    scratch,
    set_identity,
    sinc,
    transposed_multiply,
)
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.spectral import symmetric_eigen
from gdmp_ros.manifolds.sphere import orthonormalise

#: Below this sine a plane counts as turned by exactly pi (far inside `ops.CUT_LOCUS_LIMIT`).
_HALF_TURN = 1e-9


@compiled
def _skew(m, v, out):
    """Skew matrix of coordinates: rotation vector for m = 3, else upper triangle by rows."""
    for i in range(m):
        out[i * m + i] = 0.0
    if m == 3:
        out[1], out[2], out[5] = -v[2], v[1], -v[0]
    else:
        k = 0
        for i in range(m):
            for j in range(i + 1, m):
                # SO(2): the coordinate is the angle, counter-clockwise.
                out[i * m + j] = -v[k] if m == 2 else v[k]
                k += 1
    for i in range(m):
        for j in range(i):
            out[i * m + j] = -out[j * m + i]


@compiled
def _vee(m, s, out):
    """Coordinates of the skew part of ``s`` (the inverse of `_skew`)."""
    if m == 3:
        out[0] = 0.5 * (s[7] - s[5])
        out[1] = 0.5 * (s[2] - s[6])
        out[2] = 0.5 * (s[3] - s[1])
        return
    sign = -0.5 if m == 2 else 0.5
    k = 0
    for i in range(m):
        for j in range(i + 1, m):
            out[k] = sign * (s[i * m + j] - s[j * m + i])
            k += 1


@compiled
def _exp3(v, scale, out):
    """Rodrigues' formula, [GDMP] eq. (A.10), with 1 - cos from the half angle."""
    kept_apart()
    x, y, z = scale * v[0], scale * v[1], scale * v[2]
    angle = math.sqrt(x * x + y * y + z * z)
    s = sinc(angle)
    half = sinc(0.5 * angle)
    c = 0.5 * half * half
    out[0], out[4], out[8] = (1.0 - c * (y * y + z * z), 1.0 - c * (x * x + z * z),
                              1.0 - c * (x * x + y * y))
    out[1], out[3] = c * x * y - s * z, c * x * y + s * z
    out[2], out[6] = c * x * z + s * y, c * x * z - s * y
    out[5], out[7] = c * y * z - s * x, c * y * z + s * x


@compiled
def _log3(r, out, q):
    """[GDMP] eq. (A.9), through the quaternion's largest component: right also near pi."""
    kept_apart()
    trace = r[0] + r[4] + r[8]
    largest = 0
    best = trace
    for i in range(3):
        if r[i * 3 + i] > best:
            best, largest = r[i * 3 + i], i + 1
    if largest == 0:
        q[0] = 1.0 + trace
        q[1], q[2], q[3] = r[7] - r[5], r[2] - r[6], r[3] - r[1]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i + 1] = 1.0 + r[i * 3 + i] - r[j * 3 + j] - r[k * 3 + k]
        q[j + 1] = r[i * 3 + j] + r[j * 3 + i]
        q[k + 1] = r[i * 3 + k] + r[k * 3 + i]
        q[0] = r[k * 3 + j] - r[j * 3 + k]
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
def _exp_general(m, v, scale, out, work):
    """``exp(V) = cos(Ω) + sinc(Ω) V`` with Ω² = -V²: one symmetric eigenproblem."""
    kept_apart()
    skew, square, vectors, factor = (scratch(work, 0, m), scratch(work, 1, m),
                                     scratch(work, 2, m), scratch(work, 3, m))
    values = work[4 * m * m:4 * m * m + m]
    _skew(m, v, skew)
    for i in range(m):
        for j in range(m):
            skew[i * m + j] *= scale
    transposed_multiply(m, skew, skew, square)
    symmetric_eigen(m, square, values, vectors, work[4 * m * m + m:])
    for i in range(m):
        for j in range(m):
            cosine, sine = 0.0, 0.0
            for k in range(m):
                angle = math.sqrt(max(values[k], 0.0))
                weight = vectors[k * m + i] * vectors[k * m + j]
                half = math.sin(0.5 * angle)
                cosine -= 2.0 * half * half * weight
                sine += sinc(angle) * weight
            out[i * m + j] = cosine + (1.0 if i == j else 0.0)
            factor[i * m + j] = sine
    multiply(m, factor, skew, square)
    for i in range(m):
        for j in range(m):
            out[i * m + j] += square[i * m + j]


@compiled
def _log_general(m, r, out, work):
    """
    ``log R = f(S) A`` with S, A the symmetric and skew parts of R and f = angle / sine.

    The sine of each plane is read off A, not off S, which keeps the error near pi at eps / gap.
    """
    kept_apart()
    skew, even, vectors, result = (scratch(work, 0, m), scratch(work, 1, m),
                                   scratch(work, 2, m), scratch(work, 3, m))
    cosines, rest = work[4 * m * m:4 * m * m + m], work[4 * m * m + m:]
    for i in range(m):
        for j in range(m):
            skew[i * m + j] = 0.5 * (r[i * m + j] - r[j * m + i])
            even[i * m + j] = 0.5 * (r[i * m + j] + r[j * m + i])
            result[i * m + j] = 0.0
    symmetric_eigen(m, even, cosines, vectors, rest)
    image = rest[:m]
    largest, open_plane = 0.0, -1
    for k in range(m):
        total = 0.0
        for i in range(m):
            image[i] = 0.0
            for j in range(m):
                image[i] += skew[i * m + j] * vectors[k * m + j]
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
                    turned = (vectors[k * m + i] * vectors[open_plane * m + j]
                              - vectors[open_plane * m + i] * vectors[k * m + j])
                    result[i * m + j] += math.pi * turned
            open_plane = -1
            continue
        ratio = angle / sine if sine > 1e-300 else 1.0
        for i in range(m):
            for j in range(m):
                result[i * m + j] += ratio * image[i] * vectors[k * m + j]
    _vee(m, result, out)
    return math.pi - largest


@compiled
def _exp_identity(m, v, scale, out, work):
    if m == 2:
        angle = scale * v[0]
        out[0], out[1] = math.cos(angle), -math.sin(angle)
        out[2], out[3] = math.sin(angle), math.cos(angle)
    elif m == 3:
        _exp3(v, scale, out)
    else:
        _exp_general(m, v, scale, out, work)


@compiled
def _log_identity(m, r, out, work):
    if m == 2:
        out[0] = math.atan2(r[2] - r[1], r[0] + r[3])
        return math.pi - abs(out[0])
    if m == 3:
        return _log3(r, out, work)
    return _log_general(m, r, out, work)


@compiled
def _conjugate(m, turn, v, forward, out, work):
    """Coordinates of ``T V Tᵀ`` (forward) or ``Tᵀ V T``."""
    kept_apart()
    skew, half = scratch(work, 0, m), scratch(work, 1, m)
    _skew(m, v, skew)
    if forward:
        multiply(m, turn, skew, half)
        multiply_transposed(m, half, turn, skew)
    else:
        transposed_multiply(m, turn, skew, half)
        multiply(m, half, turn, skew)
    _vee(m, skew, out)


@compiled
def apply(op, m, a, b, out, work):
    """Answer one of the operations; a frame is (A, C) with the point at A C."""
    kept_apart()
    size = m * m
    if op == ops.TANGENT:
        copy_into(b, out)
        return 0.0
    if op == ops.MEND_POINT:
        orthonormalise(m, a, work)
        return 0.0
    if op == ops.FRAME:
        set_identity(m, out[:size])
        copy_into(a, out[size:])
        return 0.0
    part, other, rest = scratch(work, 0, m), scratch(work, 1, m), work[2 * size:]
    if op == ops.LOG:
        multiply_transposed(m, b, a, part)
        return _log_identity(m, part, out, rest)
    if op == ops.EXP:
        _exp_identity(m, b, 1.0, part, rest)
        multiply(m, part, a, out)
        return 0.0
    first, second = a[:size], a[size:]
    if op == ops.FRAME_LOG:
        transposed_multiply(m, first, b, part)
        multiply_transposed(m, part, second, other)
        return _log_identity(m, other, out, rest)
    if op == ops.MOVE:
        _exp_identity(m, b, 0.5, part, rest)
        multiply(m, first, part, other)
        copy_into(other, first)
        multiply(m, part, second, other)
        copy_into(other, second)
    elif op == ops.POINT:
        multiply(m, first, second, out)
    elif op == ops.VECTOR:
        if m == 3:
            for i in range(3):
                rest[i] = first[3 * i] * b[0] + first[3 * i + 1] * b[1] + first[3 * i + 2] * b[2]
            copy_into(rest[:3], out)
        else:
            _conjugate(m, first, b, True, out, rest)
    elif op == ops.COORDS:
        _conjugate(m, first, b, False, out, rest)
    elif op == ops.MEND:
        orthonormalise(m, first, work)
        orthonormalise(m, second, work)
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
