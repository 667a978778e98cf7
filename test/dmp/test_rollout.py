"""Options and memory of a roll-out."""
import os
import subprocess
import sys

import numpy as np
import pytest

from gdmp_ros import Batch, Euclidean, ParameterError, Rollout, Skill, Sphere
from test.motions import motion


def test_unknown_options_are_named(rng):
    with pytest.raises(ParameterError, match='unknown option sped; expected one of speed'):
        Rollout(Skill.learn(motion(Euclidean(1), rng)), sped=1.0)


def test_a_step_allocates_nothing():
    """Numba counts what its kernels allocate: as much for a thousand steps as for ten."""
    code = """
import numpy as np, gdmp_ros as g
from numba.core.runtime import rtsys
rng = np.random.default_rng(0)
m = g.Product(g.Euclidean(3), g.UnitQuaternion(), g.SymmetricPositiveDefinite(6), g.Sphere(2),
              g.SpecialOrthogonal(3))
t = np.linspace(0, 1, 400)
base = m.random_point(rng)
v = 0.3 * m.random_tangent(base, rng)
shown = g.Demonstration(t, np.array([m.exp(base, x ** 3 * v) for x in t]), m)
for connection in ('parallel', 'published'):
    rollout = g.Rollout(g.Skill.learn(shown, connection=connection))
    rollout.retarget(m.exp(rollout.goal, 0.1 * v))
    counts = []
    for times in (np.arange(3), np.arange(3, 13), np.arange(13, 1013)):
        rollout.sample(times * 1e-3)
        counts.append(rtsys.get_allocation_stats().alloc)
    assert counts[1] - counts[0] == counts[2] - counts[1], counts
from gdmp_ros.control.impedance import damping_design
damping_design(np.eye(3), np.eye(3), 0.7)  # an allocation is counted
assert rtsys.get_allocation_stats().alloc > counts[2]
"""
    subprocess.run([sys.executable, '-c', code], check=True,
                   env={**os.environ, 'NUMBA_NRT_STATS': '1'})


@pytest.mark.parametrize('dt', [-1e-9, float('nan'), float('inf'), -float('inf'), 3601.0])
def test_a_time_that_cannot_pass_is_refused_and_changes_nothing(dt, rng):
    skill = Skill.learn(motion(Sphere(2), rng))
    rollout, other = Rollout(skill), Rollout(skill)
    before = rollout.advance(0.3).numbers
    out = np.empty(rollout.state_size)
    for call in (rollout.advance, lambda dt: rollout.advance_to(dt, out),
                 lambda dt: rollout.sample(np.array([0.4, 0.4 + dt])), Batch([other]).advance):
        with pytest.raises(ParameterError, match='time'):
            call(dt)
    np.testing.assert_array_equal(rollout.advance(0.0).numbers, before)
    assert not rollout.flags
