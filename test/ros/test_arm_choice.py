"""Which arm is started, and what is refused before anything is."""
from pathlib import Path

import pytest

from gdmp_ros.demo.tasks import run_wiping
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.ros.arm_choice import ArmChoice, FRANKA, POSITION, SERVO_SIM, SIMULATED


def test_an_arm_has_its_node_and_parameters():
    simulated, real = ArmChoice(), ArmChoice('franka', host='172.16.0.2')
    for one in (simulated, real):
        one.check()
    assert (simulated.node, real.node) == (SIMULATED, FRANKA)
    assert (simulated.parameters(), real.parameters()) == ({}, {'host': '172.16.0.2'})
    assert 'robot_position_tolerance' in real.server_parameters()


def test_an_arm_that_takes_positions_has_a_robot_in_front_of_it():
    arm = ArmChoice('ur5e')
    arm.check()
    assert (arm.node, arm.robots, arm.frame) == (POSITION, (SERVO_SIM,), 'base_link')
    assert len(arm.limits.torque) == 6
    # What hangs at its sensor is known.
    assert arm.parameters()['payload_mass'] == pytest.approx(1.0)
    assert arm.server_parameters()['reach_model'] == 'ur5e'
    # A simulated arm like it is guided by hand.
    assert arm.shown_on == {'model': 'ur5e', 'frame_id': 'base_link'}
    assert ArmChoice().shown_on == {}


def test_what_no_table_can_be_put_under_is_not_asked_to_wipe(tmp_path):
    with pytest.raises(ParameterError, match='--task wipe puts tables under the arm'):
        run_wiping(tmp_path, ArmChoice('franka', host='172.16.0.2'))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('choice, reason', [
    (ArmChoice(host='here'), 'need --arm franka'),
    (ArmChoice(protocol_server=True), 'need --arm franka'),
    (ArmChoice('franka'), 'needs --host'),
    (ArmChoice('franka', 'here', True), 'leave --host out'),
    (ArmChoice(parameter_files=(Path('none.yaml'),)), 'there is no such file')])
def test_what_contradicts_itself_is_refused(choice, reason):
    with pytest.raises(GdmpError, match=reason):
        choice.check()
