"""Two arms of one simulation execute a coupled skill, and carry a tray."""
import numpy as np
import pytest

from gdmp_ros.demo.tray import (
    carry,
    coupling_of,
    MEASURED_LIMITS,
    REFERENCE_LIMITS,
    STEP,
    STEP_TURN,
    taught_skills,
)
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ManifoldError
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.streamed_skill import StreamedSkill
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.execution import execute
from gdmp_ros.sim.path_check import check_skill, PathChecker
from gdmp_ros.sim.two_arms import bases, pose_on_stand, SIDES, TwoArms, World


@pytest.fixture(scope='module')
def skills():
    left, right = taught_skills(np.random.default_rng(3))
    joined = Skill.joined(left, right, SIDES)
    return joined, joined.coupled(coupling_of(joined, pose_on_stand()))


@pytest.mark.parametrize('side', [0, pytest.param(1, marks=pytest.mark.long)])
def test_the_arms_keep_the_relation_while_the_goal_of_one_is_switched(skills, side):
    _, skill = skills
    arms, coupling = TwoArms(World(bases())), skill.couplings[0]
    goal = skill.goal[7 * side:7 * side + 7].copy()
    goal[:3] += STEP
    rotate_by_vector(goal[3:].copy(), np.array([0.0, 0.0, STEP_TURN]), goal[3:])
    switched = False

    def switch(done, player):
        nonlocal switched
        if done > 0.5 and not switched:
            switched = True
            player.go_to(goal, side=side)
    moments = list(arms.execute(skill, switch))
    reference, measured = (np.max([coupling.deviation(skill.manifold, points)
                                   for points in column], axis=0)
                           for column in list(zip(*moments))[:2])
    assert switched and arms.player.rollout.finished and not arms.player.rollout.flags
    assert (reference <= REFERENCE_LIMITS).all()
    assert (measured <= MEASURED_LIMITS).all()
    last = moments[-1]
    assert np.abs(last.reference[7 * side:7 * side + 7] - goal).max() < 1e-3
    assert np.abs(last.measured - last.reference).max() < 2e-3


def test_the_tray_is_carried(skills):
    together, _ = carry(skills[1], skills[1].couplings[0])
    assert together['ball_on_tray'] and together['finished'] and together['tilt_rad'] < 0.01
    assert together['squeeze_n'] < 1.0


@pytest.mark.long
def test_without_the_coupling_the_tray_is_not_carried(skills):
    apart, _ = carry(skills[0], skills[1].couplings[0])
    assert not apart['ball_on_tray'] and apart['tilt_rad'] > 0.05
    assert apart['squeeze_n'] > 1.0


def test_a_stream_of_one_arm_refuses_a_skill_of_two(skills):
    with pytest.raises(DataError, match='two arms'):
        execute(skills[1], Arm())
    with pytest.raises(DataError, match='two arms'):
        check_skill(skills[1], PathChecker(Arm()))
    with pytest.raises(ManifoldError, match='moves on'):
        StreamedSkill(skills[1], PlayerSettings()).tangent_of_twist(np.zeros(6))


def test_a_world_needs_two_arms_and_the_skill_two_tools(skills):
    both = bases()
    with pytest.raises(DataError, match='expected 2'):
        TwoArms(World({'left': both['left']}))
    with pytest.raises(DataError, match='two tools'):
        next(TwoArms(World(both)).execute(taught_skills(np.random.default_rng(0))[0]))


def test_an_arm_in_a_world_is_the_arm_alone():
    """The same torques give the same motion, wherever the base is."""
    world = World(bases())
    for arm in world.arms.values():
        now = arm.measure()
        assert np.allclose(now.position, arm.home)
        assert np.allclose(now.pose[1], arm.known.model.body('link0').pos[1])
        arm.act(now.bias)
    world.advance()
    assert np.abs(world.data.qvel).max() < 1e-3
