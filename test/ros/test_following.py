"""The arm begins to follow only what it may, and the action looks at the robot; over DDS."""
import copy

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import ArmStatus, MovingGoal, Reference, RobotState
from gdmp_msgs.srv import SetPayload, SetTool
from geometry_msgs.msg import Point, Pose, PoseStamped
import numpy as np
import pytest
from std_srvs.srv import SetBool, Trigger

from gdmp_ros import Demonstration, Skill
from gdmp_ros.control.target import resting_target
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.ros.middleware import best_effort
from test.ros.nodes import ACTIVATE, CONFIGURE, DEACTIVATE, FRAME

RESULT = ExecuteSkill.Result


def step_of(references):
    """Largest distance between two references one after the other [m]."""
    shown = np.array([messages.pose_numbers(m.pose)[:3] for m in references])
    return np.linalg.norm(np.diff(shown, axis=0), axis=1).max()


def moved_of(states):
    """Distance that the arm moved [m]."""
    shown = np.array([messages.pose_numbers(m.pose)[:3] for m in states])
    return np.linalg.norm(shown - shown[0], axis=1).max()


def guide(running, offset):
    """Move the arm by hand, and end teaching there."""
    assert running.call(SetBool, f'{ARM}/teach', data=True).success
    hand = running.publisher(PoseStamped, f'{ARM}/hand_pose')
    message, goal = PoseStamped(), running.tool() + np.concatenate([offset, np.zeros(4)])
    message.header.frame_id = FRAME
    messages.set_pose(message.pose, goal)

    def arrived():
        hand.publish(message)
        return np.linalg.norm(running.tool()[:3] - goal[:3]) < 0.01
    running.wait('the arm to follow the hand', arrived)
    running.spend(0.5)
    assert running.call(SetBool, f'{ARM}/teach', data=False).success
    running.wait_rest()


def test_a_robot_that_does_not_move_is_blocked(running):
    running.listen()
    assert running.call(SetBool, f'{ARM}/teach', data=True).success
    running.client.execute()
    running.wait('the robot to lag', lambda: {'lagging', 'not_followed'} <= set(
        running.state.flags))
    result = running.client.result(30.0)
    assert result.error_code == RESULT.BLOCKED and 'has not moved for 3 s' in result.error_string
    assert 'the arm does not follow, the arm is guided by hand' in result.error_string
    assert result.robot_distance[0] > 0.02
    running.client.wait_status('holding', 5.0)
    assert step_of(running.references) < 0.5e-3
    # The stream goes on after teaching, and began before the arm was ready.
    before = len(running.robot)
    assert running.call(SetBool, f'{ARM}/teach', data=False).success
    running.spend(1.0)
    assert moved_of(running.robot[before:]) < 1e-3
    assert running.robot[-1].mode == RobotState.HOLD


def test_a_motion_that_is_streamed_when_teaching_ends_is_not_followed(running):
    running.listen()
    assert running.call(SetBool, f'{ARM}/teach', data=True).success
    running.client.execute()
    running.wait('the motion', lambda: running.state.progress > 0.05)
    before = len(running.robot)
    assert running.call(SetBool, f'{ARM}/teach', data=False).success
    running.spend(1.0)
    assert moved_of(running.robot[before:]) < 1e-3
    assert {m.mode for m in running.robot[before + 200:]} == {RobotState.HOLD}
    assert 'began before the arm was ready' in running.log(ARM)
    assert running.client.cancel()


@pytest.mark.parametrize('position', [(0.75, 0.55, 0.9), (0.05, 0.0, 0.05)])
def test_a_goal_out_of_reach_is_refused_before_anything_moves(running, position):
    running.listen()
    goal = ExecuteSkill.Goal(use_goal_pose=True)
    goal.goal_pose.header.frame_id = FRAME
    messages.set_pose(goal.goal_pose.pose, np.array([*position, 0.0, 1.0, 0.0, 0.0]))
    running.client.execute(goal)
    result = running.client.result(10.0)
    assert result.error_code == RESULT.INVALID_GOAL and 'cannot be reached' in result.error_string
    running.spend(0.3)
    assert len(running.references) > 250
    assert step_of(running.references) == 0.0


@pytest.mark.long
def test_a_motion_goes_on_from_the_reference_when_the_robot_is_behind(nodes, skill):
    """A robot that stays 25 mm behind, and a second goal in the middle of the first motion."""
    nodes.start_server(measured_pose_topic='/robot')
    nodes.listen()
    robot = nodes.publisher(PoseStamped, '/robot')
    behind = PoseStamped()
    behind.header.frame_id = FRAME
    messages.set_pose(behind.pose, skill.start[:7])

    executed = [False]

    def publish():
        if nodes.references:
            behind.pose = copy.deepcopy(nodes.references[-1].pose)
            behind.pose.position.x += 0.025 * executed[0]
        robot.publish(behind)
    nodes.every(0.01, publish)
    nodes.client.wait_status('holding', 60.0)
    nodes.client.execute(ExecuteSkill.Goal(duration=5.0))
    executed[0] = True
    nodes.wait_progress(0.4)
    nodes.client.execute(ExecuteSkill.Goal(duration=5.0))
    result = nodes.client.result(30.0)
    assert step_of(nodes.references) < 0.5e-3
    assert result.error_code == RESULT.GOAL_TOLERANCE_VIOLATED
    assert 'the robot 25.0 mm' in result.error_string


def test_a_robot_that_is_lost_on_the_way_is_not_at_the_goal(nodes, skill):
    nodes.start_server(measured_pose_topic='/robot')
    nodes.listen()
    robot = nodes.publisher(PoseStamped, '/robot')
    message, lost = PoseStamped(), [False]
    message.header.frame_id = FRAME
    messages.set_pose(message.pose, skill.start[:7])

    def publish():
        if nodes.references:
            message.pose = nodes.references[-1].pose
        if not lost[0]:
            robot.publish(message)
    nodes.every(0.01, publish)
    nodes.client.wait_status('holding', 60.0)
    nodes.client.execute()
    nodes.wait_progress(0.4)
    lost[0] = True
    result = nodes.client.result(30.0)
    assert result.error_code == RESULT.BLOCKED
    assert 'measured pose of the robot has ended' in result.error_string
    # It stopped where it was, and a new start decides.
    nodes.client.wait_status('holding', 5.0)
    assert nodes.references[-1].twist.linear.y == 0.0 and nodes.state.progress < 0.9
    lost[0] = False
    nodes.spend(1.0)
    assert nodes.state.status == 'holding'
    nodes.client.execute()
    nodes.wait_progress(0.2)


def test_a_server_holds_the_measured_pose_when_it_is_activated(running):
    """The arm is moved while the server is inactive."""
    running.listen()
    assert running.transition(SERVER, DEACTIVATE)
    guide(running, [0.1, 0.1, 0.0])
    running.references.clear()
    before = len(running.robot)
    assert running.transition(SERVER, ACTIVATE)
    running.client.wait_status('holding', 10.0)
    running.spend(0.5)
    pose = messages.pose_numbers(running.references[-1].pose)
    assert np.linalg.norm(pose[:3] - running.tool()[:3]) < 1e-3
    assert step_of(running.references) == 0.0
    assert moved_of(running.robot[before:]) < 1e-3
    assert running.robot[-1].mode == RobotState.HOLD
    running.client.execute()
    running.wait('the arm to follow', lambda: running.robot[-1].mode == RobotState.FOLLOW)
    assert running.client.cancel()


def test_after_a_jump_of_half_a_metre_the_arm_holds_until_it_is_armed(running):
    assert running.transition(SERVER, DEACTIVATE)
    out = running.publisher(Reference, f'{SERVER}/reference')
    running.wait_rest()
    start = running.tool()
    message = Reference()
    message.header.frame_id = FRAME

    def stream(pose, what, until):
        messages.fill_reference(message, resting_target(pose))

        def streamed():
            message.sequence += 1
            message.header.stamp = messages.stamp_of(running.client.clock.wall())
            out.publish(message)
            running.spend(0.005)
            return until()
        running.wait(what, streamed)
    stream(start, 'the arm to follow', lambda: running.robot[-1].mode == RobotState.FOLLOW)
    said, before = len(running.log(ARM)), len(running.robot)
    far = start + [0.1, 0.49, 0, 0, 0, 0, 0]
    stream(far, 'the refusal', lambda: 'jumps by 0.5 m' in running.log(ARM)[said:])
    stream(far, 'the arm to hold', lambda: running.robot[-1].mode == RobotState.HOLD
           and 'call ~/arm' in running.log(ARM)[said:])
    assert moved_of(running.robot[before:]) < 1e-3
    assert running.call(Trigger, f'{ARM}/arm').success
    stream(far, 'the arm to arrive', lambda: np.linalg.norm(running.tool()[:3] - far[:3]) < 0.01)
    fastest = max(np.linalg.norm([m.twist.linear.x, m.twist.linear.y, m.twist.linear.z])
                  for m in running.robot[before:])
    assert fastest < 0.35


def test_stop_gives_way_and_hold(running):
    """A motion stops at once and stays stopped, the arm gives way, and holds again."""
    running.client.execute()
    running.wait_progress(0.2)
    assert running.call(Trigger, f'{ARM}/stop').success
    running.wait('the arm to hold', lambda: running.robot[-1].mode == RobotState.HOLD)
    running.wait_rest()
    before = len(running.robot)
    running.spend(0.5)
    assert moved_of(running.robot[before:]) < 1e-3
    assert running.call(Trigger, f'{ARM}/comply').success
    running.wait('the arm to give way', lambda: running.robot[-1].mode == RobotState.COMPLIANT)
    assert not running.call(Trigger, f'{ARM}/recover').success
    assert running.call(Trigger, f'{ARM}/stop').success
    running.wait('the arm to hold', lambda: running.robot[-1].mode == RobotState.HOLD)
    running.client.cancel()


def test_a_stopped_server_tells_the_arm_that_its_stream_ends(running):
    running.client.execute()
    running.wait_progress(0.1)
    running.listen()
    assert running.transition(SERVER, DEACTIVATE)
    running.wait('the end', lambda: running.references
                 and running.references[-1].mode == Reference.ENDED)
    running.wait('the arm to hold', lambda: running.robot[-1].mode == RobotState.HOLD)


@pytest.mark.long
def test_an_arm_with_friction_that_is_not_known_says_how_far_it_is_off(nodes):
    nodes.start(arm={'plant_dry_friction': 1.1, 'plant_armature': 0.2})
    nodes.client.execute()
    result = nodes.client.result(30.0)
    assert result.error_code == RESULT.GOAL_TOLERANCE_VIOLATED
    assert 'the reference is at the goal, the robot' in result.error_string
    assert 0.003 < result.robot_distance[0] < 0.05
    nodes.client.execute(ExecuteSkill.Goal(robot_position_tolerance=0.05,
                                           robot_rotation_tolerance=0.2))
    assert nodes.client.result(30.0).error_code == RESULT.SUCCESSFUL


def test_the_path_has_a_tolerance_if_one_is_given(running):
    running.client.execute(ExecuteSkill.Goal(path_position_tolerance=1e-4))
    result = running.client.result(30.0)
    assert result.error_code == RESULT.PATH_TOLERANCE_VIOLATED
    running.client.wait_status('holding', 5.0)


@pytest.mark.long
def test_a_payload_is_told_by_service_and_by_parameters(nodes):
    """0.5 kg hang 12 mm low at 400 N/m until the arm knows of them."""
    nodes.start(arm={'plant_payload': 0.5})
    nodes.client.execute()
    result = nodes.client.result(30.0)
    assert result.error_code == RESULT.GOAL_TOLERANCE_VIOLATED and result.robot_distance[0] > 0.005
    refused = nodes.call(SetPayload, f'{ARM}/set_payload', mass=-1.0)
    assert not refused.success and 'mass' in refused.message
    assert nodes.call(SetPayload, f'{ARM}/set_payload', mass=0.5).success
    nodes.spend(1.0)
    nodes.client.execute()
    assert nodes.client.result(30.0).error_code == RESULT.SUCCESSFUL
    assert nodes.set_parameters(ARM, payload_mass=0.0).successful
    assert not nodes.set_parameters(ARM, payload_inertia=[1.0, 0.1, 0.1, 0.0, 0.0, 0.0]).successful


@pytest.mark.long
def test_another_tool_goes_to_the_goals(nodes):
    """The same goal, with a tool that is 0.1 m longer and 0.03 m aside."""
    nodes.start()
    nodes.client.execute()
    refused = nodes.call(SetTool, f'{ARM}/set_tool', pose=Pose(position=Point(z=0.1)))
    assert not refused.success and 'follows a motion' in refused.message
    assert nodes.client.result(30.0).error_code == RESULT.SUCCESSFUL
    assert nodes.call(Trigger, f'{ARM}/stop').success
    nodes.wait('the arm to hold', lambda: nodes.robot[-1].mode == RobotState.HOLD)
    nodes.wait_rest()
    last, before = nodes.tool(), len(nodes.robot)
    assert nodes.call(SetTool, f'{ARM}/set_tool', pose=Pose(position=Point(y=0.03, z=0.1))).success
    nodes.spend(0.5)
    speeds = [np.linalg.norm([m.twist.linear.x, m.twist.linear.y, m.twist.linear.z])
              for m in nodes.robot[before:]]
    assert max(speeds) < 0.01
    assert np.linalg.norm(nodes.tool()[:3] - last[:3]) == pytest.approx(np.hypot(0.03, 0.1),
                                                                        abs=1e-3)
    nodes.client.execute()
    assert nodes.client.result(60.0).error_code == RESULT.SUCCESSFUL
    assert np.linalg.norm(nodes.tool()[:3] - last[:3]) < 0.003
    assert not nodes.set_parameters(ARM, tool_rotation=[2.0, 0.0, 0.0, 0.0]).successful


def test_the_server_says_that_the_tank_of_the_arm_is_low(nodes, skill):
    nodes.start_server(arm_status_topic='/status', measured_pose_topic='/robot')
    status = nodes.publisher(ArmStatus, '/status')
    nodes.every(0.1, lambda: status.publish(ArmStatus(tank_low=True)))
    nodes.wait('the flag', lambda: nodes.client.state is not None
               and 'tank_low' in nodes.state.flags, 60.0)


def test_a_wrench_of_the_skill_is_streamed_and_let_go(nodes, skill, tmp_path):
    s = np.linspace(0.0, 1.0, 501)
    points = np.tile(np.concatenate([skill.start[:7], np.zeros(6)]), (501, 1))
    points[:, 1] += 0.1 * s ** 2 * (3.0 - 2.0 * s)
    points[:, 9] = -6.0 * np.sin(np.pi * s) ** 2
    shown = Demonstration(4.0 * s, points, tool_manifold(None, wrench=True))
    Skill.learn(shown).save(tmp_path / 'press.json')
    nodes.start_server(skill=str(tmp_path / 'press.json'), start_from='skill', wrench_gain=3.0)
    nodes.listen()
    nodes.wait('the server', lambda: nodes.client.state is not None, 60.0)
    nodes.client.execute()
    nodes.wait('the wrench', lambda: nodes.references
               and nodes.references[-1].wrench.force.z < -5.0, 30.0)
    assert nodes.references[-1].wrench_gain[2] == 3.0
    assert nodes.client.cancel()
    nodes.wait('the wrench to be let go', lambda: nodes.references[-1].wrench.force.z == 0.0)
    forces = np.array([m.wrench.force.z for m in nodes.references])
    assert np.abs(np.diff(forces)).max() < 0.5 and forces.min() == pytest.approx(-6.0, abs=1.0)


@pytest.mark.long
def test_without_a_robot_a_motion_ends_unverified(nodes):
    nodes.start_server(start_from='skill')
    nodes.wait('the server', lambda: nodes.client.state is not None, 60.0)
    nodes.client.execute()
    result = nodes.client.result(30.0)
    assert (result.error_code, result.flags[-1]) == (RESULT.SUCCESSFUL, 'unverified')


@pytest.mark.parametrize('clock_s', [0.0, -1000.0], ids=['same clock', 'another clock'])
def test_where_the_robot_was_during_a_gap_of_the_network_is_not_where_it_is(running, clock_s):
    running.unconfigure()
    assert running.transition(SERVER, CONFIGURE, ACTIVATE)
    running.wait('the flag', lambda: 'no_robot' in running.state.flags)
    robot = running.client.participant.publisher(PoseStamped, f'{ARM}/measured_pose',
                                                 best_effort(1))
    clock, sends, late = running.client.clock, True, 0.0

    def measure():
        if sends:
            pose = np.array([0.4, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0])
            message = messages.stamped_pose(pose, FRAME)
            message.header.stamp = messages.stamp_of(
                clock.wall() + round((clock_s - late) * 1e9))
            robot.publish(message)
    running.every(0.01, measure)
    running.wait('the robot', lambda: 'no_robot' not in running.state.flags, 5.0)
    running.spend(2.5)
    sends = False
    running.spend(1.0)
    assert 'no_robot' in running.state.flags
    sends, late = True, 1.0
    running.spend(0.5)
    assert 'no_robot' in running.state.flags
    late = 0.0
    running.wait('the robot again', lambda: 'no_robot' not in running.state.flags, 0.5)
    # A delay that stays is one of the network from now on.
    sends = False
    running.spend(1.0)
    sends, late = True, 1.0
    running.wait('the robot behind a slow network', lambda: 'no_robot' not in running.state.flags,
                 3.0)
    running.client.participant.destroy(robot)


def test_what_best_effort_publishers_measure_is_heard(running):
    running.unconfigure()
    assert running.transition(SERVER, CONFIGURE, ACTIVATE)
    running.wait('the flag', lambda: 'no_robot' in running.state.flags)
    camera = [running.client.participant.publisher(kind, topic, best_effort(1))
              for kind, topic in ((PoseStamped, f'{ARM}/measured_pose'),
                                  (MovingGoal, f'{SERVER}/moving_goal'))]
    pose = messages.stamped_pose(np.array([0.4, 0.0, 0.4, 0.0, 1.0, 0.0, 0.0]), FRAME)
    goal = MovingGoal(header=pose.header, pose=pose.pose)

    def measure():
        for publisher, message in zip(camera, (pose, goal)):
            message.header.stamp = messages.stamp_of(running.client.clock.wall())
            publisher.publish(message)
    running.every(0.01, measure)
    running.wait('the robot', lambda: 'no_robot' not in running.state.flags, 5.0)
    running.wait('the goal', lambda: 'moving_goal' in running.state.last_refusal, 5.0)
    for publisher in camera:
        running.client.participant.destroy(publisher)
