"""An arm that takes joint positions gives way to what a sensor at its wrist measures; lockstep."""
from dataclasses import replace
import subprocess
import sys

import mink
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from experiments.position_trial import (
    circle,
    CYCLE,
    DEPTH,
    FAST,
    given,
    letter,
    lost,
    press,
    push,
    resting,
    SLOW,
    TABLE_STIFFNESS,
    Trial,
    whole_delay,
)
from gdmp_ros.control.admittance import DAMPING_SHARE
from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.plain_tick import controller_of, MADE
from gdmp_ros.control.servo import AHEAD_ACCELERATION, remember, ServoState, write_measured
from gdmp_ros.control.settings import ControllerSettings, LimitSettings, TankSettings
from gdmp_ros.control.surroundings import depths
from gdmp_ros.control.target import POSE, resting_target
from gdmp_ros.ros.messages import ROBOT_STATE_FIXED, robot_state_numbers
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.sim.position_tick import plain_tick, view_of, write_arm
from gdmp_ros.sim.servo_arm import ServoSettings
from gdmp_ros.util.profiles import minimum_jerk

#: Whole delays of two arms.
DELAYS, IDS = [FAST, SLOW], ['8 ms', '36 ms']


@pytest.mark.parametrize('stiffness', [300.0, 800.0])
@pytest.mark.parametrize('settings', DELAYS, ids=IDS)
@pytest.mark.parametrize('model', ['ur5e', 'xarm7'])
def test_in_free_space_it_is_where_its_reference_is(model, settings, stiffness):
    trial = Trial(settings, model=model)
    references = circle(trial.pose, stiffness)
    rows = trial.follow(references)
    errors = np.linalg.norm(rows[:, :3] - references[:, :3], axis=1)
    assert np.sqrt((errors ** 2).mean()) < 1e-3
    # The whole delay is measured while it moves.
    assert trial.driver.delay == pytest.approx(whole_delay(settings), abs=1e-3)
    # What hangs at the sensor, 1 kg or 10 N, is no force of the world; the noise is 0.3 N.
    assert np.abs(rows[250:, 8:11]).max() < 1.5


@pytest.mark.parametrize('stiffness', [300.0, 800.0])
@pytest.mark.parametrize('settings', DELAYS, ids=IDS)
def test_it_follows_a_letter_whose_goal_is_switched(settings, stiffness):
    trial = Trial(settings)
    references = letter(trial.pose, stiffness)
    errors = np.linalg.norm(trial.follow(references)[:, :3] - references[:, :3], axis=1)
    assert np.sqrt((errors ** 2).mean()) < 1e-3 and errors[-1] < 1e-3


def test_a_late_tick_leaves_no_gap_in_what_is_remembered():
    rows, time = np.zeros((9, 2)), 0
    for cycles in (1, 1, 3, 1, 2, 4, 1, 1, 20, 1):
        time += cycles
        remember(rows, time * np.array([1.0, -2.0]), cycles)
        wanted = np.maximum(time - np.arange(9), 0)
        np.testing.assert_allclose(rows, wanted[:, None] * [1.0, -2.0], atol=1e-12)


@pytest.mark.parametrize('settings', DELAYS, ids=IDS)
def test_ticks_that_are_late_do_not_disturb_the_measured_delay(settings, rng):
    """A sixth of the ticks is up to 8 ms late; then one tick passes the time of all."""
    trial = Trial(settings)
    loop, servo, driver = trial.loop, trial.servo, trial.driver
    references, errors, k = circle(trial.pose, 800.0, 16.0), [], 0
    while k < len(references):
        cycles = int(rng.integers(2, 5)) if rng.random() < 1.0 / 6.0 else 1
        k = min(k + cycles, len(references))
        driver.dt = cycles * CYCLE
        loop.must_follow(references[k - 1])
        loop.answer(loop.wait())
        servo.advance(cycles * round(CYCLE / servo.arm.period))
        errors.append(np.linalg.norm(trial.pose[:3] - references[k - 1, :3]))
    # The next command is due after a cycle: on average it has been there for longer.
    assert driver.delay == pytest.approx(whole_delay(settings), abs=2.5e-3)
    assert np.sqrt(np.mean(np.square(errors))) < 1e-3


def test_a_compiled_tick_is_the_same():
    """With a table, so that all parts of the tick matter."""
    trials = Trial(FAST), Trial(FAST)
    for trial in trials:
        trial.loop.tick()
        trial.table = trial.pose[2] - 0.002
    references = circle(trials[0].pose, 300.0)[:1200]
    references[:, POSE + 2] -= 0.01 * minimum_jerk(np.linspace(0.0, 1.0, len(references)))
    compiled, driver, made = trials[1].loop, trials[1].driver, 0
    state = np.zeros(ROBOT_STATE_FIXED + 36)
    for reference in references:
        trials[0].loop.must_follow(reference)
        tick = trials[0].driver.reported(trials[0].loop.tick())
        compiled.must_follow(reference)
        if compiled.only_goes_on:
            write_measured(driver.servo, driver.link.read())
            view, controller = view_of(driver), controller_of(compiled)
            assert plain_tick(view, controller) == MADE
            driver.link.send(*driver.servo.command)
            trials[1].servo.advance()
            trials[1].servo.advance()
            write_arm(view, controller, state)
            made += 1
            expected = robot_state_numbers(tick)
            joints = slice(ROBOT_STATE_FIXED, ROBOT_STATE_FIXED + 18)
            for part in slice(19), slice(91, 93), joints:  # motion, energies
                np.testing.assert_allclose(state[part], expected[part], atol=1e-9)
        else:
            compiled.tick()
        np.testing.assert_allclose(driver.servo.command, trials[0].driver.servo.command,
                                   atol=1e-9)
    assert made > 1190 and trials[1].force > 1.0


class Judge:
    """The differential inverse kinematics of mink, with the limits of the joints."""

    def __init__(self, model, posture):
        self.state, self.task = mink.Configuration(model, posture), mink.FrameTask(
            'tcp', 'site', position_cost=1.0, orientation_cost=1.0)
        self.limits = [mink.ConfigurationLimit(model)]

    def follow(self, poses):
        """Track poses; the posture at the end, and how far its tool is from the last one [m]."""
        for pose in poses:
            self.task.set_target(mink.SE3(np.concatenate([pose[3:7], pose[:3]])))
            self.state.integrate_inplace(mink.solve_ik(
                self.state, [self.task], 0.01, 'daqp', limits=self.limits), 0.01)
        return self.state.q.copy(), np.linalg.norm(self.task.compute_error(self.state)[:3])


@pytest.mark.parametrize('model', ['ur5e', 'xarm7'])
def test_where_another_solver_gets_its_joints_get_too(model, rng):
    trial = Trial(FAST, model=model)
    arm, goals = trial.servo.arm, 0
    home, judge = trial.pose, Judge(arm.known.model, arm.home)
    for _ in range(6):
        there = arm.pose_at(arm.home + rng.uniform(-0.5, 0.5, len(arm.home)))
        turns = Slerp([0.0, 1.0], Rotation.from_quat([home[3:], there[3:]], scalar_first=True))
        shares = minimum_jerk(np.linspace(0.0, 1.0, 1000))
        shares = np.concatenate([shares, np.ones(500), shares[::-1]])
        references = resting(home, 800.0, len(shares) * CYCLE)
        references[:, :3] += shares[:, None] * (there[:3] - home[:3])
        references[:, 3:7] = turns(shares).as_quat(scalar_first=True)
        posture, missed = judge.follow(references[:1500])
        if missed < 1e-3:
            goals += 1
            assert np.linalg.norm(trial.follow(references[:1500])[-1, :3] - there[:3]) < 1e-3
            now = trial.servo.read().position
            assert ((arm.limits.lower < now) & (now < arm.limits.upper)).all()
            if model == 'ur5e':  # with six joints there is one solution on each branch
                np.testing.assert_allclose(now, posture, atol=0.01)
            trial.follow(references[1500:])
        judge.follow(references[1500:])
    assert goals >= 4


@pytest.mark.parametrize(('settings', 'stiffness', 'speed', 'model'), [
    (FAST, 300.0, 0.05, 'ur5e'), (SLOW, 300.0, 0.01, 'ur5e'),
    (FAST, 300.0, 0.05, 'xarm7')])  # others: `experiments limits position-arm`
def test_pressed_on_a_hard_table_it_stays_in_contact(settings, stiffness, speed, model):
    trial = Trial(settings, model=model)
    forces = press(trial, stiffness, speed)
    damping = DAMPING_SHARE * TABLE_STIFFNESS * trial.driver.delay
    assert 1.5 < damping / (TABLE_STIFFNESS * whole_delay(settings)) < 2.2
    assert forces.max() < 1.4 * (stiffness * DEPTH + damping * speed)
    if settings is FAST and stiffness == 300.0:
        assert forces.max() < 35.0
    assert lost(forces) == 0
    expected = stiffness * DEPTH * TABLE_STIFFNESS / (stiffness + TABLE_STIFFNESS)
    assert forces[-150:].mean() == pytest.approx(expected, rel=0.1)
    assert trial.loop.controller.tank.energy > 0.0


@pytest.mark.parametrize(('settings', 'speed', 'hard'), [
    (FAST, 0.05, 20_000.0), (FAST, 0.05, 35_000.0), (SLOW, 0.01, 20_000.0)])
def test_a_table_that_it_was_not_told_is_touched_as_well(settings, speed, hard):
    """Told are 30 kN/m and 20 ms."""
    trial = Trial(settings)
    trial.table_stiffness = hard
    forces = press(trial, 300.0, speed)
    damping = DAMPING_SHARE * TABLE_STIFFNESS * trial.driver.delay
    assert forces.max() < 1.4 * (300.0 * DEPTH + damping * speed) and lost(forces) == 0
    assert forces[-150:].mean() == pytest.approx(300.0 * DEPTH * hard / (300.0 + hard), rel=0.1)


def test_without_its_damping_it_would_chatter():
    trial = Trial(FAST)
    trial.driver.scalars.damping = 0.0
    home = trial.pose
    trial.table = home[2] - 0.001
    down = resting(home, 300.0, 3.0)
    down[:, POSE + 2] = np.maximum(home[2] - 0.005 * CYCLE * np.arange(len(down)),
                                   trial.table - DEPTH)
    forces = trial.follow(down)[:, 7]
    assert (forces[-500:] == 0.0).mean() > 0.2


@pytest.mark.parametrize('stiffness', [300.0, 800.0])
@pytest.mark.parametrize('settings', DELAYS, ids=IDS)
def test_a_hand_moves_it_by_its_force_over_the_stiffness(settings, stiffness):
    trial = Trial(settings)
    trial.follow(circle(trial.pose, stiffness)[:1000])  # its delay is measured
    trial = Trial(settings, servo_delay=trial.driver.delay)
    home = trial.pose
    assert push(trial, stiffness) == pytest.approx(1.0, rel=0.1)
    damping = DAMPING_SHARE * TABLE_STIFFNESS * trial.driver.delay
    rows = trial.follow(resting(home, stiffness, 6.0 * damping / stiffness))
    assert np.linalg.norm(rows[-1, :3] - home[:3]) < 2e-3


@pytest.mark.parametrize(('settings', 'share'), [
    (FAST, DAMPING_SHARE), (SLOW, DAMPING_SHARE), (FAST, 0.0)],
    ids=['8 ms', '36 ms', 'chattering'])
def test_what_it_gives_to_the_world_comes_from_the_tank(rng, settings, share):
    """The book at the true port, where the arm is behind the virtual one."""
    trial = Trial(settings, TankSettings(recharge_power=0.0))
    trial.driver.scalars.damping = share
    # Chattering, the force changes much between two samples of it.
    assert given(trial, rng) < (0.01 if share else 0.03)
    assert trial.loop.controller.tank.energy > -0.01


class Broken:
    """A link whose states are changed."""

    def __init__(self, servo):
        self.servo, self.cycle, self.change, self.sent = servo, servo.cycle, lambda s: s, []

    def read(self):
        return self.change(self.servo.read())

    def send(self, position, velocity):
        self.sent.append(position.copy())
        self.servo.send(position, velocity)


def not_finite(state):
    return state._replace(wrench=np.full(6, np.nan))


def saturated(state):
    return state._replace(wrench=np.array([0.0, 0.0, 101.0, 0.0, 0.0, 0.0]))


def twisted(state):
    return state._replace(wrench=np.array([0.0, 0.0, 0.0, 10.1, 0.0, 0.0]))


def nowhere(state):
    return state._replace(position=state.position * np.nan)


def silent(state):
    return state._replace(wrench_age=0.2)


def gone(state):
    return state._replace(age=0.3)


def elsewhere(state):
    return state._replace(position=state.position + [0.0, 0.0, 0.2, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(('change', 'reason'), [
    (not_finite, 'the measured wrench is not finite'),
    (saturated, 'the sensor is saturated: 101 N, its range is 100 N'),
    (twisted, 'the sensor is saturated: 10.1 Nm, its range is 10 Nm'),
    (nowhere, 'the measured joints are not finite'),
    (silent, 'no measured wrench for 0.2 s'), (gone, 'no measured joints for 0.3 s'),
    (elsewhere, 'joint 3 is 0.2 rad from where its command leads')])
@pytest.mark.parametrize('settings', DELAYS, ids=IDS)
def test_what_it_cannot_trust_stops_it_with_the_reason(settings, change, reason):
    trial = Trial(settings)
    link = trial.driver.link = Broken(trial.servo)
    trial.follow(circle(trial.pose, 300.0)[:700])
    link.change, states = change, trial.loop.states
    for _ in range(200):
        trial.loop.tick()
    assert states.state is State.FAULT and reason in states.reason
    # It brakes: neither a step, nor a jerk of the commands.
    speed = np.diff(np.array(link.sent), axis=0) / CYCLE
    assert np.abs(np.diff(speed, axis=0)).max() / CYCLE < 12.0
    assert np.abs(speed[-1]).max() == 0.0 and len(speed) < 850
    link.change = lambda state: state
    trial.loop.do(Request.RECOVER)
    assert states.state is State.HOLDING
    trial.loop.do(Request.ARM)
    trial.follow(resting(trial.pose, 300.0, 0.5))


def test_a_delay_that_its_damping_is_not_made_for_stops_it():
    trial = Trial(ServoSettings(delay=0.08), servo_delay_max=0.05)
    with pytest.raises(Exception, match='does not follow|FAULT|fault'):
        trial.follow(circle(trial.pose, 300.0))
    assert 'ms behind its commands, expected at most 50 ms' in trial.loop.states.reason
    tick(trial.loop, 0.5)
    trial.loop.do(Request.RECOVER)
    tick(trial.loop, 0.5)
    assert trial.loop.states.state is State.HOLDING


@pytest.mark.parametrize(('payload', 'wrench', 'why'), [
    (1.0, 1.0, 'set payload_mass to 0'), (1.0, -1.0, 'is the sign of the wrench wrong'),
    (0.0, 1.0, 'is the payload another one'), (1.0, 0.0, '')])
def test_a_weight_that_is_not_the_payload_is_told(payload, wrench, why):
    """The driver subtracts it, too; the sensor has another sign; it was not told; all is well."""
    trial = Trial(FAST)
    driver, hand = trial.driver, trial.servo.hand
    driver.carry(replace(hand, mass=payload * hand.mass))
    read, weight = trial.servo.read, 9.81 * hand.mass

    def changed():
        state = read()
        if wrench < 0.0:
            return state._replace(wrench=-state.wrench)
        taken = state.wrench.copy()
        if payload and wrench:
            taken[:3] *= 1.0 - weight / np.linalg.norm(taken[:3])
            taken[3:] = 0.0
        return state._replace(wrench=taken)
    tick(trial.loop, 0.05)  # the sensor begins with the first period
    trial.servo.read = changed
    driver.measure()
    doubt = driver.weight_doubt()
    assert why in doubt and bool(why) == bool(doubt)


def test_without_a_sensor_it_follows_stiffly():
    trial = Trial(FAST)
    read = trial.servo.read
    trial.servo.read = lambda: ServoState(*read()[:2])
    trial.hand = np.array([0.0, 20.0, 0.0])
    references = circle(trial.pose, 300.0)
    rows = trial.follow(references)
    errors = np.linalg.norm(rows[:, :3] - references[:, :3], axis=1)
    assert np.sqrt((errors ** 2).mean()) < 1e-3


def test_beside_a_singular_posture_it_does_not_shake_its_tool():
    """Straight above the base the reference jerks: the sensor feels the tool that it shakes."""
    trial = Trial(FAST)
    home, felt, named = trial.pose, [], set()
    for k in range(3000):
        target = resting_target(home)
        share = minimum_jerk(np.array([min(k / 1500.0, 1.0)]))
        target[:3] += share * ([0.0, 0.1, 1.3] - home[:3])
        trial.loop.must_follow(target)
        trial.loop.tick()
        felt.append(np.linalg.norm(trial.driver.wrench[:3]))
        named.add(trial.loop.controller.blocked)
    assert 'a singularity' in named
    # Mass times the acceleration that is sent ahead; the levers of all joints are 4 m together.
    assert max(felt[100:]) < 4.0 * 1.0 * AHEAD_ACCELERATION


@pytest.mark.parametrize('settings', [FAST, SLOW], ids=['8 ms', '36 ms'])
def test_its_links_keep_away_from_what_is_around(settings):
    trial, margin = Trial(settings), 0.02
    home, arm = trial.pose, trial.servo.arm
    wall = Scene([Volume('wall', 'box', (1.0, 0.04, 2.0), np.array(
        [home[0], home[1] + 0.25, 0.5, 1.0, 0.0, 0.0, 0.0]))], margin)
    trial.loop.controller.surround(wall)
    references = resting(home, 500.0, 4.0)
    references[:, 1] += 0.4 * minimum_jerk(np.clip(np.linspace(0.0, 2.0, len(references)), 0, 1))
    for k, reference in enumerate(references):
        trial.loop.must_follow(reference)
        trial.loop.tick()
        if k % 10 == 0:
            assert depths(arm.chain, arm.shape, trial.servo.read().position.copy(),
                          wall.packed()).max() < 0.0
    assert trial.loop.controller.blocked.startswith('wall (')


@pytest.mark.parametrize('cycle', [0.004, 0.01], ids=['250 Hz', '100 Hz'])
def test_it_follows_at_the_rate_of_its_controller(cycle):
    settings = ServoSettings(delay=0.01, lag=0.002, cycle=cycle)
    trial = Trial(settings)
    references = circle(trial.pose, 800.0, cycle=cycle)
    rows = trial.follow(references)
    errors = np.linalg.norm(rows[:, :3] - references[:, :3], axis=1)
    assert np.sqrt((errors ** 2).mean()) < 2e-3 and errors[-1] < 1e-3
    assert trial.driver.delay == pytest.approx(whole_delay(settings), abs=2e-3)


@pytest.mark.parametrize('settings', DELAYS, ids=IDS)
def test_when_its_references_end_it_slows_down_and_holds(settings):
    trial = Trial(settings)
    trial.follow(circle(trial.pose, 800.0)[:1000])
    places = []
    for _ in range(round(1.0 / CYCLE)):
        trial.loop.tick()
        places.append(trial.pose[:3])
    assert trial.loop.states.state is State.HOLDING
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / CYCLE
    assert speed[0] > 0.1 and speed[-1] < 1e-3
    assert np.abs(np.diff(speed)).max() / CYCLE < 5.0


@pytest.mark.parametrize('settings', DELAYS, ids=IDS)
def test_it_stays_within_its_workspace(settings):
    trial = Trial(settings)
    home, low = trial.pose, trial.pose[2] - 0.05
    limits = replace(LimitSettings(), workspace_min=(-2.0, -2.0, low))
    trial.loop.controller.configure(ControllerSettings(limits=limits))
    references = resting(home, 800.0, 6.0)
    references[:, POSE + 2] -= 0.15 * minimum_jerk(
        np.clip(np.linspace(0.0, 2.0, len(references)), 0.0, 1.0))
    rows = trial.follow(references)
    assert rows[:, 2].min() > low - 2e-3 and rows[-1, 2] < low + 2e-3


def test_it_does_what_other_arms_do():
    trial = Trial(FAST)
    loop, states = trial.loop, trial.loop.states
    trial.follow(resting(trial.pose, 300.0, 0.3))
    for request, seconds in ((Request.STOP, 0.6), (Request.GUIDE, 0.1)):
        loop.do(request)
        tick(loop, seconds)
    assert states.state is State.GUIDED
    before, trial.hand = trial.pose, np.array([0.0, 15.0, 0.0])
    tick(loop, 2.0)
    assert trial.pose[1] - before[1] > 0.03
    before, trial.hand = trial.pose, np.zeros(3)
    tick(loop, 1.0)
    assert np.linalg.norm((trial.pose - before)[:3]) < 2e-3  # it stays where it was left
    loop.do(Request.STOP)
    tick(loop, 0.6)
    goal = trial.servo.arm.data.qpos + [0.3, 0.0, 0.0, 0.0, -0.2, 0.0]
    loop.do(Request.MOVE, PostureMotion(loop.joints, goal[None], 0.3))
    tick(loop, 4.0)
    assert states.state is State.HOLDING and not loop.joint_motion_problem
    assert np.abs(trial.servo.arm.data.qpos - goal).max() < 1e-3


def tick(loop, seconds):
    for _ in range(round(seconds / CYCLE)):
        loop.tick()


LATE = """
from numba.core import dispatcher
from experiments.position_trial import FAST, resting, Trial
trial, late = Trial(FAST), []
trial.loop.warm_up(trial.driver._measure(), 0.002)
load = dispatcher._DispatcherBase._compile_for_args
dispatcher._DispatcherBase._compile_for_args = lambda kernel, *types, **named: (
    late.append(kernel.py_func.__name__) or load(kernel, *types, **named))
for reference in resting(trial.pose, 300.0, 0.01):
    trial.loop.must_follow(reference)
    measured = trial.loop.wait()
    trial.loop.answer(measured)
print(*late)
"""


def test_no_kernel_is_loaded_when_a_motion_begins():
    """To load one takes 30 ms: the arm would stop."""
    done = subprocess.run([sys.executable, '-c', LATE], capture_output=True, text=True, check=True)
    assert done.stdout == '\n'
