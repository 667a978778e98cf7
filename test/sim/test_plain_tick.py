"""Ticks that a kernel makes, beside the same ticks made one by one."""
import numpy as np
import pytest

from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.plain_tick import controller_of, MADE, OTHER
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.target import resting_target, TWIST
from gdmp_ros.errors import DataError, RefusedError
from gdmp_ros.sim.arm import Arm, FATAL
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.gripper import arm_with_gripper
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plain_tick import end_tick, only_goes_on, plain_tick, robot_of
from gdmp_ros.sim.plant import PlantSettings, REAL
from gdmp_ros.sim.teaching import Hand, HandSettings


def motion(loop, count):
    """References that begin where the arm is."""
    first = resting_target(loop.arm.measure().pose)
    result = np.tile(first, (count, 1))
    seconds = 1e-3 * np.arange(count)
    result[:, 1] += 0.03 * (1.0 - np.cos(2.0 * seconds))
    result[:, TWIST + 1] = 0.06 * np.sin(2.0 * seconds)
    return result


def one_by_one(loop, references):
    """Follow references without kernels that make ticks."""
    poses = []
    for reference in references:
        loop.must_follow(reference)
        poses.append(loop.tick().measurement.pose)
    return np.array(poses)


@pytest.fixture
def loops():
    return ClosedLoop(Arm()), ClosedLoop(Arm())


def test_the_motion_is_the_same_to_the_bit(loops, monkeypatch):
    one, other = loops
    references, ticks, tick = motion(one, 900), [], other.tick
    expected = one_by_one(one, references)
    monkeypatch.setattr(other, 'tick', lambda: ticks.append(0) or tick())
    assert np.array_equal(other.follow_all(references), expected)
    twists = [loop.controller.memory.twist for loop in loops]
    np.testing.assert_allclose(*twists, atol=1e-12)  # the sums have another order
    assert np.abs(twists[0]).max() > 0.01
    # Only the first of a motion is not one that goes on.
    assert len(ticks) == 1
    # Then both are lost, come to rest and hold.
    for _ in range(800):
        one.tick()
        tick()
    assert one.states.state is other.states.state is State.HOLDING
    assert np.array_equal(one.arm.data.qpos, other.arm.data.qpos)


def test_a_torque_that_is_not_finite_is_a_fault_as_ever(loops):
    for loop, follow in zip(loops, (one_by_one, ClosedLoop.follow_all)):
        references = motion(loop, 200)
        follow(loop, references[:100])
        loop.controller.memory.gains[:] = np.nan
        with pytest.raises(RefusedError):
            follow(loop, references[100:])
        assert loop.states.state is State.FAULT
        assert 'not finite' in loop.states.reason
    assert np.array_equal(loops[0].arm.data.qpos, loops[1].arm.data.qpos)


def test_an_unstable_simulation_is_told(loops):
    for loop, follow in zip(loops, (one_by_one, ClosedLoop.follow_all)):
        references = motion(loop, 200)
        follow(loop, references[:100])
        loop.arm.data.qvel[0] = 1e8
        with pytest.raises(DataError, match='unstable'):
            follow(loop, references[100:])


def test_a_warning_that_is_harmless_changes_nothing(loops):
    """Contacts that do not fit into memory, for example: MuJoCo counts them for ever."""
    one, other = loops
    references = motion(one, 300)
    harmless = next(k for k in range(len(other.arm.data.warning.number)) if k not in FATAL)
    other.arm.data.warning.number[harmless] = 1
    assert np.array_equal(other.follow_all(references), one_by_one(one, references))


@pytest.mark.parametrize('asked', [
    lambda loop: loop.arm.announce(Payload(1.0)),
    lambda loop: loop.controller.configure(ControllerSettings(damping_ratio=0.9)),
    lambda loop: loop.do(Request.REFILL),
    lambda loop: loop.driver.gripper.command(GripperCommand(0.02))],
    ids=['payload', 'settings', 'tank', 'gripper'])
def test_what_changes_is_left_to_the_controller(asked):
    arm, gripper = arm_with_gripper()
    loop = ClosedLoop(arm, gripper=gripper)
    loop.tick()
    assert only_goes_on(loop, loop.driver)
    asked(loop)
    assert not only_goes_on(loop, loop.driver)


def with_gripper():
    arm, gripper = arm_with_gripper()
    loop = ClosedLoop(arm, gripper=gripper)
    gripper.command(GripperCommand(0.03, 20.0))
    return loop


def pulled():
    loop = ClosedLoop(Arm())
    pose = loop.arm.measure().pose
    pose[:3] += [0.1, 0.05, -0.02]
    loop.driver.hand = Hand(pose, HandSettings(stiffness=200.0), 0.4)
    return loop


def with_payload():
    loop = ClosedLoop(Arm(plant=PlantSettings(payload=1.0)))
    loop.arm.announce(Payload(1.0))
    return loop


@pytest.mark.parametrize('make', [
    lambda: ClosedLoop(Arm(plant=REAL)),
    lambda: ClosedLoop(Arm(plant=PlantSettings(payload=0.5, delay=0.003))),
    with_gripper, pulled, with_payload], ids=['real', 'delay', 'gripper', 'hand', 'payload'])
def test_an_arm_that_is_not_its_model_moves_the_same(make):
    """Other masses, friction, noise and delay; fingers, a hand, something that is carried."""
    one, other = make(), make()
    for loop in (one, other):
        loop.tick()
        while not only_goes_on(loop, loop.driver):  # a payload is taken over in half a second
            loop.tick()
    # Each measures once, so that the noise is the same.
    references, _, ticks, tick = motion(one, 900), motion(other, 1), [], other.tick
    expected = one_by_one(one, references)
    other.tick = lambda: ticks.append(0) or tick()
    np.testing.assert_allclose(other.follow_all(references), expected, atol=1e-12)
    np.testing.assert_allclose(other.arm.data.qpos, one.arm.data.qpos, atol=1e-12)
    np.testing.assert_allclose(other.arm.data.ctrl, one.arm.data.ctrl, atol=1e-9)
    assert other.controller.tank.energy == pytest.approx(one.controller.tank.energy, abs=1e-12)
    assert len(ticks) == 1


def test_a_hand_lets_go_when_its_time_is_over():
    loop = pulled()
    applied = loop.arm.data.xfrc_applied[loop.arm.tool_body]
    references = motion(loop, 500)
    loop.follow_all(references[:300])
    assert loop.driver.hand.holds and np.abs(applied).max() > 1.0
    loop.follow_all(references[300:])
    assert not loop.driver.hand.holds and not applied.any()


def test_the_noise_of_the_encoders_has_the_size_that_was_set():
    arm = Arm(plant=PlantSettings(position_noise=1e-4, velocity_noise=3e-3))
    seen = [arm.measure() for _ in range(2000)]
    for name, true, size in (('position', arm.data.qpos, 1e-4), ('velocity', 0.0, 3e-3)):
        errors = np.array([getattr(one, name) for one in seen]) - true
        np.testing.assert_allclose(errors.std(axis=0), size, rtol=0.1)
        assert len(np.unique(errors, axis=0)) == 2000


def test_a_torque_acts_after_the_delay():
    arm = Arm(plant=PlantSettings(delay=0.002))
    held = arm.data.qfrc_bias.copy()
    acting = []
    for k in range(4):
        arm.act(np.full(7, float(k)))
        acting.append(arm.data.ctrl.copy())
    np.testing.assert_array_equal(acting, [held, held, np.zeros(7), np.ones(7)])


def compiled(loop, count):
    """Make ticks by kernels; how many of them Python had to make."""
    by_python = 0
    for _ in range(count):
        why = OTHER
        if only_goes_on(loop, loop.driver):
            why = plain_tick(robot_of(loop.driver), controller_of(loop), loop.driver.dt)
            loop.catch_up()
        if why == OTHER:
            loop.tick()
        elif why not in (MADE, CALLED):
            end_tick(loop, loop.driver, why)
        by_python += why not in (MADE, CALLED)
    return by_python


def move(loop):
    goal = loop.arm.home + [0.3, -0.2, 0.1, 0.2, -0.1, 0.2, 0.3]
    loop.do(Request.MOVE, PostureMotion(loop.joints, goal[None], 0.5))


def identify(loop):
    loop.do(Request.IDENTIFY, FrictionIdentification(loop.joints, loop.arm.chain, (0.5,), 0.3))


def move_and_stop(loop):
    move(loop)
    for _ in range(300):
        loop.tick()
    loop.do(Request.STOP)


def follow_joints_and_lose(loop):
    target = resting_joints(loop.arm.home, np.full(7, 200.0))
    target[10] = 0.2
    for k in range(300):
        target[3] = loop.arm.home[3] + 0.2e-3 * k
        loop.must_follow(target)
        loop.tick()


def follow_and_lose(loop):
    for reference in motion(loop, 300):
        loop.must_follow(reference)
        loop.tick()


@pytest.mark.parametrize('begin, state', [
    (move, State.MOVING), (identify, State.IDENTIFYING), (move_and_stop, State.STOPPING),
    (follow_and_lose, State.FOLLOWING), (follow_joints_and_lose, State.FOLLOWING),
    (lambda loop: loop.do(Request.GUIDE), State.GUIDED),
    (lambda loop: loop.do(Request.COMPLY), State.COMPLIANT),
    (lambda loop: loop.fail('broken'), State.FAULT)],
    ids=['posture', 'identification', 'braking', 'lost stream', 'lost joints', 'guided',
         'compliant', 'fault'])
def test_whatever_an_arm_does_is_the_same(loops, begin, state):
    """Python begins a motion of the joints, and is told when the state changes."""
    one, other = loops
    for loop in loops:
        for _ in range(3):
            loop.tick()
        begin(loop)
        assert loop.states.state is state
        loop.arm.data.qvel[:] += 0.02
    for _ in range(2500):
        one.tick()
    assert compiled(other, 2500) == (state in (State.MOVING, State.IDENTIFYING))
    assert other.states.state is one.states.state
    np.testing.assert_allclose(other.arm.data.qpos, one.arm.data.qpos, atol=1e-12)
    np.testing.assert_allclose(other.controller.memory.torque, one.controller.memory.torque,
                               atol=1e-9)
    assert other.controller.tank.energy == pytest.approx(one.controller.tank.energy, abs=1e-12)
    if one.joint_motion is not None:
        np.testing.assert_allclose(other.joint_motion.path.samples, one.joint_motion.path.samples,
                                   atol=1e-9)
    # Afterwards both follow alike: the guard knows where the arm is.
    for loop in loops:
        if state in (State.GUIDED, State.COMPLIANT, State.FAULT):
            loop.do(Request.RECOVER if state is State.FAULT else Request.STOP)
        elif loop.moves_joints:
            loop.do(Request.STOP)
            for _ in range(400):
                loop.tick()
    references = motion(one, 200)
    np.testing.assert_allclose(other.follow_all(references), one_by_one(one, references),
                               atol=1e-12)


def test_a_motion_that_is_held_ends_alike(loops):
    """A joint is stopped by more than its motor; kernels see it in the same tick."""
    ended = []
    for loop, go in zip(loops, (lambda loop: loop.tick(), lambda loop: compiled(loop, 1))):
        move(loop)
        loop.arm.model.dof_damping[0] = 3000.0
        ticks = 0
        while loop.moves_joints:
            go(loop)
            ticks += 1
        ended.append((ticks, loop.joint_motion_problem))
    assert ended[0] == ended[1]
    assert 'joint 1 is 0.2 rad from where it is to be' in ended[0][1]
