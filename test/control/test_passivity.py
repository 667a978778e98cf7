"""The energy of robot, spring and tank never grows."""
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from experiments.reliability.stability import growth_margin
from gdmp_ros.control import limits
from gdmp_ros.control.impedance import damping_design
from gdmp_ros.control.settings import (
    ControllerSettings,
    FrictionSettings,
    GuardSettings,
    LimitSettings,
    TankSettings,
)
from gdmp_ros.control.stiffness import compose_modes, relative_modes
from gdmp_ros.control.tank import RESERVE
from gdmp_ros.control.target import HOLD_STIFFNESS, STIFFNESS, TARGET_SIZE
from gdmp_ros.manifolds import SymmetricPositiveDefinite
from gdmp_ros.sim.arm import Arm, PANDA
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.util.profiles import minimum_jerk
from test.control.plants import CLEAN, on_every_plant

ANYWHERE = GuardSettings(jump_position=10.0, jump_rotation=10.0, arming_position=10.0,
                         arming_rotation=10.0, arming_speed=100.0, arming_angular_speed=100.0)
SPD6 = SymmetricPositiveDefinite(6)


def loop_with(energy, passive=True, plant=CLEAN, **limit_changes):
    return plant.loop(guard=ANYWHERE, tank=TankSettings(energy, energy, 0.0, 0.0, passive),
                      limits=LimitSettings(**{'stiffness_rate': 500.0, **limit_changes}))


def target_at(pose, stiffness, damping_ratio=0.7):
    target = np.zeros(TARGET_SIZE)
    target[:7], target[-1] = pose, damping_ratio
    target[STIFFNESS:STIFFNESS + 36] = np.asarray(stiffness).reshape(-1)
    return target


def total(loop, tick):
    """Kinetic energy, spring and tank [J]."""
    measured = tick.measurement
    kinetic = 0.5 * measured.velocity @ measured.inertia @ measured.velocity
    return kinetic + tick.spring + tick.tank


def test_modes_of_a_stiffness_relative_to_another(rng):
    for _ in range(20):
        old, new = SPD6.random_point(rng), SPD6.random_point(rng)
        values, modes, again = np.empty(6), np.empty(36), np.empty(36)
        relative_modes(old.reshape(-1), new.reshape(-1), values, modes)
        compose_modes(values, modes, again)
        np.testing.assert_allclose(again.reshape(6, 6), new, rtol=1e-8, atol=1e-10)
        compose_modes(np.ones(6), modes, again)
        np.testing.assert_allclose(again.reshape(6, 6), old, rtol=1e-8, atol=1e-10)
        expected = np.sort(np.linalg.eigvals(np.linalg.solve(old, new)).real)
        np.testing.assert_allclose(np.sort(values), expected, rtol=1e-8)


@on_every_plant
@pytest.mark.parametrize('seed', range(2))
def test_energy_never_grows_under_random_stiffness_and_references(seed, plant):
    rng = np.random.default_rng(seed)
    loop = loop_with(0.3, plant=plant)
    home, totals, tanks, fed = loop.arm.measure().pose.copy(), [], [], []
    target = target_at(home, HOLD_STIFFNESS, 0.05)
    for k in range(3000):
        if k % 40 == 0:
            factor = rng.standard_normal((6, 6)) * np.exp(rng.uniform(-1, 2.5))
            scale = np.diag([10.0] * 3 + [2.0] * 3)
            target = target_at(home, scale @ (factor @ factor.T + np.eye(6)) @ scale, 0.05)
            target[:3] += rng.uniform(-0.05, 0.05, 3)
        assert loop.follow(target)
        tick = loop.tick()
        totals.append(total(loop, tick))
        tanks.append(tick.tank)
        fed.append(tick.violation[limits.ENERGY])
    # One tick of a residual that the damping cannot take away at once is all that may be missing.
    assert min(tanks) > -0.03
    assert max(totals) < 0.3 + 0.03
    assert np.max(np.diff(totals)) < 0.03
    assert max(fed) > 0.0


def test_in_free_motion_the_tank_gets_back_what_it_gave():
    loop = loop_with(5.0)
    # The model knows its friction, and every torque acts at once.
    loop.controller.configure(replace(loop.controller.settings, friction=FrictionSettings(
        credit_viscous=tuple(loop.arm.friction)), tank=TankSettings(5.0, 5.0, 0.0, 0.0)))
    home = loop.arm.measure().pose.copy()
    tanks = []
    for k in range(4000):
        s = min(k / 3000.0, 1.0)
        target = target_at(home, HOLD_STIFFNESS)
        target[1] += 0.2 * minimum_jerk(s)
        target[8] = 0.2 * 30 * s ** 2 * (1 - s) ** 2 / 3.0
        target[14] = 0.2 * 60 * s * (1 - s) * (1 - 2 * s) / 9.0
        loop.follow(target)
        tanks.append(loop.tick().tank)
    assert min(tanks) < 4.97
    assert tanks[-1] == pytest.approx(5.0, abs=2e-3)


def pushed_into(loop, depth, ticks=1500):
    """Reference ``depth`` below a table that the tool stands on; where it was pushed from."""
    home = loop.arm.measure().pose.copy()
    for k in range(ticks):
        target = target_at(home, HOLD_STIFFNESS)
        target[2] -= depth * min(k / 1000.0, 1.0)
        loop.follow(target)
        loop.tick()
    return home


def table():
    arm = Arm()
    height = arm.measure().pose[2]
    spec = mujoco.MjSpec.from_file(str(PANDA))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.2, 0.2, 0.1],
                            pos=[0.3069, 0.0, height - 0.115], contype=2, conaffinity=1)
    return Arm(spec)


def on_table(energy):
    settings = ControllerSettings(guard=ANYWHERE, limits=LimitSettings(stiffness_rate=500.0),
                                  tank=TankSettings(energy, max(energy, 0.01), 0.0))
    loop = ClosedLoop(table(), settings)
    return loop, pushed_into(loop, 0.05)


def test_growth_waits_for_energy_and_a_decrease_is_always_allowed():
    loop, home = on_table(0.8)
    loop.controller.tank.energy = RESERVE  # nothing can be spent
    stiff = target_at(home, 4.0 * HOLD_STIFFNESS)
    stiff[2] -= 0.05
    loop.follow(stiff)
    for _ in range(80):
        tick = loop.tick()
        loop.follow(stiff)
    assert tick.violation[limits.ENERGY] > 0.0
    assert tick.stiffness[14] < 1.05 * 400.0 and tick.requested[14] == 1600.0
    # Directions in which nothing is stored may grow freely.
    assert tick.stiffness[7] > 1500.0
    soft = target_at(home, 0.1 * HOLD_STIFFNESS)
    soft[2] -= 0.05
    before = loop.controller.tank.energy
    for _ in range(60):
        loop.follow(soft)
        tick = loop.tick()
    assert tick.stiffness[14] == pytest.approx(40.0)
    assert loop.controller.tank.energy > before + 0.1  # the spring gave its energy back


def test_an_empty_tank_holds_the_reference_and_lets_it_return():
    loop, home = on_table(0.8)
    loop.controller.tank.energy = 0.0
    held = loop.controller.reference[2]
    deeper = target_at(home, HOLD_STIFFNESS)
    deeper[2] -= 0.09
    for _ in range(300):
        loop.follow(deeper)
        tick = loop.tick()
    assert abs(loop.controller.reference[2] - held) < 2e-3
    assert tick.violation[limits.ENERGY] > 0.0
    back = target_at(home, HOLD_STIFFNESS)
    for _ in range(1500):
        loop.follow(back)
        tick = loop.tick()
    assert loop.controller.reference[2] == pytest.approx(home[2], abs=1e-6)
    assert tick.tank > 0.3


def test_work_on_the_world_ends_when_the_tank_is_empty_unless_it_is_refilled():
    def pushed(refill):
        arm = Arm()
        arm.model.dof_damping[:] = 1.0
        loop = ClosedLoop(arm, ControllerSettings(guard=ANYWHERE,
                                                  tank=TankSettings(1.0, 1.0, refill)))
        body, home = arm.model.body('hand').id, arm.measure().pose.copy()
        given = 0.0
        for k in range(6000):
            # Something drags at the hand, whichever way it goes.
            tick = None
            target = target_at(home, HOLD_STIFFNESS)
            target[1] += 0.1 * np.sin(2 * np.pi * 0.5e-3 * k)
            target[8] = 0.1 * np.pi * np.cos(2 * np.pi * 0.5e-3 * k)
            loop.follow(target)
            tick = loop.tick()
            arm.data.xfrc_applied[body, :3] = -40.0 * tick.twist[:3]
            given += 40.0 * float(tick.twist[:3] @ tick.twist[:3]) * 1e-3
        return given

    strict = pushed(0.0)
    assert strict < 1.1
    assert pushed(3.0) > 3.0 * strict


def test_a_profile_with_a_proof_of_stability_and_one_without():
    times = np.linspace(0.0, 4.0, 2001)
    inertia = np.diag([11.7, 4.4, 5.8])

    def margin(rate):
        stiffness = np.array([np.diag([300.0, 300.0, 500.0]) * np.exp(np.sin(rate * t))
                              for t in times])
        inverse = np.linalg.inv(inertia)
        damping = np.array([damping_design(k, inverse, 0.7)[0] for k in stiffness])
        return growth_margin(times, stiffness, damping, inertia)

    alpha, slow = margin(0.5)
    assert alpha > 0.0 and slow < 0.0
    _, fast = margin(40.0)
    assert fast > 0.0
