"""What recorders do to a demonstration is mended; what a clean one shows is not."""
import warnings

import numpy as np
import pytest

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import GdmpWarning
from gdmp_ros.learning.cleaning import cleaned
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.util.profiles import minimum_jerk


def shown(count):
    """Along a line; orientation and stiffness are constant."""
    s = np.linspace(0.0, 1.0, count)
    stiffness = np.diag([100.0, 200.0, 300.0]).reshape(-1)
    points = np.tile([0.4, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0, *stiffness], (count, 1))
    points[:, 0] += 0.2 * minimum_jerk(s)
    return Demonstration(2.0 * s, points, tool_manifold(3))


@pytest.mark.parametrize('count', [30, 60, 120, 500])
def test_rounding_of_what_does_not_move_is_not_suspicious(count):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        clean = shown(count)
        assert cleaned(clean, 'demonstration 0') is clean


def test_a_step_that_is_too_small_to_matter_is_not_suspicious():
    """A simulated arm that sags a little at the very beginning."""
    clean = shown(200)
    points = clean.points.copy()
    points[0, 2] += 5e-5
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        sagging = Demonstration(clean.times, points, clean.manifold)
        assert cleaned(sagging, 'demonstration 0') is sagging


@pytest.mark.parametrize('at', [0, -1])
def test_a_wrong_sample_at_an_end_is_replaced_and_named(at):
    clean = shown(120)
    points = clean.points.copy()
    points[at, 1] += 0.02
    with pytest.warns(GdmpWarning, match=f'sample {at % 120} of 120 is far from where'):
        mended = cleaned(Demonstration(clean.times, points, clean.manifold), 'demonstration 0')
    assert np.abs(mended.points - clean.points).max() < 1e-4
