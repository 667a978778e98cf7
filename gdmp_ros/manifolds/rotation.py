"""SO(m): rotation matrices."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.kernels import kernel, noinline
from gdmp_ros.manifolds.factors import CUT_LOCUS_LIMIT, Kernels
from gdmp_ros.manifolds.linalg import (
    copy_into,
    multiply,
    multiply_transposed,
    orthonormalize,
    scratch,
    set_identity,
    sinc,
    transposed_multiply,
)
from gdmp_ros.manifolds.manifold import earliest, first_of, Manifold
from gdmp_ros.manifolds.spectral import symmetric_eigen

#: Below this sine a plane counts as rotated by exactly pi.
_HALF_TURN = 1e-3 * CUT_LOCUS_LIMIT


@kernel
def skew_matrix(m, v, out):
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


@kernel
def skew_coordinates(m, s, out):
    """Coordinates of the skew part of ``s`` (the inverse of `skew_matrix`)."""
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


@kernel
def _exp3(v, scale, out):
    """Rodrigues' formula, [GDMP] eq. (A.10), with 1 - cos from the half angle."""
    noinline()
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


@kernel
def _log3(r, out, q):
    """[GDMP] eq. (A.9), by the quaternion's largest component: accurate also near pi."""
    noinline()
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


@kernel
def _exp_general(m, v, scale, out, work):
    """``exp(V) = cos(Ω) + sinc(Ω) V`` with Ω² = -V²: one symmetric eigenvalue problem."""
    noinline()
    skew, square, vectors, factor = (scratch(work, 0, m), scratch(work, 1, m),
                                     scratch(work, 2, m), scratch(work, 3, m))
    values = work[4 * m * m:4 * m * m + m]
    skew_matrix(m, v, skew)
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


@kernel
def _log_general(m, r, out, work):
    """
    ``log R = f(S) A`` with S, A the symmetric and skew parts of R and f = angle / sine.

    The sine of each plane comes from A, not from S: the error near pi is then eps over the
    distance from the cut locus.
    """
    noinline()
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
    largest, half_plane = 0.0, -1
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
            if half_plane < 0:
                half_plane = k
                continue
            for i in range(m):
                for j in range(m):
                    rotated = (vectors[k * m + i] * vectors[half_plane * m + j]
                               - vectors[half_plane * m + i] * vectors[k * m + j])
                    result[i * m + j] += math.pi * rotated
            half_plane = -1
            continue
        ratio = angle / sine if sine > 1e-300 else 1.0
        for i in range(m):
            for j in range(m):
                result[i * m + j] += ratio * image[i] * vectors[k * m + j]
    skew_coordinates(m, result, out)
    return math.pi - largest


@kernel
def exp_at_identity(m, v, scale, out, work):
    if m == 2:
        angle = scale * v[0]
        out[0], out[1] = math.cos(angle), -math.sin(angle)
        out[2], out[3] = math.sin(angle), math.cos(angle)
    elif m == 3:
        _exp3(v, scale, out)
    else:
        _exp_general(m, v, scale, out, work)


@kernel
def log_at_identity(m, r, out, work):
    if m == 2:
        out[0] = math.atan2(r[2] - r[1], r[0] + r[3])
        return math.pi - abs(out[0])
    if m == 3:
        return _log3(r, out, work)
    return _log_general(m, r, out, work)


@kernel
def _exp(size, base, tangent, point, work):
    """``Exp_U(v) = expm([v]) U``."""
    step = scratch(work, 0, size)
    exp_at_identity(size, tangent, 1.0, step, work[size * size:])
    multiply(size, step, base, point)


@kernel
def _log(size, base, point, tangent, work):
    """``Log_U(Q) = logm(Q Uᵀ)``."""
    relative = scratch(work, 0, size)
    multiply_transposed(size, point, base, relative)
    return log_at_identity(size, relative, tangent, work[size * size:])


# A frame is (A, C) with the point A C; each takes half of every step.

@kernel
def _frame(size, point, frame, work):
    set_identity(size, frame[:size * size])
    copy_into(point, frame[size * size:])


@kernel
def _frame_point(size, frame, point, work):
    multiply(size, frame[:size * size], frame[size * size:], point)


@kernel
def _transport_frame(size, frame, coordinates, work):
    first, second = frame[:size * size], frame[size * size:]
    half, product = scratch(work, 0, size), scratch(work, 1, size)
    exp_at_identity(size, coordinates, 0.5, half, work[2 * size * size:])
    multiply(size, first, half, product)
    copy_into(product, first)
    multiply(size, half, second, product)
    copy_into(product, second)


@kernel
def _log_in_frame(size, frame, point, coordinates, work):
    part, relative = scratch(work, 0, size), scratch(work, 1, size)
    transposed_multiply(size, frame[:size * size], point, part)
    multiply_transposed(size, part, frame[size * size:], relative)
    return log_at_identity(size, relative, coordinates, work[2 * size * size:])


@kernel
def _from_frame(size, frame, coordinates, tangent, work):
    """Coordinates of ``A V Aᵀ``."""
    if size == 3:
        for i in range(3):
            work[i] = (frame[3 * i] * coordinates[0] + frame[3 * i + 1] * coordinates[1]
                       + frame[3 * i + 2] * coordinates[2])
        copy_into(work[:3], tangent)
        return
    matrix, half = scratch(work, 0, size), scratch(work, 1, size)
    skew_matrix(size, coordinates, matrix)
    multiply(size, frame, matrix, half)
    multiply_transposed(size, half, frame, matrix)
    skew_coordinates(size, matrix, tangent)


@kernel
def _to_frame(size, frame, tangent, coordinates, work):
    """Coordinates of ``Aᵀ V A``."""
    matrix, half = scratch(work, 0, size), scratch(work, 1, size)
    skew_matrix(size, tangent, matrix)
    transposed_multiply(size, frame, matrix, half)
    multiply(size, half, frame, matrix)
    skew_coordinates(size, matrix, coordinates)


@kernel
def _renormalize_frame(size, frame, work):
    orthonormalize(size, frame[:size * size], work)
    orthonormalize(size, frame[size * size:], work)


@kernel
def _renormalize(size, point, work):
    orthonormalize(size, point, work)


@kernel
def _project_tangent(size, point, vector, tangent, work):
    copy_into(vector, tangent)


class SpecialOrthogonal(Manifold):
    """
    Rotation matrices of R^m with ``Log_U(Q) = logm(Q Uᵀ)``, [GDMP] eqs. (A.9), (A.10) for m = 3.

    A point has shape ``(m, m)``; a tangent the ``m (m - 1) / 2`` coordinates of a skew matrix in
    the base frame [rad]: the rotation vector for m = 3, the angle for m = 2, otherwise the upper
    triangle row by row.
    """

    kind = 'rotation'
    unit = 'rad'
    goal_tolerance = 0.0025
    # The logarithm turns π / distance times as fast as the point moves near the cut locus: too
    # fast to be learned from samples.
    split_margin = 0.5
    kernels = Kernels(exp=_exp, log=_log, frame=_frame, frame_point=_frame_point,
                      transport_frame=_transport_frame, log_in_frame=_log_in_frame,
                      from_frame=_from_frame, to_frame=_to_frame,
                      renormalize_frame=_renormalize_frame, renormalize=_renormalize,
                      project_tangent=_project_tangent)

    def __init__(self, m: int):
        """:param m: size of the matrices, at least 2"""
        self._check_size(m, least=2)
        dim = m * (m - 1) // 2
        super().__init__(m, dim=dim, point_shape=(m, m), tangent_size=dim, frame_size=2 * m * m)

    @property
    def components(self) -> list[tuple[str, int]]:
        m = self.size
        return [(f'{i + 1}{j + 1}', i * m + j) for i in range(m) for j in range(m)]

    def nearest_point(self, array: np.ndarray) -> np.ndarray:
        left, _, right = np.linalg.svd(array)
        left[:, -1] *= np.sign(np.linalg.det(left @ right))
        return np.ascontiguousarray(left @ right)

    def first_invalid(self, points: np.ndarray) -> tuple[int, str] | None:
        errors = np.abs(points @ points.transpose(0, 2, 1) - np.eye(self.size)).max(axis=(1, 2))
        return earliest(
            first_of(~(errors <= self.tolerance), lambda i: f'R Rᵀ differs from I by '
                     f'{errors[i]:.3g}, expected at most {self.tolerance:g}'),
            first_of(np.linalg.det(points) < 0.0,
                     lambda _: 'determinant is -1 (a reflection), expected +1'))

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw uniformly (Haar measure)."""
        q, r = np.linalg.qr(rng.standard_normal((self.size, self.size)))
        q = q * np.sign(np.diag(r))
        if np.linalg.det(q) < 0.0:
            q[:, 0] = -q[:, 0]
        return np.ascontiguousarray(q)
