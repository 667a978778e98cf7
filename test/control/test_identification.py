"""Friction of the joints, and weight that the model lacks, found from slow motions."""
import mujoco
import numpy as np
import pytest

from experiments.energy_audit import Audit
from gdmp_ros.control.identification import ACCELERATION, FrictionIdentification, MARGIN
from gdmp_ros.control.settings import (
    ControllerSettings,
    FrictionSettings,
    GuardSettings,
    TankSettings,
)
from gdmp_ros.control.target import resting_target
from gdmp_ros.control.weight import add_weight, weight_rows
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.plant import PlantSettings, REAL
from gdmp_ros.sim.teaching import Hand, HandSettings


def identified(plant):
    loop = ClosedLoop(Arm(plant=plant), ControllerSettings(guard=GuardSettings()))
    start = loop.arm.data.qpos.copy()
    # Fewer and faster motions than on a robot: the arm is simulated.
    loop.move(FrictionIdentification(loop.arm.limits, loop.arm.chain, (0.2, 0.4), 0.12))
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


@pytest.mark.parametrize('plant', [
    pytest.param(PlantSettings(model='fr3', armature=0.1), marks=pytest.mark.long),
    PlantSettings(model='fr3', armature=0.1, dry_friction=1.1, delay=0.002)],
    ids=['clean', 'real'])
def test_the_weight_that_the_model_lacks_is_found(plant, rng):
    loop, found, _ = identified(plant)
    arm, moments = loop.arm, found.moments.ravel()
    lacking, left = [], []
    for spread in (0.1, 0.2):
        for _ in range(10):
            posture = arm.home + rng.uniform(-spread, spread, len(arm.home))
            difference = (bias(arm.model, posture) - bias(arm.known.model, posture))
            lacking.append(difference)
            left.append(difference - weight_rows(arm.chain, posture) @ moments)
    # Near the posture of the identification little is left, and half further away.
    assert np.abs(lacking[:10]).max() > 0.3
    assert np.linalg.norm(left[:10]) < 0.35 * np.linalg.norm(lacking[:10])
    assert np.linalg.norm(left[10:]) < 0.6 * np.linalg.norm(lacking[10:])


def bias(model, posture):
    data = mujoco.MjData(model)
    data.qpos[:] = posture
    mujoco.mj_forward(model, data)
    return data.qfrc_bias.copy()


def test_a_weight_that_no_arm_lacks_is_refused():
    with pytest.raises(DataError, match='lacks .* Nm of weight at joint 6, .* announced'):
        identified(PlantSettings(payload=4.0))


def test_weight_is_the_gradient_of_its_energy(rng):
    chain, moments = Arm().chain, rng.normal(size=(7, 3))
    posture, step = rng.uniform(-1.0, 1.0, 7), 1e-6
    torque = np.zeros(7)
    add_weight(*chain, posture, moments, torque)
    gradient = [(add_weight(*chain, posture + step * way, moments, np.zeros(7))
                 - add_weight(*chain, posture - step * way, moments, np.zeros(7))) / (2.0 * step)
                for way in np.eye(7)]
    np.testing.assert_allclose(torque, gradient, atol=1e-8)
    np.testing.assert_allclose(weight_rows(chain, posture) @ moments.ravel(), torque, atol=1e-12)


def test_moments_are_those_of_another_mass(rng):
    """A heavier link of the robot, and the moment of the difference."""
    robot, known = Arm('panda').model, Arm('panda').model
    link, more = robot.body('link5').id, 0.7
    robot.body_mass[link] += more
    moments = np.zeros((7, 3))
    # Body and joint have the same frame.
    moments[4] = 9.81 * more * robot.body_ipos[link]
    chain = Arm().chain
    for _ in range(5):
        posture = rng.uniform(-1.0, 1.0, 7)
        moved = weight_rows(chain, posture)
        lacking = bias(robot, posture) - bias(known, posture)
        # What is above does not carry the mass, what is below does: that is in the moments, too.
        below = moments.copy()
        frames = chain.frames[1:5, :3]
        for k in range(4):
            below[k] = 9.81 * more * frames[k]
        np.testing.assert_allclose(moved @ below.ravel(), lacking, atol=1e-9)


def test_other_moments_make_no_step_and_the_books_hold():
    """Moments that no robot lacks: the spring holds them."""
    tank, moments = TankSettings(energy=1.0, recharge_power=0.0), 0.3 * np.arange(21.0) - 3.0
    friction = FrictionSettings(credit=0.0)
    loop = ClosedLoop(Arm(), ControllerSettings(tank=tank, friction=friction))
    for _ in range(100):
        tick = loop.tick()
    before, largest = tick.measurement.pose[:3].copy(), 0.0
    loop.controller.configure(ControllerSettings(tank=tank, friction=friction,
                                                 weight_moments=tuple(moments)))
    for _ in range(3000):
        last, tick = tick.torque, loop.tick()
        largest = max(largest, np.abs(tick.torque - last).max())
    assert largest < 0.1
    assert 0.005 < np.linalg.norm(tick.measurement.pose[:3] - before) < 0.1

    def energy():
        return add_weight(*loop.arm.chain, loop.arm.data.qpos, moments.reshape(7, 3), np.zeros(7))
    loop.controller.guard.arm()
    audit, first, target = Audit(loop), energy(), loop.controller.reference
    range_of_energy = [first]
    for k in range(2000):
        target[:3] += 1e-4 * np.sin(0.003 * k) * np.array([0.0, 1.0, 1.0])
        loop.must_follow(target)
        audit.tick()
        # The tank counts the weight as it counts that of the model.
        assert loop.controller.tank.energy == pytest.approx(
            audit.content[-1] + range_of_energy[-1] - first, abs=5e-3)
        range_of_energy.append(energy())
    assert np.ptp(range_of_energy) > 0.1


def test_moments_are_counted():
    with pytest.raises(ParameterError, match='weight_moments: 7 numbers, expected 21'):
        ClosedLoop(Arm(), ControllerSettings(weight_moments=(0.1,) * 7))


def test_an_arm_that_is_held_is_not_forced():
    loop = ClosedLoop(Arm())
    loop.move(FrictionIdentification(loop.arm.limits, loop.arm.chain, (0.5,), 0.4))
    loop.driver.hand = Hand(loop.arm.measure().pose.copy(),
                            HandSettings(5000.0, 200.0, 2000.0, 50.0, 100.0))
    while loop.moves_joints:
        loop.tick()
    assert 'something holds the arm' in loop.joint_motion_problem


def test_a_joint_without_room_is_named():
    arm = Arm()
    start = arm.data.qpos.copy()
    start[3] = arm.limits.upper[3] - 0.04
    plan = FrictionIdentification(arm.limits, arm.chain, (0.2,), 0.1)
    loop = ClosedLoop(arm)
    loop.reset(start)
    loop.move(plan)
    while not plan.done:
        loop.tick()
    with pytest.raises(DataError, match='joint 4 has no room'):
        plan.result()


def test_a_joint_with_little_room_moves_without_a_jump():
    """The motion is too short for the ramps of its speed."""
    arm = Arm()
    start = arm.data.qpos.copy()
    start[3] = arm.limits.upper[3] - MARGIN - 0.01
    plan = FrictionIdentification(arm.limits, arm.chain, (0.4,), 0.1)
    plan.begin(start)
    step = 0.002
    places, rates = zip(*(plan.at(time) for time in np.arange(0.0, plan.remaining, step)))
    assert np.abs(np.diff(places, axis=0)).max() <= 0.4 * step * (1.0 + 1e-9)
    assert np.abs(np.diff(rates, axis=0)).max() <= ACCELERATION * step * (1.0 + 1e-9)
    np.testing.assert_allclose(places[-1], start, atol=0.4 * step)
    assert np.max(places, axis=0)[3] == pytest.approx(start[3] + 0.01, abs=1e-4)


def test_after_the_motions_references_are_followed_again():
    loop = ClosedLoop(Arm())
    loop.move(FrictionIdentification(loop.arm.limits, loop.arm.chain, (0.5,), 0.05))
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
