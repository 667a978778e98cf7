"""Unit quaternions, S³: orientations of a tool, scalar first."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.manifolds.factors import Kernels
from gdmp_ros.manifolds.linalg import sinc
from gdmp_ros.manifolds.manifold import Manifold


@kernel
def multiply(a, b, out):
    """``out = a * b``; ``out`` may be ``a`` or ``b``."""
    w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    x = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    y = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    z = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@kernel
def multiply_conjugate(a, b, out):
    """``out = a * conj(b)``; ``out`` may be ``a`` or ``b``."""
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = -a[0] * b[1] + a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    y = -a[0] * b[2] + a[1] * b[3] + a[2] * b[0] - a[3] * b[1]
    z = -a[0] * b[3] - a[1] * b[2] + a[2] * b[1] + a[3] * b[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@kernel
def conjugate_multiply(a, b, out):
    """``out = conj(a) * b``; ``out`` may be ``a`` or ``b``."""
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    y = a[0] * b[2] + a[1] * b[3] - a[2] * b[0] - a[3] * b[1]
    z = a[0] * b[3] - a[1] * b[2] + a[2] * b[1] - a[3] * b[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@kernel
def normalize(q):
    """Scale ``q`` to unit norm."""
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        q[i] *= scale


@kernel
def rotate(q, v, out):
    """Rotate vector ``v`` by unit quaternion ``q``; ``out`` may be ``v``."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    x = v[0] + q[0] * tx + q[2] * tz - q[3] * ty
    y = v[1] + q[0] * ty + q[3] * tx - q[1] * tz
    z = v[2] + q[0] * tz + q[1] * ty - q[2] * tx
    out[0], out[1], out[2] = x, y, z


@kernel
def exp_at_identity(v, scale, out):
    """``Exp(scale v)`` of a half-angle vector, [GDMP] eq. (A.6)."""
    angle = scale * math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    s = scale * sinc(angle)
    out[0] = math.cos(angle)
    for i in range(3):
        out[i + 1] = s * v[i]


@kernel
def log_at_identity(q, out):
    """
    Half-angle vector of ``q``, [GDMP] eq. (A.5), up to pi: the sign of ``q`` matters.

    :returns: distance of ``q`` from the cut locus [rad]
    """
    norm = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    angle = math.atan2(norm, q[0])
    if norm > 1e-300:
        for i in range(3):
            out[i] = q[i + 1] * (angle / norm)
    else:
        out[0], out[1], out[2] = angle, 0.0, 0.0
    return math.pi - angle


@kernel
def rotate_by_vector(q, rotation, out):
    """
    Rotate an orientation about axes of the base frame; ``out`` may be ``q``.

    :param rotation: rotation vector in the base frame [rad]
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    exp_at_identity(rotation, 0.5, out)
    a, b, c, d = out[0], out[1], out[2], out[3]
    out[0] = a * w - b * x - c * y - d * z
    out[1] = a * x + b * w + c * z - d * y
    out[2] = a * y - b * z + c * w + d * x
    out[3] = a * z + b * y - c * x + d * w
    normalize(out)


@kernel
def rotation_between(start, end, out):
    """
    Rotation vector in the base frame that takes ``start`` to ``end`` by less than half a turn.

    q and -q count as the same orientation. Unit: rad, shape ``(3,)``.
    """
    w = start[0] * end[0] + start[1] * end[1] + start[2] * end[2] + start[3] * end[3]
    sign = 1.0 if w >= 0.0 else -1.0
    x = sign * (-end[0] * start[1] + end[1] * start[0] - end[2] * start[3] + end[3] * start[2])
    y = sign * (-end[0] * start[2] + end[1] * start[3] + end[2] * start[0] - end[3] * start[1])
    z = sign * (-end[0] * start[3] - end[1] * start[2] + end[2] * start[1] + end[3] * start[0])
    norm = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(norm, sign * w) / norm if norm > 1e-12 else 2.0
    out[0], out[1], out[2] = scale * x, scale * y, scale * z


@kernel
def pose_distance(first, second):
    """Distance [m] and angle [rad] between two poses (x, y, z, qw, qx, qy, qz)."""
    rotation = local_numbers(3)
    rotation_between(first[3:7], second[3:7], rotation)
    distance, angle = 0.0, 0.0
    for i in range(3):
        distance += (second[i] - first[i]) ** 2
        angle += rotation[i] ** 2
    return math.sqrt(distance), math.sqrt(angle)


def rotation_angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """
    Angles between orientations, row by row; q and -q count as the same [rad].

    :param a: quaternions (wxyz), shape ``(T, 4)`` or ``(4,)``
    :param b: the same
    :returns: shape ``(T,)``, or a number
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    real = np.sum(a * b, axis=-1)
    imaginary = (a[..., :1] * b[..., 1:] - b[..., :1] * a[..., 1:]
                 - np.cross(a[..., 1:], b[..., 1:]))
    # The arc tangent is accurate for small angles; the arc cosine loses half the digits.
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(imaginary, axis=-1), np.abs(real)))


@kernel
def exp(size, base, tangent, point, work):
    """``Exp_U(v) = Exp(v) * U``."""
    step = work[:4]
    exp_at_identity(tangent, 1.0, step)
    multiply(step, base, point)
    normalize(point)


@kernel
def log(size, base, point, tangent, work):
    """``Log_U(Q) = Log(Q * conj(U))``."""
    relative = work[:4]
    multiply_conjugate(point, base, relative)
    return log_at_identity(relative, tangent)


# A frame is (A, C) with the point A * C; each takes half of every step.

@kernel
def _frame(size, point, frame, work):
    frame[0], frame[1], frame[2], frame[3] = 1.0, 0.0, 0.0, 0.0
    for i in range(4):
        frame[i + 4] = point[i]


@kernel
def _frame_point(size, frame, point, work):
    multiply(frame[:4], frame[4:8], point)


@kernel
def _transport_frame(size, frame, coordinates, work):
    half = work[:4]
    exp_at_identity(coordinates, 0.5, half)
    multiply(frame[:4], half, frame[:4])
    multiply(half, frame[4:8], frame[4:8])


@kernel
def _log_in_frame(size, frame, point, coordinates, work):
    relative = work[:4]
    conjugate_multiply(frame[:4], point, relative)
    multiply_conjugate(relative, frame[4:8], relative)
    return log_at_identity(relative, coordinates)


@kernel
def _from_frame(size, frame, coordinates, tangent, work):
    rotate(frame[:4], coordinates, tangent)


@kernel
def _to_frame(size, frame, tangent, coordinates, work):
    inverse = work[:4]
    inverse[0] = frame[0]
    for i in range(1, 4):
        inverse[i] = -frame[i]
    rotate(inverse, tangent, coordinates)


@kernel
def _renormalize_frame(size, frame, work):
    normalize(frame[:4])
    normalize(frame[4:8])


@kernel
def _renormalize(size, point, work):
    normalize(point)


@kernel
def _project_tangent(size, point, vector, tangent, work):
    for i in range(3):
        tangent[i] = vector[i]


class UnitQuaternion(Manifold):
    """
    The sphere S³ of unit quaternions (w, x, y, z), [GDMP] eqs. (A.5), (A.6).

    ``Log_U(Q) = Log(Q * conj(U))`` has shape ``(3,)``, half the rotation vector in the base frame,
    and reaches up to pi: rotations up to 360 degrees. q and -q are different points here; use
    `align` to choose the sign.
    """

    kind = 'quaternion'
    unit = 'wxyz, tangents half-angle rad'
    goal_tolerance = 0.00125
    # As on `Sphere`.
    split_margin = 1.1
    kernels = Kernels(exp=exp, log=log, frame=_frame, frame_point=_frame_point,
                      transport_frame=_transport_frame, log_in_frame=_log_in_frame,
                      from_frame=_from_frame, to_frame=_to_frame,
                      renormalize_frame=_renormalize_frame, renormalize=_renormalize,
                      project_tangent=_project_tangent)

    def __init__(self) -> None:
        super().__init__(3, dim=3, point_shape=(4,), tangent_size=3, frame_size=8)

    @classmethod
    def of_size(cls, size: object) -> UnitQuaternion:
        return cls()

    @property
    def components(self) -> list[tuple[str, int]]:
        return list(zip('wxyz', range(4)))

    def nearest_point(self, array: np.ndarray) -> np.ndarray:
        norm = np.linalg.norm(array)
        if norm < 1e-12:
            raise self.error('the zero quaternion has no orientation')
        return np.asarray(array / norm)

    def first_invalid(self, points: np.ndarray) -> tuple[int, str] | None:
        return self._first_not_of_unit_norm(points, 'quaternion norm')

    def align(self, point: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """``point`` or ``-point``, the same orientation, whichever is nearer to ``reference``."""
        return -point if float(point @ reference) < 0.0 else point

    def continuous(self, points: np.ndarray) -> np.ndarray:
        turned = np.einsum('ij,ij->i', points[1:], points[:-1]) < 0.0
        return points * np.cumprod(np.append(1.0, np.where(turned, -1.0, 1.0)))[:, None]

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw uniformly from S³."""
        return self.nearest_point(rng.standard_normal(4))

    def __repr__(self) -> str:
        return 'UnitQuaternion()'
