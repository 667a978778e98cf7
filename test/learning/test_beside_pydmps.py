"""
Rhythmic skills on R^m beside pydmps, in one run.

pydmps is fetched for this test into a temporary folder; it is no part of any environment.
"""
import importlib
import subprocess
import sys
import time

import numpy as np
import pytest

from gdmp_ros import Euclidean, Rollout, Skill
from test.motions import cycle, recorded_cycles

PACKAGE = 'pydmps==0.2'
PERIOD, FUNCTIONS, STEPS = 2.0, 50, 4000


@pytest.fixture(scope='module')
def peer(tmp_path_factory):
    """Its rhythmic class."""
    folder = tmp_path_factory.mktemp('pydmps')
    done = subprocess.run([sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps',
                           '--target', str(folder), PACKAGE], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f'{PACKAGE} cannot be fetched: {done.stderr.strip()[-200:]}')
    sys.path.insert(0, str(folder))
    try:
        yield importlib.import_module('pydmps.dmp_rhythmic').DMPs_rhythmic
    finally:
        sys.path.remove(str(folder))


@pytest.mark.long
def test_accuracy_and_cost_beside_pydmps(peer, rng):
    manifold = Euclidean(3)
    curve = cycle(manifold, rng)
    shown = recorded_cycles(manifold, curve, PERIOD, 3.0)
    skill = Skill.learn_rhythmic(shown, n_basis=FUNCTIONS)
    s = np.arange(STEPS) / STEPS
    expected = curve.points(s)

    # As its own example does: one cycle, run time 2 pi, as fine a grid as ours.
    other = peer(n_dmps=3, n_bfs=FUNCTIONS, dt=2.0 * np.pi / STEPS)
    other.imitate_path(y_des=curve.points(np.linspace(0.0, 1.0, 200)).T, plot=False)
    path = other.rollout()[0]
    errors = {'pydmps, first cycle': _error(path, expected[:len(path)], curve.span)}
    # Its later cycles: stepped on, not reset.
    later = np.array([other.step()[0].copy() for _ in range(2 * STEPS)])[STEPS:]
    # Its grid may be a step shorter than a cycle: the best shift in time counts.
    errors['pydmps, third cycle'] = min(_error(later, np.roll(expected, shift, axis=0),
                                               curve.span) for shift in range(-40, 41, 2))
    rollout = Rollout(skill)
    for name in ('gdmp_ros, first cycle', 'gdmp_ros, second cycle', 'gdmp_ros, third cycle'):
        begin = rollout.motion.scalars.time
        errors[name] = _error(rollout.sample(begin + s * PERIOD).points, expected, curve.span)
        rollout.sample(np.array([begin + PERIOD]))

    costs = {'pydmps, step of 3 coordinates': _median(other.step),
             'gdmp_ros, the same step': _median(lambda: rollout.advance(PERIOD / STEPS))}
    for name, value in {**errors, **costs}.items():
        print(f'{name}: {value:.3g}')
    ours = errors['gdmp_ros, third cycle']
    assert ours < 1e-3 and ours < errors['pydmps, third cycle']


def _error(path, expected, span):
    """Mean distance / span."""
    return float(np.linalg.norm(path - expected, axis=1).mean() / span)


def _median(step):
    """Median time of a call [us]."""
    times = []
    for _ in range(2000):
        begin = time.perf_counter()
        step()
        times.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(times))
