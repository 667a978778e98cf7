"""Unit quaternions, S³: orientations of a tool, scalar first."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled, merged
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.linalg import sinc
from gdmp_ros.manifolds.manifold import Manifold


@compiled
def _product(a, b, out):
    """``out = a * b``; ``out`` may be ``a`` or ``b``."""
    w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    x = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    y = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    z = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@compiled
def _product_conjugate(a, b, out):
    """``out = a * conj(b)``."""
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = -a[0] * b[1] + a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    y = -a[0] * b[2] + a[1] * b[3] + a[2] * b[0] - a[3] * b[1]
    z = -a[0] * b[3] - a[1] * b[2] + a[2] * b[1] + a[3] * b[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@compiled
def _conjugate_product(a, b, out):
    """``out = conj(a) * b``."""
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    y = a[0] * b[2] + a[1] * b[3] - a[2] * b[0] - a[3] * b[1]
    z = a[0] * b[3] - a[1] * b[2] + a[2] * b[1] - a[3] * b[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@compiled
def _normalise(q):
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        q[i] *= scale


@compiled
def _exp_identity(v, scale, out):
    """``exp(scale v)`` for a half-angle vector, [GDMP] eq. (A.6)."""
    angle = scale * math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    s = scale * sinc(angle)
    out[0] = math.cos(angle)
    for i in range(3):
        out[i + 1] = s * v[i]


@compiled
def _log_identity(q, out):
    """Half-angle vector of ``q``, [GDMP] eq. (A.5), up to pi: the sign of ``q`` matters."""
    norm = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    angle = math.atan2(norm, q[0])
    if norm > 1e-300:
        for i in range(3):
            out[i] = q[i + 1] * (angle / norm)
    else:
        out[0], out[1], out[2] = angle, 0.0, 0.0
    return math.pi - angle


@compiled
def rotate(q, v, out):
    """Turn vector ``v`` by unit quaternion ``q``; ``out`` may be ``v``."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    x = v[0] + q[0] * tx + q[2] * tz - q[3] * ty
    y = v[1] + q[0] * ty + q[3] * tx - q[1] * tz
    z = v[2] + q[0] * tz + q[1] * ty - q[2] * tx
    out[0], out[1], out[2] = x, y, z


@merged
def apply(op, m, a, b, out, work):
    """Answer one of the operations; a frame is (A, C) with the point at A * C."""
    if op == ops.FRAME_LOG:
        relative = work[:4]
        _conjugate_product(a[:4], b, relative)
        _product_conjugate(relative, a[4:8], relative)
        return _log_identity(relative, out)
    if op == ops.MOVE:
        half = work[:4]
        _exp_identity(b, 0.5, half)
        _product(a[:4], half, a[:4])
        _product(half, a[4:8], a[4:8])
    elif op == ops.VECTOR:
        rotate(a[:4], b, out)
    elif op == ops.POINT:
        _product(a[:4], a[4:8], out)
    elif op == ops.COORDS:
        inverse = work[:4]
        inverse[0] = a[0]
        for i in range(1, 4):
            inverse[i] = -a[i]
        rotate(inverse, b, out)
    elif op == ops.LOG:
        relative = work[:4]
        _product_conjugate(b, a, relative)
        return _log_identity(relative, out)
    elif op == ops.EXP:
        step = work[:4]
        _exp_identity(b, 1.0, step)
        _product(step, a, out)
        _normalise(out)
    elif op == ops.FRAME:
        out[0], out[1], out[2], out[3] = 1.0, 0.0, 0.0, 0.0
        for i in range(4):
            out[i + 4] = a[i]
    elif op == ops.MEND:
        _normalise(a[:4])
        _normalise(a[4:8])
    elif op == ops.MEND_POINT:
        _normalise(a)
    elif op == ops.TANGENT:
        for i in range(3):
            out[i] = b[i]
    return 0.0


class UnitQuaternion(Manifold):
    """
    The sphere S³ of unit quaternions (w, x, y, z), [GDMP] eqs. (A.5), (A.6).

    ``Log_U(Q) = Log(Q * conj(U))`` has shape ``(3,)``, half the rotation vector in the base frame,
    and reaches up to pi: turns up to 360 degrees. q and -q are different points here; use `align`
    to choose the sign.
    """

    kind = 'quaternion'
    kernel = staticmethod(apply)

    def __init__(self) -> None:
        super().__init__(3, dim=3, point_shape=(4,), tangent_size=3, frame_size=8)

    def _project(self, array: np.ndarray) -> np.ndarray:
        norm = np.linalg.norm(array)
        if norm < 1e-12:
            raise self._no_point('the zero quaternion has no orientation')
        return np.asarray(array / norm)

    def _defect(self, point: np.ndarray) -> str | None:
        return self._unit_defect(point, 'quaternion norm')

    def __repr__(self) -> str:
        return 'UnitQuaternion()'

    def align(self, point: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """``point`` or ``-point``, the same orientation, whichever is nearer to ``reference``."""
        return -point if float(point @ reference) < 0.0 else point

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw uniformly from S³."""
        return self._project(rng.standard_normal(4))
