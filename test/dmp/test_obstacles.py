"""Obstacles are passed at a distance."""
import numpy as np
import pytest

from gdmp_ros import Demonstration, Euclidean, ParameterError, Rollout, Skill, Sphere
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.scene.distance import distances
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
    with pytest.raises(ParameterError, match='up to 64'):
        rollout.set_obstacles(np.zeros((65, 3)))
    with pytest.raises(ParameterError, match='of 3 numbers'):
        rollout.set_obstacles(np.zeros((2, 2)))
    with pytest.raises(ParameterError, match='no position'):
        Rollout(Skill.learn(motion(Sphere(2), rng))).set_obstacles(np.zeros((1, 3)))


def bent(scene, keep=0.0, bound=60.0):
    """A straight line of 1 m through what is in the way; its points, and the skill."""
    line = np.column_stack([BLEND, 0.0 * BLEND, 0.0 * BLEND])
    skill = Skill.learn(Demonstration(3.0 * TIMES, line, Euclidean(3)))
    rollout = Rollout(skill)
    rollout.set_obstacles(scene, 3000.0, 0.25, bound, keep)
    return rollout.sample(np.arange(0.0, 5.0, 1e-3)).points, skill


@pytest.mark.parametrize(('kind', 'size', 'turn'), [
    ('sphere', (0.08,), (1.0, 0.0, 0.0, 0.0)), ('box', (0.1, 0.12, 0.2), (0.9, 0.3, 0.3, 0.1)),
    ('capsule', (0.05, 0.4), (1.0, 0.0, 0.0, 0.0)), ('plane', (), (1.0, 0.0, 0.0, 0.0))])
def test_a_motion_bends_around_a_volume_and_ends_at_its_goal(kind, size, turn):
    turn = np.array(turn) / np.linalg.norm(turn)
    height = -0.01 if kind == 'plane' else 0.01
    scene = Scene([Volume('one', kind, size, np.array([0.5, 0.02, height, *turn]))], 0.02)
    points, skill = bent(scene, keep=0.03)
    assert distances(scene.packed(), points).min() > 0.0
    if kind != 'plane':  # its ends are as near as the line
        assert distances(scene.packed(), points).min() > 0.015
    assert np.linalg.norm(points[-1] - skill.goal) < 1e-3
    # A point is a sphere without a size.
    as_point = bent(np.array([[0.5, 0.02, 0.01]]))[0]
    as_ball = bent(Scene([Volume('one', 'sphere', (1e-9,), np.array(
        [0.5, 0.02, 0.01, 1.0, 0.0, 0.0, 0.0]))], 0.0))[0]
    np.testing.assert_allclose(as_point, as_ball, atol=1e-7)
