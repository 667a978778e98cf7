"""Friction of the joints, found from slow motions."""
import numpy as np
import pytest

from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.settings import ControllerSettings, GuardSettings
from gdmp_ros.control.target import resting_target
from gdmp_ros.errors import DataError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.plant import PlantSettings, REAL
from gdmp_ros.sim.teaching import Hand, HandSettings


def identified(plant):
    loop = ClosedLoop(Arm(plant=plant), ControllerSettings(guard=GuardSettings()))
    start = loop.arm.data.qpos.copy()
    # Fewer and faster motions than on a robot: the arm is simulated.
    loop.move(FrictionIdentification(loop.arm.limits, (0.2, 0.4), 0.12))
    largest = 0.0
    while loop.moves_joints:
        loop.tick()
        largest = max(largest, np.abs(loop.arm.data.qpos - start).max())
    return loop, loop.joint_motion.result(), largest


@pytest.mark.parametrize('plant, dry', [
    pytest.param(None, 0.0, marks=pytest.mark.long), (REAL, 1.1),
    pytest.param(PlantSettings(dry_friction=0.4, payload=0.5), 0.4, marks=pytest.mark.long)],
    ids=['none', 'real', 'with a payload'])
def test_friction_is_found_although_the_model_is_wrong(plant, dry):
    loop, found, largest = identified(plant)
    np.testing.assert_allclose(found.dry, dry, atol=0.15)
    # At such speeds dry and viscous friction are hardly told apart; what counts is their sum.
    np.testing.assert_allclose(found.dry + 0.15 * found.viscous,
                               dry + 0.15 * loop.arm.friction, atol=0.1)
    assert 0.08 < largest < 0.15
    # The arm holds afterwards where it began; a payload of 0.5 kg hangs by 12 mm.
    pose = loop.arm.measure().pose.copy()
    for _ in range(300):
        loop.tick()
    assert np.linalg.norm(loop.arm.measure().pose[:3] - pose[:3]) < 0.015


def test_an_arm_that_is_held_is_not_forced():
    loop = ClosedLoop(Arm())
    loop.move(FrictionIdentification(loop.arm.limits, (0.5,), 0.4))
    loop.driver.hand = Hand(loop.arm.measure().pose.copy(),
                            HandSettings(5000.0, 200.0, 2000.0, 50.0, 100.0))
    while loop.moves_joints:
        loop.tick()
    assert 'something holds the arm' in loop.joint_motion_problem


def test_a_joint_without_room_is_named():
    arm = Arm()
    start = arm.data.qpos.copy()
    start[3] = arm.limits.upper[3] - 0.04
    plan = FrictionIdentification(arm.limits, (0.2,), 0.1)
    loop = ClosedLoop(arm)
    loop.reset(start)
    loop.move(plan)
    while not plan.done:
        loop.tick()
    with pytest.raises(DataError, match='joint 4 has no room'):
        plan.result()


def test_after_the_motions_references_are_followed_again():
    loop = ClosedLoop(Arm())
    loop.move(FrictionIdentification(loop.arm.limits, (0.5,), 0.05))
    while loop.moves_joints:
        loop.tick()
    for _ in range(500):
        loop.tick()
    target = resting_target(loop.arm.measure().pose.copy())
    target[1] += 0.015
    for _ in range(1500):
        assert loop.follow(target), loop.controller.guard.last_refusal
        loop.tick()
    assert abs(loop.arm.measure().pose[1] - target[1]) < 1e-3
