"""Every limit is kept, and counted with its excess."""
from dataclasses import replace
import functools

import mujoco
import numpy as np
import pytest

from gdmp_ros.control import limits
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.settings import (
    GuardSettings,
    LimitSettings,
    TankSettings,
)
from gdmp_ros.control.singularity import ROTATION_LENGTH, singular_rate, singular_value
from gdmp_ros.control.stiffness import bound_stiffness, diagonal_bounds
from gdmp_ros.control.target import HOLD_STIFFNESS, STIFFNESS, TARGET_SIZE
from gdmp_ros.control.torque_limits import relief_of, TorqueLimiter
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import UnitQuaternion
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.sim.arm import Arm
from test.control.plants import CLEAN, on_every_plant, on_plants

DT = 1e-3
ANYWHERE = GuardSettings(jump_position=10.0, jump_rotation=10.0, arming_position=10.0,
                         arming_rotation=10.0, arming_speed=100.0, arming_angular_speed=100.0)
S3 = UnitQuaternion()


def loop_with(plant=CLEAN, **changes):
    return plant.loop(guard=ANYWHERE, limits=LimitSettings(**changes))


@functools.cache
def home():
    """Pose of the tool in the initial posture; a model takes milliseconds to load."""
    return Arm().measure().pose.copy()


def reference(loop, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0),
              stiffness=HOLD_STIFFNESS):
    target = np.zeros(TARGET_SIZE)
    pose = home()
    target[:3] = pose[:3] + shift
    target[3:7] = S3.exp(pose[3:].copy(), 0.5 * np.asarray(turn))
    target[7:10] = velocity
    target[STIFFNESS:STIFFNESS + 36], target[-1] = stiffness.reshape(-1), 0.7
    return target


def run(loop, targets):
    """Follow references; what happened at every tick, and the follower's own reference."""
    ticks, followed = [], []
    for target in targets:
        assert loop.follow(target), loop.controller.guard.last_refusal
        ticks.append(loop.tick())
        followed.append(loop.controller.reference[:13])
    return ticks, np.array(followed)


def most(ticks, which):
    return max(tick.violation[which] for tick in ticks)


@on_every_plant
def test_a_reference_inside_the_limits_is_followed_to_rounding_and_no_limit_is_active(plant):
    loop, given = loop_with(plant), []
    for u in np.arange(0.0, 1.0, DT / 2.0):
        given.append(reference(loop, (0, 0.2 * u ** 3 * (10 - u * (15 - 6 * u)), 0),
                               velocity=(0, 3.0 * u ** 2 * (1 - u) ** 2, 0)))
        given[-1][14] = 3.0 * u * (1 - u) * (1 - 2 * u)
    ticks, followed = run(loop, given)
    np.testing.assert_allclose(followed[:, :3], [g[:3] for g in given],
                               atol=1e-6 if plant is CLEAN else 1e-4)
    assert not np.any([tick.violation for tick in ticks])
    assert loop.controller.counters.recent() == ''


@on_every_plant
def test_a_distant_reference_is_caught_up_with_inside_speed_and_acceleration(plant):
    loop = loop_with(plant, catch_up_speed=0.2, acceleration=2.0)
    ticks, followed = run(loop, [reference(loop, (0.15, 0, 0), (0.6, 0, 0))] * 3000)
    speed = np.linalg.norm(np.diff(followed[:, :3], axis=0), axis=1) / DT
    assert 0.19 < speed.max() < 0.2 * 1.001
    assert np.abs(np.diff(speed)).max() < 2.0 * DT * 1.001
    assert followed[:, 0].max() <= 0.15 + home()[0] + 1e-6  # no overshoot
    # The posture of the null space pulls a little.
    np.testing.assert_allclose(followed[-1, :7], reference(loop, (0.15, 0, 0), (0.6, 0, 0))[:7],
                               atol=2e-5)
    assert most(ticks, limits.ACCELERATION_LIMIT) > 0.0


@on_every_plant
@pytest.mark.parametrize('index, name, limit, factor', [
    (limits.SPEED, 'speed', 0.1, 3.0), (limits.ACCELERATION_LIMIT, 'acceleration', 1.0, 3.0)])
def test_a_fast_reference_is_slowed_down(index, name, limit, factor, plant):
    loop = loop_with(plant, **{name: limit})
    velocity = 0.3
    given = [reference(loop, (0, velocity * k * DT, 0), velocity=(0, velocity, 0))
             for k in range(600)]
    ticks, followed = run(loop, given)
    speed = followed[:, 8]
    assert most(ticks, index) > 0.0
    if name == 'speed':
        assert np.abs(speed).max() <= limit + 1e-9
        assert most(ticks, index) == pytest.approx(velocity + 0.25 - limit, rel=0.2)
    else:
        assert np.abs(np.diff(speed)).max() <= limit * DT + 1e-9


@on_every_plant
def test_rotations_are_slowed_down(plant):
    loop = loop_with(plant, angular_speed=0.3, angular_acceleration=2.0)
    ticks, followed = run(loop, [reference(loop, turn=(0.5, 0, 0))] * 1500)
    rate = np.linalg.norm(followed[:, 10:13], axis=1)
    assert rate.max() <= 0.3 + 1e-9 and np.abs(np.diff(rate)).max() <= 2.0 * DT + 1e-9
    assert most(ticks, limits.ANGULAR_SPEED) > 0.0
    assert most(ticks, limits.ANGULAR_ACCELERATION) > 0.0


@on_every_plant
def test_references_outside_the_workspace_are_held_at_its_wall(plant):
    loop = loop_with(plant, workspace_max=(0.35, 1.0, 1.3))
    ticks, followed = run(loop, [reference(loop, (0.1, 0.05, 0), velocity=(0.02, 0, 0))] * 1500)
    assert followed[:, 0].max() <= 0.35 + 1e-9
    assert followed[-1, 1] == pytest.approx(0.05, abs=1e-3)
    assert most(ticks, limits.WORKSPACE) == pytest.approx(home()[0] + 0.1 - 0.35,
                                                          abs=1e-6)


@on_plants('clean', 'real')  # an unannounced payload sinks
def test_a_smaller_workspace_moves_nothing_and_the_next_motion_goes_inwards(plant):
    loop = loop_with(plant)
    home = run(loop, [reference(loop)] * 3000)[0][-1].measurement.pose
    changed = replace(loop.controller.settings, limits=LimitSettings(
        workspace_max=(home[0] - 0.1, 1.0, 1.3)))
    loop.controller.configure(changed)
    ticks, followed = run(loop, [reference(loop)] * 1500)
    away = np.array([tick.measurement.pose[:3] - home[:3] for tick in ticks])
    assert np.abs(away).max() < 0.001
    assert ticks[-1].violation[limits.WORKSPACE] == pytest.approx(0.1, abs=0.005)
    # Sideways and inwards it goes, outwards it does not, and what was left is closed.
    for shift, expected in (((0.05, 0.1, 0.0), (0.0, 0.1)), ((-0.05, 0.1, 0.0), (-0.05, 0.1)),
                            ((0.05, 0.1, 0.0), (-0.05, 0.1)), ((-0.2, 0.1, 0.0), (-0.2, 0.1)),
                            ((0.05, 0.1, 0.0), (-0.1, 0.1))):
        target = reference(loop)
        target[:3] = home[:3] + shift
        _, followed = run(loop, [target] * 3000)
        np.testing.assert_allclose(followed[-1, :2] - home[:2], expected, atol=0.005)


@on_plants('clean', 'real')  # an unannounced payload sinks
def test_another_zone_of_repulsion_moves_nothing(plant):
    """With a margin of 1 rad joints are inside of it where they rest."""
    loop = loop_with(plant)
    for _ in range(3000):
        before = loop.tick().measurement
    for settings in ({'joint_margin': 1.0, 'joint_repulsion': 50.0}, {'joint_margin': 1.0},
                     {'joint_margin': 1.0, 'joint_repulsion': 20.0}):
        loop.controller.configure(replace(loop.controller.settings,
                                          limits=LimitSettings(**settings)))
        for _ in range(1500):
            tick = loop.tick()
        assert np.abs(tick.measurement.pose[:3] - before.pose[:3]).max() < 0.001
        assert tick.violation[limits.JOINT_POSITION] > 0.1


def test_repulsion_that_was_kept_back_acts_when_a_joint_returns():
    joints = JointLimits(np.full(2, -1.0), np.full(2, 1.0), np.full(2, 50.0))
    position, relief = np.array([0.5, -0.5]), np.zeros(2)
    relief[:] = relief_of(position, joints, LimitSettings(), LimitSettings(
        joint_margin=1.0, joint_repulsion=50.0), relief)
    made, still = limiter(torque_slew=1e6, joint_margin=1.0, joint_repulsion=50.0), np.zeros(2)
    made._relief[:] = relief

    def pushed(first):
        return made.apply(np.array([first, 0.0]), still, LIGHT, still, still, DT,
                          np.zeros(len(limits.LIMITS)))[0]
    assert pushed(0.5) == 0.0 and pushed(0.6) == pytest.approx(-0.25)
    assert pushed(0.52) == pytest.approx(-0.05)
    assert pushed(0.4) == 0.0 and pushed(0.42) == pytest.approx(-0.05)
    assert pushed(0.0) == 0.0 and pushed(0.05) == pytest.approx(-0.125)


@on_plants('clean', 'real')  # an unannounced payload needs the law
@pytest.mark.parametrize('share', [0.2, 0.01])
def test_a_small_share_of_the_torque_drops_nothing(plant, share, rng):
    """Gravity alone needs a quarter of it here, and up to 0.65 in other postures."""
    for away in [np.zeros(7), *rng.uniform(-0.5, 0.5, (3, 7))]:
        loop = loop_with(plant, torque_share=share)
        loop.reset(loop.arm.data.qpos[:7] + away)
        before = loop.arm.measure().pose
        for _ in range(1500):
            tick = loop.tick()
        away = np.linalg.norm(tick.measurement.pose[:3] - before[:3])
        assert away < 0.001 + plant.slack()


@on_every_plant
@pytest.mark.parametrize('speed', [0.5, 2.0])
def test_joints_that_move_to_a_posture_keep_the_speed_of_the_tool(plant, speed):
    loop = loop_with(plant, tool_speed=0.25)
    goal = loop.arm.home + [0.8, -0.5, -0.6, 0.6, 0.3, 0.5, 0.5]
    loop.move(PostureMotion(loop.joints, goal[None], speed))
    fastest = 0.0
    while loop.moves_joints:
        tick = loop.tick()
        fastest = max(fastest, np.linalg.norm(tick.twist[:3]))
    assert not loop.joint_motion_problem and fastest <= 1.05 * 0.25
    np.testing.assert_allclose(tick.measurement.position, goal, atol=0.05)


def test_stiffness_stays_between_its_bounds_in_every_direction(rng):
    bounds = diagonal_bounds((100.0, 10.0), (800.0, 60.0))
    for _ in range(50):
        factor = rng.standard_normal((3, 3)) * np.exp(rng.uniform(0, 3.5))
        wanted = np.zeros((6, 6))
        wanted[:3, :3], wanted[3:, 3:] = factor @ factor.T, 0.1 * factor.T @ factor
        wanted += 1e-3 * np.eye(6)
        bounded, excess = wanted.reshape(-1).copy(), np.zeros(15)
        bound_stiffness(bounded, bounds[0], bounds[1], excess)
        values = np.linalg.eigvalsh(bounded.reshape(6, 6)[:3, :3])
        assert values.min() > 100.0 * (1 - 1e-9) and values.max() < 800.0 * (1 + 1e-9)
        expected = np.clip(np.linalg.eigvalsh(wanted[:3, :3]), 100.0, 800.0)
        np.testing.assert_allclose(values, expected, rtol=1e-6)
        assert (excess[limits.STIFFNESS_BOUNDS] > 0.0) == (
            not np.allclose(bounded, wanted.reshape(-1), rtol=1e-8, atol=1e-8))


def test_coupled_stiffness_is_never_above_the_upper_bound(rng):
    settings = LimitSettings(stiffness_min=(100.0, 1.0), stiffness_max=(800.0, 60.0))
    bounds = diagonal_bounds(settings.stiffness_min, settings.stiffness_max)
    for _ in range(50):
        factor = 40.0 * rng.standard_normal((6, 6))
        bounded = (factor @ factor.T + np.eye(6)).reshape(-1)
        bound_stiffness(bounded, bounds[0], bounds[1], np.zeros(15))
        left = bounds[1].reshape(6, 6) - bounded.reshape(6, 6)
        assert np.linalg.eigvalsh(left).min() > -1e-6


@on_every_plant
def test_stiffness_changes_at_a_bounded_rate(plant):
    loop = loop_with(plant, stiffness_rate=2.0)
    ticks, _ = run(loop, [reference(loop, stiffness=4.0 * HOLD_STIFFNESS)] * 1000)
    trace = np.array([tick.stiffness[0] for tick in ticks])
    assert np.abs(np.diff(np.log(trace))).max() <= 2.0 * DT * (1 + 1e-6)
    assert trace[-1] == pytest.approx(1600.0)
    assert (np.array([tick.requested[0] for tick in ticks]) == 1600.0).all()
    assert most(ticks, limits.STIFFNESS_RATE) == pytest.approx(np.log(4.0) / DT - 2.0, rel=1e-6)


@on_every_plant
def test_pose_errors_are_clipped(plant):
    loop = loop_with(plant)
    body = loop.arm.model.body('hand').id
    loop.arm.data.xfrc_applied[body, :3] = [0.0, 60.0, 0.0]
    start = loop.arm.measure().pose.copy()
    ticks = [loop.tick() for _ in range(1500)]
    assert most(ticks, limits.POSITION_ERROR) > 0.01
    # 400 N/m times 0.1 m: the arm yields to more.
    assert np.linalg.norm(loop.arm.measure().pose[:3] - start[:3]) > 0.1


@on_every_plant
def test_a_fast_joint_is_braked(plant):
    loop = loop_with(plant, joint_speed=0.4)
    ticks, _ = run(loop, [reference(loop, (0, 0.25 * k * DT, 0), velocity=(0, 0.25, 0))
                          for k in range(1200)])
    fastest = max(np.abs(tick.measurement.velocity).max() for tick in ticks)
    assert 0.3 < fastest < 0.4
    assert most(ticks, limits.JOINT_SPEED) > 0.1


@on_every_plant
def test_a_joint_pushed_by_somebody_is_braked(plant):
    fastest = []
    for brake in (0.0, 20.0):
        loop = loop_with(plant, joint_speed=1.0, joint_brake=brake)
        loop.arm.data.qfrc_applied[0] = 25.0
        ticks = [loop.tick() for _ in range(800)]
        fastest.append(max(abs(tick.measurement.velocity[0]) for tick in ticks))
    assert fastest[1] < 0.75 * fastest[0]
    assert most(ticks, limits.JOINT_SPEED) > 0.0


def test_singular_value_and_its_rate(rng):
    arm = Arm()
    for _ in range(30):
        q = rng.uniform(arm.limits.lower, arm.limits.upper)
        dq = rng.standard_normal(7)

        def measured(position):
            arm.reset(position)
            return arm.measure().jacobian.copy()

        def value(position):
            jacobian = measured(position)
            jacobian[3:] *= ROTATION_LENGTH
            return np.linalg.svd(jacobian, compute_uv=False)[-1]

        jacobian, direction = measured(q), np.empty(6)
        assert singular_value(jacobian, direction) == pytest.approx(value(q), abs=1e-7)
        rate = (value(q + 1e-6 * dq) ** 2 - value(q - 1e-6 * dq) ** 2) / 4e-6
        assert singular_rate(jacobian, dq, direction) == pytest.approx(rate, abs=1e-6)


@on_every_plant
def test_a_motion_into_a_singularity_stops_before_it_and_the_way_back_is_open(plant):
    loop, model = loop_with(plant), Arm()
    near = np.array([0.0, 0.3, 0.0, -0.75, 0.0, 1.2, np.pi / 4])
    loop.reset(near)
    start, direction = loop.arm.measure().pose.copy(), np.empty(6)
    outward = np.array([1.0, 0.0, 0.35]) / np.linalg.norm([1.0, 0.0, 0.35])
    stop, ticks, blocked = LimitSettings().singularity_stop, [], set()
    values, governed = [], []
    for k in range(2500):
        target = reference(loop)
        target[:7] = start
        target[:3] += 0.2 * k * DT * outward
        target[7:10] = 0.2 * outward
        ticks += run(loop, [target])[0]
        blocked.add(loop.controller.blocked)
        values.append(singular_value(loop.arm.measure().jacobian, direction))
        model.reset(loop.controller.memory.governed)
        governed.append(singular_value(model.measure().jacobian, direction))
    assert most(ticks, limits.SINGULARITY) > 0.9 and 'a singularity' in blocked
    assert min(governed) > 0.95 * stop and min(values) > 0.3 * stop
    target[:7], target[7:10] = start, 0.0
    _, followed = run(loop, [target] * 4000)
    assert np.linalg.norm(followed[-1, :3] - start[:3]) < 1e-3
    assert rotation_angles(followed[-1, 3:7], start[3:7]) < 0.01


#: Inertia of two joints.
LIGHT = np.diag([0.5, 0.1])


def limiter(**changes):
    made = TorqueLimiter(JointLimits(np.full(2, -1.0), np.full(2, 1.0), np.array([5.0, 2.0])),
                         LimitSettings(**changes))
    made.reset(np.zeros(2))
    return made


def test_torque_rate_torque_and_joint_position_are_limited():
    middle, still, excess = np.zeros(2), np.zeros(2), np.zeros(len(limits.LIMITS))
    limited = limiter(torque_slew=1000.0)
    wanted = np.array([3.0, -9.0])
    sent = limited.apply(middle, still, LIGHT, still, wanted, DT, excess)
    # As a whole: the second motor may give 2 of 9 Nm, and 1 Nm more in a tick.
    np.testing.assert_allclose(sent, wanted / 9.0)
    assert excess[limits.TORQUE] == 7.0
    assert excess[limits.TORQUE_RATE] == pytest.approx(2000.0 - 1000.0)
    for _ in range(10):
        last = limited.apply(middle, still, LIGHT, still, wanted, DT, excess)
    np.testing.assert_allclose(last, wanted * 2.0 / 9.0)
    pushed = limiter(torque_slew=1e4).apply(np.array([0.975, 0.0]), still, LIGHT, still,
                                             still, DT, excess)
    # Half of the way, and half of what the motor can do.
    np.testing.assert_allclose(pushed, [-1.25, 0.0])
    assert excess[limits.JOINT_POSITION] == pytest.approx(0.025)
    shared = limiter(torque_slew=1e4, torque_share=0.5)
    np.testing.assert_allclose(shared.apply(middle, still, LIGHT, still, np.array([9.0, 9.0]),
                                            DT, excess), [1.0, 1.0])


def test_what_drives_a_joint_to_its_limit_decreases_to_nothing_there():
    still, excess = np.zeros(2), np.zeros(len(limits.LIMITS))

    def sent(position, torque):
        return limiter(torque_slew=1e5).apply(np.array([position, 0.0]), still, LIGHT, still,
                                              np.array([torque, 0.4]), DT, excess)
    np.testing.assert_allclose(sent(0.975, 2.0), [-1.25 + 1.0, 0.2])
    np.testing.assert_allclose(sent(1.0, 2.0), [-2.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(sent(0.975, -2.0), [-1.25 - 2.0, 0.4])  # away from it
    np.testing.assert_allclose(sent(-0.975, 2.0), [1.25 + 2.0, 0.4])


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_a_joint_that_could_not_stop_at_its_limit_is_braked_before(side):
    """As hard as its way and its inertia want it, from the acceleration that is allowed on."""
    still, excess = np.zeros(2), np.zeros(len(limits.LIMITS))
    settings = {'torque_slew': 1e6, 'joint_speed': 10.0, 'joint_acceleration': 5.0}

    def sent(way, speed, torque=0.0):
        return side * limiter(**settings).apply(
            side * np.array([1.0 - way, 0.0]), side * np.array([speed, 0.0]), LIGHT, still,
            side * np.array([torque, 0.0]), DT, excess)[0]
    assert sent(0.5, 2.0) == 0.0  # 4 rad/s² suffice
    assert sent(0.5, 3.0, 1.0) == pytest.approx(0.2 * 1.0 - 0.8 * 0.5 * 9.0)
    assert sent(0.5, 4.0) == -5.0  # all that the motor has; 8 Nm are wanted
    assert sent(0.5, -3.0, 1.0) == 1.0  # away from it


def test_gravity_is_never_scaled():
    still, excess = np.zeros(2), np.zeros(len(limits.LIMITS))
    gravity = np.array([4.0, 1.5])
    sent = limiter(torque_slew=1e5).apply(still, still, LIGHT, gravity, gravity + [0.5, 1.0], DT,
                                          excess)
    np.testing.assert_allclose(sent, gravity + [0.25, 0.5])


def test_gravity_is_never_taken_from_a_fast_joint():
    gravity, excess = np.array([4.0, 0.0]), np.zeros(len(limits.LIMITS))
    braking = limiter(torque_slew=1e5, joint_speed=1.0, joint_brake=2.0)
    sent = braking.apply(np.zeros(2), np.array([1.0, 0.0]), LIGHT, gravity, gravity + [0.9, 0.0],
                         DT, excess)
    np.testing.assert_allclose(sent, [4.0 - 2.0 * 0.1, 0.0])


@on_every_plant
def test_active_limits_are_reported_once_with_excess_and_unit(plant):
    # Noise of the measurements alone changes the torque by up to 500 Nm/s.
    loop = loop_with(plant, torque_slew=50.0 if plant is CLEAN else 900.0)
    run(loop, [reference(loop, (0.02, 0, 0))] * 50)
    text = loop.controller.counters.recent()
    assert 'torque_rate by ' in text and text.count('Nm/s') == 1
    assert loop.controller.counters.ticks[limits.TORQUE_RATE] > 0
    for _ in range(3000):
        loop.follow(reference(loop, (0.02, 0, 0)))
        loop.tick()
    loop.controller.counters.recent()
    loop.tick()
    assert loop.controller.counters.recent() == ''


@pytest.mark.parametrize('changes', [
    {'workspace_min': (0.0, 0.0, 2.0)}, {'stiffness_min': (1.0, 900.0)},
    {'singularity_stop': 0.06}])
def test_limits_that_contradict_each_other_are_refused(changes):
    with pytest.raises(ParameterError, match=next(iter(changes))):
        LimitSettings(**changes)


def test_the_message_names_every_limit_at_its_place():
    message = pytest.importorskip('gdmp_msgs.msg').RobotState
    for index, limit in enumerate(limits.LIMITS):
        assert getattr(message, limit.name.upper()) == index
    assert len(message().limited) >= len(limits.LIMITS)


@on_every_plant
def test_an_arm_beyond_a_joint_limit_is_pushed_back(plant):
    loop = plant.loop(tank=TankSettings(energy=5.0))
    arm = loop.arm
    arm.model.jnt_limited[:] = 0  # the controller has to do it alone
    at_limit = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, 2.88])
    loop.reset(at_limit)
    mujoco.mj_forward(arm.model, arm.data)
    tick = loop.tick()
    assert tick.violation[limits.JOINT_POSITION] == pytest.approx(2.88 - (2.8973 - 0.05), abs=1e-4)
    for _ in range(1500):
        tick = loop.tick()
    assert tick.measurement.position[6] < 2.87


@on_every_plant
def test_settings_change_in_motion_without_a_step_of_torque_or_energy(plant):
    loop = plant.loop()
    target = np.zeros(TARGET_SIZE)
    target[:7], target[-1] = loop.arm.measure().pose, 0.7
    target[STIFFNESS:STIFFNESS + 36] = np.diag([800.0] * 3 + [40.0] * 3).reshape(-1)
    torques, tanks = [], []
    for k in range(1200):
        target[1] = 0.08 * np.sin(2e-3 * k)
        loop.follow(target)
        if k == 600:
            loop.controller.configure(replace(
                loop.controller.settings, limits=LimitSettings(
                    stiffness_max=(200.0, 20.0), torque_slew=500.0, speed=0.05)))
        tick = loop.tick()
        torques.append(tick.torque)
        tanks.append(tick.tank)
    steps = np.abs(np.diff(torques, axis=0)).max(axis=1)
    assert steps[:599].max() <= 0.95 + 1e-9 and steps[600:].max() <= 0.5 + 1e-9
    assert tick.stiffness.reshape(6, 6)[1, 1] == pytest.approx(200.0, rel=1e-3)
    assert np.abs(np.diff(tanks)).max() < 0.02
    assert np.linalg.norm(tick.twist[:3]) < 0.08  # twice that before
