"""Manipulability, its gradient and the law that tracks it."""
from dataclasses import replace

import numpy as np
import pytest

from gdmp_ros.control.manipulability import (
    divergence,
    divergence_gradient,
    manipulability,
    position_torque,
    PositionGains,
    PositionState,
    PositionTarget,
)
from gdmp_ros.data.public_sets import PlanarArm
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.planar import planar_arm, point_mass


def spd(rng, m):
    a = rng.standard_normal((m, m))
    return a @ a.T + 0.1 * np.eye(m)


def test_divergence_is_zero_only_where_equal(rng):
    a, b = spd(rng, 3), spd(rng, 3)
    assert divergence(a, a) == pytest.approx(0.0, abs=1e-12)
    assert divergence(a, b) == pytest.approx(divergence(b, a)) and divergence(a, b) > 0.01


@pytest.mark.parametrize('make', [Arm, lambda: planar_arm([0.3, 0.2, 0.3, 0.2])],
                         ids=['panda', 'planar'])
def test_gradient_is_that_of_the_simulated_arm(make, rng):
    arm = make()
    q0 = arm.data.qpos + 0.3 * rng.standard_normal(arm.model.nv)
    axes = 3 if arm.model.nv == 7 else 2
    wanted = spd(rng, axes)

    def at(q):
        arm.reset(q)
        return arm.linear_state(axes)
    state = at(q0)
    gradient = divergence_gradient(wanted, state.jacobian, state.derivative)
    for k in range(len(q0)):
        step = 1e-6 * np.eye(len(q0))[k]
        up, down = (divergence(wanted, manipulability(at(q0 + s).jacobian)) for s in (step, -step))
        assert gradient[k] == pytest.approx((up - down) / 2e-6, abs=1e-6)


def test_the_null_space_term_does_not_accelerate_the_tool(rng):
    arm = Arm()
    arm.reset(arm.data.qpos + 0.2 * rng.standard_normal(7))
    state = arm.linear_state()
    still = PositionTarget(state.position, np.zeros(3), np.zeros(3), spd(rng, 3))
    gains = [PositionGains(400.0 * np.eye(3), alpha=alpha, null_damping=0.0, singularity=0.0)
             for alpha in (0.0, 100.0)]
    plain, pushed = (position_torque(state, still, g) for g in gains)
    assert np.abs(pushed - plain).max() > 0.1
    acceleration = state.jacobian @ np.linalg.solve(state.inertia, pushed - plain)
    assert np.abs(acceleration).max() < 1e-9 * np.abs(pushed - plain).max()


def test_the_friction_of_the_wanted_motion_is_compensated(rng):
    arm = Arm()
    arm.reset(arm.data.qpos + 0.2 * rng.standard_normal(7))
    state, velocity = arm.linear_state(), 0.1 * rng.standard_normal(3)
    target = PositionTarget(state.position, velocity, np.zeros(3))
    gains = PositionGains(400.0 * np.eye(3), singularity=0.0)
    none, some = (position_torque(replace(state, friction=np.full(7, friction)), target, gains)
                  for friction in (0.0, 2.0))
    # 2 Nm s/rad at the velocity of each joint, of which that of the tool results.
    assert state.jacobian @ (0.5 * (some - none)) == pytest.approx(velocity)


def test_jdot_qdot_is_the_acceleration_at_constant_joint_velocity(rng):
    arm = Arm()
    arm.data.qvel[:] = rng.uniform(-1.0, 1.0, 7)
    import mujoco
    mujoco.mj_forward(arm.model, arm.data)
    now = arm.measure()
    q, dq, h = now.position, now.velocity, 1e-6
    arm.reset(q + h * dq)
    rate = (arm.measure().jacobian - now.jacobian) / h
    assert now.jdot_qdot == pytest.approx(rate @ dq, abs=1e-4)


def test_a_planar_arm_follows_a_path_and_agrees_with_the_simulated_one(rng):
    arm, simulated = PlanarArm([0.4, 0.3, 0.2]), planar_arm([0.4, 0.3, 0.2])
    q = rng.uniform(-1.0, 1.0, 3)
    simulated.reset(q)
    state = simulated.linear_state(2)
    assert state.position == pytest.approx(arm.position(q), abs=1e-12)
    assert state.jacobian == pytest.approx(arm.jacobian(q), abs=1e-12)
    path = np.column_stack([np.linspace(0.4, 0.6, 50), np.linspace(-0.1, 0.2, 50)])
    joints = arm.follow(path, np.array([-0.5, 1.0, 0.5]))
    assert max(np.linalg.norm(arm.position(q) - p) for q, p in zip(joints, path)) < 1e-3


def test_a_mass_on_a_spring_swings_as_its_equation_says():
    arm = point_mass(2.0)
    arm.reset(np.array([0.1, 0.0]))
    gains = PositionGains(50.0 * np.eye(2), damping_ratio=0.0, null_damping=0.0, singularity=0.0)
    target = PositionTarget(np.zeros(2), np.zeros(2), np.zeros(2))
    for _ in range(round(2.0 * np.pi / np.sqrt(50.0 / 2.0) / arm.period)):
        state = arm.linear_state(2)
        assert isinstance(state, PositionState)
        arm.step(position_torque(state, target, gains))
    assert arm.data.qpos == pytest.approx([0.1, 0.0], abs=1e-3)
