"""What is around the arm, by ``~/scene``: to the server and to the arm."""
from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import ArmStatus
from geometry_msgs.msg import Point
import numpy as np
import pytest
from visualization_msgs.msg import Marker, MarkerArray

from experiments.obstacles import line
from gdmp_ros import DataError, GdmpError
from gdmp_ros.control.surroundings import depths
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.ros.scene.messages import markers_of, volumes_of
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.scene.distance import distances
from gdmp_ros.sim.arm import Arm
from test.ros.nodes import FRAME


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
    box = volume_of(marker(Marker.CUBE))
    assert box.kind == 'box' and box.size == (0.1, 0.1, 0.3) and box.name == 'thing'
    assert volume_of(marker(Marker.SPHERE)).size == (0.15,)
    cylinder = volume_of(marker(Marker.CYLINDER))
    angles = rng.uniform(0.0, 2.0 * np.pi, 50)
    rim = np.column_stack([0.05 * np.cos(angles), 0.05 * np.sin(angles), rng.choice(
        [-0.15, 0.15], 50)]) + [0.4, 0.1, 0.2]
    assert distances(cylinder.packed(0.0, {}), rim).max() < 1e-9
    points = rng.uniform(-0.1, 0.2, (30, 3))
    cloud = marker(Marker.TRIANGLE_LIST, points=[Point(x=x, y=y, z=z) for x, y, z in points])
    assert distances(volume_of(cloud).packed(0.0, {}), points + [0.4, 0.1, 0.2]).max() < 1e-9
    assert volume_of(marker(Marker.CUBE, name='', ns='table', id=3)).name == 'table/3'
    for wrong, reason in ((marker(Marker.ARROW), 'is no volume'),
                          (marker(Marker.CUBE, scale=(0.1, np.nan, 0.1)), 'not finite'),
                          (marker(Marker.CUBE, scale=(0.1, 0.0, 0.1)), 'expected above 0'),
                          (marker(Marker.TRIANGLE_LIST), 'finite points')):
        with pytest.raises(DataError, match=reason):
            volume_of(wrong)


def test_a_scene_comes_back_from_its_markers():
    here = np.array([0.4, 0.1, 0.2, 0.8, 0.0, 0.6, 0.0])
    scene = Scene([Volume('a', 'sphere', (0.1,), here), Volume('b', 'box', (0.1, 0.2, 0.3), here),
                   Volume('c', 'capsule', (0.05, 0.3), here), Volume('d', 'plane', (), here)])
    found = [volume_of(one) for one in markers_of(scene, FRAME, Marker().header.stamp).markers]
    assert [one.name for one in found] == ['a', 'b', 'c']
    for one in found:
        np.testing.assert_allclose(one.packed(0.0, {}), scene[one.name].packed(0.0, {}),
                                   atol=1e-12)


@pytest.fixture
def around(running):
    """Publishes markers to server and arm, and removes all at the end."""
    topics = [running.publisher(MarkerArray, f'{node}/scene') for node in (SERVER, ARM)]

    def tell(*markers):
        for topic in topics:
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
    elsewhere = marker(Marker.SPHERE, place, (0.1, 0.1, 0.1), 'ball')
    elsewhere.header.frame_id = 'camera'
    around(elsewhere)
    running.wait('the refusal', lambda: "the frame is 'camera'" in reports[-1].last_refusal, 5.0)
    assert "'camera'" in running.state.last_refusal


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
    running.record()
    running.client.execute()
    result = running.client.result(60.0)
    assert result.error_code == ExecuteSkill.Result.SUCCESSFUL, result.error_string
    arm, rows = Arm(), Scene([ball]).packed()
    run = running.recorded()
    nearest = max(depths(arm.chain, arm.shape, one, rows).max() for one in run.joints[::20])
    assert nearest < 0.0
    # The tool stands where something is put: there is no way out.
    around(marker(Marker.SPHERE, skill.goal[:3], (0.06, 0.06, 0.06), 'cork'))
    running.client.execute()
    result = running.client.result(20.0)
    assert result.error_code == ExecuteSkill.Result.INVALID_GOAL
    assert 'blocked by cork' in result.error_string and 'at the start' in result.error_string
    around(Marker(action=Marker.DELETEALL))
    running.client.execute()
    assert running.client.result(60.0).error_code == ExecuteSkill.Result.SUCCESSFUL
