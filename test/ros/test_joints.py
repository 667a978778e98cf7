"""A skill of the joints: learned from recorded joint states, streamed, followed; over DDS."""
import json
from pathlib import Path

from gdmp_msgs.msg import MovingGoal, Reference, RobotState
from gdmp_msgs.srv import LoadSkill
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
from trajectory_msgs.msg import JointTrajectory

from gdmp_ros.data.bags import BagWriter
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import SERVER
from gdmp_ros.sim import Arm
from test.commands import gdmp
from test.ros.nodes import FRAME, open_testbed

SECONDS = 2.5


def shown_joints():
    """Times and positions: a swing of several joints, from the home posture to another one."""
    times = np.arange(0.0, SECONDS + 1e-9, 0.01)
    s = times / SECONDS
    share = s ** 3 * (10.0 - 15.0 * s + 6.0 * s ** 2)
    way = np.array([0.4, 0.2, -0.2, 0.3, 0.0, 0.1, 0.3])
    bend = np.array([0.0, -0.15, 0.0, 0.2, 0.1, 0.0, 0.0])
    return times, Arm().home + share[:, None] * way + np.sin(np.pi * share)[:, None] * bend


@pytest.fixture(scope='session')
def joint_skill(tmp_path_factory):
    """Learned by the command line from a bag with joint states, and noise."""
    folder = tmp_path_factory.mktemp('joints')
    times, positions = shown_joints()
    positions = positions + np.random.default_rng(0).normal(0.0, 2e-4, positions.shape)
    with BagWriter(folder / 'take') as bag:
        for time, position in zip(times, positions):
            bag.joints('/joint_states', 1_700_000_000_000_000_000 + round(1e9 * time),
                       Arm().names, position)
    done = gdmp('learn', folder / 'take', '--joints', '-o', folder / 'skill.json')
    assert done.returncode == 0, done.stderr
    return folder / 'skill.json'


@pytest.fixture(scope='module')
def shared_nodes(tmp_path_factory, joint_skill):
    with open_testbed(tmp_path_factory.mktemp('nodes'), joint_skill) as made:
        made.start()
        yield made


def test_a_skill_of_the_joints_is_learned_from_joint_states(joint_skill):
    skill, (times, positions) = Skill.load(joint_skill), shown_joints()
    assert skill.manifold.names == ('joints',)
    assert list(skill.provenance['joints']) == Arm().names
    path = skill.rollout().sample(times * skill.duration / SECONDS).points
    # The rest at both ends of a minimum-jerk motion is cut off: compare the paths.
    away = [np.abs(path - position).max(axis=1).min() for position in positions[::10]]
    assert max(away) < 5e-3


def test_the_arm_follows_to_the_goal_of_the_skill(running, joint_skill):
    skill = Skill.load(joint_skill)
    running.listen()
    running.client.execute()
    result = running.client.result(30.0)
    assert result.error_code == 0, result.error_string
    assert list(result.factors) == ['joints'] and result.robot_distance[1] < 0.02
    moving = [m for m in running.references if m.mode == Reference.STREAMING]
    assert moving and all(len(m.joints) == 1 for m in moving)
    position = np.array(running.robot[-1].position)
    assert np.abs(position - skill.goal).max() < 5e-3
    followed = [m for m in running.robot if m.joint_reference]
    assert followed and followed[-1].mode == RobotState.FOLLOW
    lag = [np.abs(np.array(m.position) - np.array(m.joint_reference[0].position)).max()
           for m in followed]
    assert max(lag) < 0.03


def test_a_pose_as_goal_is_reached_by_inverse_kinematics(running):
    publisher = running.publisher(PoseStamped, f'{SERVER}/goal_pose')
    running.client.execute()
    running.wait_progress(0.3)
    pose = np.array(messages.pose_numbers(running.client.state.goal[0]))
    pose[:3] += [0.03, -0.08, 0.05]
    message = PoseStamped()
    message.header.frame_id = FRAME
    messages.set_pose(message.pose, pose)
    publisher.publish(message)
    result = running.client.result(30.0)
    assert result.error_code == 0, result.error_string
    assert running.state.refused == 0
    assert np.linalg.norm(running.tool()[:3] - pose[:3]) < 0.01


def test_what_a_skill_of_the_joints_cannot_do_is_refused(running):
    publisher = running.publisher(MovingGoal, f'{SERVER}/moving_goal')
    running.client.execute()
    running.wait_progress(0.2)
    goal = MovingGoal(pose=running.client.state.goal[0])
    goal.header.frame_id = FRAME
    goal.twist.linear.x = 0.05
    publisher.publish(goal)
    running.wait('the refusal', lambda: running.state.refused == 1)
    assert 'does not follow a goal that moves on' in running.state.last_refusal
    assert running.client.result(30.0).error_code == 0


def test_tool_and_joints_alternate(running, joint_skill, skill_file):
    for path in (skill_file, joint_skill, skill_file):
        reply = running.call(LoadSkill, f'{SERVER}/load_skill', path=str(path))
        assert reply.success, reply.message
        running.client.execute()
        result = running.client.result(60.0)
        assert result.error_code == 0, (path, result.error_string)
    torques = running.torques()
    assert np.abs(np.diff(torques, axis=0)).max() <= 10 * 0.951  # a few states may be missing


def test_the_adapter_makes_trajectories_of_them(running):
    preset = Path(__file__).parents[2] / 'config/presets/joint_trajectory_controller.yaml'
    running.children.start_node('adapter', 'gdmp_ros.ros.adapter', {}, [
        '--params-file', str(preset), '-p', f'joint_names:={json.dumps(Arm().names)}'])
    try:
        made = []
        running.subscribe(JointTrajectory, 'joint_trajectory_controller/joint_trajectory',
                          made.append)
        # Otherwise the motion might begin before the adapter has found its topics.
        running.wait_log('adapter', 'the joints of the robot are known', 60.0)
        running.wait_log('adapter', 'references arrive', 60.0)
        running.client.execute()
        assert running.client.result(30.0).error_code == 0
        running.wait('trajectories', lambda: len(made) > 100)
        assert all(list(one.joint_names) == Arm().names and len(one.points) == 1 for one in made)
        steps = np.abs(np.diff([one.points[0].positions for one in made], axis=0)).max()
        assert steps < 0.05
        np.testing.assert_allclose(made[-1].points[0].positions, running.robot[-1].position,
                                   atol=0.01)
        assert made[0].points[0].time_from_start.nanosec == 30_000_000
        assert running.log('adapter').count('the joints of the robot are known') == 1
    finally:
        running.children.stop('adapter')
