"""Nothing jerks: tempo, tracking errors, starts, goals, obstacles; and batches step the same."""
import os
import subprocess
import sys

import numpy as np
import pytest

from gdmp_ros import (
    Batch,
    Demonstration,
    Euclidean,
    ParameterError,
    Product,
    Rollout,
    Skill,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.util.profiles import minimum_jerk

TIMES = np.linspace(0.0, 1.0, 500)
BLEND = minimum_jerk(TIMES)
TOOL = Product(Euclidean(3), UnitQuaternion(), SymmetricPositiveDefinite(3),
               names=['position', 'orientation', 'stiffness'])
CONNECTIONS = ['parallel', 'published']


def motion(manifold, rng, duration=2.0, size=0.5):
    base = manifold.random_point(rng)
    first, second = manifold.random_tangent(base, rng), manifold.random_tangent(base, rng)
    first *= size / manifold.norm(base, first)
    second *= 0.3 * size / manifold.norm(base, second)
    points = [manifold.exp(base, b * first + np.sin(2.0 * np.pi * b) * second) for b in BLEND]
    return Demonstration(duration * TIMES, np.array(points), manifold)


def accelerations(rollout, ticks=400):
    return np.array([rollout.advance(1e-3).acceleration for _ in range(ticks)])


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_a_moving_start_keeps_velocity_and_acceleration(connection, rng):
    skill = Skill.learn(motion(TOOL, rng), connection=connection)
    start = TOOL.exp(skill.start, 0.1 * TOOL.random_tangent(skill.start, rng))
    velocity = 0.2 * TOOL.random_tangent(start, rng)
    acceleration = 0.5 * TOOL.random_tangent(start, rng)
    for speed in (1.0, 0.4):
        rollout = Rollout(skill, start=start, velocity=velocity, acceleration=acceleration,
                          speed=speed)
        first = rollout.state
        np.testing.assert_allclose(first.velocity, velocity, atol=1e-9)
        # The first interval's mean acceleration, half a step later.
        scale = np.abs(accelerations(Rollout(skill, start=start))).max()
        np.testing.assert_allclose(first.acceleration, acceleration, atol=0.02 * scale)
        rollout.sample(np.arange(0.01, 8.0, 0.01))
        assert rollout.finished and rollout.flags == set()


def test_without_an_acceleration_a_moving_start_would_jump(rng):
    """What the push is for: the skill's own acceleration at the start is another one."""
    skill = Skill.learn(motion(Euclidean(3), rng))
    velocity = np.array([0.3, -0.2, 0.4])
    rollout = Rollout(skill, velocity=velocity)
    assert np.linalg.norm(rollout.state.acceleration) < 0.02 * 0.3 * 60 / 2.0
    with pytest.raises(ParameterError, match='above 0'):
        Rollout(skill, velocity=velocity, speed=0.0)
    with pytest.raises(ParameterError, match='initial velocity has an entry'):
        Rollout(skill, velocity=np.array([0.0, np.nan, 0.0]))


def test_a_start_at_rest_elsewhere_begins_without_velocity_and_acceleration(rng):
    shown = motion(TOOL, rng)
    cut = Demonstration(shown.times[100:], shown.points[100:], TOOL)  # it begins in motion
    skill = Skill.learn(cut)
    start = TOOL.exp(skill.start, 0.2 * TOOL.random_tangent(skill.start, rng))
    rollout = Rollout(skill, start=start, speed=0.0)
    rollout.set_speed(1.0)
    values = np.vstack([rollout.state.acceleration, accelerations(rollout)])
    assert np.linalg.norm(values[0]) == 0.0
    assert np.linalg.norm(np.diff(values, axis=0), axis=1).max() < 0.05 * np.abs(values).max()


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_a_goal_switch_steps_no_more_than_a_tick_of_its_filter(connection, rng):
    skill = Skill.learn(motion(TOOL, rng, duration=1.0), connection=connection)
    away = TOOL.random_tangent(skill.goal, rng)
    away *= 0.8 / TOOL.norm(skill.goal, away)
    switched, plain = Rollout(skill), Rollout(skill)
    switched.advance(0.5)
    plain.advance(0.5)
    before = switched.state.acceleration
    switched.retarget(TOOL.exp(skill.goal, away))
    with_switch = np.vstack([before, accelerations(switched, 8)])
    without = np.vstack([before, accelerations(plain, 8)])
    steps = np.linalg.norm(np.diff(with_switch - without, axis=0), axis=1)
    filter_tick = 900.0 * -np.expm1(-8.0 * 1e-3) * np.linalg.norm(away)
    assert 0.0 < steps.max() < filter_tick * (1.0 if connection == 'parallel' else 1.5)


def test_the_goals_speed_is_bounded_and_it_arrives(rng):
    manifold = Product(Euclidean(3), UnitQuaternion())
    skill = Skill.learn(motion(manifold, rng))
    new = manifold.join(skill.goal[:3] + [1.0, 0.5, -0.5],
                        UnitQuaternion().exp(skill.goal[3:], np.array([0.2, 0.1, 0.0])))
    bounded = Rollout(skill, goal_speed=[0.5, 0.3])
    free = Rollout(skill)
    goals = []
    for rollout in (bounded, free):
        rollout.advance(0.8)
        rollout.retarget(new)
    for _ in range(6000):
        bounded.advance(1e-3)
        goals.append(bounded.motion.points.goal.copy())
    goals = np.array(goals)
    speed = np.linalg.norm(np.diff(goals[:, :3], axis=0), axis=1) / 1e-3
    assert speed.max() == pytest.approx(0.5, rel=1e-6)
    assert bounded.finished and bounded.flags == set()
    assert np.linalg.norm(bounded.state.point[:3] - new[:3]) < 0.0005
    fast, slow = accelerations(free), accelerations(Rollout(skill))
    assert np.abs(fast).max() > np.abs(slow).max()
    with pytest.raises(ParameterError, match='goal_speed: expected 2'):
        Rollout(skill, goal_speed=[1.0])


def test_phase_stopping_waits_for_the_robot_and_keeps_the_path(rng):
    skill = Skill.learn(motion(TOOL, rng))
    plain = Rollout(skill)
    rollout = Rollout(skill, phase_stopping=2.0, error_weights=[400.0, 4.0, 0.0])
    rollout.advance(0.4)
    held = rollout.state.point.copy()
    held[:3] += [0.1, 0.0, 0.0]
    error = rollout.observe(held)
    assert error == pytest.approx(400.0 * 0.01, rel=1e-6)
    speeds = []
    for _ in range(1000):
        point = rollout.advance(1e-3).point
        speeds.append(rollout.speed)
        behind = point.copy()
        behind[:3] += [0.1, 0.0, 0.0]
        rollout.observe(behind)
    assert speeds[-1] == pytest.approx(1.0 / (1.0 + 2.0 * 4.0), rel=1e-4)
    assert np.abs(np.diff(speeds)).max() <= 5e-3 + 1e-12
    for _ in range(1000):
        rollout.observe(rollout.advance(1e-3).point)
    assert rollout.speed == pytest.approx(1.0, abs=1e-4)
    same = plain.advance(rollout.progress * skill.duration).point
    assert TOOL.distance(rollout.state.point, same) < 1e-9


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


def test_obstacles_that_make_no_sense_are_refused(rng):
    rollout = Rollout(Skill.learn(motion(Euclidean(3), rng)))
    with pytest.raises(ParameterError, match='up to 32'):
        rollout.set_obstacles(np.zeros((33, 3)))
    with pytest.raises(ParameterError, match='of 3 numbers'):
        rollout.set_obstacles(np.zeros((2, 2)))
    with pytest.raises(ParameterError, match='no position'):
        Rollout(Skill.learn(motion(Sphere(2), rng))).set_obstacles(np.zeros((1, 3)))


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
    # Each still answers for itself.
    np.testing.assert_array_equal(together[1].advance(0.01).point, alone[1].advance(0.01).point)
    assert [r.progress for r in together] == [r.progress for r in alone]
    with pytest.raises(ParameterError, match='one batch only'):
        Batch([together[0]])
    with pytest.raises(ParameterError, match='at least one'):
        Batch([])


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
    assert counts[1] > 0 and counts[1] - counts[0] == counts[2] - counts[1], counts
"""
    subprocess.run([sys.executable, '-c', code], check=True,
                   env={**os.environ, 'NUMBA_NRT_STATS': '1'})
