"""Goals and measurements of a skill of two arms, without ROS."""
import numpy as np
import pytest

from gdmp_ros.control.target import (
    ACCELERATION,
    resting_target,
    STIFFNESS,
    target_in_frame,
    TARGET_SIZE,
    TWIST,
    WRENCH,
)
from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError, ManifoldError, ParameterError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.poses import compose, inverse, tool_manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.playback.goal_check import GoalCheck
from gdmp_ros.playback.measured_input import MeasuredInput, MeasuredInputs
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill
from gdmp_ros.scene import Scene, Volume
from test.lockstep.clock import SteppedClock

HOME = np.array([0.4, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0])
BASE = np.array([0.1, -0.6, 0.0, np.cos(0.2), 0.0, 0.0, np.sin(0.2)])


def one_arm(home):
    s = np.linspace(0.0, 1.0, 100)
    points = np.tile(home, (len(s), 1))
    points[:, 2] += 0.1 * s ** 2 * (3.0 - 2.0 * s)
    return Skill.learn(Demonstration(2.0 * s, points, tool_manifold(None)), 20)


@pytest.fixture(scope='module')
def skills():
    joined = Skill.joined(one_arm(HOME), one_arm(compose(BASE, HOME)), ('left', 'right'))
    names = tool_manifold(None).names
    return joined, joined.coupled(Coupling.at(
        'pose', *(tuple(f'{side}_{name}' for name in names) for side in ('left', 'right')),
        joined.manifold, joined.start))


@pytest.mark.parametrize('side', [0, 1])
def test_the_other_tool_follows_a_goal_or_stays_without_couplings(skills, side):
    joined, coupled = (StreamedSkill(skill, PlayerSettings()) for skill in skills)
    near = coupled.place_of(coupled.skill.goal)
    pose = near[7 * side:7 * side + 7] + [0.05, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0]
    place = coupled.place_of(coupled.changed(coupled.skill.goal, pose, side=side))
    np.testing.assert_allclose(place[7 * side:7 * side + 7], pose, atol=1e-12)
    relation = skills[1].couplings[0]
    assert relation.deviation(skills[1].manifold, place)[0] < 1e-9
    other = slice(7, 14) if side == 0 else slice(0, 7)
    assert np.abs(place[other] - near[other]).max() > 0.01
    alone = joined.place_of(joined.changed(joined.skill.goal, pose, side=side))
    np.testing.assert_array_equal(alone[other], near[other])


def test_only_motions_of_one_tool_bend_around_volumes(skills):
    """Two tools that belong together would come apart; three joints are no position."""
    times = np.linspace(0.0, 1.0, 50)
    joints = Skill.learn(Demonstration(times, np.outer(times, [0.1, 0.2, 0.3]), Product(
        Euclidean(3), names=['joints'])), 10)
    scene = Scene([Volume('ball', 'sphere', (0.05,), HOME)])
    for skill, count in ((skills[1], 0), (joints, 0), (one_arm(HOME), 1)):
        player = Player(skill, PlayerSettings())
        player.start(None)
        player.avoid(scene, 0.0)
        player.tick(1e-3)
        assert player.rollout.motion.scalars.obstacles == count


def test_the_workspace_of_the_second_arm_is_in_its_own_frame(skills):
    pair = StreamedSkill(skills[0], PlayerSettings())
    goals = GoalCheck(StreamSettings(), None, lambda: BASE)
    near = pair.place_of(skills[0].goal)
    # Beyond the workspace of the first arm, within that of the second one.
    inside = compose(BASE, np.array([0.5, -0.7, 0.4, 0.0, 1.0, 0.0, 0.0]))
    assert inside[1] < -0.8
    goals.place_for(pair, inside, near, 1)
    with pytest.raises(ManifoldError, match='first arm: goal . is'):
        goals.place_for(pair, inside, near, 0)
    outside = compose(BASE, np.array([0.5, 0.9, 0.4, 0.0, 1.0, 0.0, 0.0]))
    with pytest.raises(ManifoldError, match='second arm: goal y is 0.900 m'):
        goals.place_for(pair, outside, near, 1)
    with pytest.raises(ParameterError, match='no second arm'):
        GoalCheck(StreamSettings(), None).check(pair, near)
    tool = StreamedSkill(one_arm(HOME), PlayerSettings())
    with pytest.raises(ManifoldError, match='not one of two arms'):
        goals.place_for(tool, HOME, HOME, 1)


def test_both_poses_are_as_old_as_the_older_one(skills):
    poses, clock = {'first': (HOME, 0.1), 'second': None}, SteppedClock()

    def reading(name):
        def read():
            taken, poses[name] = poses[name], None
            return taken
        return MeasuredInput(clock, read, name)
    inputs = MeasuredInputs(reading('first'), second_tool=reading('second'))
    both = inputs.of(Kind.TWO_TOOLS)
    assert both.newest() is None
    with pytest.raises(ParameterError, match='both arms has arrived on first and second'):
        both.recent(0.5)
    poses['second'] = BASE, 0.3
    measured = both.newest()
    np.testing.assert_array_equal(measured.place, [*HOME, *BASE])
    assert both.age(measured) == pytest.approx(0.3)
    clock.run_until(clock.now() + 100_000_000)
    assert both.age(measured) == pytest.approx(0.4)
    assert both.newest() is measured
    poses['first'] = HOME + 1.0, 0.0
    assert both.newest().place[0] == HOME[0] + 1.0
    inputs.forget()
    assert both.newest() is None
    with pytest.raises(GdmpError, match='no second arm'):
        MeasuredInputs(reading('first')).of(Kind.TWO_TOOLS)


def test_a_target_in_another_frame_is_the_same_target(rng):
    """Power of the wrench, energy of the spring and the poses themselves do not depend on it."""
    frame = np.concatenate([rng.standard_normal(3), _unit(rng)])
    factor = rng.standard_normal((6, 6))
    target = resting_target(np.concatenate([rng.standard_normal(3), _unit(rng)]),
                            factor @ factor.T)
    for part in (TWIST, ACCELERATION, WRENCH):
        target[part:part + 6] = rng.standard_normal(6)
    moved, back = np.empty(TARGET_SIZE), np.empty(TARGET_SIZE)
    target_in_frame(target, frame, moved)
    assert max(pose_distance(compose(frame, moved[:7]), target[:7])) < 1e-12

    def invariants(one):
        twist, wrench = one[TWIST:TWIST + 6], one[WRENCH:WRENCH + 6]
        stiffness = one[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
        return [twist @ wrench, twist @ stiffness @ wrench, twist[:3] @ one[ACCELERATION:][:3]]
    np.testing.assert_allclose(invariants(moved), invariants(target), rtol=1e-11)
    target_in_frame(moved, inverse(frame), back)
    np.testing.assert_allclose(back, target, atol=1e-11)


def _unit(rng):
    q = rng.standard_normal(4)
    return q / np.linalg.norm(q)
