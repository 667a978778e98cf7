"""References of the joints: which are followed, how, and with how much energy."""
import numpy as np
import pytest

from experiments.energy_audit import Audit
from gdmp_ros.control.joint_spring import CATCH_UP
from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.limits import ENERGY, JOINT_POSITION, JOINT_SPEED
from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.settings import ControllerSettings, LimitSettings, TankSettings
from gdmp_ros.control.target import resting_target
from gdmp_ros.control.torque_limits import SPEED_MARGIN
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.sim.plant import REAL

SOFT = np.full(7, 200.0)


def loop_of(plant=None, **settings):
    loop = ClosedLoop(Arm(plant=plant), ControllerSettings(**settings))
    loop.tick()
    return loop


def posture(loop):
    return loop.arm.measure().position.copy()


def target_of(position, velocity=None, stiffness=SOFT):
    result = resting_joints(position, stiffness)
    if velocity is not None:
        result[7:14] = velocity
    return result


def swing(loop, amplitude, seconds=2.0, each=lambda tick: None):
    """Move all joints there and back; returns the errors."""
    home, errors = posture(loop), []
    for k in range(round(1000 * seconds)):
        t, w = 1e-3 * k, 2.0 * np.pi / seconds
        wanted = home + amplitude * 0.5 * (1.0 - np.cos(w * t))
        assert loop.follow(target_of(wanted, amplitude * 0.5 * w * np.sin(w * t))), (
            loop.controller.guard.last_refusal)
        tick = loop.tick()
        each(tick)
        errors.append(wanted - tick.measurement.position)
    return np.array(errors)


def test_a_motion_of_the_joints_is_followed():
    loop = loop_of()
    errors = swing(loop, np.full(7, 0.2))
    assert loop.controller.guard.mode is ArmMode.FOLLOW
    assert np.sqrt(np.mean(errors ** 2)) < 2e-3
    assert np.abs(errors).max() < 8e-3


def test_a_motion_that_is_too_fast_says_by_how_much():
    fastest, amplitude = 0.3, 0.2
    loop = loop_of(limits=LimitSettings(joint_speed=fastest))
    said = []
    swing(loop, np.full(7, amplitude), 1.0, lambda tick: said.append(tick.violation[JOINT_SPEED]))
    beyond = amplitude * np.pi - SPEED_MARGIN * fastest
    assert beyond < max(said) <= beyond + CATCH_UP


def test_a_motion_must_begin_near_the_joints_and_at_their_velocity():
    loop = loop_of()
    home, guard = posture(loop), loop.controller.guard
    far = home.copy()
    far[3] += 0.06
    assert not loop.follow(target_of(far))
    assert 'joint 4 begins 0.06 rad from the robot' in guard.last_refusal
    loop = loop_of()
    guard = loop.controller.guard
    assert not loop.follow(target_of(home, np.eye(7)[1]))
    assert 'joint 2 differs by 1 rad/s' in guard.last_refusal
    guard.arm()
    assert loop.follow(target_of(far))


@pytest.mark.parametrize(('change', 'reason'), [
    (lambda t: t.__setitem__(0, np.nan), 'NaN'), (lambda t: t.__setitem__(8, 30.0), '30 rad/s'),
    (lambda t: t.__setitem__(15, -1.0), 'stiffness of a joint is -1'),
    (lambda t: t.__setitem__(21, 5.0), 'damping ratio is 5')])
def test_numbers_that_cannot_be_followed_are_refused(change, reason):
    loop = loop_of()
    target = target_of(posture(loop))
    change(target)
    assert not loop.follow(target)
    assert reason in loop.controller.guard.last_refusal


def test_a_wrong_number_of_joints_is_refused():
    loop = loop_of()
    guard = loop.controller.guard
    assert not guard.offer(resting_joints(np.zeros(6), np.ones(6)), Origin(guard.settings.frame))
    assert 'a reference of 6 joints, the arm has 7' in guard.last_refusal


def test_a_stream_that_jumps_is_not_followed_and_one_that_ends_stops_the_arm():
    loop = loop_of()
    home, guard = posture(loop), loop.controller.guard
    for _ in range(10):
        assert loop.follow(target_of(home, 0.05 * np.eye(7)[0]))
        loop.tick()
    jumped = home.copy()
    jumped[0] += 0.2
    assert not loop.follow(target_of(jumped)) and 'joint 1 jumps by 0.2' in guard.last_refusal
    for _ in range(1500):
        last = loop.tick()
    assert guard.mode is ArmMode.HOLD and guard.in_joints
    assert np.abs(last.measurement.velocity).max() < 1e-3


def test_tool_and_joints_take_over_from_each_other_without_a_torque_step():
    loop = loop_of()
    guard, torques = loop.controller.guard, []
    for kind in ('tool', 'joints', 'tool', 'joints'):
        target = (target_of(posture(loop)) if kind == 'joints'
                  else resting_target(loop.arm.measure().pose.copy()))
        for _ in range(300):
            assert loop.follow(target), guard.last_refusal
            torques.append(loop.tick().torque)
        assert guard.in_joints == (kind == 'joints')
    assert np.abs(np.diff(torques, axis=0)).max() <= 0.951


def test_another_publisher_cannot_take_over_with_the_other_kind():
    loop = loop_of()
    guard = loop.controller.guard
    assert guard.offer(resting_target(loop.arm.measure().pose),
                       Origin(guard.settings.frame, sequence=1000))
    assert not guard.offer(target_of(posture(loop)),
                           Origin(guard.settings.frame, sequence=5_000_000))
    assert 'more than one publisher' in guard.last_refusal and not guard.in_joints


def test_a_stream_that_rests_is_never_begun_with():
    loop = loop_of()
    guard = loop.controller.guard
    assert not guard.offer(target_of(posture(loop)),
                           Origin(guard.settings.frame, mode=StreamMode.HOLDING))
    assert guard.refused == 0 and guard.mode is ArmMode.HOLD


@pytest.mark.parametrize('plant', [
    pytest.param(None, marks=pytest.mark.long), REAL], ids=['clean', 'real'])
def test_references_beyond_a_limit_keep_their_distance(plant):
    loop = loop_of(plant)
    home, violated = posture(loop), 0.0
    lower, upper = loop.arm.limits.lower, loop.arm.limits.upper
    nearest = np.inf
    for k in range(14000):
        far = k * 2e-4 < 2.6
        loop.follow(target_of(home + min(k * 2e-4, 2.6) * np.eye(7)[3], 0.2 * np.eye(7)[3] * far))
        tick = loop.tick()
        violated = max(violated, tick.violation[JOINT_POSITION])
        nearest = min(nearest, (upper - tick.measurement.position).min(),
                      (tick.measurement.position - lower).min())
    assert violated > 0.0 and nearest > 0.01


def test_a_growing_stiffness_and_a_moving_reference_take_their_energy_from_the_tank():
    """A hand holds the tool aside while reference and stiffness change; the tank is low."""
    loop = loop_of(tank=TankSettings(energy=0.2, recharge_power=0.0))
    home, rng, audit = posture(loop), np.random.default_rng(1), Audit(loop)
    limited, stiffness, wanted = 0.0, SOFT, home
    for k in range(6000):
        if k % 40 == 0:
            stiffness = rng.uniform(20.0, 1500.0, 7)
            wanted = home + rng.uniform(-0.04, 0.04, 7)
        loop.follow(target_of(wanted, stiffness=stiffness))
        loop.arm.push(np.array([0.0, 25.0 * np.sin(6e-3 * k), 10.0, 0.0, 0.0, 0.0]))
        tick = audit.tick()
        limited = max(limited, tick.violation[ENERGY])
    assert limited > 0.0
    assert min(audit.content) >= -0.01


def test_a_tool_that_is_let_go_is_slower_with_a_speed_limit():
    """Pushed until the wrist is at its torque limit; the motors need time to let go."""
    fastest = {}
    for limit in (1.6, 0.3):
        loop = loop_of(limits=LimitSettings(tool_speed=limit))
        home, speeds = posture(loop), []
        for k in range(3000):
            loop.follow(target_of(home, stiffness=np.full(7, 400.0)))
            loop.arm.push(np.array([0.0, 80.0 if k < 2000 else 0.0, 0.0, 0.0, 0.0, 0.0]))
            tick = loop.tick()
            speeds.append(np.linalg.norm(tick.twist[:3]))
        fastest[limit] = max(speeds[2000:])
    assert fastest[0.3] < 0.6 and fastest[1.6] > 1.2


def test_a_stiffness_decreases_no_faster_than_half_of_the_rate_of_the_torque():
    loop = loop_of(tank=TankSettings(passive=False))
    stiff, error = np.full(7, 1500.0), np.zeros(7)
    error[3] = 0.1
    begin = posture(loop)
    for _ in range(1500):
        loop.must_follow(target_of(begin, stiffness=stiff))
        loop.arm.data.qvel[:] = 0.0
        loop.tick()
    soft, pulls, stiffnesses = np.full(7, 20.0), [], []
    for _ in range(400):
        loop.arm.data.qpos[:], loop.arm.data.qvel[:] = begin - error, 0.0
        loop.must_follow(target_of(begin, stiffness=soft))
        loop.tick()
        stiffnesses.append(loop.controller.reference[14:21].copy())
        pulls.append(0.1 * stiffnesses[-1][3])
    rate = np.diff(pulls) / 1e-3
    assert -0.51 * 950.0 < rate.min() < -0.4 * 950.0
    # One that pulls at nothing is as soft at once as the rate of a stiffness allows.
    assert stiffnesses[-1][0] == pytest.approx(20.0) and stiffnesses[100][0] < stiffnesses[100][3]


@pytest.mark.parametrize('joint, velocity', [(1, -1.8), (2, 2.0), (3, 1.8)])
def test_an_fr3_slows_down_near_the_limits_of_its_joints_as_the_robot_asks(joint, velocity):
    """The speed that libfranka allows, by its own formula and numbers; the rows keep a tenth."""
    offset = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])
    deceleration = np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])
    loop = ClosedLoop(Arm('fr3'))
    loop.tick()
    begin, limits, unit = posture(loop), loop.arm.limits, np.eye(7)[joint]
    fastest, nearest = 0.0, np.inf
    loop.controller.guard.arm()
    for k in range(4000):
        wanted = begin + min(1e-3 * k * velocity, 4.0) * unit
        rate = min(1e-2 * k, 1.0) * velocity * unit
        wanted[joint] = np.clip(wanted[joint], limits.lower[joint], limits.upper[joint])
        loop.follow(target_of(wanted, rate, np.full(7, 400.0)))
        measured = loop.tick().measurement
        away = (limits.upper - measured.position if velocity > 0.0
                else measured.position - limits.lower)[joint]
        allowed = np.sqrt(2.0 * deceleration[joint] * max(away, 0.0)) - offset[joint]
        speed = measured.velocity[joint] * np.sign(velocity)
        assert speed < max(allowed, 0.0) + 0.02, (away, speed)
        fastest, nearest = max(fastest, speed), min(nearest, away)
    assert fastest > 1.0 and nearest < 0.2
