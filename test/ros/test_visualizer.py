"""What RViz and Foxglove receive, and what dragging an interactive marker does."""
from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.srv import LoadSkill
from nav_msgs.msg import Path
import numpy as np
import pytest
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import InteractiveMarkerFeedback, InteractiveMarkerUpdate, MarkerArray
from visualization_msgs.srv import GetInteractiveMarkers

from gdmp_ros import Demonstration, Skill
from gdmp_ros.data import lasa
from gdmp_ros.playback.prediction import LIKELY, Tube
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.ros.visualizer import markers
from gdmp_ros.ros.visualizer.node import MENU
from test.ros.nodes import CLEANUP, DEACTIVATE, FRAME

FEEDBACK = InteractiveMarkerFeedback


@pytest.fixture(scope='module')
def visualizer(shared_nodes):
    shared_nodes.children.start_node('visualizer', 'gdmp_ros.ros.visualizer.node', {
        'objects': ['hole']})


class Viewer:
    """What a viewer knows: markers by namespace and number, interactive markers by name."""

    def __init__(self, nodes):
        self.nodes, self.shown, self.plans, self.updates = nodes, {}, [], []
        nodes.subscribe(MarkerArray, '/visualizer/markers', self._on_markers, 1)
        nodes.subscribe(InteractiveMarkerUpdate, '/visualizer/update', self.updates.append)
        nodes.subscribe(Path, f'/{SERVER}/plan', self.plans.append, 1)
        self._feedback = nodes.publisher(FEEDBACK, '/visualizer/feedback')

    def _on_markers(self, message):
        for marker in message.markers:
            if marker.action == marker.DELETE:
                # Markers that were shown to nobody are deleted too.
                self.shown.pop((marker.ns, marker.id), None)
            elif marker.action == marker.DELETEALL:
                self.shown.clear()
            else:
                self.shown[marker.ns, marker.id] = marker

    def namespaces(self):
        return {space for space, _ in self.shown}

    def handles(self):
        reply = self.nodes.call(GetInteractiveMarkers, '/visualizer/get_interactive_markers')
        return {marker.name: marker for marker in reply.markers}

    def use(self, name, event, pose=None, entry=0, frame=FRAME):
        message = FEEDBACK(marker_name=name, event_type=event, menu_entry_id=entry)
        message.header.frame_id = frame
        if pose is not None:
            messages.set_pose(message.pose, pose)
        self._feedback.publish(message)

    def wait_handles(self, *names):
        self.nodes.wait(f'{names}', lambda: set(self.handles()) == set(names), 60.0)
        return self.handles()


@pytest.fixture
def viewer(running, visualizer):
    return Viewer(running)


def test_everything_is_shown_and_the_goal_is_switched_by_its_handle(running, viewer):
    running.wait('all markers', lambda: {
        'arm', 'tool', 'base', 'goal', 'stiffness', 'manipulability'} <= viewer.namespaces(), 60.0)
    stiffness = viewer.shown['stiffness', 0]
    size = np.sort([stiffness.scale.x, stiffness.scale.y, stiffness.scale.z])
    applied = np.linalg.eigvalsh(np.reshape(running.robot[-1].stiffness, (6, 6))[:3, :3])
    np.testing.assert_allclose(size, 2e-4 * applied, rtol=1e-3)

    handles = viewer.wait_handles('goal', 'hand', 'object hole')
    assert len(handles['goal'].controls) == 7
    assert [entry.title for entry in handles['goal'].menu_entries] == list(MENU)
    # The menu starts the motion, the handle switches its goal.
    viewer.use('goal', FEEDBACK.MENU_SELECT, entry=1 + MENU.index('start'))
    running.client.wait_status('moving', 10.0)
    running.wait('a predicted path', lambda: viewer.plans and len(viewer.plans[-1].poses) > 10)
    before = messages.pose_numbers(viewer.plans[-1].poses[-1].pose)
    np.testing.assert_allclose(before, messages.pose_numbers(handles['goal'].pose), atol=2e-3)
    goal, elsewhere = before.copy(), before.copy()
    goal[:3] += [0.0, -0.06, 0.05]
    elsewhere[:3] += [0.05, 0.0, 0.0]
    viewer.use('goal', FEEDBACK.POSE_UPDATE, elsewhere)
    viewer.use('goal', FEEDBACK.MOUSE_UP, elsewhere, frame='somewhere')  # a wrong frame
    ticks = running.state.ticks
    running.wait('more ticks', lambda: running.state.ticks > ticks + 300)
    np.testing.assert_allclose(messages.pose_numbers(running.state.goal[0])[:3], before[:3],
                               atol=2e-3)
    viewer.use('goal', FEEDBACK.POSE_UPDATE, goal)
    viewer.use('goal', FEEDBACK.MOUSE_UP, goal)
    running.wait('the goal to be switched', lambda: np.allclose(
        messages.pose_numbers(running.state.goal[0])[:3], goal[:3]))
    running.wait('a path to the new goal', lambda: viewer.plans[-1].poses and np.allclose(
        messages.pose_numbers(viewer.plans[-1].poses[-1].pose)[:3], goal[:3], atol=2e-3))
    running.client.wait_status('holding', 20.0)
    running.wait('the tool to be there',
                 lambda: np.linalg.norm(running.tool()[:3] - goal[:3]) < 0.01)
    running.wait('the end of the predicted path',
                 lambda: 'predicted path' not in viewer.namespaces())
    # A viewer that missed the message removes the path, too.
    late = Viewer(running)
    late.shown['predicted path', 0] = None
    running.wait('its end', lambda: 'predicted path' not in late.namespaces())
    assert len(viewer.shown['past path', 0].points) > 10
    # A viewer repeats that the handle is held; after the last repetition it is released.
    held = goal.copy()
    held[2] += 0.1
    viewer.use('goal', FEEDBACK.POSE_UPDATE, held)
    begun = len(running.robot)

    def still_held():
        viewer.use('goal', FEEDBACK.KEEP_ALIVE)
        running.spend(0.05)
        pose = messages.pose_numbers(viewer.handles()['goal'].pose)
        np.testing.assert_allclose(pose, held)
        return len(running.robot) > begun + 2000
    running.wait('two seconds', still_held, 60.0)
    running.wait('the handle to be back', lambda: np.allclose(
        messages.pose_numbers(viewer.handles()['goal'].pose), goal, atol=1e-6))
    # Updates are numbered without gaps: a viewer that finds one begins anew.
    numbers = [update.seq_num for update in viewer.updates]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_how_takes_vary_is_shown_around_the_predicted_path(running, viewer, tmp_path):
    shown, path = lasa.robot_demonstrations('GShape')[:3], tmp_path / 'several.json'
    skill = Skill.learn(shown, 40)
    skill.save(path)
    assert running.call(LoadSkill, f'{SERVER}/load_skill', path=str(path)).success
    assert running.call(Trigger, f'/{SERVER}/start').success
    space = 'likely positions of takes'
    running.wait('the tube', lambda: space in viewer.namespaces(), 60.0)
    # The skill is likely to pass a point as far from its own path as the drawn ellipsoid says.
    drawn = [marker for key, marker in viewer.shown.items() if key[0] == space]
    largest = max(max(marker.scale.x, marker.scale.y, marker.scale.z) for marker in drawn) / 2.0
    stated = Tube(skill, 40).covariances(np.linspace(0.0, 1.0, 41))[:, :3, :3]
    assert largest <= LIKELY * np.sqrt(np.linalg.eigvalsh(stated).max()) * 1.01
    assert largest > 0.001
    assert running.call(Trigger, f'/{SERVER}/stop').success
    running.wait('its end', lambda: space not in viewer.namespaces(), 60.0)


def test_the_handle_returns_from_a_goal_that_is_refused(running, viewer):
    running.wait('the goal', lambda: ('goal', 0) in viewer.shown, 60.0)
    assert running.call(Trigger, f'/{SERVER}/start').success
    there = messages.pose_numbers(viewer.wait_handles('goal', 'hand', 'object hole')['goal'].pose)
    away = there.copy()
    away[2] = 7.0
    viewer.use('goal', FEEDBACK.POSE_UPDATE, away)
    viewer.use('goal', FEEDBACK.MOUSE_UP, away)
    running.wait('the refusal', lambda: running.state.refused > 0)
    assert 'goal z is 7.000 m, outside the workspace' in running.state.last_refusal
    running.wait('the handle to be back', lambda: np.allclose(
        messages.pose_numbers(viewer.handles()['goal'].pose), there))


def test_an_object_is_dragged_and_the_motion_goes_with_it(running, viewer, skill, tmp_path):
    path = skill.reproduce(0.02)
    Skill.learn(Demonstration(path.times, path.points, skill.manifold, frames={
        'box': skill.start[:7], 'hole': skill.goal[:7]}), start_frame='box',
        goal_frame='hole').save(tmp_path / 'among.json')
    assert running.set_parameters(SERVER, moving_objects=['hole']).successful
    viewer.wait_handles('goal', 'hand', 'object hole')
    hole = skill.goal[:7].copy()
    viewer.use('object hole', FEEDBACK.MOUSE_DOWN, hole)
    viewer.use('object hole', FEEDBACK.POSE_UPDATE, hole)
    viewer.use('object hole', FEEDBACK.MOUSE_UP, hole)
    running.wait('its axes', lambda: 'hole' in viewer.namespaces())
    running.client.execute(ExecuteSkill.Goal(skill=str(tmp_path / 'among.json')))
    running.wait_progress(0.3)
    for step in range(1, 11):
        moved = hole + step / 10 * np.array([0.0, 0.05, 0.03, 0.0, 0.0, 0.0, 0.0])
        viewer.use('object hole', FEEDBACK.POSE_UPDATE, moved)
        running.spend(0.05)
    viewer.use('object hole', FEEDBACK.MOUSE_UP, moved)
    result = running.client.result(60.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    assert np.linalg.norm(running.tool()[:3] - moved[:3]) < 5e-3


def test_the_arm_is_guided_by_the_handle_of_the_hand(running, viewer):
    assert running.transition(SERVER, DEACTIVATE, CLEANUP)
    running.wait('the arm', lambda: ('arm', 0) in viewer.shown, 60.0)
    viewer.wait_handles('hand', 'object hole')  # without a server there is no goal
    assert running.call(SetBool, f'/{ARM}/teach', data=True).success
    begun = running.tool()
    pose = begun.copy()
    for _ in range(30):
        pose[1] += 0.003
        viewer.use('hand', FEEDBACK.POSE_UPDATE, pose)
        running.spend(0.03)
    running.wait('the tool to follow', lambda: running.tool()[1] - begun[1] > 0.06)
    viewer.use('hand', FEEDBACK.MOUSE_UP, pose)
    running.wait_rest(0.01)


def test_a_frame_has_arrows_along_its_axes():
    pose = np.array([0.1, 0.2, 0.3, np.cos(0.25 * np.pi), 0.0, 0.0, np.sin(0.25 * np.pi)])
    ends = [np.array([[p.x, p.y, p.z] for p in arrow.points])
            for arrow in markers.frame('base', pose, 0.5)]
    for (tail, tip), axis in zip(ends, ([0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0])):
        np.testing.assert_allclose(tail, pose[:3])
        np.testing.assert_allclose(tip - tail, 0.5 * np.array(axis), atol=1e-12)
