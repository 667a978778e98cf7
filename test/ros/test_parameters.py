"""Parameters: descriptions, ranges, changes while the nodes run, and former names."""
from pathlib import Path
import re

import numpy as np
import pytest
from rcl_interfaces.srv import DescribeParameters, GetParameters

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.ros.parameter_tables import NODES
from gdmp_ros.ros.running import with_parameter_files


def values_of(nodes, node, *names):
    return [one.double_value for one in nodes.call(
        GetParameters, f'{node}/get_parameters', names=list(names)).values]


@pytest.mark.parametrize('node', [ARM, SERVER])
def test_parameters_describe_themselves(running, node):
    specs = {spec.name: spec for spec in NODES[node][1]}
    described = {one.name: one for one in running.call(
        DescribeParameters, f'{node}/describe_parameters', names=list(specs)).descriptors}
    assert described.keys() == specs.keys()
    assert all(one.description for one in described.values())
    name, largest = {ARM: ('speed', 10.0), SERVER: ('damping_ratio', 2.0)}[node]
    assert described[name].floating_point_range[0].to_value == largest
    text, fixed = {
        ARM: ('speed limit of the reference [m/s]; changes at once', 'model'),
        SERVER: ('oldest measured pose from which a motion may start [s]; changes at once',
                 'rate_hz')}[node]
    assert text in [one.description for one in described.values()]
    assert 'read-only while the node is configured' in described[fixed].description


def test_parameters_change_live_and_are_checked_first(running):
    # A change that contradicts another parameter is refused as a whole.
    bad = running.set_parameters(ARM, speed=0.1, stiffness_min=[900.0, 20.0],
                                 stiffness_max=[800.0, 30.0])
    assert not bad.successful and 'stiffness_min is (900.0, 20.0)' in bad.reason
    assert 'expected less than stiffness_max' in bad.reason
    assert values_of(running, ARM, 'speed') == [1.7]
    assert 'speed out of range' in running.set_parameters(ARM, speed=-1.0).reason
    unknown = running.set_parameters(ARM, torque_rate=0.5)
    assert not unknown.successful
    assert 'torque_rate is no parameter of this node; similar: ' in unknown.reason
    assert running.set_parameters(ARM, torque_slew=950.0).successful
    sizes = running.set_parameters(ARM, friction_dry=[1.0, 1.0])
    assert not sizes.successful and '2 numbers, expected 1 or 7' in sizes.reason
    assert running.set_parameters(ARM, friction_dry=[0.0] * 7).successful
    locked = running.set_parameters(ARM, model='other.xml')
    assert not locked.successful and 'cannot change while the node is configured' in locked.reason
    box = running.set_parameters(SERVER, workspace_min=[0.0, 0.0, 0.9],
                                 workspace_max=[1.0, 1.0, 0.5])
    assert not box.successful and 'workspace_min z is 0.9 m' in box.reason
    choice = running.set_parameters(SERVER, start_from='anywhere')
    assert not choice.successful and 'expected one of measured, skill' in choice.reason
    # Live: the stiffness is bounded from now on.
    before = np.array(running.robot[-1].stiffness).reshape(6, 6)
    assert before[0, 0] == pytest.approx(400.0, rel=0.05)
    assert running.set_parameters(ARM, stiffness_max=[150.0, 20.0]).successful
    running.wait('a softer arm', lambda: np.linalg.eigvalsh(
        np.array(running.robot[-1].stiffness).reshape(6, 6)[:3, :3]).max() < 151.0)
    # With the next motion: what is sent with the reference.
    running.listen()
    assert running.set_parameters(SERVER, damping_ratio=0.9).successful
    running.wait('references after the change', lambda: len(running.references) > 300)
    assert running.references[-1].damping_ratio == pytest.approx(0.7)
    running.client.execute()
    running.wait('the new damping ratio',
                 lambda: running.references[-1].damping_ratio == 0.9)
    assert np.abs(np.diff(running.torques(), axis=0)).max() <= 1.0 + 1e-9


@pytest.mark.parametrize('name, value, reason', [
    ('workspace_min', [0.0, 0.0], 'workspace_min has 2 entries, expected 3'),
    ('joint_sped', 1.0, 'joint_sped is no parameter of this node; similar: joint_speed'),
    ('speed', 99.0, 'speed out of range'), ('speed', 'high', "'speed' to 'high'")])
def test_an_invalid_value_at_start_up_is_refused(nodes, name, value, reason):
    with pytest.raises(GdmpError, match=re.escape(reason)):
        nodes.start_arm(**{name: value})


def test_a_parameter_file_is_found_in_the_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ['x', '--ros-args', '--params-file', 'config/presets/crisp.yaml']
    found = Path(with_parameter_files(words)[-1])
    assert found.is_absolute() and found.is_file()
    (tmp_path / 'mine.yaml').write_text('')
    assert with_parameter_files([*words[:-1], 'mine.yaml'])[-1] == 'mine.yaml'
    with pytest.raises(GdmpError, match='other.yaml: no such parameter file, neither here nor in'):
        with_parameter_files([*words[:-1], 'other.yaml'])
