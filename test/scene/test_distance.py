"""Distances of points and segments from volumes, judged by coal."""
import coal
import numpy as np
import pytest

from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.scene.distance import distances, segment_distance
from gdmp_ros.scene.volume import Volume


def placed(rng):
    quaternion = rng.normal(size=4)
    return np.array([*rng.uniform(-0.6, 0.6, 3), *(quaternion / np.linalg.norm(quaternion))])


def transform(pose):
    w, x, y, z = pose[3:]
    return coal.Transform3s(np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]), pose[:3].copy())


def shape(volume):
    if volume.kind == 'sphere':
        return coal.Sphere(*volume.size)
    if volume.kind == 'box':
        return coal.Box(*volume.size)
    if volume.kind == 'capsule':
        return coal.Capsule(*volume.size)
    return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)


def judged(volume, segment, radius):
    a, b = segment
    along = (b - a) / np.linalg.norm(b - a)
    across = np.linalg.svd(along[None])[2][1:]
    if np.linalg.det(np.vstack([across, along])) < 0.0:
        across[0] *= -1.0
    place = coal.Transform3s(np.vstack([across, along]).T, 0.5 * (a + b))
    capsule = coal.Capsule(radius, float(np.linalg.norm(b - a)))
    result = coal.DistanceResult()
    return coal.distance(capsule, place, shape(volume), transform(volume.pose),
                         coal.DistanceRequest(True), result)


@kernel
def all_distances(volume, segments, found):
    way = local_numbers(3)
    for k in range(segments.shape[0]):
        found[k, 0], found[k, 1] = segment_distance(volume, segments[k, 0], segments[k, 1], way)
        for i in range(3):
            found[k, 2 + i] = way[i]


def found(volume, segments):
    result = np.empty((len(segments), 5))
    all_distances(volume.packed(0.0, {}), segments, result)
    return result


@pytest.mark.parametrize(('kind', 'count'), [
    ('sphere', 1), ('box', 3), ('capsule', 2), ('plane', 0)])
def test_distances_of_capsules_are_those_of_another_library(kind, count, rng):
    apart = 0
    for _ in range(40):
        volume = Volume('one', kind, tuple(rng.uniform(0.02, 0.4, count)), placed(rng))
        segments = rng.uniform(-1.0, 1.0, (10, 2, 3))
        segments[5:, 1] = segments[5:, 0] + 0.3 * np.eye(3)[rng.integers(0, 3, 5)]
        for (distance, t, *way), segment in zip(found(volume, segments), segments):
            expected = judged(volume, segment, 0.05) + 0.05
            if expected > 0.051:
                apart += 1
                # coal iterates, to 1e-6.
                assert distance == pytest.approx(expected, abs=2e-6)
                # The way is the gradient of the distance.
                point = segment[0] + t * (segment[1] - segment[0])
                ahead = distances(volume.packed(0.0, {}), [point + 1e-6 * np.array(way)])[0]
                assert ahead == pytest.approx(distance + 1e-6, abs=1e-9)
            else:
                assert distance < 0.052
    assert apart > 100


def test_inside_of_a_volume_the_distance_is_its_depth():
    box = Volume('box', 'box', (0.2, 0.4, 0.6), np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    points = np.array([[1.0, 0.0, 0.0], [1.08, 0.0, 0.0], [1.0, 0.19, 0.0]])
    np.testing.assert_allclose(distances(box.packed(0.0, {}), points), [-0.1, -0.02, -0.01])
    segment = np.array([[[0.5, 0.01, 0.0], [1.5, 0.01, 0.0]]])
    assert found(box, segment)[0, 0] <= 0.0


def test_without_a_volume_nothing_is_near():
    assert distances(np.empty((0, 20)), np.zeros((2, 3))).tolist() == [np.inf, np.inf]
