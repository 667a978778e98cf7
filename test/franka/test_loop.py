"""Control of a Franka, with a stand-in for the robot that enforces its limits."""
from contextlib import suppress
import os

import numpy as np
import pytest

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.control.joint_motion import Braking, PostureMotion
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.control.target import resting_target, TWIST
from gdmp_ros.errors import ParameterError
from gdmp_ros.franka.robot import FrankaRobot
from gdmp_ros.franka.settings import FrankaSettings
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import ToolTransform


def cycles(loop, count, each=lambda k: None):
    """Control for a number of cycles; returns the ticks."""
    made = []
    for k in range(count):
        measured = loop.wait()
        assert measured is not None, loop.states.reason
        each(k)
        made.append(loop.answer(measured))
        assert loop.driver.robot.controlled, loop.states.reason
    return made


def test_the_robots_model_is_that_of_our_fr3(loop):
    measured = loop.driver.measured
    arm = Arm('fr3')
    arm.reset(measured.position)
    own = arm.measure()
    np.testing.assert_allclose(measured.jacobian, own.jacobian, atol=1e-6)
    np.testing.assert_allclose(measured.pose[:3], own.pose[:3], atol=1e-6)
    rotors = 0.1 * np.eye(7) - np.diag(arm.model.dof_armature)
    np.testing.assert_allclose(measured.inertia, own.inertia + rotors, atol=1e-5)


def test_it_begins_and_ends_without_a_jump_of_the_torque(loop):
    loop.activate()
    ticks = cycles(loop, 300)
    assert np.abs(ticks[0].torque).max() < 0.05
    largest = max(np.abs(one.torque - other.torque).max()
                  for one, other in zip(ticks[1:], ticks[:-1], strict=True))
    assert largest <= 0.951
    loop.end()
    assert not loop.driver.robot.controlled
    assert loop.controller.guard.mode is ArmMode.HOLD


def test_it_moves_to_a_posture_and_then_follows_a_motion(loop):
    loop.activate()
    cycles(loop, 50)
    goal = Arm('fr3').home
    loop.move(PostureMotion(loop.joints, goal[None], 0.8))
    while loop.moves_joints:
        cycles(loop, 1)
    assert not loop.joint_motion_problem
    cycles(loop, 2)
    # Dry friction of 1.1 Nm that nobody announced.
    assert np.abs(loop.driver.measured.position - goal).max() < 0.05
    target = resting_target(loop.driver.measured.pose)
    begun = target[:3].copy()

    def move(k):
        target[1] = begun[1] + 0.05 * 0.5 * (1.0 - np.cos(np.pi * min(k / 1500.0, 1.0)))
        target[TWIST + 1] = 0.05 * 0.5 * np.pi / 1.5 * np.sin(np.pi * k / 1500.0) * (k < 1500)
        assert loop.follow(target), loop.controller.guard.last_refusal
    cycles(loop, 2000, move)
    assert abs(loop.driver.measured.pose[1] - begun[1] - 0.05) < 0.02
    assert loop.driver.robot.success_rate > 0.5


def test_a_tool_is_put_to_another_place_without_a_step(loop):
    loop.activate()
    before = cycles(loop, 200)[-1]
    pose = loop.driver.measured.pose
    loop.put_tool(ToolTransform((0.0, 0.0, 0.1)))
    after = cycles(loop, 50)
    assert np.linalg.norm(loop.driver.measured.pose[:3] - pose[:3]) == pytest.approx(0.1, abs=1e-3)
    assert np.abs(after[0].torque - before.torque).max() < 0.05


def test_a_robot_that_is_switched_off_is_a_fault_and_recovers_on_request(loop, robot):
    loop.activate()
    cycles(loop, 200)
    robot.kill()
    while loop.driver.robot.connected:
        measured = loop.wait()
        if measured is not None:
            loop.answer(measured)
    assert 'does not answer' in loop.states.reason
    assert loop.controller.guard.mode is ArmMode.FAULT
    assert loop.wait() is None
    with pytest.raises(ArmStopped, match='does not answer'):
        loop.recover()
    robot.start()
    assert loop.wait() is None  # nothing happens by itself
    loop.recover()
    assert loop.controller.guard.mode is ArmMode.HOLD
    cycles(loop, 200)


def test_a_command_that_breaks_a_limit_is_a_reflex_and_recovers_on_request(loop):
    loop.activate()
    cycles(loop, 100)
    loop.wait()
    with pytest.raises(ArmStopped, match='controller_torque_discontinuity'):
        for _ in range(5):  # our limits are passed by
            loop.driver.robot.write(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0]))
            loop.driver.robot.read()
    loop.answer(loop.wait())
    assert loop.controller.guard.mode is ArmMode.FAULT
    for _ in range(100):
        measured = loop.wait()
        assert np.abs(loop.answer(measured).torque).max() == 0.0
    loop.recover()
    cycles(loop, 100)


def test_the_torque_rate_counts_from_command_to_command(loop):
    """After lost cycles the robot compares with the last command, as if none had been lost."""
    control = ArmControl(loop.driver)
    measured = loop.driver.measured
    control.hold(measured)
    away = Braking(measured.position + 0.15, np.zeros(7), 1.0)
    tick = control.controller.move_joints(measured, away.path, 0.015)
    assert np.abs(tick.torque).max() == pytest.approx(0.95, abs=1e-6)


def test_what_cannot_be_reached_is_named():
    with pytest.raises(ParameterError, match='host is empty'):
        FrankaRobot(FrankaSettings())
    with pytest.raises(ArmStopped, match='127.0.0.9: the robot does not answer'):
        FrankaRobot(FrankaSettings(host='127.0.0.9'))
    with pytest.raises(ParameterError, match='reflex_torque has 3 numbers, expected 1 or 7'):
        FrankaSettings(host='x', reflex_torque=(1.0, 2.0, 3.0))


def test_a_library_that_raises_the_priority_of_a_thread_does_not_keep_it(robot):
    def opened(host, config):
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        return robot.open(host, config)
    FrankaRobot(FrankaSettings(host='robot'), opened).close()
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
