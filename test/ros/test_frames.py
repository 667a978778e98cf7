"""Where frames are, from /tf; the same tests for our buffer and for that of tf2."""
from geometry_msgs.msg import PoseStamped, TransformStamped
import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from gdmp_ros.manifolds.poses import compose, inverse
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.ros import frames, messages
from gdmp_ros.ros.clients.testbed import SERVER
from gdmp_ros.ros.frames import FrameError, FrameTree, PATIENCE_S, Transform, Waiting
from gdmp_ros.ros.middleware import latched
from gdmp_ros.sim import Arm

NS = 1_000_000_000
HALF = np.sqrt(0.5)
#: A quarter turn about z, one metre along x.
TURNED = np.array([1.0, 0.0, 0.0, HALF, 0.0, 0.0, HALF])
BUFFERS = [FrameTree] + ([frames.Tf2Frames] if frames.tf2_py is not None else [])


@pytest.fixture(params=BUFFERS, ids=lambda kind: kind.__name__)
def buffer(request):
    return request.param()


def at(x, y=0.0, z=0.0):
    return np.array([x, y, z, 1.0, 0.0, 0.0, 0.0])


def assert_same(first, second):
    distance, angle = pose_distance(np.asarray(first), np.asarray(second))
    assert distance < 1e-9 and angle < 1e-7


def test_poses_go_up_and_down_the_tree(buffer):
    buffer.add(Transform('world', 'base', TURNED, 0), True)
    buffer.add(Transform('world', 'camera', at(0.0, 0.0, 2.0), 0), True)
    buffer.add(Transform('camera', 'box', at(0.5), 0), True)
    found = buffer.pose_of('box', 'base', 0)
    # In the axes of the base, which are turned to the left.
    assert_same(found, compose(inverse(TURNED), at(0.5, 0.0, 2.0)))
    np.testing.assert_allclose(found[:3], [0.0, 0.5, 2.0], atol=1e-12)
    assert_same(buffer.pose_of('base', 'box', 0), inverse(found))
    assert_same(buffer.pose_of('box', 'box', 0), at(0.0))


def test_a_frame_that_moves_is_interpolated_and_not_extrapolated(buffer):
    for k in range(11):
        buffer.add(Transform('base', 'box', at(0.1 * k), (100 + k) * NS // 10), False)
    assert_same(buffer.pose_of('box', 'base', 1055 * NS // 100), at(0.55))
    assert_same(buffer.pose_of('box', 'base', 0), at(1.0))
    for stamp in (12 * NS, 9 * NS):
        with pytest.raises(FrameError):
            buffer.pose_of('box', 'base', stamp)


def test_the_latest_time_is_one_that_all_frames_know(buffer):
    buffer.add(Transform('base', 'belt', at(1.0), 10 * NS), False)
    buffer.add(Transform('base', 'belt', at(2.0), 11 * NS), False)
    buffer.add(Transform('belt', 'box', at(0.0, 1.0), 10 * NS), False)
    assert_same(buffer.pose_of('box', 'base', 0), at(1.0, 1.0))


def test_frames_that_are_not_connected_are_named(buffer):
    buffer.add(Transform('world', 'base', at(0.0), 0), True)
    buffer.add(Transform('map', 'box', at(0.0), 0), True)
    for frame in ('box', 'nothing'):
        with pytest.raises(FrameError, match=frame):
            buffer.pose_of(frame, 'base', 0)


def test_a_loop_of_parents_is_an_error():
    tree = FrameTree()
    tree.add(Transform('a', 'b', at(0.0), 0), True)
    tree.add(Transform('b', 'a', at(0.0), 0), True)
    with pytest.raises(FrameError, match='loop'):
        tree.pose_of('a', 'base', 0)


def transform(parent, child, pose, stamp):
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, stamp
    messages.set_transform(message.transform, pose)
    return message


def static_broadcaster(running, *transforms):
    publisher = running.participant.publisher(TFMessage, '/tf_static', latched(1))
    running._made.append(publisher)
    publisher.publish(TFMessage(transforms=list(transforms)))


def test_the_links_that_an_arm_publishes_are_where_its_joints_put_them(running):
    tree, received = FrameTree(), []

    def take(message, fixed):
        for one in message.transforms:
            stamp = one.header.stamp
            tree.add(Transform(one.header.frame_id, one.child_frame_id,
                               messages.transform_numbers(one.transform),
                               stamp.sec * NS + stamp.nanosec), fixed)
        received.append(fixed)
    running.subscribe(TFMessage, '/tf', lambda message: take(message, False))
    running.subscribe(TFMessage, '/tf_static', lambda message: take(message, True), 1, late=True)
    running.wait('transforms', lambda: {True, False} <= set(received))
    running.client.execute()
    running.wait_progress(0.4)
    running.spend(0.2)
    stamps = np.array([one.header.stamp.sec * NS + one.header.stamp.nanosec
                       for one in running.robot])
    state, stamp = running.robot[-30], int(stamps[-30])
    found = tree.pose_of('panda_tcp', 'panda_link0', stamp)
    distance, angle = pose_distance(found, messages.pose_numbers(state.pose))
    assert distance < 2e-4 and angle < 2e-3  # between two messages of 100 Hz
    np.testing.assert_allclose(Arm().pose_at(np.array(state.position))[:3], found[:3], atol=2e-4)


def goal_in(frame, pose, stamp=None):
    message = PoseStamped()
    message.header.frame_id = frame
    if stamp is not None:
        message.header.stamp = stamp
    messages.set_pose(message.pose, pose)
    return message


def test_a_goal_on_an_object_in_the_frame_of_a_camera_is_reached(running, skill):
    """The camera is known to the world, the object to the camera, and the base to the world."""
    goal = skill.goal[:7] + [0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0]
    base, camera = TURNED, np.array([0.3, 0.4, 1.5, 0.0, 1.0, 0.0, 0.0])
    stamp = messages.stamp_of(running.client.clock.wall())
    place = compose(inverse(camera), compose(base, goal))
    static_broadcaster(running, transform('world', 'panda_link0', base, stamp),
                       transform('world', 'camera', camera, stamp),
                       transform('camera', 'object', place, stamp))
    publisher = running.publisher(PoseStamped, f'{SERVER}/goal_pose')
    running.client.execute()
    running.wait_progress(0.1)
    publisher.publish(goal_in('object', at(0.0)))
    assert running.client.result(30.0).error_code == 0, running.state.last_refusal
    assert running.state.refused == 0
    assert np.linalg.norm(running.tool()[:3] - goal[:3]) < 3e-3


def test_a_goal_in_a_frame_that_nobody_knows_is_refused_after_a_while(running):
    assert running.set_parameters(SERVER, tf_timeout=0.3).successful
    publisher = running.publisher(PoseStamped, f'{SERVER}/goal_pose')
    running.client.execute()
    running.wait_progress(0.05)
    goal = running.client.state.goal[0]
    publisher.publish(goal_in('moon', at(0.4)))
    running.wait('the refusal', lambda: running.state.refused == 1)
    assert "frame 'moon' is not connected to 'panda_link0'" in running.state.last_refusal
    assert running.client.state.goal[0] == goal


def test_a_goal_waits_until_its_frame_is_known_at_its_stamp(running, skill):
    assert running.set_parameters(SERVER, tf_timeout=1.0).successful
    publisher = running.publisher(PoseStamped, f'{SERVER}/goal_pose')
    moving = running.publisher(TFMessage, '/tf')
    goal = skill.goal[:7] + [0.0, -0.05, 0.0, 0.0, 0.0, 0.0, 0.0]

    def now():
        return messages.stamp_of(running.client.clock.wall())

    def move(pose):
        moving.publish(TFMessage(transforms=[transform('panda_link0', 'hand', pose, now())]))
    move(goal + [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    running.client.execute()
    running.wait_progress(0.05)
    move(goal)
    running.spend(0.05)
    publisher.publish(goal_in('hand', at(0.0), now()))
    before = running.client.state.goal[0]
    running.spend(0.4)
    assert running.client.state.goal[0] == before  # the hand may have moved since
    move(goal)
    assert running.client.result(30.0).error_code == 0
    assert running.state.refused == 0
    assert np.linalg.norm(running.tool()[:3] - goal[:3]) < 3e-3


def test_what_is_waited_for_in_vain_delays_others_only_once():
    taken, refused, known, now = [], [], set(), [0.0]
    waiting = Waiting(lambda: now[0], refused.append)

    def tell(frame, what):
        def take(came):
            if frame not in known:
                raise FrameError(f'{frame} is not connected')
            taken.append(what)
        waiting.add(take)
    known.add('base')
    tell('camera', 'first')
    tell('base', 'second')
    assert taken == [] and refused == []
    now[0] = PATIENCE_S + 0.01
    waiting.look()
    assert taken == ['second'] and refused == ['camera is not connected']
    tell('camera', 'third')
    tell('base', 'fourth')
    assert taken == ['second', 'fourth'] and len(refused) == 2
    known.add('camera')
    tell('camera', 'fifth')
    tell('other', 'sixth')  # for this one there is still patience
    assert taken[-1] == 'fifth' and len(refused) == 2
