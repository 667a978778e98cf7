"""Stiffness from takes: what they determine, and what they do not."""
import numpy as np
import pytest

from gdmp_ros import DataError, Demonstration, Euclidean, ParameterError, Product, UnitQuaternion
from gdmp_ros.learning import aligned, stiffness_from_takes
from gdmp_ros.learning.stiffness import stiffness_of_each
from gdmp_ros.util.profiles import minimum_jerk

TIMES = np.linspace(0.0, 4.0, 400)
S = TIMES / 4.0


def path(progress):
    blend = minimum_jerk(progress)
    return np.column_stack([0.3 * blend, 0.1 * np.sin(np.pi * blend), 0.05 * blend ** 2])


def take(offset=(0.0, 0.0, 0.0), warp=0.0):
    """One take: moved by an offset, with its timing shifted by up to a share of the duration."""
    progress = S + warp * np.sin(np.pi * S) ** 2
    return Demonstration(TIMES, path(progress) + np.asarray(offset), Euclidean(3))


def wavering(sd, rng):
    """A take that wavers smoothly, with a standard deviation at every moment."""
    angle = rng.uniform(0.0, 2.0 * np.pi, 3)
    wave = np.sqrt(2.0) * np.cos(2.0 * np.pi * np.outer(S, [1.0, 1.5, 2.0]) + angle)
    return Demonstration(TIMES, path(S) + wave * np.asarray(sd), Euclidean(3))


def test_equal_takes_are_as_stiff_as_possible():
    s, matrices = stiffness_from_takes([take() for _ in range(5)], 200.0, 800.0)
    assert s[0] == 0.0 and s[-1] == 1.0 and matrices.shape == (len(s), 3, 3)
    np.testing.assert_allclose(matrices, np.broadcast_to(800.0 * np.eye(3), matrices.shape),
                               atol=1e-6)


@pytest.mark.long
def test_few_takes_that_differ_alike_in_all_directions_have_nearly_equal_axes(rng):
    ratios = []
    for _ in range(30):
        takes = [take(0.003 * rng.standard_normal(3)) for _ in range(9)]
        values = np.linalg.eigvalsh(stiffness_from_takes(takes, 20.0, 2000.0)[1][75])
        ratios.append(values[-1] / values[0])
    assert np.median(ratios) <= 1.3


@pytest.mark.parametrize('make', [
    lambda sd, rng: take(np.asarray(sd) * rng.standard_normal(3)), wavering])
def test_the_softest_axis_is_the_one_in_which_the_takes_differ(make, rng):
    angles = []
    for _ in range(15):
        takes = [make([0.0005, 0.0005, 0.003], rng) for _ in range(9)]
        values, vectors = np.linalg.eigh(stiffness_from_takes(takes)[1][75])
        angles.append(np.degrees(np.arccos(abs(vectors[2, 0]))))
    assert np.median(angles) <= 10.0


@pytest.mark.long
def test_differences_in_timing_hardly_change_the_stiffness(rng):
    changes = []
    for _ in range(10):
        offsets = 0.003 * rng.standard_normal((9, 3)) * [1.0, 1.0, 3.0]
        plain = stiffness_from_takes([take(offset) for offset in offsets])[1]
        warps = rng.uniform(-0.1, 0.1, 9)
        warped = stiffness_from_takes([take(o, w) for o, w in zip(offsets, warps)])[1]
        changes.append((np.linalg.norm(warped - plain, axis=(1, 2))
                        / np.linalg.norm(plain, axis=(1, 2))).max())
    assert np.median(changes) <= 0.15


def test_what_differs_is_softer(rng):
    """Takes that part after the middle."""
    takes = []
    for _ in range(9):
        parted = minimum_jerk(np.clip(2.0 * S - 1.0, 0.0, 1.0))
        away = np.outer(parted, 0.01 * rng.standard_normal(3))
        takes.append(Demonstration(TIMES, path(S) + away, Euclidean(3)))
    s, matrices = stiffness_from_takes(takes, 200.0, 800.0)
    values = np.linalg.eigvalsh(matrices)
    assert values[s < 0.4].min() > 750.0 and values[-1].max() < 320.0
    assert values.min() >= 199.0 and values.max() <= 801.0


def test_every_take_gets_the_stiffness_of_its_own_moment(rng):
    takes = [take(0.003 * rng.standard_normal(3) * np.array([1.0, 1.0, 3.0]), w)
             for w in (-0.1, 0.0, 0.1)]
    each = stiffness_of_each(takes)
    assert [len(one) for one in each] == [400, 400, 400]
    for one in each:
        np.linalg.cholesky(one)


def test_alignment_removes_differences_in_timing(rng):
    takes = [take(warp=w) for w in (-0.1, -0.05, 0.0, 0.05, 0.1)]
    spread = np.std([one.points for one in takes], axis=0).max()
    after = np.std([one.points for one in aligned(takes)], axis=0).max()
    assert spread > 0.02 and after < 0.15 * spread
    # The mean keeps the usual timing.
    mean = np.mean([one.points for one in aligned(takes)], axis=0)
    assert np.linalg.norm(mean - path(S), axis=1).max() < 0.02 * 0.3


def test_takes_with_orientations_are_aligned_too(rng):
    tool = Product(Euclidean(3), UnitQuaternion())
    takes = []
    for warp in (-0.1, 0.0, 0.1):
        progress = S + warp * np.sin(np.pi * S) ** 2
        turned = [UnitQuaternion().exp(np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, b]))
                  for b in minimum_jerk(progress)]
        points = np.hstack([np.zeros((400, 3)), turned if warp else -np.array(turned)])
        takes.append(Demonstration(TIMES, points, tool))
    paths = [one.flat_points for one in aligned(takes)]
    away = tool.factor_distances(paths[0].copy(), paths[2].copy()).max()
    raw = tool.factor_distances(takes[0].flat_points.copy(), takes[2].flat_points.copy()).max()
    assert raw > 0.25 and away < 0.15 * raw


def test_too_little_to_learn_from_is_refused():
    with pytest.raises(DataError, match='at least 2 takes, got 1'):
        stiffness_from_takes([take()])
    with pytest.raises(DataError, match='does not begin with a position'):
        turning = Demonstration(TIMES, np.tile([1.0, 0.0, 0.0, 0.0], (400, 1)), UnitQuaternion())
        stiffness_from_takes([turning, turning])
    with pytest.raises(ParameterError, match='stiffness bounds'):
        stiffness_from_takes([take(), take()], 800.0, 200.0)
    with pytest.raises(DataError, match='take 1 is on'):
        aligned([take(), Demonstration(TIMES, path(S)[:, :2], Euclidean(2))])
    with pytest.raises(DataError, match='at least one take'):
        aligned([])
