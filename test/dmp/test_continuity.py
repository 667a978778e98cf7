"""Starts, goals and tracking errors change a motion without a step."""
import numpy as np
import pytest

from gdmp_ros import (
    Demonstration,
    Euclidean,
    ParameterError,
    Product,
    Rollout,
    Skill,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from test.motions import accelerations, motion, TOOL

CONNECTIONS = ['parallel', 'published']
MANIFOLDS = [Euclidean(2), Sphere(2), UnitQuaternion(), SpecialOrthogonal(3),
             SpecialOrthogonal(4), SymmetricPositiveDefinite(2), TOOL]


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


def test_a_moving_start_begins_without_acceleration_by_default(rng):
    """The acceleration of the skill itself would be another one at this velocity."""
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
@pytest.mark.parametrize('manifold', MANIFOLDS, ids=repr)
def test_a_goal_switch_steps_no_more_than_a_tick_of_its_filter(manifold, connection, rng):
    skill = Skill.learn(motion(manifold, rng, duration=1.0), connection=connection)
    away = manifold.random_tangent(skill.goal, rng)
    away *= 0.8 / manifold.norm(skill.goal, away)
    switched, plain = Rollout(skill), Rollout(skill)
    before = switched.advance(0.5)
    plain.advance(0.5)
    switched.retarget(manifold.exp(skill.goal, away))
    np.testing.assert_array_equal(switched.state.point, before.point)
    np.testing.assert_array_equal(switched.state.velocity, before.velocity)
    # The two differ by the switch alone, and not at all before the first tick after it.
    added = accelerations(switched, 8) - accelerations(plain, 8)
    steps = np.diff(added, axis=0, prepend=np.zeros((1, added.shape[1])))
    largest = max(manifold.norm(before.point, step) for step in steps)
    filter_tick = 900.0 * -np.expm1(-8.0 * 1e-3) * 0.8
    assert 0.5 * filter_tick < largest < filter_tick


def test_the_speed_of_a_goal_is_bounded_and_it_is_reached(rng):
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
