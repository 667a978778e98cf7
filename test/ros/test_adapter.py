"""The adapter with each preset: message types, topics, order and units for the controller."""
import copy
from pathlib import Path

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
import pytest
from rcl_interfaces.msg import SetParametersResult
from std_msgs.msg import Float64MultiArray

from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.ros import messages
from gdmp_ros.ros.adapter import along_axes
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.middleware import Publisher
from test.ros.nodes import FRAME, open_testbed

PRESETS = Path(__file__).parents[2] / 'config' / 'presets'
#: Presets, and namespaces of their adapters.
SPACES = {'crisp': '/crisp', 'franka': '/franka', 'matrix': '/matrix',
          'mayr': '/CartesianImpedance_trajectory_controller', 'cartesian_controllers': '/'}
POSE = np.array([0.4, -0.1, 0.5, *UnitQuaternion().project(np.array([0.1, 0.9, 0.2, -0.3]))])


def stiffness():
    result = np.diag([300.0, 400.0, 9000.0, 20.0, 30.0, 40.0])
    result[0, 1] = result[1, 0] = 50.0
    result[0, 4] = result[4, 0] = 3.0
    return result


@pytest.fixture(scope='module')
def adapters(tmp_path_factory):
    """An adapter with each preset, each in a namespace."""
    with open_testbed(tmp_path_factory.mktemp('nodes'), '') as made:
        for preset, space in SPACES.items():
            made.children.start_node(preset, 'gdmp_ros.ros.adapter', {}, [
                '--params-file', str(PRESETS / f'{preset}.yaml'), '-r', f'__ns:={space}',
                '-p', 'measured_pose_topic:=/robot',
                *(['-p', 'frame_id:=base_link'] if preset == 'cartesian_controllers' else [])])
        yield made


@pytest.fixture
def feed(adapters):
    yield Feed(adapters)
    adapters.forget()


class Feed:
    """Publishes references, and receives what the adapters make of them."""

    def __init__(self, nodes):
        self.nodes, self.got = nodes, {}
        self.message = Reference()
        self.message.header.frame_id = FRAME
        messages.fill_reference(self.message, np.concatenate(
            [POSE, np.zeros(12), stiffness().reshape(-1), [0.7]]))
        self.out = nodes.publisher(Reference, '/trajectory_server/reference')
        self.robot = nodes.publisher(PoseStamped, '/robot')
        self.measured = PoseStamped()
        self.measured.header.frame_id = FRAME
        messages.set_pose(self.measured.pose, POSE)

    def listen(self, kind, topic):
        def take(message):
            self.got[topic] = message
        self.nodes.subscribe(kind, topic, take, 1)
        return self

    def until(self, *topics):
        """Publish the reference until messages on all topics have arrived; returns them."""
        # References and measured poses that are old are not used.
        Feed.stamp = self.message.header.stamp = messages.stamp_of(
            self.nodes.client.clock.wall())

        def look():
            self.measured.header.stamp = messages.stamp_of(self.nodes.client.clock.wall())
            self.robot.publish(self.measured)
            self.out.publish(self.message)
            return all(topic in self.got for topic in topics)
        self.nodes.wait(f'{topics}', look, 60.0)
        return [self.got[topic] for topic in topics]


def check_pose(message, frame=FRAME):
    np.testing.assert_array_equal(messages.pose_numbers(message.pose), POSE)
    assert message.header.frame_id == frame
    assert message.header.stamp == Feed.stamp


def test_every_preset_is_tested():
    # That of the joints: test_joints.
    assert {path.stem for path in PRESETS.glob('*.yaml')} == {*SPACES,
                                                              'joint_trajectory_controller'}


def test_crisp_gets_six_numbers_inside_its_bounds(feed):
    pose, six = feed.listen(PoseStamped, '/crisp/target_pose').listen(
        Float64MultiArray, '/crisp/target_stiffness').until(
        '/crisp/target_pose', '/crisp/target_stiffness')
    check_pose(pose)
    assert list(six.data) == [300.0, 400.0, 2000.0, 20.0, 30.0, 40.0]


def test_an_invalid_reference_is_refused_and_not_converted(feed):
    topic = '/crisp/target_pose'
    feed.listen(PoseStamped, topic).until(topic)
    for change, reason in ((lambda m: setattr(m.header, 'frame_id', 'world'),
                            "frame is 'world'"),
                           (lambda m: setattr(m.pose.position, 'x', float('nan')),
                            'a number is NaN or infinite')):
        good = copy.deepcopy(feed.message)
        change(feed.message)
        feed.nodes.spend(0.3)  # receive what was converted before
        feed.got.clear()

        def refused(reason=reason):
            # Repeated, because a warning is logged at most once a second.
            feed.out.publish(feed.message)
            return reason in feed.nodes.log('crisp')
        feed.nodes.wait('the refusal', refused)
        assert feed.got == {}
        feed.message = good
        check_pose(feed.until(topic)[0])


def test_mayr_gets_a_wrench_in_its_namespace(feed):
    space = SPACES['mayr']
    pose, wrench = feed.listen(PoseStamped, f'{space}/reference_pose').listen(
        WrenchStamped, f'{space}/set_cartesian_stiffness').until(
        f'{space}/reference_pose', f'{space}/set_cartesian_stiffness')
    check_pose(pose)
    force, torque = wrench.wrench.force, wrench.wrench.torque
    assert (force.x, force.y, force.z) == (300.0, 400.0, 2000.0)
    assert (torque.x, torque.y, torque.z) == (20.0, 30.0, 40.0)


def test_matrix_gets_all_entries_with_the_coupling_of_axes(feed):
    pose, matrix = feed.listen(PoseStamped, '/matrix/target_pose').listen(
        Float64MultiArray, '/matrix/target_stiffness').until(
        '/matrix/target_pose', '/matrix/target_stiffness')
    check_pose(pose)
    got = np.reshape(matrix.data, (6, 6))
    # Inside the bounds: only the axis that is too stiff has changed.
    assert got[2, 2] == pytest.approx(2000.0)
    wanted = stiffness()
    wanted[2, 2] = got[2, 2]
    np.testing.assert_allclose(got, wanted, atol=1e-6)
    assert [d.label for d in matrix.layout.dim] == ['rows', 'columns']


def test_franka_gets_the_pose_and_no_stiffness(feed):
    topic = '/franka/cartesian_impedance_example_controller/equilibrium_pose'
    check_pose(feed.listen(PoseStamped, topic).until(topic)[0])
    adapter = feed.nodes.children.node('franka').participant
    published = [one.topic for one in adapter.made if isinstance(one, Publisher)]
    assert published == [topic]


def test_cartesian_controllers_get_six_parameters_along_the_tool(feed):
    names = [f'stiffness.{kind}_{axis}' for kind in ('trans', 'rot') for axis in 'xyz']
    node, refused = ManagedNode('cartesian_compliance_controller'), []
    for name in names:
        node.declare_parameter(name, 1.0)

    def check(changes):
        if len(refused) < 1:
            refused.append(changes)
            return SetParametersResult(successful=False, reason='not yet')
        return SetParametersResult(successful=True)
    node.add_on_set_parameters_callback(check)
    topic = '/cartesian_compliance_controller/target_frame'
    check_pose(feed.listen(PoseStamped, topic).until(topic)[0], 'base_link')
    wanted = along_axes(stiffness(), POSE[3:])

    def arrived():
        feed.out.publish(feed.message)
        return np.allclose([node.get_parameter(name).value for name in names],
                           np.minimum(wanted, [5000.0] * 3 + [500.0] * 3))
    # A refusal is logged, and the request repeated.
    feed.nodes.wait('the stiffness', arrived, 30.0)
    assert 'refused the stiffness: not yet' in feed.nodes.log('cartesian_controllers')
    node.participant.leave()
    node.destroy_node()


def test_six_numbers_along_the_axes_of_the_tool():
    quarter = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # about z
    np.testing.assert_allclose(along_axes(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), quarter),
                               [2.0, 1.0, 3.0, 5.0, 4.0, 6.0], atol=1e-12)
    kept = along_axes(stiffness(), POSE[3:])
    assert kept[:3].sum() == pytest.approx(9700.0) and kept[3:].sum() == pytest.approx(90.0)


def test_a_reference_that_is_old_reaches_no_other_controller(feed):
    topic = '/crisp/target_pose'
    feed.listen(PoseStamped, topic).until(topic)
    guard = feed.nodes.children.node('crisp').guard
    refused = guard.refused
    feed.message.header.stamp = messages.stamp_of(
        feed.nodes.client.clock.wall() - 3_000_000_000)
    feed.got.clear()
    for _ in range(20):
        feed.out.publish(feed.message)
        feed.nodes.spend(0.01)
    assert guard.refused > refused and 's in the past' in guard.last_refusal
    assert topic not in feed.got


def test_a_motion_begins_only_where_the_robot_is_known_to_be_now(feed):
    feed.nodes.spend(2.0)  # nobody publishes its pose any more
    guard = feed.nodes.children.node('crisp').guard
    feed.message.header.stamp = messages.stamp_of(feed.nodes.client.clock.wall())
    feed.out.publish(feed.message)
    feed.nodes.spend(0.1)
    assert 'no pose of the robot' in guard.last_refusal
