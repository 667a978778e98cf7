"""Each preset feeds a stand-in for its controller: real message types, topics, order and units."""
from pathlib import Path

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from gdmp_ros.manifolds import UnitQuaternion
from gdmp_ros.ros import messages
from gdmp_ros.ros.adapter.node import along_axes
from gdmp_ros.ros.lifecycle import reliable

PRESETS = Path(__file__).parents[2] / 'config' / 'presets'
POSE = np.array([0.4, -0.1, 0.5, *UnitQuaternion().project(np.array([0.1, 0.9, 0.2, -0.3]))])


def stiffness():
    result = np.diag([300.0, 400.0, 9000.0, 20.0, 30.0, 40.0])
    result[0, 1] = result[1, 0] = 50.0
    result[0, 4] = result[4, 0] = 3.0
    return result


class Feed:
    """References, and everything that the adapter makes of them."""

    def __init__(self, world, preset, *extra):
        self.world, self.got = world, {}
        self.out = world.node.create_publisher(Reference, '/trajectory_server/reference',
                                               reliable(10))
        self.message = Reference()
        self.message.header.frame_id = 'panda_link0'
        self.message.header.stamp = messages.stamp_of(12_345_678_901)
        messages.fill_reference(self.message, np.concatenate(
            [POSE, np.zeros(12), stiffness().reshape(-1), [0.7]]))
        world.children.start_node('adapter', 'gdmp_ros.ros.adapter.node', {}, [
            '--params-file', str(PRESETS / f'{preset}.yaml'), *extra])

    def listen(self, kind, topic):
        def take(message):
            self.got[topic] = message
        self.world.node.create_subscription(kind, topic, take, reliable(1))
        return self

    def until(self, *topics):
        def look():
            self.out.publish(self.message)
            return all(topic in self.got for topic in topics)
        self.world.wait(f'{topics}', look, 60.0)
        return [self.got[topic] for topic in topics]


def check_pose(message, frame='panda_link0'):
    np.testing.assert_array_equal(messages.pose_numbers(message.pose), POSE)
    assert message.header.frame_id == frame
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345_678_901)


def test_crisp_gets_six_numbers_inside_its_bounds(world):
    pose, six = Feed(world, 'crisp').listen(PoseStamped, '/target_pose').listen(
        Float64MultiArray, '/target_stiffness').until('/target_pose', '/target_stiffness')
    check_pose(pose)
    assert list(six.data) == [300.0, 400.0, 2000.0, 20.0, 30.0, 40.0]


def test_what_no_controller_should_see_is_not_passed_on(world):
    feed = Feed(world, 'crisp').listen(PoseStamped, '/target_pose')
    feed.until('/target_pose')
    feed.message.header.frame_id = 'world'
    feed.out.publish(feed.message)
    world.wait('the other frame', lambda: "frame is 'world'" in world.log('adapter'))
    world.spin(1.1)
    feed.message.header.frame_id = 'panda_link0'
    feed.message.pose.position.x = float('nan')
    feed.out.publish(feed.message)
    world.wait('the refusal', lambda: 'a number is NaN or infinite' in world.log('adapter'))
    world.spin(0.2)
    check_pose(feed.got['/target_pose'])


def test_mayr_gets_a_wrench_in_its_namespace(world):
    space = '/CartesianImpedance_trajectory_controller'
    pose, wrench = Feed(world, 'mayr', '-r', f'__ns:={space}').listen(
        PoseStamped, f'{space}/reference_pose').listen(
        WrenchStamped, f'{space}/set_cartesian_stiffness').until(
        f'{space}/reference_pose', f'{space}/set_cartesian_stiffness')
    check_pose(pose)
    force, torque = wrench.wrench.force, wrench.wrench.torque
    assert (force.x, force.y, force.z) == (300.0, 400.0, 2000.0)
    assert (torque.x, torque.y, torque.z) == (20.0, 30.0, 40.0)


def test_a_whole_matrix_is_passed_on_with_what_couples_its_axes(world):
    pose, matrix = Feed(world, 'matrix').listen(PoseStamped, '/target_pose').listen(
        Float64MultiArray, '/target_stiffness').until('/target_pose', '/target_stiffness')
    check_pose(pose)
    got = np.reshape(matrix.data, (6, 6))
    # Inside the bounds: only the axis that is too stiff has changed.
    assert got[2, 2] == pytest.approx(2000.0)
    wanted = stiffness()
    wanted[2, 2] = got[2, 2]
    np.testing.assert_allclose(got, wanted, atol=1e-6)
    assert [d.label for d in matrix.layout.dim] == ['rows', 'columns']


def test_franka_gets_the_pose_and_no_stiffness(world):
    feed = Feed(world, 'franka').listen(PoseStamped, '/equilibrium_pose')
    check_pose(feed.until('/equilibrium_pose')[0])
    topics = dict(world.node.get_topic_names_and_types())
    assert '/target_stiffness' not in topics


def test_cartesian_controllers_get_six_parameters_along_the_tool(world):
    names = [f'stiffness.{kind}_{axis}' for kind in ('trans', 'rot') for axis in 'xyz']
    node, refused = Node('cartesian_compliance_controller', context=world.node.context), []
    for name in names:
        node.declare_parameter(name, 1.0)

    def check(changes):
        if len(refused) < 1:
            refused.append(changes)
            return SetParametersResult(successful=False, reason='not yet')
        return SetParametersResult(successful=True)
    node.add_on_set_parameters_callback(check)
    world.operator._executor.add_node(node)
    feed = Feed(world, 'cartesian_controllers', '-p', 'frame_id:=base_link').listen(
        PoseStamped, '/cartesian_compliance_controller/target_frame')
    check_pose(feed.until('/cartesian_compliance_controller/target_frame')[0], 'base_link')
    wanted = along_axes(stiffness(), POSE[3:])

    def arrived():
        feed.out.publish(feed.message)
        return np.allclose([node.get_parameter(name).value for name in names],
                           np.minimum(wanted, [5000.0] * 3 + [500.0] * 3))
    # A refusal is said, and tried again.
    world.wait('the stiffness', arrived, 30.0)
    assert 'refuses the stiffness: not yet' in world.log('adapter')
    node.destroy_node()


def test_six_numbers_along_the_axes_of_the_tool():
    quarter = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # about z
    np.testing.assert_allclose(along_axes(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), quarter),
                               [2.0, 1.0, 3.0, 5.0, 4.0, 6.0], atol=1e-12)
    kept = along_axes(stiffness(), POSE[3:])
    assert kept[:3].sum() == pytest.approx(9700.0) and kept[3:].sum() == pytest.approx(90.0)
