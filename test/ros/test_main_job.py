"""The main job: execute, switch goals, survive the loss of the server."""
import subprocess

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.srv import LearnSkill, LoadSkill, SetSpeed
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.data import lasa, recordings
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.ros.clients.testbed import SERVER
from test.ros.nodes import FRAME


def goal_of(skill):
    pose = skill.goal[:7].copy()
    pose[:3] += (0.03, -0.11, 0.04)
    return pose


def test_the_arm_reaches_a_goal_that_is_switched_during_the_motion(running, skill):
    running.listen()
    running.client.execute()
    running.wait_progress(0.33)
    goal, stiffness = goal_of(skill), np.diag([300.0, 700.0, 350.0])
    running.client.goal_pose(goal, FRAME)
    running.client.goal_stiffness(stiffness)
    result = running.client.result(30.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    assert result.factors == ['position', 'orientation', 'stiffness']
    assert max(result.distance_to_goal) < 0.005
    running.wait('the tool to be at the goal', lambda: (
        np.linalg.norm(running.tool()[:3] - goal[:3]) < 0.002
        and rotation_angles(running.tool()[None, 3:], goal[None, 3:])[0] < 0.01))
    applied = np.array(running.robot[-1].stiffness).reshape(6, 6)[:3, :3]
    np.testing.assert_allclose(applied, stiffness, rtol=0.01, atol=2.0)
    torques = running.torques()
    assert (np.abs(torques) <= [87] * 4 + [12] * 3).all()
    assert np.abs(np.diff(torques, axis=0)).max() <= 1.0 + 1e-9
    # One stream: sequence numbers count by one, stamps by one period.
    sequence = np.array([m.sequence for m in running.references])
    assert (np.diff(sequence) == 1).all()
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
                       for m in running.references])
    assert (np.diff(stamps) > 0).all()
    assert abs(np.median(np.diff(stamps)) - 1_000_000) < 20_000


def test_pose_and_stiffness_topics_have_the_same_reference(running):
    poses = running.collect(PoseStamped, f'{SERVER}/reference_pose')
    matrices = running.collect(Float64MultiArray, f'{SERVER}/reference_stiffness')
    running.listen()

    def paired():
        by_stamp = {(m.header.stamp.sec, m.header.stamp.nanosec): m for m in running.references}
        return [(p, by_stamp[key]) for p in poses
                if (key := (p.header.stamp.sec, p.header.stamp.nanosec)) in by_stamp]
    running.wait('all topics', lambda: len(matrices) > 50 and len(paired()) > 10)
    assert poses[-1].header.frame_id == FRAME
    assert all(p.pose == m.pose for p, m in paired())
    assert [d.label for d in matrices[-1].layout.dim] == ['rows', 'columns']
    assert [d.stride for d in matrices[-1].layout.dim] == [36, 6]
    np.testing.assert_allclose(matrices[-1].data, running.references[-1].stiffness)


def test_the_action_gives_feedback_is_preempted_and_cancels_to_a_smooth_stop(running):
    feedback = []
    sent = running.client._action.send_goal_async(
        ExecuteSkill.Goal(), feedback_callback=lambda m: feedback.append(m.feedback))
    running.wait('the goal to be accepted', sent.done)
    first = sent.result().get_result_async()
    running.wait('feedback', lambda: len(feedback) > 5)
    assert feedback[-1].factors == ['position', 'orientation', 'stiffness']
    assert len(feedback[-1].distance_to_goal) == 3 and 0.0 < feedback[-1].phase < 1.0
    running.client.execute(ExecuteSkill.Goal(duration=10.0))
    running.wait('the first goal to end', first.done)
    assert first.result().result.error_code == ExecuteSkill.Result.PREEMPTED
    running.wait_progress(0.1)
    assert running.client.cancel()
    assert running.client.result(10.0).error_code == ExecuteSkill.Result.CANCELED
    running.client.wait_status('holding', 5.0)
    running.wait_rest()
    assert running.state.progress < 1.0
    assert np.abs(np.diff(running.torques(), axis=0)).max() <= 1.0 + 1e-9


def test_invalid_goals_are_refused_with_the_reason_and_the_motion_continues(running, skill):
    assert running.set_parameters(SERVER, tf_timeout=0.1).successful
    running.client.execute()
    running.wait_progress(0.05)
    good = goal_of(skill)
    nan, long_quaternion, far = good.copy(), good.copy(), good.copy()
    nan[0], far[0] = np.nan, 5.0
    long_quaternion[3:] *= 1.1
    refused = 0
    for pose, frame, reason in ((good, 'world', "'world' is not connected to 'panda_link0'"),
                                (nan, FRAME, 'NaN'),
                                (long_quaternion, FRAME, 'quaternion norm is 1.1'),
                                (far, FRAME, 'outside the workspace -0.2 to 0.8 m')):
        running.client.goal_pose(pose, frame)
        refused += 1
        running.wait(f'a refusal: {reason}', lambda n=refused: running.state.refused == n)
        assert reason in running.state.last_refusal and 'goal_pose' in running.state.last_refusal
    for matrix, reason in ((np.diag([1.0, -1, 1]), 'smallest eigenvalue is -1'),
                           (np.diag([300.0] * 3 + [99.0] * 3), 'rotational block'),
                           (np.ones(7), '7 numbers, expected 9 or 36')):
        running.client.goal_stiffness(matrix)
        refused += 1
        running.wait(f'a refusal: {reason}', lambda n=refused: running.state.refused == n)
        assert reason in running.state.last_refusal
        assert 'goal_stiffness' in running.state.last_refusal
    for topic, kind in (('goal_pose', PoseStamped), ('goal_stiffness', Float64MultiArray)):
        running.client._publishers[topic].send(serialize_message(kind())[:6])  # cut off
        refused += 1
        running.wait('the refusal of a damaged message',
                     lambda n=refused: running.state.refused == n)
        assert f'not a {kind.__name__}' in running.state.last_refusal
    assert running.client.result(30.0).error_code == ExecuteSkill.Result.SUCCESSFUL
    running.wait('the tool to be at the goal of the skill', lambda: np.linalg.norm(
        running.tool()[:3] - skill.goal[:3]) < 0.002)


def test_a_skill_that_the_arm_cannot_follow_is_loaded_with_a_warning(running, skill, tmp_path):
    behind, good = skill.goal.copy(), skill.goal.copy()
    behind[:3] = -0.9, 0.0, 0.4
    skill.between(goal=behind).save(tmp_path / 'behind.json')
    skill.between(goal=good).save(tmp_path / 'good.json')
    reply = running.call(LoadSkill, f'{SERVER}/load_skill', path=str(tmp_path / 'behind.json'))
    assert reply.success
    assert 'the arm cannot follow' in reply.message and 'out of reach' in reply.message
    running.wait('the warning', lambda: 'out of reach' in running.log(SERVER), 5.0)
    reply = running.call(LoadSkill, f'{SERVER}/load_skill', path=str(tmp_path / 'good.json'))
    assert reply.success and reply.message == ''


def test_services_start_pause_and_stop(running, skill_file, tmp_path):
    bad = running.call(LoadSkill, f'{SERVER}/load_skill', path=str(tmp_path / 'none.json'))
    assert not bad.success and 'none.json' in bad.message
    bad = running.call(LoadSkill, f'{SERVER}/load_skill', path='sent.json', contents='{}')
    assert not bad.success and 'sent.json: not a skill file' in bad.message
    assert running.call(LoadSkill, f'{SERVER}/load_skill', path='sent.json',
                        contents=skill_file.read_text()).success
    running.wait('its name', lambda: running.state.skill == 'sent.json', 5.0)
    assert running.call(LoadSkill, f'{SERVER}/load_skill', path=str(skill_file)).success
    assert running.call(SetSpeed, f'{SERVER}/set_speed', scale=0.2).success
    too_fast = running.call(SetSpeed, f'{SERVER}/set_speed', scale=7.0)
    assert not too_fast.success and 'speed is 7.0' in too_fast.message
    assert running.call(Trigger, f'{SERVER}/start').success
    running.wait('this tempo', lambda: running.state.speed == pytest.approx(0.2, 0.05))
    assert running.call(SetBool, f'{SERVER}/pause', data=True).success
    running.client.wait_status('paused', 5.0)
    running.wait('standstill', lambda: running.state.speed == 0.0)
    progress, ticks = running.state.progress, running.state.ticks
    assert progress < 1.0
    running.wait('300 more ticks', lambda: running.state.ticks > ticks + 300)
    assert running.state.progress == progress
    assert running.call(SetBool, f'{SERVER}/pause', data=False).success
    running.wait('the motion to continue', lambda: running.state.progress > progress + 0.05)
    assert running.call(Trigger, f'{SERVER}/stop').success
    running.client.wait_status('holding', 5.0)


def test_an_action_that_a_service_stops_is_aborted_with_the_reason(running):
    running.client.execute()
    running.wait_progress(0.1)
    assert running.call(Trigger, f'{SERVER}/stop').success
    result = running.client.result(15.0)
    assert result.error_code == ExecuteSkill.Result.CANCELED
    assert result.error_string == 'stopped by service'


class Punctual(subprocess.Popen):
    """A process whose end is seen when it has been looked for ten times, however long it takes."""

    looked = 0

    def poll(self):
        self.looked += 1
        return self.wait() if self.looked >= 10 else None


def test_a_skill_is_learned_by_service_while_references_are_streamed(running, tmp_path,
                                                                     monkeypatch):
    monkeypatch.setattr(subprocess, 'Popen', Punctual)
    bag = tmp_path / 'bag'
    recordings.write(bag, lasa.robot_demonstrations('GShape')[1], FRAME, 10**18)
    running.listen()
    reply = running.call(LearnSkill, f'{SERVER}/learn_skill', bags=[str(bag)], n_basis=40,
                         output=str(tmp_path / 'learned.json'))
    assert reply.success, reply.message
    assert 0.0 < reply.mean_relative_error < 5e-3
    assert (tmp_path / 'learned.json').exists()
    sequence = np.array([m.sequence for m in running.references])
    assert len(sequence) > 500 and (np.diff(sequence) == 1).all()
    bad = running.call(LearnSkill, f'{SERVER}/learn_skill', bags=[str(tmp_path / 'nowhere')])
    assert not bad.success and 'nowhere' in bad.message


def assert_gentle_start(states):
    """The tempo grows from 0 by 5 per second: after 20 ms it is 0.1."""
    speeds = np.abs([m.velocity for m in states]).max(axis=1)  # rad/s
    moving = int(np.argmax(speeds > 0.005))
    assert moving > 0 and speeds.max() > 0.2
    assert speeds[moving:moving + 20].max() < 0.1 * speeds.max()


@pytest.mark.long
def test_the_arm_holds_when_the_server_is_killed_and_follows_the_next_server(nodes):
    nodes.start()
    nodes.client.execute()
    nodes.wait_progress(0.3)
    nodes.children.kill(SERVER)
    nodes.wait_rest()
    before, held = len(nodes.robot), nodes.tool()
    nodes.client.state = None
    nodes.start_server('second_server')
    nodes.wait_holding()
    nodes.wait_rest()
    # The arm rests all the time, without a server and with the next one.
    path = np.array([[m.pose.position.x, m.pose.position.y, m.pose.position.z]
                     for m in nodes.robot[before:]])
    assert len(path) > 500
    assert np.linalg.norm(path - held[:3], axis=1).max() < 1e-3
    begun = len(nodes.robot)
    nodes.client.execute()
    result = nodes.client.result(30.0)
    assert result.error_code == result.SUCCESSFUL
    # The next motion begins there without a jerk, as the first one did.
    assert_gentle_start(nodes.robot[:before])
    assert_gentle_start(nodes.robot[begun:])
    assert np.abs(np.diff(nodes.torques(), axis=0)).max() <= 1.0 + 1e-9
