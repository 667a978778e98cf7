"""The weight of a tool from a recording, in postures at rest, with a sensor that has a bias."""
import numpy as np
import pytest
import yaml

from gdmp_ros.data import bags, recordings
from gdmp_ros.errors import DataError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.servo_arm import ServoArm, ServoSettings
from gdmp_ros.sim.tool_weight import weigh
from test.commands import gdmp

BIAS = np.array([1.5, -0.8, 2.0, 0.05, -0.02, 0.03])
JOINTS, WRENCH = '/joint_states', '/force_torque_sensor_broadcaster/wrench'
#: Of the last joints, which turn the tool.
WRISTS = ((-1.57, -1.57, 0.0), (-0.6, -1.57, 0.5), (-1.57, -0.4, 0.0), (-2.4, -1.2, 1.0),
          (-1.57, 0.6, -1.0))


def record(bag, wrists=WRISTS):
    """A simulated arm that goes from posture to posture, and rests; returns what it carries."""
    servo, stamp = ServoArm('ur5e', ServoSettings()), recordings.EPOCH_NS
    position = servo.arm.home
    with bags.BagWriter(bag) as writer:
        for wrist in wrists:
            goal = np.concatenate([position[:3], wrist])
            for k in range(1250):
                servo.send(position + min(k / 500.0, 1.0) * (goal - position), np.zeros(6))
                servo.advance()
                servo.advance()
                stamp += 2_000_000
                state = servo.read()
                if k % 5 == 0:
                    writer.joints(JOINTS, stamp, servo.arm.names, state.position.tolist())
                    writer.wrench(WRENCH, stamp, (state.wrench + BIAS).tolist(), 'tool0')
            position = goal
    return servo.hand


def test_mass_centre_and_bias_are_found(tmp_path):
    hand = record(tmp_path / 'weighing')
    found = weigh(tmp_path / 'weighing', Arm('ur5e'), Arm('ur5e', 'flange').end_pose, JOINTS,
                  WRENCH)
    assert found.postures == len(WRISTS)
    assert found.mass == pytest.approx(hand.mass, abs=0.01)
    np.testing.assert_allclose(found.center, hand.center, atol=0.003)
    np.testing.assert_allclose(found.bias[:3], BIAS[:3], atol=0.1)
    np.testing.assert_allclose(found.bias[3:], BIAS[3:], atol=0.01)
    assert found.force < 0.3 and found.torque < 0.03
    done = gdmp('arm', 'tool', tmp_path / 'weighing', '-o', tmp_path / 'tool.yaml')
    assert done.returncode == 0
    written = yaml.safe_load((tmp_path / 'tool.yaml').read_text())
    parameters = written['/**/position_arm']['ros__parameters']
    assert parameters['payload_mass'] == pytest.approx(hand.mass, abs=0.01)
    assert len(parameters['sensor_bias']) == 6


@pytest.mark.parametrize(('wrists', 'reason'), [
    (WRISTS[:2], 'in 2 postures, expected at least 4'),
    (((-1.57, -1.57, 0.0), (-1.5, -1.57, 0.5), (-1.57, -1.5, 1.0), (-1.6, -1.6, 1.5)),
     'turned too little between the postures')])
def test_postures_that_tell_too_little_are_refused(tmp_path, wrists, reason):
    record(tmp_path / 'weighing', wrists)
    with pytest.raises(DataError, match=reason):
        weigh(tmp_path / 'weighing', Arm('ur5e'), Arm('ur5e', 'flange').end_pose, JOINTS, WRENCH)
