"""A skill of two arms, streamed to two arms."""
from contextlib import contextmanager

from gdmp_msgs.msg import Reference, RobotState
from gdmp_msgs.srv import LoadSkill
from geometry_msgs.msg import PoseStamped, TransformStamped
import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.poses import compose, inverse, tool_manifold
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM, MODULES, SERVER
from gdmp_ros.ros.middleware import latched
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.profiles import minimum_jerk
from test.ros.nodes import open_testbed

SIDES = ('left', 'right')
#: Base of the right arm in the frame of the left one: beside it, and turned.
BASE = np.array([0.1, -0.6, 0.0, np.cos(0.2), 0.0, 0.0, np.sin(0.2)])
HOME = Arm().pose_at(Arm().home)


def _skill_of(home):
    s = np.linspace(0.0, 1.0, 200)
    points = np.tile(home, (len(s), 1))
    points[:, 0] -= 0.05 * minimum_jerk(s)
    points[:, 2] -= 0.06 * np.sin(np.pi * minimum_jerk(s))
    return Skill.learn(Demonstration(3.0 * s, points, tool_manifold(None)), 30)


@pytest.fixture(scope='module')
def skill():
    joined = Skill.joined(_skill_of(HOME), _skill_of(compose(BASE, HOME)), SIDES)
    first, second = (tuple(f'{side}_{name}' for name in tool_manifold(None).names)
                     for side in SIDES)
    return joined.coupled(Coupling.at('pose', first, second, joined.manifold, joined.start))


@contextmanager
def two_arms(folder, skill):
    """Two arms and a server, which does not know where the right one is."""
    skill.save(folder / 'skill.json')
    _skill_of(HOME).save(folder / 'one.json')
    with open_testbed(folder, folder / 'skill.json') as made:
        for side, topic in zip(SIDES, ('reference', 'second/reference')):
            made.children.start(side, MODULES[ARM], [
                '--ros-args', '-r', f'__ns:=/{side}', '-p', f'frame_id:={side}_link0', '-p',
                f'reference_topic:=/{SERVER}/{topic}', '-p', 'headless:=true'])
        made.start_server(frame_id='left_link0', second_frame_id='right_link0',
                          measured_pose_topic=f'/left/{ARM}/measured_pose', tf_timeout=5.0,
                          second_measured_pose_topic=f'/right/{ARM}/measured_pose')
        yield made


@pytest.fixture(scope='module')
def shared_nodes(tmp_path_factory, skill):
    with two_arms(tmp_path_factory.mktemp('two_arms'), skill) as made:
        say_where_the_right_arm_is(made)
        yield made


@pytest.fixture
def running(shared_nodes):
    """The nodes, with the skill of two arms."""
    shared_nodes.client.wait_status('holding', 30.0)
    reply = shared_nodes.call(LoadSkill, f'{SERVER}/load_skill',
                              path=str(shared_nodes.skill_file))
    assert reply.success, reply.message
    return shared_nodes


def say_where_the_right_arm_is(running):
    publisher = running.participant.publisher(TFMessage, '/tf_static', latched(1))
    transform = TransformStamped(child_frame_id='right_link0')
    transform.header.frame_id = 'left_link0'
    messages.set_transform(transform.transform, BASE)
    publisher.publish(TFMessage(transforms=[transform]))


def in_common_frame(message):
    return compose(BASE, messages.pose_numbers(message.pose))


def test_nothing_is_streamed_before_it_is_known_where_the_second_arm_is(tmp_path, skill):
    with two_arms(tmp_path, skill) as running:
        running.wait('the server', lambda: running.client.state is not None, 60.0)
        running.spend(1.0)
        assert 'no_robot' in running.state.flags
        with pytest.raises(Exception, match='no measured pose of both arms'):
            running.client.execute()
            running.client.wait('the refusal', running.client.done, 5.0)
            running.client.check_failure()
        say_where_the_right_arm_is(running)
        running.client.wait_status('holding', 30.0)


def test_two_arms_follow_one_skill_while_the_goal_of_the_second_is_switched(running, skill):
    coupling = skill.couplings[0]
    streams = [running.collect(Reference, f'/{SERVER}/{topic}')
               for topic in ('reference', 'second/reference')]
    measured = [running.collect(RobotState, f'/{side}/{ARM}/state') for side in SIDES]
    goals = running.publisher(PoseStamped, f'/{SERVER}/second/goal_pose')
    running.wait('both streams', lambda: all(streams), 10.0)
    refused = running.state.refused

    running.client.execute()
    running.wait_progress(0.4)
    goal = skill.goal[7:].copy()
    goal[:3] += [0.02, 0.05, 0.04]
    rotate_by_vector(goal[3:].copy(), np.array([0.0, 0.0, 0.2]), goal[3:])
    message = PoseStamped()
    # In the frame of the second arm: it is transformed as every goal.
    message.header.frame_id = 'right_link0'
    messages.set_pose(message.pose, compose(inverse(BASE), goal))
    goals.publish(message)
    result = running.client.result(30.0)
    assert result.error_code == result.SUCCESSFUL, result.error_string
    assert running.state.refused == refused
    assert len(running.state.goal) == 2

    first = {stamp_of(one): messages.pose_numbers(one.pose) for one in streams[0]}
    pairs = np.array([np.concatenate([first[stamp_of(one)], in_common_frame(one)])
                      for one in streams[1] if stamp_of(one) in first])
    assert len(pairs) > 3000
    away = np.array([coupling.deviation(skill.manifold, pair) for pair in pairs])
    assert (away.max(axis=0) <= [1e-4, 5e-4]).all()
    assert np.abs(pairs[-1, 7:] - goal).max() < 1e-3
    ends = np.concatenate([messages.pose_numbers(measured[0][-1].pose),
                           in_common_frame(measured[1][-1])])
    assert (coupling.deviation(skill.manifold, ends) <= [2e-3, 5e-3]).all()
    assert np.abs(ends[7:] - goal).max() < 3e-3


def stamp_of(message):
    return message.header.stamp.sec, message.header.stamp.nanosec


def test_goals_that_one_of_the_arms_cannot_have_are_refused(running, skill):
    running.client.wait_status('holding', 30.0)
    running.client.execute()
    running.wait_progress(0.1)
    refused = running.state.refused
    far = skill.goal[:7].copy()
    far[1] += 0.9  # also takes the right arm's tool to y = 0.9 m in its own frame
    running.client.goal_pose(far, 'left_link0')
    running.wait('the refusal', lambda: running.state.refused > refused, 5.0)
    assert 'arm: goal y is' in running.state.last_refusal
    result = running.client.result(30.0)
    assert result.error_code == result.SUCCESSFUL


def test_the_stream_of_the_second_arm_ends_with_a_skill_of_one(running):
    running.client.wait_status('holding', 30.0)
    second = running.collect(Reference, f'/{SERVER}/second/reference')
    goals = running.publisher(PoseStamped, f'/{SERVER}/second/goal_pose')
    running.wait('the stream', lambda: bool(second), 10.0)
    reply = running.call(LoadSkill, f'{SERVER}/load_skill',
                         path=str(running.skill_file.with_name('one.json')))
    assert reply.success, reply.message
    running.client.execute()
    running.wait('the end of the stream', lambda: second[-1].mode == Reference.ENDED, 5.0)
    refused = running.state.refused
    message = PoseStamped()
    message.header.frame_id = 'left_link0'
    messages.set_pose(message.pose, HOME)
    goals.publish(message)
    running.wait('the refusal', lambda: running.state.refused > refused, 5.0)
    assert 'not one of two arms' in running.state.last_refusal
    running.client.result(30.0)


def test_without_a_second_arm_the_skill_is_refused(running):
    running.children.start_node('alone', MODULES[SERVER], {
        'skill': str(running.skill_file), 'start_from': 'skill'}, ['-r', '__node:=alone'])
    running.wait_log('alone', 'there is no second arm', 60.0)
    assert 'second_frame_id' in running.log('alone')
    running.children.kill('alone')
