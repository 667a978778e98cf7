"""Demonstrations and goals beyond the cut locus."""
import numpy as np
import pytest

from gdmp_ros import (
    Demonstration,
    Euclidean,
    Product,
    Rollout,
    Skill,
    SpecialOrthogonal,
    Sphere,
    UnitQuaternion,
)
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.util.profiles import minimum_jerk

CONNECTIONS = ['parallel', 'published']
TIMES = np.linspace(0.0, 1.0, 600)
BLEND = minimum_jerk(TIMES)


def great_circle(length=1.25 * np.pi):
    """The “C” of [GDMP] Fig. 2b: along a great circle, through the antipode of its end."""
    angle = length * BLEND
    points = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    return Demonstration(3.0 * TIMES, points, Sphere(2))


def turns(manifold, half_angle):
    """Around a slowly tilting axis."""
    axis = np.column_stack([np.ones_like(TIMES), 0.3 * np.sin(3.0 * TIMES), 0.2 * TIMES])
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    vectors = axis * (half_angle * BLEND)[:, None]
    if isinstance(manifold, UnitQuaternion):
        points = [manifold.exp(np.array([1.0, 0, 0, 0]), v) for v in vectors]
    else:
        points = [manifold.exp(np.eye(3), 2.0 * v) for v in vectors]
    return Demonstration(3.0 * TIMES, np.array(points), manifold)


SHOWN = [great_circle(), great_circle(4.3 * np.pi), turns(UnitQuaternion(), 3.3 * np.pi),
         turns(SpecialOrthogonal(3), 1.7 * np.pi)]


@pytest.mark.parametrize('connection', CONNECTIONS)
@pytest.mark.parametrize('shown', SHOWN, ids=['circle', 'circles', 'quaternion', 'rotation'])
def test_a_motion_around_the_manifold_is_followed_through(shown, connection):
    skill = Skill.learn(shown, connection=connection)
    assert len(skill.segments) > 1
    assert reproduction_error(skill, shown)[0] < (1e-4 if connection == 'parallel' else 5e-4)
    rollout = Rollout(skill)
    states = [rollout.advance(1e-3) for _ in range(3000)]
    assert rollout.flags == set()
    velocity = np.array([s.velocity for s in states])
    acceleration = np.array([s.acceleration for s in states])
    # Continuous, at the joins as elsewhere: a step there would be many times that of other ticks.
    ticks = np.arange(2999)[:, None] + 1.5
    joins = (np.abs(ticks - 3000.0 * skill.segments.ends) < 4.0).any(axis=1)
    assert joins.any()
    for values in (velocity, acceleration):
        steps = np.linalg.norm(np.diff(values, axis=0), axis=1)
        assert steps[joins].max() <= 1.5 * steps[~joins].max()
        assert steps.max() < 0.1 * np.abs(values).max()


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_the_papers_circle_without_segments_turns_back(connection):
    """[GDMP] Fig. 2b as published: the goal is reached, the demonstration is not followed."""
    shown = great_circle()
    assert np.linalg.norm(shown.points + shown.points[-1], axis=1).min() > 1e-4
    whole = Skill.learn(shown, connection=connection)
    alone = Skill.learn(shown, connection=connection, split=False)
    assert reproduction_error(alone, shown)[0] > 1e3 * reproduction_error(whole, shown)[0]


def test_only_the_factor_that_needs_it_is_split():
    manifold = Product(Euclidean(3), UnitQuaternion())
    turning = turns(UnitQuaternion(), 1.6 * np.pi).points
    path = np.column_stack([BLEND, BLEND ** 2, np.sin(BLEND)])
    shown = Demonstration(3.0 * TIMES, np.hstack([path, turning]), manifold)
    skill = Skill.learn(shown)
    assert skill.segments.split == (False, True)
    plain = Skill.learn(Demonstration(3.0 * TIMES, path, Euclidean(3)))
    one, other = Rollout(skill), Rollout(plain)
    one.advance(0.9)
    other.advance(0.9)
    moved = skill.goal.copy()
    moved[:3] += [0.1, -0.2, 0.05]
    one.retarget(moved)
    other.retarget(moved[:3])
    for _ in range(300):
        a, b = one.advance(0.01), other.advance(0.01)
        np.testing.assert_allclose(a.point[:3], b.point, atol=1e-12)


@pytest.mark.parametrize('connection', CONNECTIONS)
@pytest.mark.parametrize('at', [0.3, 1.5, 2.9])
def test_a_new_goal_is_reached_from_any_segment_after_all_the_turns(connection, at):
    shown = turns(UnitQuaternion(), 3.3 * np.pi)
    skill = Skill.learn(shown, connection=connection)
    rollout, plain = Rollout(skill), Rollout(skill)
    rollout.advance(at)
    new = skill.manifold.exp(skill.goal, np.array([0.3, -0.4, 0.2]))
    rollout.retarget(new)
    last = 3.0 * skill.segments.ends[-1]
    before = np.arange(at + 0.05, last, 0.05)
    path, same = rollout.sample(before), plain.sample(before)
    np.testing.assert_allclose(path.points, same.points, atol=1e-9)
    states = [rollout.advance(1e-3) for _ in range(4500)]
    assert rollout.finished and rollout.flags == set()
    assert skill.manifold.distance(states[-1].point, rollout.goal) < 0.00125
    turn = np.array([s.acceleration for s in states])
    filter_tick = 900.0 / 9.0 * -np.expm1(-8.0 * 1e-3 / 3.0) * 0.54
    steps = np.linalg.norm(np.diff(turn, axis=0), axis=1)
    assert steps.max() < filter_tick + 0.05 * np.abs(turn).max()


@pytest.mark.parametrize('connection', CONNECTIONS)
@pytest.mark.parametrize('side', [1e-9, 0.02])
def test_a_goal_that_passes_opposite_to_the_last_waypoint_does_not_jerk(connection, side):
    skill = Skill.learn(great_circle(4.3 * np.pi), connection=connection)
    manifold, waypoint = skill.manifold, skill.segments.waypoints[-1]
    begin = 3.0 * skill.segments.ends[-1]
    # From the goal through the point opposite to the waypoint, and on.
    opposite = -waypoint + side * np.array([0.0, 0.0, 1.0])
    opposite /= np.linalg.norm(opposite)
    new = manifold.exp(skill.goal, 1.3 * manifold.log(skill.goal, opposite))
    rollout, plain = Rollout(skill), Rollout(skill)
    for one in (rollout, plain):
        one.advance(begin + 0.02)
    rollout.retarget(new)
    # Half way to a goal that stays in reach: as large a switch, without the opposite point.
    near = manifold.exp(skill.goal, 0.3 * manifold.log(skill.goal, opposite))
    plain.retarget(near)
    jerks, moved = [], []
    for one in (rollout, plain):
        states = [one.advance(1e-3) for _ in range(4000)]
        turn = np.array([state.acceleration for state in states])
        jerks.append(np.linalg.norm(np.diff(turn, axis=0), axis=1).max())
        moved.append(states[-1].point)
    scale = manifold.distance(skill.goal, new) / manifold.distance(skill.goal, near)
    assert jerks[0] < 1.5 * scale * jerks[1]
    assert rollout.finished and 'cut_locus' in rollout.flags and 'cut_locus' not in plain.flags
    assert manifold.distance(moved[0], new) < 0.00125


def test_segments_are_saved_with_the_skill(tmp_path):
    skill = Skill.learn(SHOWN[2])
    skill.save(tmp_path / 'skill.json')
    again = Skill.load(tmp_path / 'skill.json')
    np.testing.assert_array_equal(again.reproduce(0.01).points, skill.reproduce(0.01).points)
    assert len(again.segments) == len(skill.segments)


def test_several_demonstrations_share_their_segments():
    shown = [turns(UnitQuaternion(), length * np.pi) for length in (2.25, 2.3, 2.35)]
    skill = Skill.learn(shown)
    assert len(skill.segments) > 1
    assert reproduction_error(skill, shown[1])[0] < 2e-3


@pytest.mark.parametrize('connection', CONNECTIONS)
@pytest.mark.parametrize('manifold', [Sphere(2), UnitQuaternion(), SpecialOrthogonal(3)],
                         ids=repr)
def test_an_opposite_goal_is_flagged_and_reached(manifold, connection, rng):
    start = manifold.random_point(rng)
    tangent = manifold.random_tangent(start, rng)
    tangent *= 0.7 / manifold.norm(start, tangent)
    shown = Demonstration(TIMES, np.array([manifold.exp(start, b * tangent) for b in BLEND]),
                          manifold)
    skill = Skill.learn(shown, connection=connection)
    half_turn = manifold.random_tangent(skill.goal, rng)
    half_turn *= np.pi / manifold.norm(skill.goal, half_turn)
    opposite = manifold.exp(skill.goal, half_turn)
    rollout = Rollout(skill)
    rollout.advance(0.5)
    # Otherwise the sign of a quaternion would be chosen anew.
    rollout.motion.points.anchor[:] = opposite.reshape(-1)
    rollout.retarget(opposite)
    assert 'cut_locus' in rollout.flags
    path = rollout.sample(np.arange(0.51, 4.0, 0.01)).points
    assert rollout.finished and 'held' not in rollout.flags
    assert manifold.distance(path[-1], opposite) < 0.0025
    begin = Rollout(skill, goal=manifold.exp(skill.start, half_turn_at(manifold, skill, rng)))
    begin.advance(3.0)
    assert np.isfinite(begin.state.point).all()


def half_turn_at(manifold, skill, rng):
    tangent = manifold.random_tangent(skill.start, rng)
    return tangent * np.pi / manifold.norm(skill.start, tangent)


def test_demonstrations_near_their_goal_are_not_split(rng):
    shown = great_circle(0.6 * np.pi)
    assert len(Skill.learn(shown).segments) == 1


def test_a_motion_that_its_goal_pushes_sideways_is_split_and_followed():
    """Further than π/2 away, a goal on a sphere makes deviations grow; wiggles excite them."""
    angle = 2.5 * (1.0 - BLEND)
    wiggle = 0.15 * np.sin(9.0 * TIMES / TIMES[-1]) * np.sin(np.pi * BLEND)
    points = np.column_stack([np.cos(angle) * np.cos(wiggle), np.sin(angle) * np.cos(wiggle),
                              np.sin(wiggle)])
    shown = Demonstration(3.0 * TIMES, points, Sphere(2))
    skill, unsplit = Skill.learn(shown), Skill.learn(shown, split=False)
    assert len(skill.segments) > 1
    assert reproduction_error(skill, shown)[0] < 1e-4 < reproduction_error(unsplit, shown)[0]
