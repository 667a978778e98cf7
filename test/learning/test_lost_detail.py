"""Skills that lost the detail of their demonstrations say so; good ones do not."""
import warnings

import numpy as np
import pytest

from gdmp_ros import Demonstration, Euclidean, GdmpWarning, Skill
from gdmp_ros.data import lasa
from gdmp_ros.learning.lost_detail import lost_detail, Reproduced

DURATION = 8.0


def grating(lines, phase=0.0, noise=1e-4, seed=0):
    """Lines to and fro, 40 mm apart at most, along 0.5 m."""
    s = np.linspace(0.0, 1.0, 4001)
    swing = 0.02 * np.sin(2.0 * np.pi * lines * s + phase) * np.sqrt(np.sin(np.pi * s) + 1e-12)
    points = np.column_stack([0.5 * s, swing, np.zeros_like(s)])
    points += noise * np.random.default_rng(seed).standard_normal(points.shape)
    return Demonstration(DURATION * s, points, Euclidean(3))


def said(shown, n_basis, **options):
    """Warnings of learning, without that of the tolerance."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always', GdmpWarning)
        Skill.learn(shown, n_basis, **options)
    return [str(one.message) for one in caught if 'tolerance' not in str(one.message)]


@pytest.mark.parametrize('noise', [0.0, 1e-4, 1e-3])
def test_too_few_functions(noise):
    """60 functions cannot make 40 lines; 120 can, and noise does not count as detail."""
    shown = grating(40, noise=noise)
    message, = said(shown, 60)
    assert message.startswith('60 basis functions cannot follow the demonstrations: the path of '
                              'euclidean is 8')
    assert not said(shown, 120)
    assert not said(shown, 'auto')


def test_takes_out_of_phase():
    """Averages of takes that are not aligned are ripples."""
    shown = [grating(40, phase, seed=k) for k, phase in enumerate((0.0, 1.9, 3.9, 5.0, 2.5))]
    message, = said(shown, 'auto', align=False)
    assert message.startswith('the demonstrations differ, and their average loses detail')
    assert 'timing' in message
    assert not said([grating(40, 0.1 * k, seed=k) for k in range(5)], 'auto', align=False)


@pytest.mark.parametrize('letter', [
    'GShape', *(pytest.param(name, marks=pytest.mark.long)
                for name in ('Sine', 'WShape', 'Trapezoid', 'Leaf_1'))])
def test_recorded_letters_are_no_cause(letter):
    """Seven hand-drawn takes with orientation and stiffness differ, as takes do."""
    assert not said(lasa.robot_demonstrations(letter), 60)


def test_what_is_measured():
    """A residual of half of the swing, common to all, or along the motion only."""
    curve = grating(20, noise=0.0).points
    swing = np.column_stack([np.zeros((len(curve), 1)), curve[:, 1:]])
    common = lost_detail([Reproduced(curve, 0.5 * swing)] * 3)
    assert common.common == pytest.approx(1.0)
    forward, sideways = (float((np.diff(curve, axis=0)[:, k] ** 2).sum()) for k in (0, 1))
    kept = (forward + 0.25 * sideways) / (forward + sideways)
    assert common.shorter == pytest.approx(1.0 - np.sqrt(kept), abs=1e-3)
    assert common.distance == pytest.approx(0.5 * np.sqrt((swing ** 2).sum(axis=1).mean()))
    along = [Reproduced(curve, share * np.gradient(curve, axis=0)) for share in (-3.0, 0.0, 3.0)]
    assert lost_detail(along).timing == pytest.approx(1.0, abs=0.01)
    across = [Reproduced(curve, np.array([[0.0, 0.0, share]]) * swing[:, 1:2])
              for share in (-0.5, 0.0, 0.5)]
    assert lost_detail(across).timing == pytest.approx(0.0, abs=0.01)


def test_noise_is_not_detail(rng):
    """Noise of 100 times the step between two samples: nothing can be said, and nothing is."""
    clean = grating(2, noise=0.0)
    for level in (0.005, 0.02):
        points = clean.points + level * rng.standard_normal(clean.points.shape)
        assert not said(Demonstration(clean.times, points, Euclidean(3)), 'auto')


def test_a_long_recording_is_seen_in_detail():
    """Averaged samples, four to a period: the functions cannot follow, and it is told."""
    times = np.linspace(0.0, 3600.0, 36_001)
    points = np.column_stack([0.05 * np.sin(0.5 * times), 0.1 * np.sin(0.31 * times),
                              np.full_like(times, 0.4)])
    message, = said(Demonstration(times, points, Euclidean(3)), 500)
    assert message.startswith('500 basis functions cannot follow')
