"""Figures and events of a recorded run."""
from dataclasses import replace

import numpy as np
import pytest

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.data import runs
from test.recorded_run import BEGIN_NS, NS, recorded_run


@pytest.fixture(scope='module')
def run():
    return recorded_run()


def test_the_summary_has_the_measured_values(run):
    before_gap = runs.tracking(run, end_ns=BEGIN_NS + NS)
    rows = dict(runs.summary(run, before_gap))
    assert rows['duration'] == '2.00 s' and rows['smallest energy in the tank'] == '4.00 J'
    assert rows['references lost'] == '300' == str(runs.lost(run))
    assert rows['lateness p50, p99, max'] == '50, 50, 50 µs'
    assert rows['tracking error, RMS'] == '3.00 mm, 0.0000 rad'


def test_the_arm_is_compared_with_the_reference_that_it_followed(run):
    tracked = runs.tracking(run)
    assert len(tracked.states) == 2000 and not tracked.rotation.any()
    assert tracked.position[0] == pytest.approx(0.003)
    begin, end = BEGIN_NS + NS // 10, BEGIN_NS + NS // 2
    assert len(runs.tracking(run, begin, end).states) == 401
    assert runs.stiffness_error(run, tracked) == 0.0
    softer = replace(run, stiffness=0.9 * run.stiffness)
    assert runs.stiffness_error(softer, tracked) == pytest.approx(0.1)


def test_events_are_in_the_order_of_time(run):
    found = runs.events(run)
    assert [event.time for event in found] == sorted(event.time for event in found)
    text = '\n'.join(f'{event.time:.2f} {event.text}' for event in found)
    assert '0.00 the reference begins to move' in text
    assert '1.00 the reference stops, after 1.00 s' in text
    assert '1.20 no reference for 301 ms' in text
    assert '0.50 the goal changes by 0.' in text
    assert len(found) == 4


def test_a_goal_that_moves_is_one_event(run):
    goals = np.tile(run.goals[0], (len(run.goals), 1))
    goals[:, 0] = 0.3 + 0.01 * np.clip(np.arange(len(goals)), 5, 9)
    found = [event for event in runs.events(replace(run, goals=goals))
             if 'goal' in event.text]
    assert [event.text for event in found] == ['the goal moves for 0.3 s, by 0.040 m, 0.00 rad']
    assert found[0].time == pytest.approx(0.6)
    without = replace(run, goals=goals[:0], goal_stamps=run.goal_stamps[:0])
    assert not any('goal' in event.text for event in runs.events(without))


def test_the_times_at_which_a_limit_is_active(run):
    one, = runs.limited_times(run)
    assert one.limit is LIMITS[2] and one.largest == 1.5
    np.testing.assert_allclose(one.begins, [0.1, 0.9])
    np.testing.assert_allclose(one.ends, [0.15, 1.0])
    assert one.seconds == pytest.approx(0.15)


def test_another_stream_of_references_is_an_event(run):
    sequences = run.sequences.copy()
    sequences[1000:] += 2 * runs.ONE_STREAM
    text = [event.text for event in runs.events(replace(run, sequences=sequences))]
    assert text.count('another stream of references begins') == 1
    assert 'another stream of references begins' not in [
        event.text for event in runs.events(run)]


def test_gaps_between_references_are_measured(run):
    gaps = runs.reference_gaps(run)
    longest = int(np.argmax(gaps[:, 0]))
    assert gaps[longest, 0] == pytest.approx(0.301, abs=1e-6)
    assert gaps[longest, 1] == BEGIN_NS + 1_500_000_000
    assert np.delete(gaps[:, 0], longest).max() == pytest.approx(1e-3, abs=1e-6)
    assert runs.longest_wait(run) == 300


def test_the_time_to_rest_is_that_of_the_tool(run):
    since = BEGIN_NS + NS // 2
    assert runs.time_to_rest(run, since) == pytest.approx(0.499, abs=1e-6)
    assert runs.time_to_rest(run, BEGIN_NS + NS + NS // 2) == 0.0
    moving = replace(run, twists=np.full_like(run.twists, 0.1))
    assert np.isnan(runs.time_to_rest(moving, since))


def test_distances_from_the_last_reference_and_from_a_goal(run):
    assert runs.final_distance(run) == pytest.approx(0.003)
    strangers = replace(run, applied=np.zeros_like(run.applied))
    assert np.isnan(runs.final_distance(strangers))
    goal = run.poses[1000].copy()
    goal[:3] += [0.0, 0.02, 0.0]
    goal[3:] = [np.cos(0.1), np.sin(0.1), 0.0, 0.0]
    error = runs.goal_error(run, BEGIN_NS + NS, goal, 400.0 * np.eye(3))
    assert error.position == pytest.approx(0.02) and error.rotation == pytest.approx(0.2)
    assert error.stiffness == pytest.approx(0.0, abs=1e-9)
    other = runs.goal_error(run, BEGIN_NS + NS, goal, 800.0 * np.eye(3))
    assert other.stiffness == pytest.approx(np.sqrt(3.0) * np.log(2.0))


def test_a_run_is_compared_with_the_limits_of_the_joints(run):
    joints = JointLimits(lower=np.full(7, -1.0), upper=np.full(7, 2.0), torque=np.full(7, 50.0))
    torques, positions = run.torques.copy(), run.joints.copy()
    torques[500:, 3], positions[700, 1] = 25.0, -1.2
    # The step of the torque at a gap in the states is not a rate.
    stamps = run.state_stamps.copy()
    stamps[1500:] += NS
    torques[1500:, 3] = 0.0
    figures = runs.limit_figures(
        replace(run, torques=torques, joints=positions, state_stamps=stamps), joints)
    assert figures.torque == 0.5 and figures.torque_rate == 25.0
    assert figures.joint_distance == pytest.approx(-0.2)
    assert figures.speed == pytest.approx(0.1) and figures.tank_energy == pytest.approx(4.0005)
    falling = torques.copy()
    falling[1500:, 3] = 60.0
    assert runs.limit_figures(
        replace(run, torques=falling, joints=positions), joints).torque_rate == 35.0
