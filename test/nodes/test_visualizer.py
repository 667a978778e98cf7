"""What RViz and Foxglove see, and what dragging a handle does: over DDS, as they speak."""
from nav_msgs.msg import Path
import numpy as np
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import InteractiveMarkerFeedback, InteractiveMarkerUpdate, MarkerArray
from visualization_msgs.srv import GetInteractiveMarkers

from gdmp_ros.ros import messages
from gdmp_ros.ros.lifecycle import reliable

FEEDBACK = InteractiveMarkerFeedback


class Viewer:
    """What a viewer knows: markers by name, handles by name."""

    def __init__(self, world):
        self.world, self.shown, self.plans, self.updates = world, {}, [], []
        world.children.start_node('visualizer', 'gdmp_ros.ros.visualizer.node', {})
        node = world.node
        node.create_subscription(MarkerArray, '/visualizer/markers', self._on_markers, reliable(1))
        node.create_subscription(InteractiveMarkerUpdate, '/visualizer/update',
                                 self.updates.append, reliable(100))
        node.create_subscription(Path, '/trajectory_server/plan', self.plans.append, reliable(1))
        self._feedback = node.create_publisher(FEEDBACK, '/visualizer/feedback', reliable(100))

    def _on_markers(self, message):
        for marker in message.markers:
            if marker.action == marker.DELETE:
                self.shown.pop((marker.ns, marker.id))
            elif marker.action == marker.DELETEALL:
                self.shown.clear()
            else:
                self.shown[marker.ns, marker.id] = marker

    def spaces(self):
        return {space for space, _ in self.shown}

    def handles(self):
        reply = self.world.call(GetInteractiveMarkers, '/visualizer/get_interactive_markers')
        return {marker.name: marker for marker in reply.markers}

    def use(self, name, event, pose=None, entry=0, frame='panda_link0'):
        message = FEEDBACK(marker_name=name, event_type=event, menu_entry_id=entry)
        message.header.frame_id = frame
        if pose is not None:
            messages.set_pose(message.pose, pose)
        self.world.wait('the handles to be served',
                        lambda: self._feedback.get_subscription_count() > 0)
        self._feedback.publish(message)


def test_the_goal_is_switched_by_its_handle_and_everything_is_shown(world):
    world.start()
    viewer = Viewer(world)
    world.wait('everything to be drawn', lambda: {
        'arm', 'tool', 'base', 'goal', 'stiffness', 'manipulability'} <= viewer.spaces(), 60.0)
    stiffness = viewer.shown['stiffness', 0]
    size = np.sort([stiffness.scale.x, stiffness.scale.y, stiffness.scale.z])
    applied = np.linalg.eigvalsh(np.reshape(world.robot[-1].stiffness, (6, 6))[:3, :3])
    np.testing.assert_allclose(size, 2e-4 * applied, rtol=1e-3)

    handles = viewer.handles()
    assert set(handles) == {'goal', 'hand'} and len(handles['goal'].controls) == 7
    assert [entry.title for entry in handles['goal'].menu_entries][:2] == ['start', 'stop']
    # The menu starts the motion, the handle switches its goal.
    viewer.use('goal', FEEDBACK.MENU_SELECT, entry=1)
    world.operator.wait_status('moving', 10.0)
    world.wait('a path to come', lambda: viewer.plans and len(viewer.plans[-1].poses) > 10)
    before = messages.pose_numbers(viewer.plans[-1].poses[-1].pose)
    np.testing.assert_allclose(before, messages.pose_numbers(handles['goal'].pose), atol=2e-3)
    goal = before.copy()
    goal[:3] += [0.0, -0.06, 0.05]
    viewer.use('goal', FEEDBACK.POSE_UPDATE, goal)
    viewer.use('goal', FEEDBACK.MOUSE_UP, goal, frame='somewhere')  # not a frame of ours
    world.spin(0.3)
    assert np.linalg.norm(messages.pose_numbers(world.operator.state.goal[0])[:3] - goal[:3]) > 0.05
    viewer.use('goal', FEEDBACK.MOUSE_UP, goal)
    world.wait('the goal to be switched', lambda: np.allclose(
        messages.pose_numbers(world.operator.state.goal[0])[:3], goal[:3]))
    world.wait('a path to the new goal', lambda: viewer.plans[-1].poses and np.allclose(
        messages.pose_numbers(viewer.plans[-1].poses[-1].pose)[:3], goal[:3], atol=2e-3))
    world.operator.wait_status('holding', 20.0)
    world.wait('the tool to be there', lambda: np.linalg.norm(world.tool()[:3] - goal[:3]) < 0.01)
    world.wait('the path to come to vanish', lambda: 'path to come' not in viewer.spaces())
    assert len(viewer.shown['path so far', 0].points) > 10
    # Who holds a handle still says so four times a second; who is gone has let go.
    held = goal.copy()
    held[2] += 0.1
    viewer.use('goal', FEEDBACK.POSE_UPDATE, held)
    for _ in range(7):
        viewer.use('goal', FEEDBACK.KEEP_ALIVE)
        world.spin(0.25)
    np.testing.assert_allclose(messages.pose_numbers(viewer.handles()['goal'].pose), held)
    world.wait('the handle to be back', lambda: np.allclose(
        messages.pose_numbers(viewer.handles()['goal'].pose), goal, atol=1e-6))
    # Updates are numbered without gaps: a viewer that finds one starts anew.
    numbers = [update.seq_num for update in viewer.updates]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_a_goal_that_is_refused_springs_back(world):
    world.start()
    viewer = Viewer(world)
    world.wait('the goal to be drawn', lambda: ('goal', 0) in viewer.shown, 60.0)
    assert world.call(Trigger, '/trajectory_server/start').success
    there = messages.pose_numbers(viewer.handles()['goal'].pose)
    away = there.copy()
    away[2] = 7.0
    viewer.use('goal', FEEDBACK.POSE_UPDATE, away)
    viewer.use('goal', FEEDBACK.MOUSE_UP, away)
    world.wait('the refusal', lambda: world.operator.state.refused > 0)
    assert 'goal z is 7.000 m, outside the workspace' in world.operator.state.last_refusal
    world.wait('the handle to be back', lambda: np.allclose(
        messages.pose_numbers(viewer.handles()['goal'].pose), there))


def test_the_arm_is_led_by_the_handle_of_the_hand(world):
    world.start_sim()
    world.wait('the arm', lambda: len(world.robot) > 0, 60.0)
    viewer = Viewer(world)
    world.wait('the arm to be drawn', lambda: ('arm', 0) in viewer.shown, 60.0)
    assert set(viewer.handles()) == {'hand'}  # without a server there is no goal
    assert world.call(SetBool, '/panda_sim/teach', data=True).success
    begun = world.tool()
    pose = begun.copy()
    for _ in range(30):
        pose[1] += 0.003
        viewer.use('hand', FEEDBACK.POSE_UPDATE, pose)
        world.spin(0.03)
    world.wait('the tool to follow', lambda: world.tool()[1] - begun[1] > 0.06)
    viewer.use('hand', FEEDBACK.MOUSE_UP, pose)
    world.spin(1.0)
    rest = world.tool()
    world.spin(0.5)
    assert np.linalg.norm(world.tool()[:3] - rest[:3]) < 0.01


def test_the_arm_describes_itself_to_whoever_comes_later(world):
    world.start_sim()
    world.wait('the arm', lambda: len(world.robot) > 0, 60.0)
    heard = []
    quality = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    world.node.create_subscription(String, '/robot_description', heard.append, quality)
    world.wait('the description', lambda: len(heard) > 0)
    assert '<link name="panda_link0">' in heard[0].data
    assert all(f'<joint name="joint{i}" type="revolute">' in heard[0].data for i in range(1, 8))
