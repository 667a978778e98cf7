"""Rhythmic skills: the cycle, its frequency, amplitude and centre, entry and exit."""
from dataclasses import replace

import numpy as np
import pytest

from gdmp_ros import (
    Euclidean,
    ParameterError,
    Product,
    Rollout,
    Skill,
    Sphere,
    UnitQuaternion,
)
from gdmp_ros.dmp.forcing import periodic_basis, periodic_design, periodic_forcing
from test.motions import cycle, cycle_error, MANIFOLDS, motion, recorded_cycles

PERIOD = 1.7


@pytest.fixture(params=MANIFOLDS, ids=str)
def learned(request, rng):
    manifold = request.param
    curve = cycle(manifold, rng)
    return Skill.learn_rhythmic(recorded_cycles(manifold, curve, PERIOD, 3.3)), curve


def test_the_cycle_is_that_of_the_demonstration_and_stays(learned):
    _stays(*learned, 100)


@pytest.mark.long
def test_the_cycle_stays_for_a_thousand_periods(learned):
    _stays(*learned, 1000)


def _stays(skill, curve, periods):
    rollout = Rollout(skill)
    first = cycle_error(rollout, curve)
    assert first.max() < 1e-3 * curve.span
    # A coarse grid is enough to see a drift, and four times as fast.
    coarse = replace(skill, steps=1000)
    late = Rollout(coarse)
    late.sample(np.array([0.0, 0.5 * periods, periods - 1.0]) * skill.duration)
    assert cycle_error(late, curve).max() < 1e-3 * curve.span
    early = Rollout(coarse)
    early.sample(np.array([10.0 * skill.duration]))
    manifold = skill.manifold
    for _ in range(5):
        pair = [one.advance(0.37 * skill.duration).point for one in (early, late)]
        # Both are at the same phase, many periods apart.
        assert manifold.distance(*pair) < 1e-6 * curve.span


def test_it_is_reached_from_anywhere(learned, rng):
    skill, curve = learned
    manifold = skill.manifold
    away = manifold.random_tangent(skill.goal, rng)
    start = manifold.exp(skill.goal, 0.3 * away / manifold.norm(skill.goal, away))
    rollout = Rollout(skill, start=start)
    state = rollout.state
    assert manifold.distance(state.point, start) < 1e-12
    assert np.abs(state.velocity).max() < 1e-12
    assert np.abs(state.acceleration).max() < 1e-2 * _largest_acceleration(skill)
    rollout.sample(np.array([6.0 * skill.duration]))
    assert cycle_error(rollout, curve).max() < 1e-3 * curve.span


def test_frequency_changes_keep_the_path(learned):
    skill, _ = learned
    manifold, plain, changed = skill.manifold, Rollout(skill), Rollout(skill)
    wanted = {0: 1.7, 600: 0.0, 1000: 0.6}
    for step in range(4000):
        if step in wanted:
            changed.set_frequency(wanted[step] / skill.duration)
        point = changed.advance(1e-3).point
        if step % 100 == 0:
            same = plain.advance((changed.progress - plain.progress) * skill.duration).point
            assert manifold.distance(same, point) < 1e-6
    assert changed.frequency == pytest.approx(0.6 / skill.duration)


def test_the_path_does_not_depend_on_the_tempo(learned):
    skill, _ = learned
    fast, slow = Rollout(skill, speed=1.6), Rollout(skill, speed=0.4)
    progress = np.linspace(0.0, 2.0, 41)
    first = fast.sample(progress * skill.duration / 1.6).points
    second = slow.sample(progress * skill.duration / 0.4).points
    away = skill.manifold.factor_distances(first.reshape(41, -1), second.reshape(41, -1))
    assert away.max() < 1e-9


def _steps_of_acceleration(rollout, ticks, act=lambda tick: None):
    """Largest change of the acceleration in one millisecond."""
    last, largest = rollout.state.acceleration, 0.0
    for tick in range(ticks):
        act(tick)
        now = rollout.advance(1e-3).acceleration
        largest = max(largest, float(np.linalg.norm(now - last)))
        last = now
    return largest


def _largest_acceleration(skill):
    rollout = Rollout(skill)
    return max(float(np.linalg.norm(rollout.advance(0.01 * skill.duration).acceleration))
               for _ in range(100))


def test_entry_changes_and_exit_have_no_step_of_acceleration(learned, rng):
    skill, _ = learned
    manifold = skill.manifold
    away = manifold.random_tangent(skill.goal, rng)
    elsewhere = manifold.exp(skill.goal, 0.2 * away / manifold.norm(skill.goal, away))
    rollout = Rollout(skill, start=elsewhere)

    def act(tick):
        if tick == 1500:
            rollout.set_amplitude(0.4)
        if tick == 2500:
            rollout.retarget(elsewhere)
        if tick == 3500:
            rollout.set_amplitude(0.0)
            rollout.retarget(skill.goal)

    # One tick of 1 ms is 1/1700 of a period; the fastest lag has 1/30 of a period.
    largest = _steps_of_acceleration(rollout, 10000, act)
    assert largest < 0.1 * _largest_acceleration(skill)
    assert rollout.finished and not rollout.flags
    assert manifold.distance(rollout.state.point, skill.goal) < 1e-3


def test_amplitude_scales_a_cycle_of_a_flat_space_exactly(rng):
    manifold = Euclidean(3)
    curve = cycle(manifold, rng)
    skill = Skill.learn_rhythmic(recorded_cycles(manifold, curve, PERIOD, 3.3))
    plain, smaller = Rollout(skill), Rollout(skill)
    smaller.set_amplitude(0.25)
    times = np.linspace(8.0, 10.0, 50)
    first, second = (one.sample(times).points - skill.goal for one in (plain, smaller))
    np.testing.assert_allclose(second, 0.25 * first, atol=1e-7)
    assert smaller.amplitude == pytest.approx(0.25)


def test_the_centre_moves_the_cycle(rng):
    manifold = Product(Euclidean(3), UnitQuaternion())
    curve = cycle(manifold, rng)
    skill = Skill.learn_rhythmic(recorded_cycles(manifold, curve, PERIOD, 3.3))
    shift = np.array([0.3, -0.2, 0.1])
    centre = np.concatenate([skill.goal[:3] + shift, skill.goal[3:]])
    moved, plain = Rollout(skill), Rollout(skill)
    moved.retarget(centre)
    times = np.linspace(8.0, 10.0, 50)
    first, second = (one.sample(times).points for one in (plain, moved))
    np.testing.assert_allclose(second[:, :3], first[:, :3] + shift, atol=1e-6)
    np.testing.assert_allclose(second[:, 3:], first[:, 3:], atol=1e-6)
    # From the beginning too, and as a skill of its own.
    other = Rollout(skill, goal=centre)
    np.testing.assert_allclose(other.sample(times).points, second, atol=1e-6)
    own = skill.between(goal=centre)
    np.testing.assert_allclose(Rollout(own).sample(times).points, second, atol=1e-6)


def test_it_begins_with_a_velocity_and_an_acceleration(learned, rng):
    skill, _ = learned
    manifold = skill.manifold
    velocity = manifold.random_tangent(skill.goal, rng)
    acceleration = manifold.random_tangent(skill.goal, rng)
    rollout = Rollout(skill, start=skill.goal, velocity=velocity, acceleration=acceleration)
    state = rollout.state
    np.testing.assert_allclose(state.velocity, velocity, atol=1e-9)
    # The acceleration is that of the middle of the first interval, 0.2 ms later; damping alone,
    # without the correction, would be alpha_z / PERIOD = 35 times the velocity.
    np.testing.assert_allclose(state.acceleration, acceleration, atol=0.5)


def test_a_file_keeps_it_bit_for_bit(learned, tmp_path):
    skill, _ = learned
    skill.save(tmp_path / 'wipe.json')
    again = Skill.load(tmp_path / 'wipe.json')
    assert again.rhythmic
    times = np.linspace(0.0, 3.0, 40)
    assert np.array_equal(Rollout(skill).sample(times).points, Rollout(again).sample(times).points)


def test_a_turned_cycle_is_turned_about_its_centre(rng):
    manifold = Euclidean(3)
    curve = cycle(manifold, rng)
    skill = Skill.learn_rhythmic(recorded_cycles(manifold, curve, PERIOD, 3.3))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    times = np.linspace(0.0, 4.0, 60)
    plain, turned = (Rollout(skill, frame=frame).sample(times).points
                     for frame in (None, turn))
    np.testing.assert_allclose(turned - skill.goal, (plain - skill.goal) @ turn.T, atol=1e-9)
    ball = Sphere(2)
    curve = cycle(ball, rng)
    skill = Skill.learn_rhythmic(recorded_cycles(ball, curve, PERIOD, 3.3))
    c, s = np.cos(1.0), np.sin(1.0)
    axis = skill.goal
    cross = np.cross(np.eye(3), axis) * -1.0
    turn = c * np.eye(3) + s * cross + (1.0 - c) * np.outer(axis, axis)
    plain, turned = (Rollout(skill, frame=frame).sample(times).points
                     for frame in (None, turn))
    np.testing.assert_allclose(turned, plain @ turn.T, atol=1e-7)


def test_a_skill_around_another_centre_moves_as_a_roll_out_there(learned, rng):
    skill, _ = learned
    manifold = skill.manifold
    away = manifold.random_tangent(skill.goal, rng)
    centre = manifold.exp(skill.goal, 0.4 * away / manifold.norm(skill.goal, away))
    times = np.linspace(10.0, 12.0, 30)
    own = Rollout(skill.between(goal=centre)).sample(times).points
    moved = Rollout(skill, goal=centre).sample(times).points
    for one, other in zip(own, moved):
        assert manifold.distance(one, other) < 1e-6


@pytest.mark.parametrize('count', [4, 5, 6, 13, 40])
def test_the_kernel_of_the_forcing_term_is_the_sum_of_all_functions(count, rng):
    functions, weights = periodic_basis(count), rng.standard_normal((count, 3))
    progress = np.concatenate([rng.uniform(-3.0, 5.0, 50), np.arange(count) / count, [0.5, 1.0]])
    matrix = np.empty((len(progress), count))
    periodic_design(functions, progress, matrix)
    out = np.empty(3)
    for s, row in zip(progress, matrix):
        periodic_forcing(functions, weights, s, out)
        np.testing.assert_allclose(out, row @ weights, atol=1e-12)


def test_what_needs_an_end_is_refused(rng):
    manifold = Euclidean(3)
    skill = Skill.learn_rhythmic(recorded_cycles(manifold, cycle(manifold, rng), PERIOD, 3.3))
    for use in (lambda: skill.through([(0.5, np.zeros(3))]),
                lambda: skill.between(start=np.zeros(3)),
                lambda: Rollout(skill, final_velocity=np.zeros(3))):
        with pytest.raises(ParameterError, match='repeats a cycle and has no end'):
            use()
    other = Rollout(Skill.learn(motion(manifold, rng)))
    for use in (other.set_amplitude, other.set_frequency):
        with pytest.raises(ParameterError, match='the skill is not rhythmic'):
            use(1.0)
    rollout = Rollout(skill)
    for use, limit in ((rollout.set_amplitude, 2.1), (rollout.set_frequency, 2.1 / PERIOD),
                       (rollout.set_amplitude, float('nan'))):
        with pytest.raises(ParameterError, match='expected a number from 0'):
            use(limit)
