"""A robot that is not its model: friction, delay, noise, payload."""
import mujoco
import numpy as np
import pytest

from gdmp_ros.control.settings import ControllerSettings, FrictionSettings, TankSettings
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plant import PlantSettings, REAL


def write(skill, plant, dry):
    """Follow a letter; RMS errors [mm, rad], last position error [mm], smallest tank [J]."""
    arm = Arm(plant=plant)
    loop = ClosedLoop(arm, ControllerSettings(friction=FrictionSettings(dry=(dry,))))
    return follow(skill, loop)


def follow(skill, loop):
    arm = loop.arm
    player = Player(skill, PlayerSettings())
    player.start(arm.measure().pose.copy())
    away, turned, tank, pose = [], [], np.inf, np.empty(7)
    for _ in range(round(1000 * (skill.duration + 1.0))):
        target = player.tick(1e-3)
        loop.follow(target)
        tank = min(tank, loop.tick().tank)
        site = arm.data.site('tcp')
        pose[:3] = site.xpos
        mujoco.mju_mat2Quat(pose[3:], site.xmat)
        away.append(1e3 * np.linalg.norm(pose[:3] - target[:3]))
        turned.append(rotation_angles(pose[3:], target[3:7]))
    return (np.sqrt(np.mean(np.square(away))), np.sqrt(np.mean(np.square(turned))), away[-1],
            tank)


def test_with_compensation_a_letter_is_followed_in_spite_of_friction(letter):
    position, rotation, _, tank = write(letter, REAL, 1.1)
    assert position <= 3.0 and rotation <= 0.02 and tank >= 3.0
    plain, _, last, _ = write(letter, REAL, 0.0)
    assert 10.0 < plain < 40.0 and last < 20.0


def test_a_payload_that_nobody_announced_hangs_by_its_weight(letter):
    plant = PlantSettings(1.1, 0.2, 0.001, 1e-5, 2e-3, 0.5)
    position, _, last, tank = write(letter, plant, 1.1)
    weight = 0.5 * 9.81 / 400.0 * 1e3
    assert position <= weight + 3.0 and last <= weight + 3.0 and tank >= 3.0


def test_a_payload_is_a_mass_at_the_tool(rng):
    plain, loaded = Arm(), Arm(plant=PlantSettings(payload=2.0))
    for _ in range(3):
        q = plain.data.qpos + 0.3 * rng.standard_normal(7)
        for arm in (plain, loaded):
            arm.reset(q)
        m = plain.measure()
        linear = m.jacobian[:3]
        weight = linear.T @ np.array([0.0, 0.0, 2.0 * 9.81])
        np.testing.assert_allclose(loaded.data.qfrc_bias - plain.data.qfrc_bias, weight,
                                   atol=1e-8)
        inertia = np.empty((7, 7))
        mujoco.mj_fullM(loaded.model, loaded.data, inertia)
        np.testing.assert_allclose(inertia - m.inertia, 2.0 * linear.T @ linear, atol=1e-8)
        # The controller knows nothing of it.
        np.testing.assert_allclose(loaded.measure().bias, m.bias, atol=1e-10)


def test_torques_act_late_and_measurements_have_noise():
    plant = PlantSettings(delay=0.002, position_noise=1e-4, velocity_noise=1e-2)
    arm = Arm(plant=plant)
    begin = arm.data.qfrc_bias.copy()
    for k in range(1, 5):
        arm.step(np.full(7, float(k)))
        expected = begin if k <= 2 else np.full(7, k - 2.0)
        np.testing.assert_allclose(arm.data.actuator_force, expected, atol=1e-12)
    arm.reset()
    seen = [arm.measure() for _ in range(500)]
    positions = np.array([m.position for m in seen]) - arm.data.qpos
    velocities = np.array([m.velocity for m in seen])
    assert positions.std() == pytest.approx(1e-4, rel=0.1)
    assert velocities.std() == pytest.approx(1e-2, rel=0.1)
    again = Arm(plant=plant)
    np.testing.assert_array_equal(again.measure().position, seen[0].position)


def test_a_payload_is_told_without_a_step_and_the_letter_is_followed_again(letter):
    arm = Arm(plant=PlantSettings(1.1, 0.2, 0.001, 1e-5, 2e-3, 0.5))
    loop = ClosedLoop(arm, ControllerSettings(friction=FrictionSettings(dry=(1.1,))))
    at_rest = []
    for _ in range(2000):
        before = loop.tick()
        at_rest.append(before.torque)
    noise = np.abs(np.diff(at_rest[1000:], axis=0)).max()
    arm.announce(Payload(0.5))
    torques, speeds = [before.torque], []
    for _ in range(2000):
        tick = loop.tick()
        torques.append(tick.torque)
        speeds.append(np.linalg.norm(tick.twist[:3]))
    # 0.5 kg at an arm of half a metre take 2.5 Nm: in 0.5 s that is 5 mNm a tick, beside noise.
    assert np.abs(np.diff(torques, axis=0)).max() < 1.3 * noise + 0.005
    assert noise < 0.8 and max(speeds) < 0.1
    assert tick.tank >= 3.0
    arm.announce(Payload(0.5))
    assert follow(letter, loop)[0] <= 3.0


def test_a_payload_that_is_told_fills_no_tank():
    """Its potential energy is not that of the motors: 5 J at the height of the tool."""
    loop = ClosedLoop(Arm(plant=PlantSettings(payload=1.0)), ControllerSettings(
        tank=TankSettings(energy=1.0, recharge_power=0.0)))
    for _ in range(1500):
        before = loop.tick()
    loop.arm.announce(Payload(1.0))
    tanks = [loop.tick().tank for _ in range(1500)]
    # The spring gives back what the weight stretched it by, and lifts the weight with it.
    assert max(tanks) < before.tank + 0.15 and min(tanks) > before.tank - 0.3


def test_a_payload_with_an_inertia_of_its_own_is_part_of_the_model(rng):
    """Two bodies at once are what each of them is in turn, whatever is put in between."""
    told, plain = Arm(), Arm()
    first, second = Payload(1.0, (0.1, 0.0, 0.05), (0.01, 0.02, 0.015, 0.0, 0.002, 0.0)), Payload()
    loads = []
    for payload in (first, second, first):
        told.announce(payload)
        for _ in range(600):
            measured = told.measure()
        loads.append((measured.inertia.copy(), measured.bias.copy()))
    np.testing.assert_allclose(loads[0][0], loads[2][0], atol=1e-12)
    np.testing.assert_allclose(loads[1][0], plain.measure().inertia, atol=1e-10)
    m = plain.measure()
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, m.pose[3:])
    arm, r = m.jacobian, turn.reshape(3, 3) @ np.array(first.center)
    cross = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    linear = arm[:3] - cross @ arm[3:]
    own = turn.reshape(3, 3) @ first.matrix @ turn.reshape(3, 3).T
    np.testing.assert_allclose(loads[0][0] - m.inertia,
                               linear.T @ linear + arm[3:].T @ own @ arm[3:], atol=1e-9)
    np.testing.assert_allclose(loads[0][1] - m.bias, linear.T @ [0.0, 0.0, 9.81], atol=1e-8)


@pytest.mark.parametrize('numbers', [(-1.0,), (20.1,), (np.nan,), (1.0, (0, 0, np.inf)),
                                     (1.0, (0, 0, 1e300)),
                                     (1.0, (0, 0, 0), (1e300, 1e300, 1e300, 0, 0, 0)),
                                     (1.0, (0, 0, 0), (1, 0.1, 0.1, 0, 0, 0)),
                                     (1.0, (0, 0, 0), (-1, 1, 1, 0, 0, 0))])
def test_a_payload_that_no_body_has_is_refused(numbers):
    with pytest.raises(ParameterError, match='payload'):
        Payload(*numbers)
