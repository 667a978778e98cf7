"""S^m, the unit sphere in R^(m+1): directions."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.kernels import kernel, noinline
from gdmp_ros.manifolds.factors import Kernels
from gdmp_ros.manifolds.linalg import orthonormalize, set_identity, sinc
from gdmp_ros.manifolds.manifold import Manifold


@kernel
def _normalize(v):
    total = 0.0
    for i in range(v.size):
        total += v[i] * v[i]
    scale = 1.0 / math.sqrt(total)
    for i in range(v.size):
        v[i] *= scale


@kernel
def _project(base, v, out):
    dot = 0.0
    for i in range(base.size):
        dot += base[i] * v[i]
    for i in range(base.size):
        out[i] = v[i] - dot * base[i]


@kernel
def _any_tangent(base, out):
    """Some unit tangent at ``base``."""
    least = 0
    for i in range(base.size):
        if abs(base[i]) < abs(base[least]):
            least = i
    for i in range(base.size):
        out[i] = (1.0 if i == least else 0.0) - base[least] * base[i]
    _normalize(out)


@kernel
def _log_at(base, point, out):
    """[GDMP] eq. (A.3), with the angle from atan2: accurate also near 0 and near pi."""
    noinline()
    cosine = 0.0
    for i in range(base.size):
        cosine += base[i] * point[i]
    # Twice: one projection leaves a part along the base as large as the rounding of the points.
    _project(base, point, out)
    _project(base, out, out)
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


@kernel
def _exp(size, base, tangent, point, work):
    """[GDMP] eq. (A.4)."""
    total = 0.0
    for i in range(base.size):
        total += tangent[i] * tangent[i]
    angle = math.sqrt(total)
    c, s = math.cos(angle), sinc(angle)
    for i in range(base.size):
        point[i] = c * base[i] + s * tangent[i]
    _normalize(point)


@kernel
def _log(size, base, point, tangent, work):
    return _log_at(base, point, tangent)


# A frame is (origin, P): a point of the sphere and a rotation; the point of the frame is P origin.

@kernel
def _frame(size, point, frame, work):
    for i in range(size + 1):
        frame[i] = point[i]
    set_identity(size + 1, frame[size + 1:])


@kernel
def _rotate(rotation, vector, out):
    n = out.size
    for i in range(n):
        total = 0.0
        for k in range(n):
            total += rotation[i * n + k] * vector[k]
        out[i] = total


@kernel
def _rotate_back(rotation, vector, out):
    n = out.size
    for i in range(n):
        total = 0.0
        for k in range(n):
            total += rotation[k * n + i] * vector[k]
        out[i] = total


@kernel
def _frame_point(size, frame, point, work):
    _rotate(frame[size + 1:], frame[:size + 1], point)


@kernel
def _from_frame(size, frame, coordinates, tangent, work):
    _rotate(frame[size + 1:], coordinates, tangent)


@kernel
def _to_frame(size, frame, tangent, coordinates, work):
    image = work[:size + 1]
    _rotate_back(frame[size + 1:], tangent, image)
    _project(frame[:size + 1], image, coordinates)


@kernel
def _log_in_frame(size, frame, point, coordinates, work):
    image = work[:size + 1]
    _rotate_back(frame[size + 1:], point, image)
    return _log_at(frame[:size + 1], image, coordinates)


@kernel
def _transport_frame(size, frame, coordinates, work):
    """Multiply P on the right by the rotation in the plane (origin, coordinates)."""
    n, origin, rotation = size + 1, frame[:size + 1], frame[size + 1:]
    total = 0.0
    for i in range(n):
        total += coordinates[i] * coordinates[i]
    angle = math.sqrt(total)
    if angle < 1e-300:
        return
    sine, cosine1 = math.sin(angle), -2.0 * math.sin(0.5 * angle) ** 2
    for row in range(0, n * n, n):
        along, across = 0.0, 0.0
        for i in range(n):
            along += rotation[row + i] * origin[i]
            across += rotation[row + i] * coordinates[i] / angle
        for i in range(n):
            unit = coordinates[i] / angle
            rotation[row + i] += (sine * (across * origin[i] - along * unit)
                                  + cosine1 * (across * unit + along * origin[i]))


@kernel
def _renormalize_frame(size, frame, work):
    orthonormalize(size + 1, frame[size + 1:], work)


@kernel
def _renormalize(size, point, work):
    _normalize(point)


@kernel
def _project_tangent(size, point, vector, tangent, work):
    _project(point, vector, tangent)


class Sphere(Manifold):
    """
    Unit vectors of R^(m+1), [GDMP] eqs. (A.3), (A.4).

    A point has shape ``(m + 1,)``; a tangent is the ambient vector [rad], shape ``(m + 1,)``,
    orthogonal to its base.
    """

    kind = 'sphere'
    unit = 'rad'
    goal_tolerance = 0.0025
    # A goal further away than π/2 pushes sideways: at distance r a deviation from the path grows
    # as exp(α_z/2 (√(1 - r cot r) - 1) s), threefold in a tenth of a duration at r = 2.04.
    split_margin = 1.1
    kernels = Kernels(exp=_exp, log=_log, frame=_frame, frame_point=_frame_point,
                      transport_frame=_transport_frame, log_in_frame=_log_in_frame,
                      from_frame=_from_frame, to_frame=_to_frame,
                      renormalize_frame=_renormalize_frame, renormalize=_renormalize,
                      project_tangent=_project_tangent)

    def __init__(self, m: int):
        """:param m: dimension of the sphere, at least 1"""
        super().__init__(self._check_size(m, least=1), dim=m, point_shape=(m + 1,),
                         tangent_size=m + 1, frame_size=(m + 1) * (m + 2))

    def nearest_point(self, array: np.ndarray) -> np.ndarray:
        norm = np.linalg.norm(array)
        if norm < 1e-12:
            raise self.error('the zero vector has no direction')
        return np.asarray(array / norm)

    def first_invalid(self, points: np.ndarray) -> tuple[int, str] | None:
        return self._first_not_of_unit_norm(points, 'norm')

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw uniformly from the sphere."""
        return self.nearest_point(rng.standard_normal(self.size + 1))
