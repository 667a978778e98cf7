"""The laws of `Manifold`, each stated once and held against every manifold."""
import math

import numpy as np
import pytest
from scipy.linalg import expm, logm

from gdmp_ros.errors import CutLocusError, ManifoldError
from gdmp_ros.manifolds import (
    Euclidean,
    from_spec,
    KINDS,
    Product,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)

EPS = np.finfo(float).eps
LISTED = [Euclidean(1), Euclidean(3), Sphere(1), Sphere(2), Sphere(5), UnitQuaternion(),
          SpecialOrthogonal(2), SpecialOrthogonal(3), SpecialOrthogonal(4),
          SpecialOrthogonal(5),
          SymmetricPositiveDefinite(1), SymmetricPositiveDefinite(2),
          SymmetricPositiveDefinite(3), SymmetricPositiveDefinite(6),
          Product(Euclidean(3), UnitQuaternion(), SymmetricPositiveDefinite(3)),
          Product(Sphere(2), SpecialOrthogonal(3))]
#: With every kind that has been added to the registry.
MANIFOLDS = [*LISTED, *(kind.of_size(2) for kind in KINDS
                        if kind not in {type(manifold) for manifold in LISTED})]


@pytest.fixture(params=MANIFOLDS, ids=repr)
def manifold(request):
    return request.param


def injectivity(manifold):
    """Radius within which the logarithm is unique, in this manifold's norm."""
    return math.pi if any(f.has_cut_locus for f in manifold.factors) else math.inf


def tangent_of_length(manifold, base, rng, length):
    v = manifold.random_tangent(base, rng)
    return v * (length / manifold.norm(base, v))


def condition(manifold, point):
    """``max(1, |U|) cond(U)`` of the worst SPD factor, 1 where there is none."""
    parts = manifold.split(point) if isinstance(manifold, Product) else (point,)
    worst = 1.0
    for factor, part in zip(manifold.factors, parts):
        if factor.kind == 'spd':
            values = np.linalg.eigvalsh(part)
            worst = max(worst, max(1.0, values[-1]) * values[-1] / values[0])
    return worst


@pytest.mark.parametrize('length', [0.0, 1e-300, 1e-16, 1e-12, 1e-9, 1e-7, 1e-4, 1e-2])
def test_log_undoes_the_smallest_exp(manifold, rng, length):
    for _ in range(10):
        base = manifold.random_point(rng)
        v = tangent_of_length(manifold, base, rng, 1.0) * length
        back = manifold.log(base, manifold.exp(base, v))
        bound = 8.0 * EPS * condition(manifold, base) * max(1.0, np.abs(base).max())
        np.testing.assert_allclose(back, v, rtol=0.0, atol=bound)


@pytest.mark.parametrize('fraction', [0.1, 0.5, 0.9])
def test_log_undoes_exp(manifold, rng, fraction):
    reach = min(injectivity(manifold), 4.0)
    for _ in range(10):
        base = manifold.random_point(rng)
        v = tangent_of_length(manifold, base, rng, fraction * reach)
        back = manifold.log(base, manifold.exp(base, v))
        np.testing.assert_allclose(back, v, rtol=0.0, atol=1e-12 * condition(manifold, base))


@pytest.mark.parametrize('manifold', [m for m in MANIFOLDS if math.isfinite(injectivity(m))],
                         ids=repr)
@pytest.mark.parametrize('gap', [1e-1, 1e-3, 1e-5])
def test_log_near_the_cut_locus_loses_no_more_than_the_gap(manifold, rng, gap):
    base = manifold.random_point(rng)
    for factor_at in range(len(manifold.factors)):
        v = np.zeros(manifold.tangent_size)
        factor = manifold.factors[factor_at]
        if factor.kind not in ('sphere', 'quaternion', 'rotation'):
            continue
        part = manifold.split(base)[factor_at] if isinstance(manifold, Product) else base
        where = (manifold.tangent_slices[factor_at] if isinstance(manifold, Product)
                 else slice(None))
        drawn = factor.random_tangent(part, rng)
        if factor.kind == 'rotation' and factor.size > 3:
            # The cut locus is where the largest plane angle is pi, not where the norm is.
            angles = np.abs(np.linalg.eigvals(logm(factor.exp(part, 1e-3 * drawn) @ part.T)))
            drawn *= (math.pi - gap) * 1e-3 / angles.max()
        else:
            drawn *= (math.pi - gap) / np.linalg.norm(drawn)
        v[where] = drawn
        back = manifold.log(base, manifold.exp(base, v))
        np.testing.assert_allclose(back, v, rtol=0.0, atol=64 * EPS / gap)


def test_exp_undoes_log(manifold, rng):
    for _ in range(10):
        a, b = manifold.random_point(rng), manifold.random_point(rng)
        tolerance = 1e-12 * condition(manifold, a) * condition(manifold, b)
        np.testing.assert_allclose(manifold.exp(a, manifold.log(a, b)), b, rtol=0, atol=tolerance)


def test_exp_gives_points(manifold, rng):
    base = manifold.random_point(rng)
    for length in (1e-8, 1.0, 3.0):
        manifold.check_point(manifold.exp(base, tangent_of_length(manifold, base, rng, length)))


def test_distance_is_a_metric_and_the_length_of_log(manifold, rng):
    a, b, c = (manifold.random_point(rng) for _ in range(3))
    assert manifold.distance(a, b) == pytest.approx(manifold.distance(b, a), rel=1e-9)
    assert manifold.distance(a, b) == pytest.approx(manifold.norm(a, manifold.log(a, b)), rel=1e-9)
    assert manifold.distance(a, a) <= 1e-12
    assert manifold.distance(a, c) <= manifold.distance(a, b) + manifold.distance(b, c) + 1e-12


def test_transport_keeps_inner_products(manifold, rng):
    a, b = manifold.random_point(rng), manifold.random_point(rng)
    u, v = manifold.random_tangent(a, rng), manifold.random_tangent(a, rng)
    moved = manifold.inner(b, manifold.transport(a, b, u), manifold.transport(a, b, v))
    assert moved == pytest.approx(manifold.inner(a, u, v), rel=1e-9, abs=1e-12)


def test_transport_carries_the_geodesic_along_itself(manifold, rng):
    a, b = manifold.random_point(rng), manifold.random_point(rng)
    carried = manifold.transport(a, b, manifold.log(a, b))
    np.testing.assert_allclose(carried, -manifold.log(b, a), rtol=0.0,
                               atol=1e-10 * condition(manifold, b))


def test_transport_there_and_back_is_the_identity(manifold, rng):
    a, b = manifold.random_point(rng), manifold.random_point(rng)
    v = manifold.random_tangent(a, rng)
    back = manifold.transport(b, a, manifold.transport(a, b, v))
    np.testing.assert_allclose(back, v, rtol=0, atol=1e-10 * condition(manifold, a))


def test_geodesic_has_constant_speed(manifold, rng):
    a, b = manifold.random_point(rng), manifold.random_point(rng)
    whole = manifold.distance(a, b)
    for t in (0.0, 0.25, 0.5, 1.0):
        assert manifold.distance(a, manifold.geodesic(a, b, t)) == pytest.approx(t * whole,
                                                                                 abs=1e-9)


def test_mean_balances_the_tangents(manifold, rng):
    centre = manifold.random_point(rng)
    points = [manifold.exp(centre, tangent_of_length(manifold, centre, rng, 0.5))
              for _ in range(6)]
    weights = rng.uniform(0.2, 1.0, 6)
    mean = manifold.mean(points, weights)
    gradient = sum(w * manifold.log(mean, p) for w, p in zip(weights, points))
    assert manifold.norm(mean, gradient) < 1e-9


def test_mean_of_two_is_the_midpoint(manifold, rng):
    a = manifold.random_point(rng)
    b = manifold.exp(a, tangent_of_length(manifold, a, rng, 0.8))
    assert manifold.distance(manifold.mean([a, b]), manifold.geodesic(a, b, 0.5)) < 1e-9


def test_project_removes_noise_and_keeps_points(manifold, rng):
    point = manifold.random_point(rng)
    np.testing.assert_allclose(manifold.project(point), point, atol=1e-12)
    noisy = point + 1e-4 * rng.standard_normal(manifold.point_shape)
    mended = manifold.check_point(manifold.project(noisy))
    assert manifold.distance(point, mended) < 1e-2


def test_wrong_shapes_and_numbers_are_refused(manifold, rng):
    point = manifold.random_point(rng)
    with pytest.raises(ManifoldError, match='shape is'):
        manifold.check_point(np.zeros(manifold.point_size + 1))
    with pytest.raises(ManifoldError, match='tangent shape is'):
        manifold.exp(point, np.zeros(manifold.tangent_size + 1))
    broken = point.copy()
    broken.flat[0] = np.nan
    with pytest.raises(ManifoldError, match='NaN'):
        manifold.check_point(broken)


def test_spec_describes_the_manifold(manifold):
    assert from_spec(manifold.spec()) == manifold


def antipode(manifold, point):
    if manifold.kind == 'rotation':
        turned = point.copy()
        turned[:2] = -turned[:2]  # half a turn in the plane of the first two axes
        return turned
    return -point


@pytest.mark.parametrize('manifold', [m for m in MANIFOLDS
                                      if m.kind in ('sphere', 'quaternion', 'rotation')], ids=repr)
def test_the_cut_locus_has_a_distance_but_no_log(manifold, rng):
    a = manifold.random_point(rng)
    b = antipode(manifold, a)
    assert manifold.distance(a, b) == pytest.approx(math.pi, abs=1e-6)
    for ask in (lambda: manifold.log(a, b), lambda: manifold.geodesic(a, b, 0.5),
                lambda: manifold.transport(a, b, np.zeros(manifold.tangent_size)),
                lambda: manifold.mean([a, b])):
        with pytest.raises(CutLocusError) as caught:
            ask()
        assert caught.value.distance < 1e-6


# Known values: one for each manifold, against an independent reference.

def test_quaternion_log_is_the_half_angle_and_keeps_its_sign():
    turn = np.array([math.cos(0.4), 0.0, 0.0, math.sin(0.4)])
    identity = np.array([1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(UnitQuaternion().log(identity, turn), [0, 0, 0.4], atol=1e-15)
    np.testing.assert_allclose(UnitQuaternion().log(identity, -turn), [0, 0, 0.4 - math.pi],
                               atol=1e-15)


@pytest.mark.parametrize('m', [2, 3, 4, 6])
def test_rotation_maps_are_the_matrix_functions(rng, m):
    manifold = SpecialOrthogonal(m)
    base, v = manifold.random_point(rng), 0.4 * rng.standard_normal(manifold.tangent_size)
    skew = np.zeros((m, m))
    if m == 3:
        skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    elif m == 2:
        skew = np.array([[0, -v[0]], [v[0], 0]])
    else:
        skew[np.triu_indices(m, 1)] = v
        skew -= skew.T
    np.testing.assert_allclose(manifold.exp(base, v), expm(skew) @ base, atol=1e-13)


def mandel(matrix):
    m = len(matrix)
    return np.array([matrix[i, j] * (1.0 if i == j else math.sqrt(2.0))
                     for i in range(m) for j in range(i, m)])


@pytest.mark.parametrize('m', [2, 3, 6])
def test_spd_log_is_the_affine_invariant_one(rng, m):
    manifold = SymmetricPositiveDefinite(m)
    u, q = manifold.random_point(rng), manifold.random_point(rng)
    values, vectors = np.linalg.eigh(u)
    root = (vectors * np.sqrt(values)) @ vectors.T
    inverse = (vectors / np.sqrt(values)) @ vectors.T
    reference = root @ logm(inverse @ q @ inverse).real @ root
    np.testing.assert_allclose(manifold.log(u, q), mandel(reference), atol=1e-10)
    assert manifold.inner(u, manifold.log(u, q), manifold.log(u, q)) == pytest.approx(
        np.linalg.norm(logm(inverse @ q @ inverse)) ** 2, rel=1e-9)


def test_sphere_quarter_turn():
    manifold = Sphere(2)
    pole, equator = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    np.testing.assert_allclose(manifold.log(pole, equator), [math.pi / 2, 0, 0], atol=1e-15)
    np.testing.assert_allclose(manifold.transport(pole, equator, [1.0, 0, 0]), [0, 0, -1],
                               atol=1e-15)


def test_product_splits_and_joins(rng):
    manifold = Product(Euclidean(3), UnitQuaternion(), names=['position', 'orientation'])
    point = manifold.random_point(rng)
    np.testing.assert_array_equal(manifold.join(*manifold.split(point)), point)
    with pytest.raises(ManifoldError, match='orientation: quaternion norm is 2'):
        manifold.check_point(manifold.join(np.zeros(3), np.array([2.0, 0, 0, 0])))
    with pytest.raises(ManifoldError, match='different names'):
        Product(Euclidean(1), Euclidean(1), names=['a', 'a'])


def test_every_operation_accepts_axes_in_front(manifold, rng):
    """Each point of an array of points gives what it gives alone; axes are broadcast."""
    base = manifold.random_point(rng)
    v = np.array([[0.1 * manifold.random_tangent(base, rng) for _ in range(2)] for _ in range(3)])
    points = manifold.exp(base, v)
    frames = manifold.frame(points)
    moved, left = manifold.log_in_frame(frames, base)
    assert points.shape == (3, 2, *manifold.point_shape) and left.shape == (3, 2)
    assert manifold.transport(base, points, v).shape == v.shape
    for i, j in np.ndindex(3, 2):
        point, frame = points[i, j], frames[i, j]
        np.testing.assert_array_equal(point, manifold.exp(base, v[i, j]))
        np.testing.assert_array_equal(frame, manifold.frame(point))
        np.testing.assert_array_equal(manifold.log(base, points)[i, j], manifold.log(base, point))
        np.testing.assert_array_equal(moved[i, j], manifold.log_in_frame(frame, base)[0])
        np.testing.assert_array_equal(manifold.transport_frame(frames, moved)[i, j],
                                      manifold.transport_frame(frame, moved[i, j]))
        np.testing.assert_array_equal(manifold.transport(base, points, v)[i, j],
                                      manifold.transport(base, point, v[i, j]))
        assert manifold.distance(base, points)[i, j] == manifold.distance(base, point)
        assert manifold.inner(points, v, v)[i, j] == manifold.inner(point, v[i, j], v[i, j])
    with pytest.raises(ManifoldError, match='axes in front'):
        manifold.exp(points, v[:2])
    assert manifold.exp(points[:0], v[:0]).shape == (0, 2, *manifold.point_shape)
