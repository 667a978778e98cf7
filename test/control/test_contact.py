"""A wrench that is wished is kept in contact; a wrench against the motion stops it."""
from types import SimpleNamespace

import numpy as np
import pytest

from gdmp_ros.control.contact import described, feel
from gdmp_ros.control.friction import without_friction
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.limits import WRENCH_LIMIT
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.control.settings import (
    ContactSettings,
    ControllerSettings,
    ImpedanceGains,
    TankSettings,
)
from gdmp_ros.control.target import (
    HOLD_STIFFNESS,
    resting_target,
    WRENCH,
    WRENCH_GAIN,
)
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.scenes import hard_table
from gdmp_ros.sim.teaching import Hand, HandSettings
from test.control.plants import CLEAN, on_every_plant, on_plants

DT = 1e-3


def press(gain, height, force=10.0, seconds=3.0, plant=CLEAN, **settings):
    """Press on a table that is ``height`` higher than thought; forces on the tool, and ticks."""
    scene = hard_table(0.03 - height)
    scene.geom('table').solref = [0.005, 1.0]
    loop = plant.loop(scene, **settings)
    start = loop.arm.measure().pose.copy()
    ticks = []
    for k in range(round(seconds / DT)):
        target = resting_target(start, HOLD_STIFFNESS)
        target[2] -= 0.03 * min(k / 1000, 1.0)
        target[WRENCH + 2] = -force * min(max(k - 1000, 0) / 500, 1.0)
        target[WRENCH_GAIN + 2] = gain if k > 1000 else 0.0
        assert loop.follow(target), loop.controller.guard.last_refusal
        tick = loop.tick()
        ticks.append(tick._replace(measurement=tick.measurement._replace(
            pose=tick.measurement.pose.copy())))
    return np.array([tick.wrench[2] for tick in ticks]), ticks


def test_known_friction_of_a_joint_that_moves_is_no_external_torque():
    dry, external, result = np.array([1.1, 1.1, 0.0]), np.array([3.0, -1.1, 2.0]), np.empty(3)
    without_friction(external, np.array([-0.5, 0.5, 0.5]), dry, 0.02, result)
    assert result == pytest.approx([3.0 - 1.1, 0.0, 2.0])


@on_every_plant
@pytest.mark.parametrize('height', [
    -0.005, *(pytest.param(one, marks=pytest.mark.long) for one in (0.0, 0.02))])
def test_a_force_is_kept_although_the_height_of_the_table_is_not_known(height, plant):
    kept, ticks = press(5.0, height, plant=plant)
    plain, _ = press(0.0, height, plant=plant)
    assert abs(kept[-500:].mean() - 10.0) < 0.3 and np.abs(np.diff(kept[-500:])).max() < (
        0.5 if plant is CLEAN else 3.0)  # noise of the velocities, by way of the friction
    # Without feedback the spring adds what it is compressed by.
    assert abs(plain[-500:].mean() - 10.0) > 1.0
    assert min(tick.tank for tick in ticks) > -0.01


@on_every_plant
def test_the_correction_is_bounded_where_there_is_nothing_to_press_on(plant):
    _, ticks = press(20.0, -0.5, seconds=4.0, plant=plant, contact=ContactSettings(
        force_feedback_max=(5.0, 1.0)))
    # 10 N wished and 5 N of correction, against the spring; the reference has moved 30 mm.
    sunk = ticks[0].measurement.pose[2] - ticks[-1].measurement.pose[2]
    assert sunk == pytest.approx(0.03 + 15.0 / 400.0, abs=1e-3 + plant.slack())


@on_plants('clean', 'real')
def test_a_force_is_paid_by_the_tank(plant):
    """Without refill, a force that does work ends with the energy."""
    _, ticks = press(0.0, -0.5, force=40.0, seconds=6.0, plant=plant,
                     tank=TankSettings(energy=0.3, recharge_power=0.0))
    assert min(tick.tank for tick in ticks) > -0.01


def move_against(force, reaction, along=False, plant=CLEAN):
    """Move sideways; a force acts from the middle on, against the motion or along with it."""
    loop = plant.loop(contact=ContactSettings(collision_force=15.0, collision_reaction=reaction))
    start, modes = loop.arm.measure().pose.copy(), []
    for k in range(3000):
        target = resting_target(start, HOLD_STIFFNESS)
        target[1] += 0.05 * max(k - 200, 0) * DT
        target[8] = 0.05 if k > 200 else 0.0
        loop.follow(target)
        if k > 1500:
            loop.arm.push(np.array([0, force if along else -force, 0, 0, 0, 0.0]))
        loop.tick()
        modes.append(loop.controller.guard.mode)
    return modes, loop


@on_every_plant
@pytest.mark.parametrize('reaction, mode', [('stop', ArmMode.HOLD),
                                            ('comply', ArmMode.COMPLIANT)])
def test_a_force_against_the_motion_stops_it(reaction, mode, plant):
    modes, loop = move_against(25.0, reaction, plant=plant)
    assert set(modes[10:1500]) == {ArmMode.FOLLOW} and modes[-1] is mode
    assert set(modes[1540:]) == ({ArmMode.STOP, mode} if reaction == 'stop' else {mode})
    assert 'N against the motion' in loop.controller.guard.reason


@on_every_plant
@pytest.mark.parametrize('force, along', [(9.0, False), (25.0, True)])
def test_a_small_force_or_one_along_the_motion_does_not(force, along, plant):
    """While a joint turns round, dry friction / lever, 5.5 N, is not known: 9 N + 5.5 N < 15 N."""
    modes, _ = move_against(force, 'stop', along, plant)
    assert set(modes[10:]) == {ArmMode.FOLLOW}


def test_an_external_torque_that_is_not_finite_does_not_hide_a_collision():
    def felt_by(largest):
        """What is felt of a wrench while the tool moves; collisions from ``largest`` [N] on."""
        scalars, felt = SimpleNamespace(dt=1e-3, collision_force=largest, collision_torque=0.0,
                                        unknown=0.0, against=0.0), np.zeros(6)
        motion = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])

        def found(wrench):
            what = feel.py_func(scalars, felt, np.asarray(wrench), motion, np.zeros(6))
            return described(what, scalars.against) if what else ''
        return found
    broken, against = np.full(6, np.nan), [0.0, -30.0, 0.0, 0.0, 0.0, 0.0]
    found = felt_by(15.0)
    assert found(broken) == ''
    assert 'N against the motion' in [found(against) for _ in range(50)][-1]
    # A sensor that has broken down is no reason to move on without one.
    found = felt_by(15.0)
    said = [found(broken) for _ in range(150)]
    assert said[50] == '' and 'is not finite' in said[-1]
    blind = felt_by(0.0)
    assert not any(blind(broken) for _ in range(150))


def moved_joint(loop, ticks, push=None):
    goal = loop.arm.home.copy()
    goal[0] += 0.6
    loop.move(PostureMotion(loop.joints, goal[None], 0.3))
    made = []
    for k in range(ticks):
        if push is not None and k == 800:
            loop.arm.push(push)
        made.append(loop.tick())
    return made


@pytest.mark.parametrize('reaction, mode', [('stop', ArmMode.HOLD),
                                            ('comply', ArmMode.COMPLIANT)])
def test_joints_that_move_react_to_a_collision_too(reaction, mode):
    loop = ClosedLoop(Arm(), ControllerSettings(contact=ContactSettings(
        collision_force=15.0, collision_reaction=reaction)))
    made = moved_joint(loop, 2500, np.array([0.0, -40.0, 0.0, 0.0, 0.0, 0.0]))
    assert {tick.mode for tick in made[10:800]} == {ArmMode.MOVE}
    assert made[-1].mode is mode and 'N against the motion' in loop.states.reason
    assert loop.joint_motion_problem == loop.states.reason
    # Without a push the same motion is no collision.
    loop.reset()
    assert moved_joint(loop, 4500)[-1].mode is ArmMode.HOLD and loop.joint_motion_problem == ''


def test_joints_that_are_held_push_no_harder_than_the_wrench_limit():
    loop = ClosedLoop(Arm(), ControllerSettings(gains=ImpedanceGains(wrench_max=(20.0, 5.0))))
    loop.driver.hand = Hand(loop.arm.measure().pose.copy(),
                            HandSettings(20000.0, 500.0, 400.0, 50.0, 100.0))
    made = moved_joint(loop, 1500)
    assert 15.0 < max(np.linalg.norm(tick.wrench[:3]) for tick in made[100:]) < 26.0
    assert loop.controller.counters.ticks[WRENCH_LIMIT] > 0
