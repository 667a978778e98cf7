"""A person records takes with keys, on any arm; a take may be paused."""
import numpy as np
import pytest
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from gdmp_ros.data import recordings
from gdmp_ros.data.skills import LearningSettings, skill_from_bags
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.teaching import press, Teacher
from gdmp_ros.ros.clients.testbed import MODULES, TAKE_RECORDER
from gdmp_ros.ros.messages import stamp_of
from gdmp_ros.ros.middleware import best_effort
from test.ros.nodes import FRAME
from test.ros.test_frames import at, static_broadcaster, transform


@pytest.fixture
def teacher(nodes, tmp_path):
    nodes.start_arm(gripper=True)
    nodes.children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
        'folder': str(tmp_path / 'takes'), 'storage': 'sqlite3'})
    made = Teacher(FRAME, nodes.check)
    made.await_nodes()
    yield made
    made.close()


def shifted(pose, **by):
    return pose + np.array([by.get(name, 0.0) for name in ('x', 'y', 'z')] + [0.0] * 4)


def test_the_arm_holds_until_it_is_freed_and_holds_again_at_home(teacher):
    home = teacher.pose.copy()
    teacher.hold(shifted(home, y=0.1), 1.0)
    teacher.spend(2.0)  # the hand lets go
    assert np.linalg.norm(teacher.pose[:3] - home[:3]) < 1e-3
    assert 'guide the arm' in press(teacher, 'f')
    teacher.move_to(shifted(home, y=0.1))
    assert np.linalg.norm(teacher.pose[:3] - home[:3]) > 0.05
    assert press(teacher, '') == 'recording take_001'
    with pytest.raises(GdmpError, match='stop it first'):
        press(teacher, 'h')
    assert 'messages' in press(teacher, '')
    assert 'home posture' in press(teacher, 'h')
    assert np.linalg.norm(teacher.pose[:3] - home[:3]) < 2e-3
    teacher.spend(0.3)
    assert teacher.arm_state != 'guided'
    assert press(teacher, 'd').endswith('dropped/take_001')
    assert 'pause the take' in press(teacher, 'x')
    assert press(teacher, None) == 'done'


def test_the_time_of_a_pause_is_not_in_the_bag_and_its_grasp_is(teacher, tmp_path):
    press(teacher, 'f')
    start = teacher.pose.copy()
    press(teacher, '')
    teacher.move_to(shifted(start, y=0.1))
    assert 'is paused' in press(teacher, 'p')
    with pytest.raises(GdmpError, match='paused already'):
        teacher.pause(True)
    teacher.move_to(shifted(start, y=0.1, z=0.1))
    with pytest.raises(GdmpError, match='bring it back'):
        press(teacher, 'p')
    assert 'closes' in press(teacher, 'c')
    teacher.move_to(shifted(start, y=0.1, z=0.008))
    teacher.spend(3.0)
    assert 'again' in press(teacher, 'p')
    teacher.move_to(shifted(start))
    press(teacher, 'q')
    bag = tmp_path / 'takes/take_001'
    recording = recordings.read(bag)
    demo = recording.demonstration
    points, speeds = demo.points[:, :3], np.linalg.norm(
        np.diff(demo.points[:, :3], axis=0), axis=1) / np.diff(demo.times)
    # Nothing of the way up, of the wait, or of a jump between the two parts.
    assert points[:, 2].max() < start[2] + 0.03
    assert demo.duration < 8.0 and np.diff(demo.times).max() < 0.25
    assert speeds.max() < 0.5
    # It belongs to where the take was paused.
    event, = recording.events
    at = demo.at(np.array([event.progress * demo.duration]))[0]
    assert abs(at[1] - start[1]) > 0.08


def test_a_pause_needs_a_take(teacher):
    with pytest.raises(GdmpError, match='no take is being recorded'):
        press(teacher, 'p')
    reply = teacher.call(SetBool, f'{TAKE_RECORDER}/pause', data=False)
    assert not reply.success and 'no take is paused' in reply.message
    press(teacher, '')
    press(teacher, 'p')
    assert 'messages' in press(teacher, '')  # a take that is paused is kept


def test_takes_between_objects_have_their_frames(nodes, tmp_path):
    """Of the camera, best effort, and of a fixture that was published once, long before."""
    nodes.start_arm(gripper=True)
    box, hole = at(0.4, -0.2, 0.1), at(0.5, 0.2, 0.1)
    static_broadcaster(nodes, transform(FRAME, 'hole', hole, stamp_of(1)))
    nodes.children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
        'folder': str(tmp_path / 'takes'), 'transforms': True})
    teacher = Teacher(FRAME, nodes.check)
    teacher.await_nodes()
    clock, publisher = nodes.client.clock, nodes.participant.publisher(
        TFMessage, '/tf', best_effort(10))
    nodes._made.append(publisher)

    def camera():
        while True:
            yield clock.now() + 33_000_000
            publisher.publish(TFMessage(transforms=[transform(
                FRAME, 'box', box, stamp_of(clock.wall()))]))
    camera = clock.start(camera())
    try:
        press(teacher, 'f')
        start = teacher.pose.copy()
        for number in range(2):
            press(teacher, '')
            teacher.move_to(shifted(start, y=0.05))
            press(teacher, 'c')
            if number:
                press(teacher, 'p')
                teacher.spend(1.0)
                press(teacher, 'p')
            teacher.move_to(shifted(start, y=0.1, z=0.03))
            press(teacher, '')
            press(teacher, 'o')
            teacher.move_to(shifted(start))
    finally:
        camera.end()
        teacher.close()
    takes = sorted((tmp_path / 'takes').glob('take_*'))
    assert len(takes) == 2
    learned = skill_from_bags(takes, LearningSettings(
        20, objects=('box', 'hole'), stiffness='none', moving=('box',), ends=('box', 'hole')))
    assert [np.abs(view.pose - where).max() < 1e-6 for view, where in zip(
        learned.skill.views, (box, hole))] == [True, True]
    # Where the gripper closes, the object of the start is grasped.
    assert learned.skill.views[0].grasped == learned.skill.events[0].progress
