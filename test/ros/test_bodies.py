"""Two arms are obstacles of each other, by ``~/body``."""
from gdmp_msgs.msg import ArmStatus, RobotState
from gdmp_msgs.msg import Scene as SceneMessage
from geometry_msgs.msg import TransformStamped
import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from experiments.obstacles import line
from gdmp_ros.control.own_body import placed
from gdmp_ros.manifolds.poses import moved_on
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.testbed import ARM, MODULES, SERVER
from gdmp_ros.ros.middleware import latched
from gdmp_ros.ros.scene.bodies import body_volumes
from gdmp_ros.scene.distance import distances
from gdmp_ros.scene.scene import Scene
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from test.ros.nodes import open_testbed

SIDES, MARGIN = ('left', 'right'), 0.03
#: Base of the right arm in the frame of the left one: it faces it.
BASE = np.array([0.95, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
HOME = Arm().home
#: The right arm has drawn back.
AWAY = HOME + [0.0, -0.5, 0.0, -0.2, 0.0, 0.0, 0.0]


@pytest.fixture(scope='module')
def skill():
    """Through where the hand of the other arm is."""
    here = Arm().pose_at(HOME)[:3]
    return line(here, here + [0.36, 0.0, 0.0], np.zeros(3))


@pytest.fixture
def facing(tmp_path, skill):
    skill.save(tmp_path / 'skill.json')
    with open_testbed(tmp_path, tmp_path / 'skill.json') as made:
        for side, other in zip(SIDES, SIDES[::-1]):
            made.children.start(side, MODULES[ARM], [
                '--ros-args', '-r', f'__ns:=/{side}', '-p', f'frame_id:={side}_link0', '-p',
                f'reference_topic:=/{SERVER if side == "left" else "nobody"}/reference',
                '-p', 'headless:=true', '-p', f'scene_margin:={MARGIN}', '-p',
                f"other_arms:=['/{other}/{ARM}/body']"])
        publisher = made.participant.publisher(TFMessage, '/tf_static', latched(1))
        transform = TransformStamped(child_frame_id='right_link0')
        transform.header.frame_id = 'left_link0'
        messages.set_transform(transform.transform, BASE)
        publisher.publish(TFMessage(transforms=[transform]))
        made.start_server(frame_id='left_link0',
                          measured_pose_topic=f'/left/{ARM}/measured_pose',
                          arm_status_topic=f'/left/{ARM}/status')
        made.client.wait_status('holding', 60.0)
        yield made


def axes_of(joints, base=None):
    """Points on the axes of an arm's capsules, with the radius there."""
    arm = Arm()
    ends = placed(arm.chain, arm.shape, joints)
    shares = np.linspace(0.0, 1.0, 15)[:, None]
    points = np.concatenate([row[:3] + shares * (row[3:6] - row[:3]) for row in ends])
    if base is not None:
        for point in points:
            before = point.copy()
            rotate(base[3:], before, point)
            point += base[:3]
    return points, np.repeat(ends[:, 6], len(shares))


def least_distance(left, right):
    """Between two arms [m], by the positions of their joints."""
    (first, radii), (second, others) = axes_of(left), axes_of(right, BASE)
    between = np.linalg.norm(first[:, None] - second, axis=2) - radii[:, None] - others
    return between.min()


def test_an_arm_waits_for_the_other_one_and_goes_on_when_it_is_gone(facing, skill):
    states = [facing.collect(RobotState, f'/{side}/{ARM}/state') for side in SIDES]
    status = facing.collect(ArmStatus, f'/left/{ARM}/status')
    surroundings = facing.collect(SceneMessage, f'/left/{ARM}/surroundings')
    facing.spend(1.0)
    facing.client.execute()
    facing.spend(6.0)
    assert 'right/panda_sim' in status[-1].nearest
    # The server does not lead motions around what goes away.
    assert not [volume for message in surroundings for volume in message.volumes]
    there = messages.pose_numbers(states[0][-1].pose)
    assert np.linalg.norm(there[:3] - skill.goal[:3]) > 0.05
    move_joints(facing.client, f'/right/{ARM}', AWAY)
    facing.spend(8.0)
    there = messages.pose_numbers(states[0][-1].pose)
    assert np.linalg.norm(there[:3] - skill.goal[:3]) < 5e-3
    count = min(map(len, states))
    least = min(least_distance(np.array(one.position), np.array(other.position))
                for one, other in zip(states[0][-count::20], states[1][-count::20]))
    assert least > 0.5 * MARGIN


def test_a_body_is_what_the_arm_is_and_moves_as_it_does():
    loop = ClosedLoop(Arm())
    loop.arm.data.qvel[:] = [0.3, -0.2, 0.1, 0.4, -0.3, 0.2, 0.5]
    loop.controller.memory.position[:] = loop.arm.data.qpos
    loop.controller.memory.velocity[:] = loop.arm.data.qvel
    volumes, step = body_volumes(loop.controller), 1e-3
    points, radii = axes_of(loop.arm.data.qpos)
    # Every point of the axes lies inside, by the radius there; now, and moved on.
    inside = distances(Scene(volumes).packed(), points)
    assert (inside <= -radii + 1e-9).all()
    later, _ = axes_of(loop.arm.data.qpos + step * loop.arm.data.qvel)
    moved = [volume.at(moved_on(volume.pose, volume.twist, step)) for volume in volumes]
    assert np.abs(distances(Scene(moved).packed(), later) - inside).max() < 1e-5
    # Without the velocities they would be elsewhere.
    assert np.abs(distances(Scene(volumes).packed(), later) - inside).max() > 1e-4


def test_a_body_in_an_unknown_frame_is_refused_with_the_reason(tmp_path, skill_file):
    with open_testbed(tmp_path, skill_file) as made:
        for side in SIDES:
            made.children.start(side, MODULES[ARM], [
                '--ros-args', '-r', f'__ns:=/{side}', '-p', f'frame_id:={side}_link0', '-p',
                'headless:=true', '-p', "other_arms:=['/right/panda_sim/body']"])
        made.wait_log('left', '/right/panda_sim/body: ', 30.0)


def test_an_unknown_link_is_refused(tmp_path, skill_file):
    with open_testbed(tmp_path, skill_file) as made:
        made.children.start('left', MODULES[ARM], [
            '--ros-args', '-p', 'headless:=true', '-p', "other_arms_allowed:=['thumb']"])
        made.wait_log('left', "other_arms_allowed has 'thumb'", 30.0)
