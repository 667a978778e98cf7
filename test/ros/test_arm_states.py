"""Nothing moves by itself: requests of an arm in every order, losses and lifecycle transitions."""
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.action import IdentifyFriction, MoveJoints
from gdmp_msgs.msg import ArmStatus, RobotState
from gdmp_msgs.srv import SetPayload
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.ros.clients.testbed import ARM, SERVER
from test.ros.nodes import act, ACTIVATE, begin_action, DEACTIVATE, interrupt_joints

#: More than an arm that holds moves [m].
STILL_M = 0.005
#: Largest change of a torque in a tick [Nm].
SLEW = 0.95 + 1e-6


@pytest.fixture
def status(running):
    """Messages of ``~/status``."""
    received = []
    running.subscribe(ArmStatus, f'{ARM}/status', received.append)
    running.wait('a status', lambda: bool(received))
    return received


def call(nodes, name, kind=Trigger, **fields):
    return nodes.call(kind, f'{ARM}/{name}', **fields)


def in_motion(nodes, duration=20.0):
    """Execute slowly, and wait until the tool moves."""
    from gdmp_msgs.action import ExecuteSkill
    nodes.client.execute(ExecuteSkill.Goal(duration=duration))
    nodes.wait_progress(0.2)


def moved(nodes, since):
    """Largest distance of the tool from a place, in all states [m]."""
    return max(np.linalg.norm([m.pose.position.x - since[0], m.pose.position.y - since[1],
                               m.pose.position.z - since[2]]) for m in nodes.robot)


def assert_smooth(nodes):
    assert np.abs(np.diff(nodes.torques(), axis=0)).max() <= SLEW


@pytest.mark.parametrize('seconds', [1.0, 4.0, 12.0])
def test_activated_again_in_mid_motion_it_holds_until_it_is_armed(running, seconds, status):
    in_motion(running)
    running.robot.clear()
    assert running.transition(ARM, DEACTIVATE)
    assert_smooth(running)
    # It has come to rest before.
    assert np.abs(running.robot[-1].velocity).max() < 0.02
    running.spend(0.3)
    assert status[-1].state == 'inactive' and status[-1].mode == RobotState.UNKNOWN
    running.spend(seconds)
    place = running.tool()
    running.robot.clear()
    assert running.transition(ARM, ACTIVATE)
    running.spend(3.0)
    assert moved(running, place) < STILL_M
    assert {m.mode for m in running.robot} == {RobotState.HOLD}
    assert 'before the arm was ready' in status[-1].last_refusal or not status[-1].last_refusal
    assert_smooth(running)


def test_an_armed_stream_is_followed_after_an_activation(running):
    in_motion(running, 30.0)
    assert running.transition(ARM, DEACTIVATE, ACTIVATE)
    assert call(running, 'arm').success
    running.wait('the arm to follow',
                 lambda: running.robot and running.robot[-1].mode == RobotState.FOLLOW)


def test_a_fault_is_not_left_by_guiding(running, status):
    arm = running.children.node(ARM)
    arm.control.controller.guard.fault('a test')
    reply = call(running, 'teach', SetBool, data=True)
    assert not reply.success and 'a fault (a test): call ~/recover' in reply.message
    running.spend(0.3)
    assert status[-1].state == 'fault' and status[-1].waits_for == '~/recover'
    assert status[-1].last_refusal.startswith('~/teach true: the arm is in a fault')
    assert call(running, 'recover').success
    running.spend(0.3)
    assert running.robot[-1].mode == RobotState.HOLD and status[-1].state == 'holding'


def test_guiding_ends_with_the_activity(running):
    assert call(running, 'teach', SetBool, data=True).success
    assert running.transition(ARM, DEACTIVATE, ACTIVATE)
    running.spend(0.3)
    assert running.robot[-1].mode == RobotState.HOLD


@pytest.mark.parametrize('name, mode', [('comply', RobotState.COMPLIANT),
                                        ('stop', RobotState.HOLD)])
def test_joints_that_move_give_way_or_stop(running, name, mode):
    before = interrupt_joints(running, ARM, running.robot, name)
    running.wait_rest()
    assert running.robot[-1].mode == mode
    assert abs(running.robot[-1].position[0] - before) < 0.1
    assert_smooth(running)


def test_a_hand_guides_an_arm_that_has_come_to_rest_and_is_damped(running):
    in_motion(running)
    running.robot.clear()
    assert call(running, 'teach', SetBool, data=True).success
    running.wait('the hand', lambda: running.robot[-1].mode == RobotState.GUIDED)
    modes = [m.mode for m in running.robot]
    first = modes.index(RobotState.GUIDED)
    assert set(modes[:first]) in ({RobotState.FOLLOW, RobotState.STOP}, {RobotState.STOP})
    assert np.abs(running.robot[first].velocity).max() < 0.02
    # A push, and nothing afterwards: without damping it would drift on.
    arm = running.children.node(ARM).backend.model
    arm.data.qvel[:7] = 0.3
    running.spend(3.0)
    assert np.abs(running.robot[-1].velocity).max() < 0.02


def test_requests_to_an_inactive_arm_are_refused_and_forgotten(running):
    assert running.transition(ARM, DEACTIVATE)
    goal = np.array(running.robot[-1].position) + [0.3, 0, 0, 0, 0, 0, 0]
    for reply in (act(running, MoveJoints, f'{ARM}/move_joints', position=goal.tolist()),
                  call(running, 'arm'), call(running, 'teach', SetBool, data=True),
                  call(running, 'comply'), call(running, 'refill_tank'),
                  call(running, 'set_payload', SetPayload, mass=1.0),
                  act(running, IdentifyFriction, f'{ARM}/identify_friction')):
        assert not reply.success and reply.message == 'the node is not active'
    place = running.tool()
    assert running.transition(ARM, ACTIVATE)
    running.robot.clear()
    running.spend(2.0)
    assert moved(running, place) < STILL_M
    assert {m.mode for m in running.robot} == {RobotState.HOLD}


def test_a_motion_of_the_joints_that_waits_is_ended_by_a_deactivation(running):
    in_motion(running)
    assert call(running, 'stop').success
    goal = np.array(running.robot[-1].position) + [0.3, 0, 0, 0, 0, 0, 0]
    motion = begin_action(running, MoveJoints, f'{ARM}/move_joints', position=goal.tolist())
    running.spend(0.05)  # the arm still comes to rest
    assert running.transition(ARM, DEACTIVATE)
    assert not motion.result(10.0).success
    before = running.robot[-1].position[0]
    assert running.transition(ARM, ACTIVATE)
    running.spend(1.0)
    assert abs(running.robot[-1].position[0] - before) < 0.01


def test_after_a_stop_the_joints_move_as_soon_as_the_arm_rests(running):
    in_motion(running)
    assert call(running, 'stop').success
    home = running.children.node(ARM).backend.model.home
    running.robot.clear()
    result = act(running, MoveJoints, f'{ARM}/move_joints', position=home.tolist(), speed=1.0)
    assert result.success, result.message
    modes = [m.mode for m in running.robot]
    assert RobotState.STOP in modes[:modes.index(RobotState.MOVE)]
    np.testing.assert_allclose(running.robot[-1].position, home, atol=0.01)
    assert_smooth(running)


def test_a_loop_that_fails_makes_the_node_inactive_and_says_why(nodes):
    status, diagnostics = [], []
    nodes.start()
    nodes.subscribe(ArmStatus, f'{ARM}/status', status.append)
    nodes.subscribe(DiagnosticArray, '/diagnostics', diagnostics.append)
    arm = nodes.children.node(ARM).backend
    kept = arm.driver.measure

    def broken():
        raise ValueError('a test broke it')
    # The bed itself takes a loop that has failed for an error.
    nodes.children.check = lambda *_: None
    arm.driver.measure = broken
    nodes.wait('the end', lambda: status and status[-1].state == 'inactive')
    nodes.spend(0.5)
    assert 'a test broke it' in status[-1].reason
    assert nodes.lifecycle_state(ARM) == 'inactive'
    levels = [one.level for message in diagnostics for one in message.status
              if one.name.startswith(ARM)]
    assert levels[-1] == DiagnosticStatus.ERROR
    assert not call(nodes, 'arm').success
    arm.driver.measure = kept
    assert nodes.transition(ARM, ACTIVATE)
    nodes.spend(0.5)
    assert status[-1].state in ('holding', 'resting') and status[-1].reason == ''


def test_settings_that_act_on_the_torque_are_no_step(running):
    in_motion(running)
    running.robot.clear()
    for name, value in (('torque_share', 0.1), ('torque_share', 1.0), ('posture_stiffness', 0.0),
                        ('posture_stiffness', 100.0)):
        assert running.set_parameters(ARM, **{name: value}).successful
        running.spend(0.3)
    assert_smooth(running)


def test_the_tank_is_not_filled_in_motion_and_a_fault_empties_it(running, status):
    in_motion(running)
    assert not call(running, 'refill_tank').success
    running.children.node(ARM).control.controller.guard.fault('a test')
    running.spend(0.15)
    assert status[-1].tank_energy < 0.5
    assert call(running, 'recover').success and call(running, 'refill_tank').success
    running.spend(0.15)
    assert status[-1].tank_energy == pytest.approx(5.0, abs=0.5)


def test_a_posture_is_taken_by_names(running, status):
    out = running.publisher(JointState, f'{ARM}/posture')
    controller = running.children.node(ARM).control.controller
    wanted = controller.posture.position.copy()
    wanted[0] += 0.2
    names = [f'panda_joint{i}' for i in range(1, 8)]
    out.publish(JointState(name=names[::-1], position=wanted[::-1].tolist()))
    running.spend(2.0)
    np.testing.assert_allclose(controller.posture.position, wanted, atol=1e-9)
    out.publish(JointState(name=['elbow'] * 7, position=wanted.tolist()))
    running.spend(0.3)
    assert '~/posture' in status[-1].last_refusal
    stamp = status[-1].last_refusal_stamp
    running.spend(0.5)
    assert status[-1].last_refusal_stamp == stamp and stamp.sec > 0


def test_the_posture_of_the_parameters_is_kept_after_guiding_and_joint_motions(running):
    posture = running.children.node(ARM).backend.model.home + 0.1
    assert running.set_parameters(ARM, posture=posture.tolist()).successful
    controller = running.children.node(ARM).control.controller
    assert call(running, 'teach', SetBool, data=True).success
    running.spend(0.3)
    assert call(running, 'teach', SetBool, data=False).success
    running.spend(2.0)
    np.testing.assert_allclose(controller.posture.position, posture, atol=1e-6)
    assert act(running, MoveJoints, f'{ARM}/move_joints').success
    running.spend(2.0)
    np.testing.assert_allclose(controller.posture.position, posture, atol=1e-6)
    goal = (posture + [0.5, 0, 0, 0, 0, 0, 0]).tolist()
    motion = begin_action(running, MoveJoints, f'{ARM}/move_joints', position=goal, speed=0.1)
    running.wait('a motion', lambda: running.robot[-1].mode == RobotState.MOVE)
    assert call(running, 'stop').success
    motion.result(10.0)
    running.spend(4.0)
    np.testing.assert_allclose(controller.posture.position, posture, atol=1e-6)


def test_friction_that_no_motor_could_overcome_is_refused(running):
    result = running.set_parameters(ARM, friction_dry=[100.0])
    assert not result.successful and 'joint 5, expected at most 12' in result.reason
    assert running.set_parameters(ARM, friction_dry=[1.0]).successful


def test_a_second_arm_of_this_name_is_named(running):
    diagnostics = []
    running.subscribe(DiagnosticArray, '/diagnostics', diagnostics.append)
    running.children.start_node('another', 'gdmp_ros.ros.arm.simulated_arm', {}, [
        '-r', '__node:=panda_sim'])
    running.spend(3.0)
    said = ' '.join(one.message for message in diagnostics for one in message.status)
    assert '2 nodes have this name' in said
    running.children.stop('another')


def test_the_server_stops_and_says_so_when_the_arm_is_deactivated(running):
    in_motion(running)
    assert running.transition(ARM, DEACTIVATE)
    result = running.client.result(30.0)
    assert result.error_code == result.BLOCKED, result.error_string
    assert running.lifecycle_state(SERVER) == 'active'
