"""Ways past volumes, beside potentials and points; and what clouds of points cost."""
import numpy as np
import pytest

from experiments import timing
from experiments.baselines.potentials import dynamic, static, Superquadric
from experiments.bench import clouds, obstacles
from gdmp_ros.scene import Volume
from gdmp_ros.scene.distance import distances


@pytest.mark.parametrize(('kind', 'size'), [('sphere', (0.1,)), ('box', (0.1, 0.2, 0.3)),
                                            ('capsule', (0.05, 0.3))])
def test_potentials_enclose_their_volume_and_have_their_gradients(kind, size, rng):
    turn = rng.normal(size=4)
    volume = Volume('one', kind, size, np.array([0.4, 0.1, 0.2, *turn / np.linalg.norm(turn)]))
    shape = Superquadric(volume, 0.04)
    near = volume.pose[:3] + rng.uniform(-0.4, 0.4, (3000, 3))
    touching = near[distances(volume.packed(0.0, {}), near) < 0.03]
    inside = np.array([shape.inside(point, place=True) for point in touching])
    assert (((inside / shape.axes) ** shape.exponents).sum(axis=1) < 1.0).all()
    h, checked = 1e-6, 0
    for point in near[:40]:
        x, v = shape.inside(point, place=True), rng.normal(size=3)
        value, gradient, _ = shape.derivatives(x)
        if value < 0.1:
            continue

        def towards(at, v=v):
            _, slope, _ = shape.derivatives(at)
            return -slope @ v / (np.linalg.norm(slope) * np.linalg.norm(v))

        def velocity_potential(at, v=v, towards=towards):
            return 10.0 * towards(at) ** 2 * np.linalg.norm(v) / shape.derivatives(at)[0] ** 0.5

        def potential(at):
            value = shape.derivatives(at)[0]
            return 10.0 * np.exp(-value) / value
        for force, energy in ((static(shape, x, 10.0, 1.0), potential),
                              (dynamic(shape, x, v, 10.0, 0.5, 2.0), velocity_potential)):
            if energy is velocity_potential and towards(x) < 0.05:
                assert towards(x) > 0.0 or not force.any()
                continue
            slope = [(energy(x + step) - energy(x - step)) / (2.0 * h) for step in h * np.eye(3)]
            np.testing.assert_allclose(force, -np.array(slope), rtol=1e-4, atol=1e-5)
            checked += 1
    assert checked > 20


def test_a_way_that_is_searched_touches_nothing_and_the_best_gains_are_shown(monkeypatch):
    monkeypatch.setattr(obstacles, 'SCENES', 3)
    monkeypatch.setattr(obstacles, 'GAINS', (0.1, 10.0))
    document = obstacles.run(timing.TimingSettings())
    found = document['methods']
    assert found['a way is searched']['reached_without_contact'] == 1.0
    assert found['points (movement_primitives)']['contact'] > 0.0
    heads, *lines = obstacles.rows(document)
    assert len(lines) == 5 and len(heads) == 6


@pytest.mark.long
def test_an_arm_follows_the_clouds_of_the_bench():
    document = clouds.run(timing.TimingSettings(seconds=1.0))
    assert document['boxes'] > 5 and document['scenes'] > 3
    assert len(clouds.rows(document)) == 5
