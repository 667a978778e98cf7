"""Correction of skills by pushes."""
import numpy as np
import pytest

from gdmp_ros import DataError, GdmpWarning, ParameterError, Skill, Sphere
from gdmp_ros.control.target import POSE
from gdmp_ros.data import skills
from gdmp_ros.dmp.changes import with_functions
from gdmp_ros.learning.correction import correction, FollowedMotion, HELD
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.states import Status
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.teaching import Hand, HandSettings
from test.motions import circles, takes, TOOL

#: Progress from and to, and how far a hand pulls the tool there [m].
PUSHES = [(0.15, 0.3, [0.0, 0.0, 0.05]), (0.45, 0.6, [0.05, 0.0, 0.0]),
          (0.75, 0.85, [0.0, -0.04, 0.0])]


@pytest.fixture(scope='module')
def skill(letters):
    return Skill.learn(letters[:3])


def followed(skill, pushes):
    """The simulated arm, its controller, and a hand that pulls the tool."""
    loop, player = ClosedLoop(Arm()), Player(skill, PlayerSettings())
    player.start(loop.arm.measure().pose.copy())
    rows = []
    while player.status is not Status.HOLDING:
        target = player.tick(loop.arm.period)
        loop.follow(target)
        s, pose = player.rollout.progress, target[POSE:POSE + 7].copy()
        rows.append((s, pose.copy(), loop.arm.measure().pose.copy()))
        loop.driver.hand = None
        loop.arm.push(np.zeros(6))
        for first, last, away in pushes:
            if first < s < last:
                # The hand comes and goes.
                pose[:3] += np.minimum(1.0, 2.0 * np.sin(
                    np.pi * (s - first) / (last - first))) * np.array(away)
                loop.driver.hand = Hand(pose, HandSettings(stiffness=5000.0, force=60.0))
        loop.tick()
    return FollowedMotion(*(np.array(column) for column in zip(*(
        row for row in rows if row[0] <= 1.0))))


@pytest.fixture(scope='module')
def pushed(skill):
    return followed(skill, PUSHES)


def test_three_pushes_move_the_path_where_it_was_pushed_and_nowhere_else(skill, pushed):
    found = correction(skill, pushed)
    assert [one.quantity for one in found.pushes] == ['position'] * 3
    moved = (found.after - found.before)[:, :3]
    away = np.column_stack([np.interp(found.progress, pushed.progress, column)
                            for column in (pushed.measured - pushed.references)[:, :3].T])
    size, elsewhere = np.linalg.norm(away, axis=1), np.ones(len(moved), dtype=bool)
    for push, (first, last, _) in zip(found.pushes, PUSHES):
        assert first < push.begin < push.at < push.end < last + 0.03
        held = ((found.progress >= push.begin) & (found.progress <= push.end)
                & (size >= HELD * push.largest))
        assert held.sum() > 10
        # Half a millimetre is the lag of the arm, which is no part of the push.
        assert np.linalg.norm((moved - away)[held], axis=1).max() < 4e-3
        elsewhere &= ((found.progress < push.begin - push.way)
                      | (found.progress > push.end + push.way))
    assert elsewhere.sum() > 40
    assert np.linalg.norm(moved[elsewhere], axis=1).max() < 1e-3
    # Neither the goal nor orientation and stiffness have changed.
    assert np.abs(found.after[-1, :3] - found.before[-1, :3]).max() < 1e-4
    orientation = skill.manifold.factor_distances(found.before, found.after)[:, 1:]
    assert orientation.max() < 1e-3


def test_what_is_added_is_gentle(skill, pushed):
    def largest(primitive):
        rollout = primitive.rollout()
        return max(np.linalg.norm(rollout.advance(1e-3 * skill.duration).acceleration[:3])
                   for _ in range(1000))
    assert largest(correction(skill, pushed).primitive) < largest(skill) + 1.0


def test_without_a_push_nothing_is_corrected(skill):
    with pytest.raises(DataError, match='no push was found: the arm was at most'):
        correction(skill, followed(skill, []))


def test_a_push_that_lasts_to_the_end_moves_the_goal(skill):
    s, reference = path_of(skill)
    measured, blend = reference.copy(), np.clip((s - 0.6) / 0.2, 0.0, 1.0)[:, None]
    measured[:, :3] += blend * [0.0, 0.06, 0.0]
    found = correction(skill, FollowedMotion(s, reference, measured))
    np.testing.assert_allclose(found.primitive.goal[:3], skill.goal[:3] + [0.0, 0.06, 0.0],
                               atol=1e-9)
    rollout = found.primitive.rollout()
    rollout.advance(1.5 * skill.duration)
    np.testing.assert_allclose(rollout.state.point[:3], found.primitive.goal[:3], atol=1e-3)


def largest_acceleration(skill):
    rollout = skill.rollout()
    return max(np.linalg.norm(rollout.advance(1e-3 * skill.duration).acceleration[:3])
               for _ in range(1000))


def test_a_push_at_the_very_start_comes_in_smoothly(skill):
    s, reference = path_of(skill)
    measured = reference.copy()
    measured[:, :3] += np.clip((0.15 - s) / 0.02, 0.0, 1.0)[:, None] * [0.0, 0.04, 0.0]
    with pytest.warns(GdmpWarning, match='a push begins at 0% of the motion'):
        found = correction(skill, FollowedMotion(s, reference, measured))
    assert largest_acceleration(found.primitive) < largest_acceleration(skill) + 3.0
    np.testing.assert_allclose(found.after[0], found.before[0], atol=1e-3)
    assert np.linalg.norm((found.after - found.before)[:, :3], axis=1).max() > 0.01


@pytest.mark.parametrize('lag', [0.1, 0.15])
def test_an_arm_that_follows_late_was_not_pushed(skill, lag):
    s, reference = path_of(skill)
    late = np.clip(s - lag / skill.duration, 0.0, 1.0)
    measured = np.column_stack([np.interp(late, s, column) for column in reference.T])
    assert np.linalg.norm((measured - reference)[:, :3], axis=1).max() > 0.01
    with pytest.raises(DataError, match='no push was found'):
        correction(skill, FollowedMotion(s, reference, measured))
    # A push of a late arm is found, and the rest of its path stays.
    pushed = (s > 0.4) & (s < 0.6)
    measured[pushed, :3] += 0.04 * np.sin(np.pi * (s[pushed] - 0.4) / 0.2)[:, None] * [0, 0, 1.0]
    found = correction(skill, FollowedMotion(s, reference, measured))
    assert len(found.pushes) == 1 and abs(found.pushes[0].at - 0.5) < 0.05
    away = np.linalg.norm((found.after - found.before)[:, :3], axis=1)
    assert 0.03 < away.max() < 0.05 and away[found.progress > 0.85].max() < 2e-3


def test_what_was_not_run_is_not_refined(skill):
    """Pushed and stopped half way: the goal stays."""
    s, reference = path_of(skill)
    part = s < 0.5
    measured = reference.copy()
    measured[:, :3] += np.clip((s - 0.3) / 0.05, 0.0, 1.0)[:, None] * [0.0, 0.0, 0.05]
    with pytest.warns(GdmpWarning, match='the motion was run from 0% to 50%'):
        found = correction(skill, FollowedMotion(s[part], reference[part], measured[part]))
    np.testing.assert_allclose(found.primitive.goal, skill.goal, atol=1e-9)
    away = np.linalg.norm((found.after - found.before)[:, :3], axis=1)
    assert away[found.progress > 0.75].max() < 2e-3 and away.max() > 0.03


def path_of(skill):
    s = np.linspace(0.0, 1.0, 300)
    return s, skill.rollout(duration=1.0).sample(s).points[:, :7].copy()


def test_a_turn_of_the_tool_is_a_push_too(skill):
    s, reference = path_of(skill)
    measured, turn = reference.copy(), UnitQuaternion()
    for row in np.flatnonzero((s > 0.3) & (s < 0.6)):
        q = reference[row, 3:]
        measured[row, 3:] = turn.exp(q, turn.from_frame(turn.frame(q), [0.15, 0.0, 0.0]))
    found = correction(skill, FollowedMotion(s, reference, measured))
    assert [one.quantity for one in found.pushes] == ['orientation']
    assert found.pushes[0].largest == pytest.approx(0.3, abs=1e-3)
    middle = np.argmin(np.abs(found.progress - 0.45))
    np.testing.assert_allclose(found.after[middle, 3:7], turn.align(
        measured[np.argmin(np.abs(s - 0.45)), 3:], found.after[middle, 3:7]), atol=5e-3)
    assert np.abs(found.after - found.before)[:, :3].max() < 1e-3


def test_the_takes_vary_around_the_corrected_path_as_before(skill, pushed):
    made = correction(skill, pushed).primitive
    for s in (0.3, 0.5, 0.8):
        before, after = (one.distribution.covariance(s) for one in (skill, made))
        assert np.trace(after) == pytest.approx(np.trace(before), rel=0.05)


@pytest.mark.parametrize('count', [7, 20, 40])
def test_more_functions_describe_the_same_motion(rng, count):
    plain = Skill.learn(takes(TOOL, 4, rng), count)
    finer = with_functions(plain, 90)
    assert finer.n_basis == 90 and with_functions(plain, count) is plain
    s = np.linspace(0.0, 1.2, 100)
    ways = [one.rollout(duration=1.0).sample(s).points for one in (plain, finer)]
    away = plain.manifold.factor_distances(*(np.ascontiguousarray(w) for w in ways))
    assert away.max() < 2e-3


def test_an_undone_correction_leaves_the_same_bytes(skill, pushed, tmp_path):
    path = tmp_path / 'skill.json'
    skill.save(path)
    versions = [path.read_bytes()]
    for _ in range(2):
        skills.replace(path, correction(Skill.load(path), pushed).primitive)
        versions.append(path.read_bytes())
    assert len(set(versions)) == 3
    for before in reversed(versions[:2]):
        skills.undo(path)
        assert path.read_bytes() == before
    with pytest.raises(DataError, match='no earlier version'):
        skills.undo(path)
    assert [one.name for one in tmp_path.iterdir()] == ['skill.json']


def test_skills_without_a_tool_or_an_end_are_refused(rng, pushed):
    with pytest.raises(ParameterError, match='for skills of the tool'):
        correction(Skill.learn(takes(Sphere(2), 3, rng)), pushed)
    home = Arm().pose_at(Arm().home)
    with pytest.raises(ParameterError, match='rhythmic'):
        correction(Skill.learn_rhythmic(circles(home, 0.04, 4.3, 0.03)), pushed)
    with pytest.raises(DataError, match='expected at least 10 poses'):
        FollowedMotion(np.zeros(3), np.zeros((3, 7)), np.zeros((3, 7)))
