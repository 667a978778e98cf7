"""Energy by independent bookkeeping: hands that pull, hold and let go, limits, delay, friction."""
from dataclasses import replace

import numpy as np
import pytest

from experiments.energy_audit import Audit
from gdmp_ros.control import limits
from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.settings import (
    ControllerSettings,
    FrictionSettings,
    GuardSettings,
    LimitSettings,
    TankSettings,
)
from gdmp_ros.control.tank import RESERVE
from gdmp_ros.control.target import HOLD_STIFFNESS, resting_target, WRENCH
from gdmp_ros.manifolds import SymmetricPositiveDefinite, UnitQuaternion
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.plant import PlantSettings
from gdmp_ros.sim.teaching import Hand, HandSettings

ANYWHERE = GuardSettings(jump_position=10.0, jump_rotation=10.0, arming_position=10.0,
                         arming_rotation=10.0, arming_speed=100.0, arming_angular_speed=100.0)
#: Most that may be missing in the tank [J].
DEBT = -0.01
PLANTS = {'clean': None, 'delay': PlantSettings(delay=0.001),
          'dry': PlantSettings(dry_friction=1.1, armature=0.2, delay=0.001),
          'real': PlantSettings(1.1, 0.2, 0.001, 1e-5, 2e-3)}


def also_long(*values):
    return pytest.param(*values, marks=pytest.mark.long)


def loop_with(plant=None, energy=5.0, passive=True, **limit_changes):
    """A loop whose tank is refilled by nothing that the books do not see, as friction."""
    settings = ControllerSettings(
        friction=FrictionSettings(credit=0.0),
        guard=ANYWHERE, limits=LimitSettings(**{'stiffness_rate': 500.0, **limit_changes}),
        tank=TankSettings(energy, max(energy, 10.0), 0.0, passive=passive))
    return ClosedLoop(Arm(plant=PLANTS.get(plant)), settings)


def stiff(k):
    return np.diag([k] * 3 + [30.0 * max(1.0, k / 400.0) ** 0.5] * 3)


def pulled_and_released(loop, k, aside=0.15, direction=(0.0, 1.0, 0.0)):
    """A hand pulls the tool aside, holds it, and lets go; contents of the tank by the audit."""
    home = loop.arm.measure().pose.copy()
    audit, target = Audit(loop), resting_target(home, stiff(k))
    hand = Hand(home.copy(), HandSettings(5000.0, 200.0))
    for tick in range(3000):
        if tick == 300:
            loop.driver.hand = hand
        if tick < 1500:
            hand.pose[:3] = home[:3] + aside * min(max(tick - 300, 0) / 800.0, 1.0) * np.array(
                direction)
        else:
            loop.driver.hand = None
            loop.arm.push(np.zeros(6))
        loop.follow(target)
        audit.tick()
    return np.array(audit.content)


@pytest.mark.parametrize('k, plant', [
    (400.0, 'real'), (5000.0, 'delay'), also_long(5000.0, 'clean'),
    *(also_long(2000.0, plant) for plant in PLANTS)])
def test_a_hand_pulls_and_lets_go(k, plant):
    assert pulled_and_released(loop_with(plant), k).min() >= DEBT


@pytest.mark.parametrize('k, plant', [(5000.0, 'delay'), also_long(2000.0, 'clean')])
def test_a_hand_pulls_with_a_nearly_empty_tank(k, plant):
    assert pulled_and_released(loop_with(plant, energy=0.2), k).min() >= DEBT


def shaken(loop, k, rate=2.0, size=0.06, each=None):
    """A hand shakes the tool for three seconds, and lets go; ``each`` is called at every tick."""
    home = loop.arm.measure().pose.copy()
    audit, target = Audit(loop), resting_target(home, stiff(k), 0.1)
    hand = loop.driver.hand = Hand(home.copy(), HandSettings(3000.0, 150.0))
    for tick in range(4000):
        hand.pose[:3] = home[:3] + size * np.array([0.3, 1.0, 0.5]) * np.sin(
            2e-3 * np.pi * rate * tick)
        if tick == 3000:
            loop.driver.hand = None
            loop.arm.push(np.zeros(6))
        loop.follow(target)
        audit.tick()
        if each is not None:
            each()
    return np.array(audit.content)


@pytest.mark.parametrize('recharge', [0.0, 50.0])
def test_the_tank_holds_no_more_than_its_capacity(recharge):
    """A hand that shakes the tool puts more into it."""
    loop, contents = loop_with(energy=9.9), []
    loop.controller.configure(replace(loop.controller.settings,
                                      tank=TankSettings(9.9, 10.0, recharge)))
    shaken(loop, 2000.0, each=lambda: contents.append(loop.controller.tank.energy))
    assert max(contents) == 10.0


@pytest.mark.parametrize('hand, k, plant', [
    (pulled_and_released, 2000.0, 'clean'), also_long(shaken, 5000.0, 'delay'),
    also_long(pulled_and_released, 5000.0, 'delay'), also_long(shaken, 2000.0, 'delay')])
def test_torques_saturate_with_a_nearly_empty_tank(hand, k, plant):
    """What the spring stores is then more than the motors can take from the hand."""
    assert hand(loop_with(plant, energy=0.2, torque_share=0.3), k).min() >= DEBT
    assert hand(loop_with(plant, energy=0.2, torque_share=0.3, passive=False), k).min() < -1.0


@pytest.mark.parametrize('seed, plant', [
    (0, 'clean'), (1, 'delay'), also_long(2, 'real'),
    *(also_long(seed, plant) for seed in range(3, 7) for plant in PLANTS)])
def test_random_references_and_stiffness(seed, plant):
    rng, spd = np.random.default_rng(seed), SymmetricPositiveDefinite(6)
    loop = loop_with(plant, energy=0.3)
    home, audit = loop.arm.measure().pose.copy(), Audit(loop)
    scale = np.diag([20.0] * 3 + [4.0] * 3)
    for tick in range(3000):
        if tick % 40 == 0:
            matrix = scale @ spd.random_point(rng) @ scale
            target = resting_target(home, matrix, 0.1)
            target[:3] += rng.uniform(-0.05, 0.05, 3)
            turned = UnitQuaternion().exp(home[3:].copy(), 0.1 * rng.standard_normal(3))
            target[3:7] = turned
        loop.follow(target)
        audit.tick()
    assert min(audit.content) >= DEBT


@pytest.mark.parametrize('plant, dry, drag', [
    ('dry', 3.0, 0.0), also_long('delay', 1.1, 0.0), also_long('dry', 3.0, 40.0),
    also_long('dry', 1.1, 0.0), also_long('clean', 0.0, 40.0)])
def test_friction_is_compensated_until_the_tank_is_empty(plant, dry, drag):
    """More than there is, what there is, friction that is not there; something drags the tool."""
    loop = loop_with(plant, energy=0.3)
    loop.controller.configure(replace(loop.controller.settings,
                                      friction=FrictionSettings(dry=(dry,), credit=0.0)))
    home, audit = loop.arm.measure().pose.copy(), Audit(loop)
    rate = 2.0 * np.pi
    for tick in range(3000):
        at, target = 1e-3 * tick, resting_target(home, stiff(400.0))
        target[1] += 0.1 * np.sin(rate * at)
        target[8] = 0.1 * rate * np.cos(rate * at)
        target[14] = -0.1 * rate ** 2 * np.sin(rate * at)
        loop.follow(target)
        twist = audit.tick().twist
        loop.arm.push(np.concatenate([-drag * twist[:3], np.zeros(3)]))
    assert min(audit.content) >= DEBT


def test_the_books_of_the_controller_are_right():
    loop = loop_with()
    loop.controller.tank.settings = TankSettings(5.0, 1000.0, 0.0, 0.0)
    audit = Audit(loop)
    home = loop.arm.measure().pose.copy()
    rng = np.random.default_rng(0)
    for tick in range(1500):
        target = resting_target(home, stiff(400.0 + 300.0 * np.sin(0.01 * tick)))
        target[1] += 0.1 * np.sin(0.005 * tick)
        loop.arm.push(np.concatenate([20.0 * np.sin(0.02 * tick + rng.uniform(0, 1, 3)),
                                      np.zeros(3)]))
        loop.follow(target)
        result = audit.tick()
        assert result.tank == pytest.approx(audit.content[-1], abs=1e-6)


@pytest.mark.parametrize('stiffness', [(300.0, 700.0, 350.0), (100.0, 2000.0, 400.0)])
def test_a_closed_path_beyond_the_clip_gains_nothing(stiffness):
    """The force of the spring along a circle that is too far away for it."""
    from gdmp_ros.control.settings import ImpedanceGains
    from gdmp_ros.control.spring import make_spring, spring_force, SPRING_SIZE
    from gdmp_ros.util.settings import numbers
    spring, force = np.empty(SPRING_SIZE), np.empty(6)
    matrix = np.diag([*stiffness, 30.0, 30.0, 30.0])
    make_spring(matrix.reshape(-1), numbers(ImpedanceGains()), spring)
    angles = np.linspace(0.0, 2.0 * np.pi, 4001)
    work, turned = 0.0, np.zeros((4001, 6))
    turned[:, 0] = 0.2 * np.cos(angles) + 0.25
    turned[:, 1] = 0.2 * np.sin(angles) + 0.25
    middle = 0.5 * (turned[1:] + turned[:-1])
    for error, step in zip(middle, np.diff(turned, axis=0)):
        spring_force(spring, error, force)
        assert np.linalg.norm(force) <= 60.0 + 1e-9
        work += force @ step
    assert abs(work) < 1e-4
    # With a clipped error, as usual, the same circle gives energy.
    clipped = middle * np.minimum(1.0, 0.1 / np.linalg.norm(middle[:, :3], axis=1))[:, None]
    plain = np.einsum('ti,ij,tj->', clipped, matrix, np.diff(turned, axis=0))
    assert abs(plain) > 0.3


@pytest.mark.parametrize('k, share', [(2000.0, 0.4), also_long(800.0, 0.4),
                                      also_long(2000.0, 1.0)])
def test_saturated_motors_do_not_drive_the_elbow(k, share):
    """Cut joint by joint, the torque would turn it at 0.1 to 0.15 rad/s."""
    loop = loop_with(torque_share=share)
    home = loop.arm.measure().pose.copy()
    loop.driver.hand = Hand(home + [0.0, -0.12, 0.0, 0, 0, 0, 0], HandSettings(5000.0, 200.0))
    target, elbow, saturated = resting_target(home, stiff(k)), [], 0
    for tick in range(4000):
        loop.follow(target)
        result = loop.tick()
        if tick > 2000:
            m = result.measurement
            across = m.velocity - np.linalg.pinv(m.jacobian) @ (m.jacobian @ m.velocity)
            elbow.append(np.abs(across).max())
        saturated += result.violation[limits.TORQUE] > 0.0
    assert saturated > 1000 and max(elbow) <= 0.02


def test_debt_is_forgiven_when_passivity_is_turned_on():
    loop = loop_with(passive=False)
    home = loop.arm.measure().pose.copy()
    pulled_and_released(loop, 5000.0)
    loop.controller.tank.energy = -3.0
    loop.controller.configure(ControllerSettings(guard=ANYWHERE, tank=TankSettings(
        5.0, 10.0, 0.0)))
    loop.follow(resting_target(home, HOLD_STIFFNESS))
    assert loop.tick().tank >= -1e-6


def test_noise_of_the_positions_hides_no_work():
    """With an empty tank, a tool that is pushed into free space must stop, encoders or not."""
    plant = PlantSettings(position_noise=1e-5)
    loop = ClosedLoop(Arm(plant=plant), ControllerSettings(tank=TankSettings(0.3, 10.0, 0.0)))
    start, audit = loop.arm.measure().pose.copy(), Audit(loop)
    for k in range(5000):
        target = resting_target(start, HOLD_STIFFNESS)
        target[WRENCH + 2] = -40.0 * min(k / 500, 1.0)
        loop.follow(target)
        audit.tick()
    assert min(audit.content) >= DEBT and loop.controller.tank.energy >= DEBT


def test_the_tank_says_when_it_is_low_and_is_filled_on_request():
    loop = loop_with()
    loop.tick()
    assert not loop.controller.tank.is_low
    loop.controller.tank.energy = 0.5
    assert loop.controller.tank.is_low
    loop.controller.refill_tank()
    assert loop.tick().tank == pytest.approx(5.0, abs=1e-3)


def test_a_damping_ratio_of_zero_means_the_default_and_a_small_one_is_raised():
    loop = loop_with()
    home = loop.arm.measure().pose.copy()
    for given, used in ((0.0, 0.7), (0.01, 0.1), (0.4, 0.4)):
        loop.follow(resting_target(home, HOLD_STIFFNESS, given))
        loop.tick()
        assert loop.controller.reference[55] == pytest.approx(used)


def test_the_commanded_wrench_is_bounded():
    """A reference far away at full stiffness, and a fast one."""
    loop = loop_with()
    home = loop.arm.measure().pose.copy()
    target = resting_target(home, stiff(5000.0))
    loop.driver.hand = Hand(home + [0.0, 0.2, 0.0, 0, 0, 0, 0], HandSettings(5000.0, 200.0))
    largest = 0.0
    for _ in range(1500):
        loop.follow(target)
        result = loop.tick()
        m = result.measurement
        active = result.torque - m.bias
        wrench = np.linalg.lstsq(m.jacobian.T, active, rcond=None)[0]
        largest = max(largest, np.linalg.norm(wrench[:3]))
    assert 40.0 < largest < 62.0


@pytest.mark.parametrize('seed', [6, 22])
@pytest.mark.parametrize('law', ['tool', 'joints'])
def test_a_moving_arm_with_an_empty_tank_is_braked_and_gains_nothing(law, seed):
    """Coriolis forces are compensated, and the motion stretches the spring: both want energy."""
    loop, draw = loop_with(energy=0.02), np.random.default_rng(seed)
    loop.arm.reset(draw.uniform(loop.joints.lower + 0.3, loop.joints.upper - 0.3))
    measured = loop.arm.measure()
    loop.hold(measured)
    target = (resting_target(measured.pose, np.diag([2.0] * 3 + [0.2] * 3)) if law == 'tool'
              else resting_joints(measured.position, np.full(7, 2.0)))
    loop.controller.guard.arm()
    for _ in range(200):
        loop.follow(target)
        loop.tick()
    loop.controller.tank.energy, least = RESERVE, np.inf
    # What gives it the velocity is not in the books.
    loop.arm.data.qvel[:7] = draw.uniform(-1.5, 1.5, 7)
    loop.controller.memory.scalars.known = 0.0
    for _ in range(800):
        loop.follow(target)
        least = min(least, loop.tick().tank)
    assert least > DEBT
