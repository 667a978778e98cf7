"""Parameters: descriptions, ranges, changes while the nodes run, and former names."""
import re

import numpy as np
import pytest
from rcl_interfaces.srv import DescribeParameters, GetParameters

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.ros.parameter_tables import NODES


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
    retired = running.set_parameters(ARM, torque_rate=0.5)
    assert not retired.successful and '1 Nm per tick of 1 ms is 1000 Nm/s' in retired.reason
    assert values_of(running, ARM, 'torque_slew') == [950.0]
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


def test_former_names_are_accepted_and_reported(nodes):
    formerly = {spec.name: spec.formerly for spec in (*NODES[ARM][1], *NODES[SERVER][1])
                if spec.formerly}
    assert formerly == {'angular_speed': 'turn_speed', 'angular_acceleration': 'turn_acceleration',
                        'catch_up_angular_speed': 'catch_up_turn_speed',
                        'goal_angular_speed': 'goal_turn_speed'}

    def reported(node, former):
        return len(re.findall(
            rf'the parameter {former} is now called {former.replace("turn", "angular")}\b',
            nodes.log(node)))
    # At start-up; with both names the present one has priority. An integer is a number too.
    nodes.start_arm(turn_speed=1.5, turn_acceleration=20, catch_up_turn_speed=0.5,
                    catch_up_angular_speed=0.75)
    assert values_of(nodes, ARM, 'angular_speed', 'angular_acceleration',
                     'catch_up_angular_speed') == [1.5, 20.0, 0.75]
    assert [reported(ARM, name) for name in ('turn_speed', 'turn_acceleration')] == [1, 1]
    # While the node runs; ranges are those of the present name.
    nodes.wait('the arm', lambda: bool(nodes.robot), 60.0)
    assert nodes.set_parameters(ARM, turn_speed=1.25).successful
    assert values_of(nodes, ARM, 'angular_speed') == [1.25]
    nodes.wait('the warning', lambda: reported(ARM, 'turn_speed') == 2)
    refused = nodes.set_parameters(ARM, turn_speed=99.0)
    assert not refused.successful and 'angular_speed' in refused.reason
    assert values_of(nodes, ARM, 'angular_speed') == [1.25]
    # The former name is no parameter of its own.
    unknown = nodes.call(GetParameters, f'{ARM}/get_parameters', names=['turn_speed']).values
    assert all(value.type == 0 for value in unknown)
    nodes.start_server(goal_turn_speed=0.25)
    assert values_of(nodes, SERVER, 'goal_angular_speed') == [0.25]
    assert reported(SERVER, 'goal_turn_speed') == 1


@pytest.mark.parametrize('name, value, reason', [
    ('workspace_min', [0.0, 0.0], 'workspace_min has 2 entries, expected 3'),
    ('speed', 99.0, 'speed out of range'), ('speed', 'high', "'speed' to 'high'"),
    ('turn_speed', 99.0, 'angular_speed out of range'),
    ('turn_speed', 'high', "turn_speed is 'high', expected a float"),
    ('torque_rate', 1.0, 'torque_rate [Nm per tick] is now torque_slew [Nm/s]: 1 Nm')])
def test_an_invalid_value_at_start_up_is_refused(nodes, name, value, reason):
    with pytest.raises(GdmpError, match=re.escape(reason)):
        nodes.start_arm(**{name: value})
