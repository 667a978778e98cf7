"""The main job over DDS: execute, switch goals, survive the loss of the server."""
import time

from diagnostic_msgs.msg import DiagnosticArray
from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import Reference
from gdmp_msgs.srv import LearnSkill, LoadSkill, SetSpeed
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.experiments.demo.report import rotation_angles
from gdmp_ros.data import lasa
from gdmp_ros.data import recordings
from gdmp_ros.ros import messages
from gdmp_ros.ros.lifecycle import reliable

FRAME = 'panda_link0'
SERVER = 'trajectory_server'


def goal_of(skill, shift=(0.03, -0.11, 0.04)):
    pose = skill.goal[:7].copy()
    pose[:3] += shift
    return pose


def test_a_goal_switched_in_mid_motion_is_reached_by_the_arm(world, skill):
    world.start()
    world.listen()
    world.operator.execute()
    world.wait('a third of the motion', lambda: world.operator.state.progress > 0.33)
    goal, stiffness = goal_of(skill), np.diag([300.0, 700.0, 350.0])
    world.operator.goal_pose(goal, FRAME)
    world.operator.goal_stiffness(stiffness)
    result = world.operator.result(30.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    assert result.factors == ['position', 'orientation', 'stiffness']
    assert max(result.distance_to_goal) < 0.005
    world.spin(1.5)
    assert np.linalg.norm(world.tool()[:3] - goal[:3]) < 0.002
    assert rotation_angles(world.tool()[None, 3:], goal[None, 3:])[0] < 0.01
    applied = np.array(world.robot[-1].stiffness).reshape(6, 6)[:3, :3]
    np.testing.assert_allclose(applied, stiffness, rtol=0.01, atol=2.0)
    torques = world.torques()
    assert (np.abs(torques) <= [87] * 4 + [12] * 3).all()
    assert np.abs(np.diff(torques, axis=0)).max() <= 1.0 + 1e-9
    # One stream: sequence numbers count by one, stamps by one period.
    sequence = np.array([m.sequence for m in world.references])
    assert (np.diff(sequence) == 1).all()
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
                       for m in world.references])
    assert (np.diff(stamps) > 0).all()
    assert abs(np.median(np.diff(stamps)) - 1_000_000) < 20_000


def test_pose_and_stiffness_topics_carry_the_same_reference(world):
    poses, matrices = [], []
    world.collect(PoseStamped, f'{SERVER}/reference_pose', poses)
    world.collect(Float64MultiArray, f'{SERVER}/reference_stiffness', matrices)
    world.listen()
    world.start()
    world.wait('both topics', lambda: len(poses) > 50 and len(matrices) > 50
               and len(world.references) > 50)
    assert poses[-1].header.frame_id == FRAME
    by_stamp = {(m.header.stamp.sec, m.header.stamp.nanosec): m for m in world.references}
    paired = [(p, by_stamp[key]) for p in poses
              if (key := (p.header.stamp.sec, p.header.stamp.nanosec)) in by_stamp]
    assert len(paired) > 10
    assert all(p.pose == m.pose for p, m in paired)
    assert [d.label for d in matrices[-1].layout.dim] == ['rows', 'columns']
    assert [d.stride for d in matrices[-1].layout.dim] == [36, 6]
    np.testing.assert_allclose(matrices[-1].data, world.references[-1].stiffness)


def test_the_action_gives_feedback_is_preempted_and_cancels_to_a_smooth_stop(world):
    world.start()
    feedback = []
    sent = world.operator._action.send_goal_async(
        ExecuteSkill.Goal(), feedback_callback=lambda m: feedback.append(m.feedback))
    world.wait('the goal to be accepted', sent.done)
    first = sent.result().get_result_async()
    world.wait('feedback', lambda: len(feedback) > 5)
    assert feedback[-1].factors == ['position', 'orientation', 'stiffness']
    assert len(feedback[-1].distance_to_goal) == 3 and 0.0 < feedback[-1].phase < 1.0
    world.operator.execute()
    world.wait('the first goal to end', first.done)
    assert first.result().result.error_code == ExecuteSkill.Result.PREEMPTED
    world.spin(0.6)
    cancelled = world.operator.handle.cancel_goal_async()
    world.wait('the cancellation', cancelled.done)
    assert world.operator.result(10.0).error_code == ExecuteSkill.Result.CANCELED
    world.operator.wait_status('holding', 5.0)
    speeds = np.array([[m.twist.linear.x, m.twist.linear.y, m.twist.linear.z]
                       for m in world.robot])
    world.spin(3.0)
    assert np.linalg.norm(speeds[-1]) < 0.6
    end = world.robot[-1].twist.linear
    assert np.linalg.norm([end.x, end.y, end.z]) < 1e-3
    assert np.abs(np.diff(world.torques(), axis=0)).max() <= 1.0 + 1e-9


def test_unfit_goals_are_refused_with_the_reason_and_the_motion_goes_on(world, skill):
    world.start()
    world.operator.execute()
    world.wait('the motion', lambda: world.operator.state.progress > 0.05)
    good = goal_of(skill)
    nan, long_quaternion, far = good.copy(), good.copy(), good.copy()
    nan[0], far[0] = np.nan, 5.0
    long_quaternion[3:] *= 1.1
    refused = 0
    for pose, frame, reason in ((good, 'world', "frame 'world', expected 'panda_link0'"),
                                (nan, FRAME, 'NaN'),
                                (long_quaternion, FRAME, 'quaternion norm is 1.1'),
                                (far, FRAME, 'outside the workspace -0.2 to 0.8 m')):
        world.operator.goal_pose(pose, frame)
        refused += 1
        world.wait(f'a refusal: {reason}', lambda n=refused: world.refusal()[0] == n)
        assert reason in world.refusal()[1] and 'goal_pose' in world.refusal()[1]
    for matrix, reason in ((np.diag([1.0, -1, 1]), 'smallest eigenvalue is -1'),
                           (np.diag([300.0] * 3 + [99.0] * 3), 'rotational block'),
                           (np.ones(7), '7 numbers, expected 9 or 36')):
        world.operator.goal_stiffness(matrix)
        refused += 1
        world.wait(f'a refusal: {reason}', lambda n=refused: world.refusal()[0] == n)
        assert reason in world.refusal()[1] and 'goal_stiffness' in world.refusal()[1]
    assert world.operator.result(30.0).error_code == ExecuteSkill.Result.SUCCESSFUL
    world.spin(1.5)
    assert np.linalg.norm(world.tool()[:3] - skill.goal[:3]) < 0.002


def test_services_start_pause_and_stop(world, skill_file, tmp_path):
    world.start()
    bad = world.call(LoadSkill, f'{SERVER}/load_skill', path=str(tmp_path / 'none.json'))
    assert not bad.success and 'none.json' in bad.message
    assert world.call(LoadSkill, f'{SERVER}/load_skill', path=str(skill_file)).success
    assert world.call(Trigger, f'{SERVER}/start').success
    assert world.call(SetSpeed, f'{SERVER}/set_speed', scale=0.5).success
    slow = world.call(SetSpeed, f'{SERVER}/set_speed', scale=7.0)
    assert not slow.success and 'speed is 7.0' in slow.message
    world.wait('half speed', lambda: world.operator.state.speed == 0.5)
    assert world.call(SetBool, f'{SERVER}/pause', data=True).success
    world.operator.wait_status('paused', 5.0)
    world.wait('standstill', lambda: world.operator.state.speed == 0.0)
    progress = world.operator.state.progress
    world.spin(0.5)
    assert world.operator.state.progress == progress
    assert world.call(SetBool, f'{SERVER}/pause', data=False).success
    world.wait('the motion to go on', lambda: world.operator.state.progress > progress + 0.05)
    assert world.call(Trigger, f'{SERVER}/stop').success
    world.operator.wait_status('holding', 5.0)


def test_a_skill_is_learned_by_service_while_references_stream(world, tmp_path):
    bag = tmp_path / 'bag'
    recordings.write(bag, lasa.robot_demonstrations('GShape')[1], FRAME, 10**18)
    world.start()
    world.listen()
    reply = world.call(LearnSkill, f'{SERVER}/learn_skill', bags=[str(bag)], n_basis=40,
                       output=str(tmp_path / 'learned.json'))
    assert reply.success, reply.message
    assert 0.0 < reply.mean_relative_error < 5e-3
    assert (tmp_path / 'learned.json').exists()
    sequence = np.array([m.sequence for m in world.references])
    assert len(sequence) > 500 and (np.diff(sequence) == 1).all()
    bad = world.call(LearnSkill, f'{SERVER}/learn_skill', bags=[str(tmp_path / 'nowhere')])
    assert not bad.success and 'nowhere' in bad.message


def test_the_arm_holds_when_the_server_is_killed_and_goes_on_when_it_returns(world):
    world.start()
    world.operator.execute()
    world.wait('the motion', lambda: world.operator.state.progress > 0.3)
    world.children.kill('trajectory_server')
    world.spin(4.0)  # at 230 N/m and 12 kg the arm itself takes its time
    before = len(world.robot)
    held = world.tool()
    world.spin(0.5)
    assert np.linalg.norm(world.tool()[:3] - held[:3]) < 5e-4
    world.operator.state = None
    world.start_server('second_server')
    world.operator.wait_status('holding', 60.0)
    world.spin(1.0)
    # The returned server holds the arm where it is.
    path = np.array([[m.pose.position.x, m.pose.position.y, m.pose.position.z]
                     for m in world.robot[before:]])
    assert np.linalg.norm(path - path[0], axis=1).max() < 1e-3
    stood = len(world.robot)
    world.operator.execute()
    result = world.operator.result(30.0)
    assert result.error_code == result.SUCCESSFUL
    # It sets off from there without a jerk.
    velocities = np.array([m.velocity for m in world.robot[stood:stood + 20]])
    assert np.abs(velocities).max() < 0.05
    assert np.abs(np.diff(world.torques(), axis=0)).max() <= 1.0 + 1e-9


def test_bad_references_are_refused_counted_and_the_arm_holds(world):
    diagnostics = []
    world.node.create_subscription(DiagnosticArray, '/diagnostics', diagnostics.append,
                                   reliable(10))
    world.start_sim()
    publisher = world.node.create_publisher(Reference, 'trajectory_server/reference', reliable(10))
    world.wait('the robot', lambda: len(world.robot) > 10, 60.0)
    world.wait('the simulation to listen', lambda: publisher.get_subscription_count() > 0)
    start = world.tool()
    target = np.zeros(56)
    target[:7] = start
    target[0] += 0.1
    target[19:55] = np.diag([400.0] * 3 + [30.0] * 3).reshape(-1)
    target[55] = 0.7

    def counted():
        found = [{v.key: v.value for v in m.status[0].values} for m in diagnostics
                 if m.status[0].name.startswith('panda_sim')]
        return found[-1] if found else {}

    spoiled = []
    for change in (lambda t: None, lambda t: t.__setitem__(2, np.nan),
                   lambda t: t.__setitem__(slice(3, 7), 0.7),
                   lambda t: t.__setitem__(19, -400.0)):
        numbers = target.copy()
        change(numbers)
        spoiled.append(numbers)
    for count, (numbers, reason) in enumerate(zip(spoiled, (
            "frame is 'world'", 'NaN', 'quaternion norm', 'not positive definite')), start=1):
        message = Reference()
        message.header.frame_id = 'world' if count == 1 else FRAME
        message.header.stamp = messages.stamp_of(time.time_ns())
        messages.fill_reference(message, numbers)
        publisher.publish(message)
        world.wait(f'the refusal: {reason}',
                   lambda n=count: counted().get('references refused') == str(n))
        assert reason in counted()['last refusal']
    world.spin(0.3)
    assert np.linalg.norm(world.tool()[:3] - start[:3]) < 1e-4
    assert 'reference refused' in world.log('panda_sim')


def test_viewer_topics_come_at_100_hz(world):
    joints, poses = [], []
    world.node.create_subscription(JointState, 'joint_states', joints.append, reliable(100))
    world.node.create_subscription(PoseStamped, 'panda_sim/measured_pose', poses.append,
                                   reliable(100))
    world.start_sim()
    world.wait('both', lambda: len(joints) > 100 and len(poses) > 100, 60.0)
    for messages in (joints, poses):
        stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages]
        # Of the arm's own time: how much of it passes in a second is the machine's affair.
        assert np.median(np.diff(stamps)) == pytest.approx(0.01, abs=1e-4)
    assert joints[-1].name == [f'joint{i}' for i in range(1, 8)]
    assert len(joints[-1].effort) == 7
