"""Parameters change live, are checked before they take effect, and say why they are refused."""
import numpy as np
import pytest
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically
from rclpy.parameter import Parameter

SIM, SERVER = 'panda_sim', 'trajectory_server'


def set_all(world, node, **values):
    changes = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    return world.call(SetParametersAtomically, f'{node}/set_parameters_atomically',
                      parameters=changes).result


def test_parameters_change_live_and_are_checked_first(world):
    world.start()
    # What contradicts another parameter is refused, and nothing of the change is kept.
    bad = set_all(world, SIM, speed=0.1, stiffness_min=[900.0, 20.0], stiffness_max=[800.0, 30.0])
    assert not bad.successful and 'stiffness_min is (900.0, 20.0)' in bad.reason
    assert 'expected less than stiffness_max' in bad.reason
    assert 'speed out of range' in set_all(world, SIM, speed=-1.0).reason
    locked = set_all(world, SIM, model='other.xml')
    assert not locked.successful and 'cannot change while the node is configured' in locked.reason
    box = set_all(world, SERVER, workspace_min=[0.0, 0.0, 0.9], workspace_max=[1.0, 1.0, 0.5])
    assert not box.successful and 'workspace_min z is 0.9 m' in box.reason
    # Live: a stiffness that is bounded from now on.
    before = np.array(world.robot[-1].stiffness).reshape(6, 6)
    assert before[0, 0] == pytest.approx(400.0, rel=0.05)
    assert set_all(world, SIM, stiffness_max=[150.0, 20.0]).successful
    world.wait('a softer arm', lambda: np.linalg.eigvalsh(
        np.array(world.robot[-1].stiffness).reshape(6, 6)[:3, :3]).max() < 151.0)
    # With the next motion: what is sent with the reference.
    world.listen()
    assert set_all(world, SERVER, damping_ratio=0.9).successful
    world.spin(0.3)
    assert world.references[-1].damping_ratio == pytest.approx(0.7)
    world.operator.execute()
    world.wait('the new damping ratio', lambda: world.references[-1].damping_ratio == 0.9)
    assert np.abs(np.diff(world.torques(), axis=0)).max() <= 1.0 + 1e-9


def test_parameters_describe_themselves(world):
    world.start_sim()
    found = world.call(DescribeParameters, f'{SIM}/describe_parameters',
                       names=['speed', 'model']).descriptors
    assert found[0].description == 'of the reference [m/s]; changes at once'
    assert found[0].floating_point_range[0].to_value == 10.0
    assert 'read-only while the node is configured' in found[1].description
