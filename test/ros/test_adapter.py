"""The adapter with each preset: message types, topics, order and units for the controller."""
import copy
from pathlib import Path

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
import pytest
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.ros import messages
from gdmp_ros.ros.adapter.node import along_axes
from gdmp_ros.ros.lifecycle import reliable
from test.ros.nodes import FRAME

PRESETS = Path(__file__).parents[2] / 'config' / 'presets'
POSE = np.array([0.4, -0.1, 0.5, *UnitQuaternion().project(np.array([0.1, 0.9, 0.2, -0.3]))])


def stiffness():
    result = np.diag([300.0, 400.0, 9000.0, 20.0, 30.0, 40.0])
    result[0, 1] = result[1, 0] = 50.0
    result[0, 4] = result[4, 0] = 3.0
    return result


class Feed:
    """Publishes references, and receives what the adapter makes of them."""

    def __init__(self, nodes, preset, *extra):
        self.nodes, self.got = nodes, {}
        self.message = Reference()
        self.message.header.frame_id = FRAME
        self.message.header.stamp = messages.stamp_of(12_345_678_901)
        messages.fill_reference(self.message, np.concatenate(
            [POSE, np.zeros(12), stiffness().reshape(-1), [0.7]]))
        nodes.children.start_node('adapter', 'gdmp_ros.ros.adapter.node', {}, [
            '--params-file', str(PRESETS / f'{preset}.yaml'), *extra])
        self.out = nodes.publisher(Reference, '/trajectory_server/reference')

    def listen(self, kind, topic):
        def take(message):
            self.got[topic] = message
        self.nodes.subscribe(kind, topic, take, reliable(1))
        return self

    def until(self, *topics):
        """Publish the reference until messages on all topics have arrived; returns them."""
        def look():
            self.out.publish(self.message)
            return all(topic in self.got for topic in topics)
        self.nodes.wait(f'{topics}', look, 60.0)
        return [self.got[topic] for topic in topics]


def check_pose(message, frame=FRAME):
    np.testing.assert_array_equal(messages.pose_numbers(message.pose), POSE)
    assert message.header.frame_id == frame
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345_678_901)


def test_crisp_gets_six_numbers_inside_its_bounds(nodes):
    pose, six = Feed(nodes, 'crisp').listen(PoseStamped, '/target_pose').listen(
        Float64MultiArray, '/target_stiffness').until('/target_pose', '/target_stiffness')
    check_pose(pose)
    assert list(six.data) == [300.0, 400.0, 2000.0, 20.0, 30.0, 40.0]


def test_an_invalid_reference_is_refused_and_not_converted(nodes):
    feed = Feed(nodes, 'crisp').listen(PoseStamped, '/target_pose')
    feed.until('/target_pose')
    for change, reason in ((lambda m: setattr(m.header, 'frame_id', 'world'),
                            "frame is 'world'"),
                           (lambda m: setattr(m.pose.position, 'x', float('nan')),
                            'a number is NaN or infinite')):
        good = copy.deepcopy(feed.message)
        change(feed.message)
        nodes.wait_quiet([])
        feed.got.clear()

        def refused(reason=reason):
            # Repeated, because a warning is logged at most once a second.
            feed.out.publish(feed.message)
            return reason in nodes.log('adapter')
        nodes.wait('the refusal', refused)
        feed.message = good
        # The next valid one is the first that is converted.
        assert feed.got == {}
        check_pose(feed.until('/target_pose')[0])


def test_mayr_gets_a_wrench_in_its_namespace(nodes):
    space = '/CartesianImpedance_trajectory_controller'
    pose, wrench = Feed(nodes, 'mayr', '-r', f'__ns:={space}').listen(
        PoseStamped, f'{space}/reference_pose').listen(
        WrenchStamped, f'{space}/set_cartesian_stiffness').until(
        f'{space}/reference_pose', f'{space}/set_cartesian_stiffness')
    check_pose(pose)
    force, torque = wrench.wrench.force, wrench.wrench.torque
    assert (force.x, force.y, force.z) == (300.0, 400.0, 2000.0)
    assert (torque.x, torque.y, torque.z) == (20.0, 30.0, 40.0)


def test_matrix_gets_all_entries_with_the_coupling_of_axes(nodes):
    pose, matrix = Feed(nodes, 'matrix').listen(PoseStamped, '/target_pose').listen(
        Float64MultiArray, '/target_stiffness').until('/target_pose', '/target_stiffness')
    check_pose(pose)
    got = np.reshape(matrix.data, (6, 6))
    # Inside the bounds: only the axis that is too stiff has changed.
    assert got[2, 2] == pytest.approx(2000.0)
    wanted = stiffness()
    wanted[2, 2] = got[2, 2]
    np.testing.assert_allclose(got, wanted, atol=1e-6)
    assert [d.label for d in matrix.layout.dim] == ['rows', 'columns']


def test_franka_gets_the_pose_and_no_stiffness(nodes):
    feed = Feed(nodes, 'franka').listen(PoseStamped, '/equilibrium_pose')
    check_pose(feed.until('/equilibrium_pose')[0])
    topics = dict(nodes.node.get_topic_names_and_types())
    assert '/target_stiffness' not in topics


def test_cartesian_controllers_get_six_parameters_along_the_tool(nodes):
    names = [f'stiffness.{kind}_{axis}' for kind in ('trans', 'rot') for axis in 'xyz']
    node, refused = Node('cartesian_compliance_controller', context=nodes.node.context), []
    for name in names:
        node.declare_parameter(name, 1.0)

    def check(changes):
        if len(refused) < 1:
            refused.append(changes)
            return SetParametersResult(successful=False, reason='not yet')
        return SetParametersResult(successful=True)
    node.add_on_set_parameters_callback(check)
    nodes.client._executor.add_node(node)
    feed = Feed(nodes, 'cartesian_controllers', '-p', 'frame_id:=base_link').listen(
        PoseStamped, '/cartesian_compliance_controller/target_frame')
    check_pose(feed.until('/cartesian_compliance_controller/target_frame')[0], 'base_link')
    wanted = along_axes(stiffness(), POSE[3:])

    def arrived():
        feed.out.publish(feed.message)
        return np.allclose([node.get_parameter(name).value for name in names],
                           np.minimum(wanted, [5000.0] * 3 + [500.0] * 3))
    # A refusal is logged, and the request repeated.
    nodes.wait('the stiffness', arrived, 30.0)
    assert 'refused the stiffness: not yet' in nodes.log('adapter')
    node.destroy_node()


def test_six_numbers_along_the_axes_of_the_tool():
    quarter = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # about z
    np.testing.assert_allclose(along_axes(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), quarter),
                               [2.0, 1.0, 3.0, 5.0, 4.0, 6.0], atol=1e-12)
    kept = along_axes(stiffness(), POSE[3:])
    assert kept[:3].sum() == pytest.approx(9700.0) and kept[3:].sum() == pytest.approx(90.0)
