"""Another point of the tool's body becomes the tool."""
import dataclasses

import mujoco
import numpy as np
import pytest

from gdmp_ros.control.settings import ControllerSettings, FrictionSettings
from gdmp_ros.control.target import resting_target
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.sim.arm import Arm, PANDA
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.execution import execute
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plant import PlantSettings, REAL
from test.sim.test_plant import follow

HALF = np.sqrt(0.5)
#: 0.15 m ahead and 0.1 m aside, turned by a quarter about x.
LONG = ToolTransform((0.1, 0.0, 0.15), (HALF, HALF, 0.0, 0.0))


def loop_of(plant=None, dry=0.0):
    return ClosedLoop(Arm(plant=plant), ControllerSettings(friction=FrictionSettings(dry=(dry,))))


@pytest.mark.parametrize('payload', [Payload(), Payload(1.0, (0.0, 0.05, 0.0))])
def test_the_tool_is_where_it_was_put_and_the_payload_stays(rng, payload):
    plain, moved = Arm(), Arm()
    for arm in (plain, moved):
        arm.announce(payload)
        for _ in range(600):
            arm.measure()
    moved.put_tool(LONG)
    for _ in range(3):
        q = plain.data.qpos + 0.3 * rng.standard_normal(7)
        for arm in (plain, moved):
            arm.reset(q)
        before, after = plain.measure(), moved.measure()
        expected, turned = np.empty(3), np.empty(4)
        mujoco.mju_mulPose(expected, turned, before.pose[:3], before.pose[3:],
                           np.array(LONG.position), np.array(LONG.rotation))
        np.testing.assert_allclose(after.pose[:3], expected, atol=1e-12)
        assert abs(after.pose[3:] @ turned) == pytest.approx(1.0)
        np.testing.assert_allclose(moved.site_pose('tcp')[:3], expected, atol=1e-12)
        lever = expected - before.pose[:3]
        cross = np.array([[0, -lever[2], lever[1]], [lever[2], 0, -lever[0]],
                          [-lever[1], lever[0], 0]])
        np.testing.assert_allclose(after.jacobian[:3],
                                   before.jacobian[:3] - cross @ before.jacobian[3:], atol=1e-12)
        np.testing.assert_allclose(after.inertia, before.inertia, atol=1e-12)
        np.testing.assert_allclose(after.bias, before.bias, atol=1e-9)


@pytest.mark.parametrize('plant', [PlantSettings(payload=1.0), PlantSettings(
    1.1, 0.2, 0.001, 1e-5, 2e-3, 1.0)], ids=['clean', 'real'])
@pytest.mark.parametrize('tool', [
    LONG, pytest.param(ToolTransform((0.0, 0.0, -0.1)), marks=pytest.mark.long)])
def test_an_arm_that_holds_a_load_does_not_notice(plant, tool):
    """The spring holds 10 N, and must go on to do so with another lever."""
    loop = loop_of(plant)
    for _ in range(2000):
        loop.tick()
    height = loop.arm.measure().pose[:3].copy()
    ticks = [loop.tick() for _ in range(2000)]
    before = ticks[-1]
    assert before.spring > 0.05
    # Noise of the measured velocity, or nothing.
    noise = np.abs(np.diff([tick.torque for tick in ticks[-1000:]], axis=0)).max()
    # Friction gives way slowly under a constant load, with either tool.
    creep = np.linalg.norm(before.measurement.pose[:3] - height)
    flange = loop.arm.data.body('hand').xpos.copy()
    loop.put_tool(tool)
    last, speeds = before.torque, []
    for _ in range(2000):
        tick = loop.tick()
        assert np.abs(tick.torque - last).max() < 1.5 * noise + 0.02
        last = tick.torque
        speeds.append(np.linalg.norm(loop.arm.data.qvel))
    assert np.linalg.norm(loop.arm.data.body('hand').xpos - flange) < creep + 4e-4
    assert max(speeds) < 0.01 and tick.tank >= min(before.tank, 9.0)


def test_energy_that_the_tank_does_not_have_is_not_given():
    loop = loop_of(PlantSettings(payload=1.0))
    for _ in range(3000):
        loop.tick()
    loop.controller.tank.energy = 0.0
    loop.put_tool(ToolTransform((0.3, 0.3, 0.3)))
    least = min(loop.tick().tank for _ in range(2000))
    assert least >= -0.01


def test_while_references_are_followed_the_tool_stays():
    loop = loop_of()
    assert loop.follow(resting_target(loop.arm.measure().pose))
    loop.tick()
    with pytest.raises(ParameterError, match='follows a motion'):
        loop.put_tool(LONG)
    with pytest.raises(ParameterError, match='has norm 2, expected 1'):
        ToolTransform((0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0))
    with pytest.raises(ParameterError, match='expected at most 2 in each direction'):
        ToolTransform((0.0, np.nan, 0.0))


def test_a_letter_is_written_with_a_long_tool(letter):
    arm = Arm()
    arm.put_tool(ToolTransform((0.0, 0.05, 0.1)))
    done = execute(letter, arm)
    away = np.linalg.norm(done.measured[:, :3] - done.references[:, :3], axis=1)
    assert 1e3 * np.sqrt(np.mean(away ** 2)) < 1.0


@pytest.fixture
def heavier(tmp_path):
    """MJCF of a Panda whose links are not those of the model."""
    spec = mujoco.MjSpec.from_file(str(PANDA))
    for body in spec.bodies:
        body.mass *= 1.05
        body.inertia = 1.1 * np.array(body.inertia)
    spec.body('hand').pos = np.array(spec.body('hand').pos) + [0.0, 0.0, 0.001]
    path = tmp_path / 'other.xml'
    path.write_text(spec.to_xml())
    return str(path)


def test_a_robot_with_another_model_is_controlled_with_the_known_one(heavier, letter):
    arm = Arm(plant=PlantSettings(model=heavier))
    plain = Arm().measure()
    measured = arm.measure()
    np.testing.assert_allclose(measured.bias, plain.bias, atol=1e-9)
    np.testing.assert_allclose(measured.pose, plain.pose, atol=1e-9)
    off = arm.site_pose('tcp') - plain.pose
    assert np.linalg.norm(off[:3]) == pytest.approx(1e-3, rel=1e-3)
    assert arm.data.qfrc_bias[1] == pytest.approx(1.05 * plain.bias[1], rel=0.02)
    # The weight that the model does not know, as a force at the tool.
    force = np.linalg.lstsq(plain.jacobian.T, arm.data.qfrc_bias - plain.bias, rcond=None)[0]
    sag = 1e3 * np.linalg.norm(force[:3]) / 400.0
    for dry, settings in ((0.0, PlantSettings(model=heavier)),
                          (1.1, dataclasses.replace(REAL, model=heavier))):
        position, rotation, last, tank = follow(letter, loop_of(settings, dry))
        assert position <= sag + 3.0 and last <= sag + 3.0 and tank >= 3.0


def test_a_robot_with_other_joints_is_refused(tmp_path):
    path = tmp_path / 'two.xml'
    path.write_text("""<mujoco><worldbody><body><joint name="a"/><geom size="0.1" mass="1"/>
        <site name="tcp"/></body></worldbody>
        <actuator><motor joint="a" ctrlrange="-10 10"/></actuator></mujoco>""")
    with pytest.raises(DataError, match='the robot has 1 joints, its model 7'):
        Arm(plant=PlantSettings(model=str(path)))
