"""The gripper of the simulated arm: it moves, holds by friction, and says so."""
import numpy as np
import pytest

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.control.target import HOLD_STIFFNESS, resting_target, TWIST
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.sim.gripper import add_gripper, SimulatedGripper
from gdmp_ros.sim.scenes import CUBE_EDGE, PICK, pick_and_place
from gdmp_ros.util.profiles import smoothstep


def loop_with(*scene):
    arm = Arm(extras=[add_gripper, *scene])
    return ClosedLoop(arm, gripper=SimulatedGripper(arm.model, arm.data))


def run(loop, seconds):
    for _ in range(round(seconds / loop.arm.period)):
        loop.tick()


def go(loop, position, seconds):
    """Move the tool straight to a position."""
    start = loop.controller.reference[:7].copy()
    way = np.array(position) - start[:3]
    ticks = round(seconds / loop.arm.period)
    for k in range(ticks + 400):
        s = min((k + 1) / ticks, 1.0)
        target = resting_target(start, HOLD_STIFFNESS)
        target[:3] += smoothstep(s) * way
        rate = (smoothstep(min(s + 1e-6, 1.0)) - smoothstep(s)) / 1e-6 / seconds
        target[TWIST:TWIST + 3] = rate * way
        assert loop.follow(target), loop.controller.guard.last_refusal
        loop.tick()


def test_the_fingers_move_to_a_width_at_a_speed():
    loop = loop_with()
    assert loop.driver.gripper.state.width == pytest.approx(0.08, abs=1e-3)
    number = loop.driver.gripper.command(GripperCommand(0.02, speed=0.05))
    run(loop, 0.6)
    # 60 mm at 50 mm/s take 1.2 s.
    state = loop.driver.gripper.state
    assert state.moving and state.width == pytest.approx(0.05, abs=3e-3)
    run(loop, 1.0)
    state = loop.driver.gripper.state
    assert not state.moving and state.commands == number and not state.problem
    assert state.width == pytest.approx(0.02, abs=1e-3) and not state.holding


def test_closing_on_nothing_is_not_holding():
    loop = loop_with()
    loop.driver.gripper.command(GripperCommand(0.0, 20.0))
    run(loop, 2.0)
    state = loop.driver.gripper.state
    assert not state.moving and not state.holding and state.width < 1e-3


@pytest.mark.parametrize(('command', 'reason'), [
    (GripperCommand(0.2), 'width is 0.2 m, expected 0 to 0.08 m'),
    (GripperCommand(0.02, 500.0), 'force is 500 N'), (GripperCommand(0.02, 0.0, 0.0), 'speed'),
    (GripperCommand(float('nan')), 'width is nan')])
def test_commands_that_are_not_possible_are_refused(command, reason):
    loop = loop_with()
    with pytest.raises(ParameterError, match=reason):
        loop.driver.gripper.command(command)
    assert loop.driver.gripper.state.commands == 0


def test_a_cube_is_picked_and_carried():
    loop = loop_with(pick_and_place)
    x, y = PICK.centre
    run(loop, 0.2)
    go(loop, (x, y, 0.25), 2.0)
    go(loop, (x, y, 0.035), 2.0)
    loop.driver.gripper.command(GripperCommand(0.0, 20.0))
    run(loop, 1.0)
    state = loop.driver.gripper.state
    assert state.holding and state.width == pytest.approx(CUBE_EDGE, abs=2e-3)
    go(loop, (x, 0.0, 0.3), 2.0)
    cube = loop.arm.data.body('cube').xpos
    assert np.linalg.norm(cube - loop.arm.measure().pose[:3]) < 0.02 and cube[2] > 0.25
    loop.driver.gripper.command(GripperCommand(0.08))
    run(loop, 1.5)
    assert loop.arm.data.body('cube').xpos[2] < 0.05
    assert not loop.driver.gripper.state.holding


def test_the_controller_knows_the_arm_alone():
    loop = loop_with(pick_and_place)
    assert loop.arm.known.model.nv == 7 and loop.arm.model.nv == 15
    measured = loop.arm.measure()
    assert measured.position.shape == (7,) and measured.inertia.shape == (7, 7)
    alone = Arm()
    np.testing.assert_allclose(measured.bias, alone.measure().bias, atol=1e-9)


def test_only_the_built_in_hand_has_fingers():
    with pytest.raises(DataError, match='no body .left_finger.'):
        Arm(extras=[add_gripper], hand=False, tool='flange')
