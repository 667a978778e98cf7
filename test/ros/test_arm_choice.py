"""Which arm is started, and what is refused before anything is."""
from pathlib import Path

import pytest

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.arm_choice import ArmChoice, FRANKA, SIMULATED


def test_an_arm_has_its_node_and_parameters():
    simulated, real = ArmChoice(), ArmChoice('franka', host='172.16.0.2')
    for one in (simulated, real):
        one.check()
    assert (simulated.node, real.node) == (SIMULATED, FRANKA)
    assert (simulated.parameters(), real.parameters()) == ({}, {'host': '172.16.0.2'})
    assert 'robot_position_tolerance' in real.server_parameters()


@pytest.mark.parametrize('choice, reason', [
    (ArmChoice(host='here'), 'need --arm franka'),
    (ArmChoice(protocol_server=True), 'need --arm franka'),
    (ArmChoice('franka'), 'needs --host'),
    (ArmChoice('franka', 'here', True), 'leave --host out'),
    (ArmChoice(parameter_files=(Path('none.yaml'),)), 'there is no such file')])
def test_what_contradicts_itself_is_refused(choice, reason):
    with pytest.raises(GdmpError, match=reason):
        choice.check()
