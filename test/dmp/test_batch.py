"""Many roll-outs are stepped in one call."""
import numpy as np
import pytest

from gdmp_ros import (
    Batch,
    Euclidean,
    ParameterError,
    Rollout,
    Skill,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from test.motions import motion, TOOL

CONNECTIONS = ['parallel', 'published']


def test_a_batch_steps_each_roll_out_as_if_it_were_alone(rng):
    manifolds = [TOOL, Euclidean(2), Sphere(2), SymmetricPositiveDefinite(6), UnitQuaternion()]
    skills = [Skill.learn(motion(m, rng), n_basis=20 + 7 * i,
                          connection=CONNECTIONS[i % 2]) for i, m in enumerate(manifolds)]
    together = [Rollout(s, duration=1.0 + 0.1 * i) for i, s in enumerate(skills)]
    alone = [Rollout(s, duration=1.0 + 0.1 * i) for i, s in enumerate(skills)]
    batch = Batch(together)
    steps = 1e-3 * np.arange(1, 6)
    for tick in range(300):
        if tick == 100:
            goal = TOOL.exp(skills[0].goal, 0.1 * TOOL.random_tangent(skills[0].goal, rng))
            for rollouts in (together, alone):
                rollouts[0].retarget(goal)
                rollouts[3].set_speed(0.0)
        states = batch.advance(steps)
        for one, other, dt in zip(states, alone, steps):
            expected = other.advance(dt)
            np.testing.assert_array_equal(one.point, expected.point)
            np.testing.assert_array_equal(one.acceleration, expected.acceleration)
    # Each can still be stepped alone.
    np.testing.assert_array_equal(together[1].advance(0.01).point, alone[1].advance(0.01).point)
    assert [r.progress for r in together] == [r.progress for r in alone]
    with pytest.raises(ParameterError, match='one batch only'):
        Batch([together[0]])
    with pytest.raises(ParameterError, match='at least one'):
        Batch([])
