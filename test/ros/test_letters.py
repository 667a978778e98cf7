"""Ten letters in a row, on a robot whose friction was identified through the nodes before."""
from dataclasses import asdict

import pytest
import yaml

from gdmp_ros.control.settings import ControllerSettings, FrictionSettings
from gdmp_ros.ros.clients.testbed import ARM
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.sim.plant import PlantSettings, REAL
from test.commands import gdmp
from test.ros.nodes import open_testbed
from test.sim.test_plant import follow

LETTERS = 10
PLANTS = {'clean': PlantSettings(), 'real': REAL}


@pytest.mark.long
@pytest.mark.parametrize('plant', PLANTS)
def test_ten_letters_in_a_row(tmp_path, skill_file, letter, plant):
    """The letters are written without nodes: a busy machine must not decide how well."""
    parameters = {f'plant_{name}': value for name, value in asdict(PLANTS[plant]).items()}
    with open_testbed(tmp_path, skill_file) as nodes:
        nodes.start_arm(pace='fast', **parameters)
        done = gdmp('arm', 'friction', '-o', str(tmp_path / 'friction.yaml'))
        assert done.returncode == 0, done.stderr
    found = yaml.safe_load((tmp_path / 'friction.yaml').read_text())[f'/**/{ARM}'][
        'ros__parameters']
    loop = ClosedLoop(Arm(plant=PLANTS[plant]), ControllerSettings(friction=FrictionSettings(
        tuple(found['friction_viscous']), tuple(found['friction_dry']))))
    for _ in range(LETTERS):
        position, rotation, last, tank = follow(letter, loop)
        print(f'{position:.2f} mm, {rotation:.4f} rad, {last:.2f} mm at the end, {tank:.2f} J')
        assert position <= 3.0 and rotation <= 0.02 and tank >= 3.0
