"""Forward kinematics without a simulation."""
import mujoco
import numpy as np
import pytest

from gdmp_ros.errors import ParameterError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.chain import Chain
from gdmp_ros.sim.frames import tool_at, ToolTransform

TOOL = ToolTransform((0.02, -0.03, 0.1), (0.9238795325112867, 0.0, 0.0, -0.3826834323650898))


@pytest.mark.parametrize('words', [('',), ('fr3', 'flange', False)])
def test_the_tool_is_where_mujoco_has_it(words, rng):
    arm = Arm(*words)
    chain, low, high = Chain(arm), arm.limits.lower, arm.limits.upper
    for _ in range(20):
        position = rng.uniform(low, high)
        pose = arm.pose_at(position)
        for tools, wanted in (((), pose), ((TOOL,), tool_at(pose, TOOL))):
            found = chain.pose_at(position, chain.end_of(*tools))
            np.testing.assert_allclose(found[:3], wanted[:3], atol=1e-12)
            assert abs(found[3:] @ wanted[3:]) == pytest.approx(1.0, abs=1e-12)


def test_other_joints_are_refused():
    spec = mujoco.MjSpec.from_string("""
        <mujoco><worldbody><body><joint name='slide' type='slide' axis='0 0 1'/>
        <geom size='0.1'/><site name='tcp'/></body></worldbody>
        <actuator><motor joint='slide' ctrlrange='-1 1'/></actuator></mujoco>""")
    with pytest.raises(ParameterError, match='other joints than one revolute joint'):
        Chain(Arm(spec))
