"""Obstacles are passed at a distance."""
import numpy as np
import pytest

from gdmp_ros import Demonstration, Euclidean, ParameterError, Rollout, Skill, Sphere
from gdmp_ros.util.profiles import minimum_jerk
from test.motions import accelerations, motion

TIMES = np.linspace(0.0, 1.0, 500)
BLEND = minimum_jerk(TIMES)


def test_an_obstacle_is_passed_at_a_distance_with_bounded_acceleration(rng):
    line = np.column_stack([BLEND, 0.0 * BLEND, 0.0 * BLEND])
    skill = Skill.learn(Demonstration(3.0 * TIMES, line, Euclidean(3)))
    obstacle = np.array([[0.5, 0.005, 0.0]])
    free, steered = Rollout(skill), Rollout(skill)
    steered.set_obstacles(obstacle, bound=20.0)
    times = np.arange(0.0, 3.5, 1e-3)
    near = np.linalg.norm(free.sample(times).points - obstacle, axis=1).min()
    path = steered.sample(times).points
    assert near < 0.01 and np.linalg.norm(path - obstacle, axis=1).min() > 0.04
    assert np.linalg.norm(path[-1] - skill.goal) < 0.001
    tight = Rollout(skill)
    tight.set_obstacles(obstacle, bound=0.5)
    plain = accelerations(Rollout(skill), 3000)
    push = np.abs(accelerations(tight, 3000) - plain).max()
    assert push < 2.0 * 0.5
    again = Rollout(skill)
    again.set_obstacles(np.empty((0, 3)))
    np.testing.assert_array_equal(again.sample(times).points, Rollout(skill).sample(times).points)
    fine, coarse = Rollout(skill), Rollout(skill)
    for rollout in (fine, coarse):
        rollout.set_obstacles(obstacle)
    fine.sample(times)
    np.testing.assert_allclose(coarse.advance(times[-1]).point, fine.state.point, atol=1e-12)


def test_invalid_obstacles_are_refused(rng):
    rollout = Rollout(Skill.learn(motion(Euclidean(3), rng)))
    with pytest.raises(ParameterError, match='up to 32'):
        rollout.set_obstacles(np.zeros((33, 3)))
    with pytest.raises(ParameterError, match='of 3 numbers'):
        rollout.set_obstacles(np.zeros((2, 2)))
    with pytest.raises(ParameterError, match='no position'):
        Rollout(Skill.learn(motion(Sphere(2), rng))).set_obstacles(np.zeros((1, 3)))
