"""What is around the arm, by ``~/scene``: to the server and to the arm."""
from gdmp_msgs.action import ExecuteSequence, ExecuteSkill
from gdmp_msgs.msg import ArmStatus
from gdmp_msgs.msg import Scene as Scene_
from gdmp_msgs.srv import LoadSkill
from geometry_msgs.msg import Point
import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from experiments.obstacles import line
from gdmp_ros import DataError, GdmpError
from gdmp_ros.control.own_body import placed
from gdmp_ros.control.surroundings import depths
from gdmp_ros.demo.recorded import RecordedWorld, surroundings
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.ros.messages import stamp_of, stamped_transform
from gdmp_ros.ros.middleware import latched
from gdmp_ros.ros.scene.messages import markers_of, scene_message, scene_of, volumes_of
from gdmp_ros.scene import Scene, Volume, write_scene
from gdmp_ros.scene.distance import distances
from gdmp_ros.sim.arm import Arm
from test.ros.nodes import FRAME, open_testbed
from test.scene.camera import box, picture


@pytest.fixture(scope='module')
def skill():
    """From where the arm stands to the side, far enough to go around something."""
    here = Arm().pose_at(Arm().home)[:3]
    return line(here, here + [0.15, 0.4, -0.2], np.zeros(3))


def marker(kind, place=(0.4, 0.1, 0.2), scale=(0.1, 0.1, 0.3), name='thing', **fields):
    made = Marker(type=kind, text=name, **fields)
    made.header.frame_id = FRAME
    made.pose.position.x, made.pose.position.y, made.pose.position.z = map(float, place)
    made.scale.x, made.scale.y, made.scale.z = scale
    return made


def test_markers_become_volumes_that_hold_them(rng):
    def volume_of(made):
        (volume,) = volumes_of(made)
        return volume
    box = volume_of(marker(Marker.CUBE))
    assert box.kind == 'box' and box.size == (0.1, 0.1, 0.3) and box.name == 'thing'
    assert volume_of(marker(Marker.SPHERE)).size == (0.15,)
    cylinder = volume_of(marker(Marker.CYLINDER))
    angles = rng.uniform(0.0, 2.0 * np.pi, 50)
    rim = np.column_stack([0.05 * np.cos(angles), 0.05 * np.sin(angles), rng.choice(
        [-0.15, 0.15], 50)]) + [0.4, 0.1, 0.2]
    assert distances(cylinder.packed(0.0, {}), rim).max() < 1e-9
    points = rng.uniform(-0.1, 0.2, (30, 3))
    given = [Point(x=x, y=y, z=z) for x, y, z in points]
    cloud = marker(Marker.SPHERE_LIST, points=given, scale=(0.02, 0.02, 0.02))
    assert distances(volume_of(cloud).packed(0.0, {}), points + [0.4, 0.1, 0.2]).max() < -0.0099
    mesh = volumes_of(marker(Marker.TRIANGLE_LIST, points=given, scale=(1.0, 1.0, 1.0)))
    assert len(mesh) > 1 and mesh[0].name == 'thing#1'
    assert distances(Scene(mesh).packed(), points + [0.4, 0.1, 0.2]).max() < 1e-9
    assert volume_of(marker(Marker.CUBE, name='', ns='table', id=3)).name == 'table/3'
    for wrong, reason in ((marker(Marker.ARROW), 'is no volume'),
                          (marker(Marker.CUBE, scale=(0.1, np.nan, 0.1)), 'not finite'),
                          (marker(Marker.CUBE, scale=(0.1, 0.0, 0.1)), 'expected above 0'),
                          (marker(Marker.POINTS), 'finite points'),
                          (marker(Marker.TRIANGLE_LIST, points=given[:2]), 'no triangles')):
        with pytest.raises(DataError, match=reason):
            volume_of(wrong)


def test_a_scene_comes_back_from_its_markers():
    here = np.array([0.4, 0.1, 0.2, 0.8, 0.0, 0.6, 0.0])
    scene = Scene([Volume('a', 'sphere', (0.1,), here), Volume('b', 'box', (0.1, 0.2, 0.3), here),
                   Volume('c', 'capsule', (0.05, 0.3), here), Volume('d', 'plane', (), here)])
    stamp = Marker().header.stamp
    found = [volumes_of(one)[0] for one in markers_of(scene, FRAME, stamp).markers]
    assert [one.name for one in found] == ['a', 'b', 'c']
    for one in found:
        np.testing.assert_allclose(one.packed(0.0, {}), scene[one.name].packed(0.0, {}),
                                   atol=1e-12)


def test_a_scene_comes_back_from_its_message():
    here, twist = np.array([0.4, 0.1, 0.2, 0.8, 0.0, 0.6, 0.0]), np.arange(6.0)
    scene = Scene([Volume('a', 'sphere', (0.1,), here, twist, 0.01, ('hand', 'link7')),
                   Volume('b', 'plane', (), here), Volume('c', 'box', (0.1, 0.2, 0.3), here,
                                                          carried=True)], 0.03)
    back = scene_of(scene_message(scene, FRAME, Marker().header.stamp))
    assert back.names == ('a', 'b') and back.margin == 0.03
    bits = {'hand': 1, 'link7': 2}
    np.testing.assert_allclose(back.packed(bits), scene.packed(bits))
    np.testing.assert_allclose(back.carried, scene.carried)
    assert len(scene.carried) > 0

@pytest.fixture
def around(running):
    """Publishes markers to the arm, from which the server has them, and removes all at the end."""
    topic = running.publisher(MarkerArray, f'{ARM}/scene')

    def tell(*markers):
        topic.publish(MarkerArray(markers=list(markers)))
        running.spend(0.3)
    yield tell
    tell(Marker(action=Marker.DELETEALL))


def test_the_arm_reports_what_is_near_it_until_it_is_gone(running, around):
    reports = []
    running.subscribe(ArmStatus, f'{ARM}/status', reports.append)
    place = running.tool()[:3] + [0.0, 0.25, 0.0]
    around(marker(Marker.SPHERE, place, (0.1, 0.1, 0.1), 'ball'))
    running.wait('its report', lambda: reports[-1].nearest.endswith(' and ball'), 5.0)
    assert 0.0 < reports[-1].clearance < 0.25 and reports[-1].scale == 1.0
    around(marker(Marker.SPHERE, place, (0.1, 0.1, 0.1), 'ball', action=Marker.DELETE))
    running.wait('nothing', lambda: reports[-1].nearest == '', 5.0)
    assert reports[-1].clearance == np.inf
    brief = marker(Marker.SPHERE, place, (0.1, 0.1, 0.1), 'ball')
    brief.lifetime.sec = 1
    around(brief)
    running.wait('its report', lambda: reports[-1].nearest.endswith(' and ball'), 5.0)
    running.wait('the end of its life', lambda: reports[-1].nearest == '', 5.0)
    # Of a frame that nobody knows, and of one that /tf_static tells.
    elsewhere = marker(Marker.SPHERE, [0.0, 0.0, 1.0], (0.1, 0.1, 0.1), 'ball')
    elsewhere.header.frame_id = 'camera'
    around(elsewhere)
    running.wait('the refusal', lambda: "frame 'camera' is not connected" in
                 reports[-1].last_refusal, 5.0)
    show_camera(running, place - [0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0])
    around(elsewhere)
    running.wait('its report', lambda: reports[-1].nearest.endswith(' and ball'), 5.0)
    topic = running.publisher(MarkerArray, f'{SERVER}/scene')
    topic.publish(MarkerArray(markers=[marker(Marker.ARROW)]))
    running.wait('the refusal of the server', lambda: (
        'is no volume' in running.state.last_refusal), 5.0)


def show_camera(running, place, turn):
    """Tell where the frame ``camera`` is."""
    publisher = running.participant.publisher(TFMessage, '/tf_static', latched(1))
    publisher.publish(TFMessage(transforms=[stamped_transform(
        FRAME, 'camera', np.array([*place, *turn]))]))


def cloud_message(running, points, frame='camera', **fields):
    """A cloud with a field more than x, y and z, in rows that are longer than their points."""
    table = np.zeros((4, len(points) // 4 + 2), np.dtype(
        [('intensity', '<f4'), ('x', '<f4'), ('y', '<f4'), ('z', '<f4')]))
    points = points[:4 * (len(points) // 4)].reshape(4, -1, 3)
    for at, name in enumerate(('x', 'y', 'z')):
        table[name][:, :points.shape[1]] = points[:, :, at]
    message = PointCloud2(
        height=4, width=points.shape[1], point_step=16, row_step=table.strides[0],
        data=table.tobytes(), fields=[PointField(
            name=name, offset=table.dtype.fields[name][1], datatype=PointField.FLOAT32, count=1)
            for name in table.dtype.names])
    message.header.frame_id, message.header.stamp = frame, stamp_of(running.client.clock.wall())
    for name, value in fields.items():
        setattr(message, name, value)
    return message


@pytest.fixture
def seen(running, rng):
    """
    Shows clouds of a camera above the arm to it, ten in a second.

    The arm is among the points; told what else there is, it shows that for some time.
    """
    turned = [0.0, 1.0, 0.0, 0.0]
    eye = np.array([0.4, 0.0, 1.6, *turned])
    show_camera(running, eye[:3], turned)
    topic = running.publisher(PointCloud2, f'{ARM}/cloud')
    topic.publish(cloud_message(running, np.ones((8, 3))))
    running.spend(0.5)

    def show(things, seconds=0.5, **fields):
        arm = Arm()
        capsules = placed(arm.chain, arm.shape, np.array(running.robot[-1].position))
        on_arm = np.vstack([row[:3] + share * (row[3:6] - row[:3]) + [0.0, 0.0, row[6]]
                            for row in capsules for share in np.linspace(0.0, 1.0, 30)])
        on_arm = np.repeat(on_arm - eye[:3], 5, axis=0) * [1.0, -1.0, -1.0]
        for _ in range(round(seconds / 0.1)):
            points = np.vstack([on_arm, picture(things, rng, 30_000, pose=eye)])
            topic.publish(cloud_message(running, points, **fields))
            running.spend(0.1)
    return show


def test_a_cloud_becomes_boxes_without_the_arm_itself(running, seen):
    scenes, reports = [], []
    running.subscribe(Scene_, f'{ARM}/surroundings', lambda message: scenes.append(
        scene_of(message)), late=True)
    running.subscribe(ArmStatus, f'{ARM}/status', reports.append)
    crate = box('crate', (0.3, 0.4, 0.15), (0.2, 0.1, 0.3))
    seen([crate])
    running.wait('the scene', lambda: scenes and len(scenes[-1]) > 0, 5.0)
    found = scenes[-1]
    assert all(name.startswith('cloud#') for name in found.names)
    assert distances(found.packed(), [crate.pose[:3] + [0.0, 0.0, 0.14]])[0] < 0.01
    # The arm is no obstacle of its own.
    arm = Arm()
    posture = np.array(running.robot[-1].position)
    moving = arm.shape._replace(capsules=arm.shape.capsules[2:])
    assert depths(arm.chain, moving, posture, found.packed()).max() < 0.0
    assert reports[-1].nearest and reports[-1].blocked == ''
    # Without a new cloud the arm is held; it goes on with the next one.
    running.wait('the hold', lambda: reports[-1].scale == 0.0, 5.0)
    seen([crate], 0.7)
    running.wait('the end of the hold', lambda: reports[-1].scale == 1.0, 5.0)
    for fields, reason in (
            ({'frame': 'nowhere'}, "frame 'nowhere' is not connected"),
            ({'is_bigendian': True}, 'big-endian'), ({'fields': []}, 'expected x, y and z'),
            ({'width': 10_000_000}, 'do not fit'), ({'row_step': 3}, 'do not fit'),
            ({'data': b''}, 'do not fit'), ({'height': 0, 'data': b''}, 'none of 0 points')):
        seen([crate], 0.8, **fields)
        assert reason in reports[-1].last_refusal
    old = stamp_of(running.client.clock.wall())
    running.spend(1.5)
    topic = running.publisher(PointCloud2, f'{ARM}/cloud')
    topic.publish(cloud_message(running, np.full((8, 3), np.nan)))
    running.spend(0.3)
    assert 'none of 8 points is finite' in reports[-1].last_refusal
    late = cloud_message(running, np.ones((8, 3)))
    late.header.stamp = old
    topic.publish(late)
    running.spend(0.3)
    assert 'expected within 1 s' in reports[-1].last_refusal


def test_what_is_locked_to_the_tool_is_carried(running, around):
    scenes = []
    running.subscribe(Scene_, f'{ARM}/surroundings', lambda message: scenes.append(
        scene_of(message)), late=True)
    held = marker(Marker.CUBE, [0.0, 0.0, 0.12], (0.04, 0.04, 0.04), 'cube', frame_locked=True)
    held.header.frame_id = 'panda_hand'
    around(held)
    running.wait('the scene', lambda: scenes and 'cube' in scenes[-1], 5.0)
    assert scenes[-1].names == () and scenes[-1]['cube'].carried
    # The tool point is 0.1034 m before the hand.
    np.testing.assert_allclose(scenes[-1]['cube'].pose[:3], [0.0, 0.0, 0.12 - 0.1034], atol=1e-6)
    held.frame_locked = False
    around(held)
    running.wait('the scene', lambda: scenes[-1].names == ('cube',), 5.0)
    here = running.tool()[:3]
    assert np.linalg.norm(scenes[-1]['cube'].pose[:3] - here) < 0.02


def test_joints_are_not_moved_through_something(running, around):
    home, there = Arm().home, Arm().home.copy()
    there[0] += 1.2
    middle = home.copy()
    middle[0] += 0.6
    place = Arm().pose_at(middle)[:3]
    around(marker(Marker.SPHERE, place, (0.1, 0.1, 0.1), 'ball'))
    with pytest.raises(GdmpError, match='blocked by ball: .* would be .* of the way'):
        move_joints(running.client, ARM, there.tolist(), 0.5)
    around(Marker(action=Marker.DELETEALL))
    move_joints(running.client, ARM, there.tolist(), 1.0)


def test_a_motion_is_led_around_what_is_in_its_way_or_refused(running, around, skill):
    path = skill.rollout().sample(np.linspace(0.0, skill.duration, 200)).points[:, :3]
    lengths = np.linalg.norm(path - path[0], axis=1)
    middle = path[int(np.argmax(lengths > 0.5 * lengths[-1]))]
    ball = Volume('ball', 'sphere', (0.03,), np.array([*middle, 1.0, 0.0, 0.0, 0.0]))
    around(marker(Marker.SPHERE, middle, (0.06, 0.06, 0.06), 'ball'))
    running.listen()
    running.record(arguments=surroundings(ARM))  # they were published before
    running.client.execute()
    result = running.client.result(60.0)
    assert result.error_code == ExecuteSkill.Result.SUCCESSFUL, result.error_string
    arm, rows = Arm(), Scene([ball]).packed()
    run = running.recorded()
    nearest = max(depths(arm.chain, arm.shape, one, rows).max() for one in run.joints[::20])
    assert nearest < 0.0
    shown = RecordedWorld(running.folder / 'run')
    assert shown.places(int(shown.state_stamps[0]))['ball'][:3] == pytest.approx(middle)
    # The tool stands where something is put: there is no way out.
    around(marker(Marker.SPHERE, skill.goal[:3], (0.06, 0.06, 0.06), 'cork'))
    running.client.execute()
    result = running.client.result(20.0)
    assert result.error_code == ExecuteSkill.Result.INVALID_GOAL
    assert 'blocked by cork' in result.error_string and 'at the start' in result.error_string
    around(Marker(action=Marker.DELETEALL))
    running.client.execute()
    assert running.client.result(60.0).error_code == ExecuteSkill.Result.SUCCESSFUL


def test_the_motions_of_a_sequence_are_led_around_too(running, around, skill, tmp_path):
    """There and back: both ways are blocked, and the second one begins where the first ends."""
    back = line(skill.goal[:3], skill.start[:3], np.zeros(3))
    skill.save(tmp_path / 'there.json')
    back.save(tmp_path / 'back.json')
    (tmp_path / 'both.yaml').write_text(
        'steps:\n  - {skill: there.json}\n  - {skill: back.json}\n')
    middle = 0.5 * (skill.start[:3] + skill.goal[:3])
    ball = Volume('ball', 'sphere', (0.03,), np.array([*middle, 1.0, 0.0, 0.0, 0.0]))
    around(marker(Marker.SPHERE, middle, (0.06, 0.06, 0.06), 'ball'))
    running.listen()
    running.robot.clear()
    running.client.execute_sequence(str(tmp_path / 'both.yaml'), 1)
    result = running.client.result(60.0)
    assert result.error_code == ExecuteSequence.Result.SUCCESSFUL, result.error_string
    # Not only the arm goes around it: the references do.
    asked = np.array([[one.pose.position.x, one.pose.position.y, one.pose.position.z]
                      for one in running.references[::10]])
    assert np.linalg.norm(asked - middle, axis=1).min() > 0.05
    arm, rows = Arm(), Scene([ball]).packed()
    states = [running.robot[k] for k in range(0, len(running.robot), 20)]
    postures = [np.array(state.position) for state in states]
    assert max(depths(arm.chain, arm.shape, one, rows).max() for one in postures) < 0.0
    way = np.array([[state.pose.position.x, state.pose.position.y] for state in states])
    assert np.linalg.norm(way - skill.goal[:2], axis=1).min() < 0.01
    assert np.linalg.norm(way[-1] - skill.start[:2]) < 0.01


def known_by(running, node=ARM):
    scenes = []
    running.subscribe(Scene_, f'{node}/surroundings', lambda message: scenes.append(
        scene_of(message)), late=True)
    return scenes


def test_what_is_let_go_rests_and_what_is_not_told_again_stands_although_clouds_come(
        running, around, seen):
    scenes = known_by(running)
    held = marker(Marker.CUBE, [0.0, 0.0, 0.12], (0.04, 0.04, 0.04), 'cube', frame_locked=True)
    held.header.frame_id = 'panda_hand'
    around(held)
    held.frame_locked = False
    around(held)
    running.wait('the scene', lambda: scenes and scenes[-1].names == ('cube',), 5.0)
    assert not scenes[-1]['cube'].twist.any()
    for k in range(5):
        around(marker(Marker.SPHERE, [0.9, 0.9 - 0.03 * k, 0.5], (0.1, 0.1, 0.1), 'ball'))
    running.wait('its velocity', lambda: scenes[-1]['ball'].twist[1] < -0.05, 5.0)
    speed = scenes[-1]['ball'].twist[1]
    seen([box('crate', (0.3, 0.4, 0.15), (0.2, 0.1, 0.3))], 1.0)
    # It went on for 0.3 s, and stands.
    assert not scenes[-1]['ball'].twist.any()
    went = scenes[-1]['ball'].pose[1] - (0.9 - 0.03 * 4)
    assert went == pytest.approx(0.3 * speed, abs=0.01)


def test_a_marker_is_deleted_by_its_number_and_parts_have_names_of_their_own(running, around):
    scenes, reports = known_by(running), []
    running.subscribe(ArmStatus, f'{ARM}/status', reports.append)
    around(marker(Marker.CUBE, name='crate', ns='camera', id=7))
    running.wait('the scene', lambda: scenes and 'crate' in scenes[-1], 5.0)
    around(Marker(action=Marker.DELETE, ns='camera', id=7))
    running.wait('nothing', lambda: len(scenes[-1]) == 0, 5.0)
    around(marker(Marker.CUBE, name='crate#1'))
    running.wait('the refusal', lambda: 'for the parts of a volume' in reports[-1].last_refusal,
                 5.0)


def test_the_server_keeps_the_margin_of_the_arm(tmp_path, skill_file):
    scene = Scene([Volume('post', 'sphere', (0.05,), np.array([0.9, 0.5, 0.2, 1, 0, 0, 0.0]))],
                  0.07)
    write_scene(tmp_path / 'scene.yaml', scene)
    with open_testbed(tmp_path / 'nodes', skill_file) as nodes:
        nodes.start(arm={'scene_file': str(tmp_path / 'scene.yaml')})
        nodes.spend(0.5)
        server = nodes.children.processes[SERVER].node
        assert server.streamer.surroundings.scene['post'].margin == 0.07


def test_too_many_cells_are_refused_before_anything_runs(tmp_path, skill_file):
    with open_testbed(tmp_path / 'nodes', skill_file) as nodes, pytest.raises(GdmpError):
        nodes.start_arm(cloud_range=3.0, cloud_cell=0.005)
        nodes.wait('the arm', lambda: bool(nodes.robot), 5.0)


def test_a_motion_waits_while_something_stands_in_front_of_the_arm(running, around, skill):
    running.listen()
    running.client.execute()
    running.wait_progress(0.2)
    # A wall across the whole way: it cannot be bent around, so the arm stands before it.
    wall = marker(Marker.CUBE, 0.7 * skill.goal[:3] + 0.3 * skill.start[:3], (2.0, 0.01, 2.0),
                  'wall')
    around(wall)
    running.spend(2.0 * skill.duration)
    waits_at = running.state.progress
    assert waits_at < 0.95
    assert np.linalg.norm(running.tool()[:3] - skill.goal[:3]) > 0.1
    around(Marker(action=Marker.DELETEALL))
    result = running.client.result(60.0)
    assert result.error_code == ExecuteSkill.Result.SUCCESSFUL, result.error_string


def test_a_skill_that_is_blocked_is_told_when_it_is_loaded(running, around, skill, tmp_path):
    skill.save(tmp_path / 'skill.json')

    def loaded():
        reply = running.call(LoadSkill, f'{SERVER}/load_skill', path=str(tmp_path / 'skill.json'))
        assert reply.success
        return reply.message
    around(marker(Marker.SPHERE, skill.goal[:3], (0.06, 0.06, 0.06), 'cork'))
    assert 'blocked by cork: the tool is' in loaded() and 'at the goal' in loaded()
    # One that can be led around is no problem.
    middle = 0.5 * (skill.start[:3] + skill.goal[:3])
    around(Marker(action=Marker.DELETEALL), marker(Marker.SPHERE, middle, (0.06, 0.06, 0.06),
                                                   'ball'))
    assert loaded() == ''


def test_a_volume_that_is_told_too_rarely_for_its_speed_is_warned_of(running, around):
    def moves(by, every):
        before = running.log(ARM).count('ball moves with')
        for k in range(4):
            around(marker(Marker.SPHERE, [0.9, 0.9 - k * by, 0.9], (0.1, 0.1, 0.1), 'ball'))
            running.spend(every)
        around(Marker(action=Marker.DELETEALL))
        return running.log(ARM).count('ball moves with') - before
    # The margin is 20 mm; `around` takes 0.3 s.
    assert moves(0.015, 0.0) == 0
    assert moves(0.04, 0.1) > 0
    assert 'told every 0.40 s: it may come 40 mm nearer' in running.log(ARM)
