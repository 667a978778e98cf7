"""Forward kinematics without a simulation."""
import mujoco
import numpy as np
import pytest

from gdmp_ros.errors import ParameterError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import ToolTransform

TOOL = ToolTransform((0.02, -0.03, 0.1), (0.9238795325112867, 0.0, 0.0, -0.3826834323650898))


@pytest.mark.parametrize('words', [('',), ('fr3', 'flange', False)])
def test_the_tool_is_where_mujoco_has_it(words, rng):
    arm = Arm(*words)
    low, high = arm.limits.lower, arm.limits.upper
    for tool in (ToolTransform(), TOOL):
        arm.put_tool(tool)
        for _ in range(20):
            position = rng.uniform(low, high)
            found, wanted = arm.chain.pose_at(position, arm.end_pose), arm.pose_at(position)
            np.testing.assert_allclose(found[:3], wanted[:3], atol=1e-12)
            assert abs(found[3:] @ wanted[3:]) == pytest.approx(1.0, abs=1e-12)


def test_a_posture_is_found_near_another(rng):
    arm = Arm()
    for _ in range(20):
        position = arm.home + rng.uniform(-0.2, 0.2, 7)
        pose = arm.chain.pose_at(position, arm.end_pose)
        found = arm.chain.near(pose, arm.home, arm.end_pose)
        np.testing.assert_allclose(arm.chain.pose_at(found, arm.end_pose)[:3], pose[:3], atol=1e-6)
        assert np.abs(found - arm.home).max() < 0.5


@pytest.mark.parametrize('place', ["pos='0.1 0.2 0.3'", ''])
def test_a_joint_may_be_beside_the_origin_of_its_body(place, rng):
    spec = mujoco.MjSpec.from_string(f"""
        <mujoco><worldbody><body pos='0.1 0 0.3' euler='10 20 30'>
        <joint name='a' axis='0 1 1' {place}/><geom size='0.1'/>
        <body pos='0 0 0.2'><joint name='b' axis='1 0 0' {place}/><geom size='0.1'/>
        <site name='tcp' pos='0.1 0.1 0.1'/></body></body></worldbody>
        <actuator><motor joint='a' ctrlrange='-1 1'/><motor joint='b' ctrlrange='-1 1'/></actuator>
        </mujoco>""")
    arm = Arm(spec)
    position = rng.uniform(-1.0, 1.0, 2)
    np.testing.assert_allclose(arm.chain.pose_at(position, arm.end_pose)[:3],
                               arm.pose_at(position)[:3], atol=1e-12)


def test_other_joints_are_refused():
    spec = mujoco.MjSpec.from_string("""
        <mujoco><worldbody><body><joint name='slide' type='slide' axis='0 0 1'/>
        <geom size='0.1'/><site name='tcp'/></body></worldbody>
        <actuator><motor joint='slide' ctrlrange='-1 1'/></actuator></mujoco>""")
    with pytest.raises(ParameterError, match='other joints than one revolute joint'):
        assert Arm(spec).chain
