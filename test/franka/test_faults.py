"""Faults in mid-motion of a Franka, in lockstep."""
from gdmp_msgs.msg import Reference
import numpy as np
import pytest
from std_srvs.srv import Trigger

from experiments.reliability.trial import FRAME, short_skill
from gdmp_ros.control.target import resting_target
from gdmp_ros.ros import messages
from gdmp_ros.ros.arm_choice import FRANKA
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.testbed import SERVER
from test.franka.bed import FAULT, FOLLOW, HOLD

#: An arm that only holds moves less than this in a second [m]: MuJoCo's dry friction creeps.
STILL_M = 2e-3
SILENT = 'communication_constraints_violation'


@pytest.fixture(scope='module')
def skill(tmp_path_factory):
    return short_skill(tmp_path_factory.mktemp('skill'), 2.0)


def recover(bed):
    """Nothing begins by itself; the service ends the fault; the next motion succeeds."""
    bed.spend(1.0)
    assert bed.status.mode == FAULT
    bed.recover()
    assert bed.still() < STILL_M and bed.status.mode == HOLD
    bed.again()


def lost(bed):
    """The motion that was under way is not called reached."""
    result = bed.client.result(60.0)
    assert result.error_code in (result.BLOCKED, result.GOAL_TOLERANCE_VIOLATED), (
        result.error_string)


def test_the_robot_ends_in_mid_motion(bed, skill):
    bed.begin(skill)
    bed.robot.kill()
    bed.wait_mode(FAULT)
    assert 'does not answer' in bed.status.reason
    lost(bed)
    bed.robot.start()
    bed.spend(1.0)
    assert bed.status.mode == FAULT  # it does not begin by itself
    bed.recover()
    move_joints(bed.client, FRANKA)  # the new robot begins in another posture
    bed.again()
    assert not bed.robot.aborted


def test_the_network_is_cut_in_mid_motion(bed, skill):
    bed.begin(skill)
    bed.robot.cut()
    bed.wait_mode(FAULT)
    assert 'does not answer' in bed.status.reason
    lost(bed)
    refused = bed.call(Trigger, f'{FRANKA}/recover')
    assert not refused.success and 'does not answer' in refused.message
    bed.robot.join()
    bed.spend(2.0)
    recover(bed)
    # What the robot ends: the motion that it did not hear of any more.
    assert bed.robot.aborted == [SILENT]


def test_the_references_end_in_mid_motion(bed, skill):
    bed.begin(skill)
    bed.children.kill(SERVER)
    bed.wait_mode(HOLD)
    bed.spend(2.0)  # in which it slows down, and settles
    assert bed.still() < STILL_M
    bed.start_server(skill=str(skill))
    bed.wait_holding()
    assert bed.still() < STILL_M
    bed.again()
    assert not bed.robot.aborted


def test_the_arm_node_is_killed_in_mid_motion(bed, skill):
    bed.begin(skill)
    bed.children.kill(FRANKA)
    lost(bed)
    bed.status = None
    bed.start_arm()
    bed.wait_mode(HOLD)
    assert bed.still() < STILL_M and bed.status.mode == HOLD
    bed.wait('the server to see the arm', lambda: 'no_robot' not in bed.state.flags, 60.0)
    bed.again()
    assert bed.robot.aborted in ([], [SILENT])


def test_references_that_jump_and_stiffness_that_steps(bed):
    """A step of the stiffness is followed at the rate that is allowed; a jump is refused."""
    move_joints(bed.client, FRANKA)
    out = bed.client.publisher(Reference, f'{SERVER}/reference')
    bed.wait('the arm', lambda: bed.states and out.subscribers() > 0)
    begun = messages.pose_numbers(bed.states[-1].pose)
    message = Reference()
    message.header.frame_id = FRAME

    def stream(pose, stiffness, seconds):
        bed.states.clear()
        matrix = np.diag([stiffness] * 3 + [0.05 * stiffness] * 3)
        messages.fill_reference(message, resting_target(pose, matrix))
        for _ in range(round(seconds / 0.002)):
            message.sequence += 1
            message.header.stamp = messages.stamp_of(bed.client.clock.wall())
            out.publish(message)
            bed.spend(0.002)
        return np.array([messages.pose_numbers(one.pose)[:3] for one in bed.states])
    stream(begun, 300.0, 1.0)
    assert bed.states[-1].mode == FOLLOW
    for stiffness in (1500.0, 150.0, 1500.0):
        moved = stream(begun, stiffness, 1.0)
        assert bed.states[-1].stiffness[0] == pytest.approx(stiffness, rel=0.01)
        assert np.abs(moved - begun[:3]).max() < 5e-3
    # Another reference of the same stream, half a metre away.
    away = begun + [0.1, 0.49, 0.0, 0.0, 0.0, 0.0, 0.0]
    moved = stream(away, 1500.0, 2.0)
    assert np.linalg.norm(moved - moved[0], axis=1).max() < 5e-3
    assert bed.states[-1].mode == HOLD
    assert not bed.robot.aborted


def test_the_computer_pauses_in_mid_motion(bed, skill):
    bed.begin(skill)
    for one in bed.children.node(FRANKA).participant.clock.loops:
        one.pause(0.2)
    bed.wait_mode(FAULT)
    assert SILENT in bed.status.reason
    lost(bed)
    assert bed.robot.aborted == [SILENT]
    recover(bed)
    assert bed.robot.aborted == [SILENT]


def test_a_reflex_in_mid_motion(bed, skill):
    bed.begin(skill)
    bed.robot.abort('cartesian_reflex')
    bed.wait_mode(FAULT)
    assert 'cartesian_reflex' in bed.status.reason
    lost(bed)
    recover(bed)
    assert bed.robot.aborted == ['cartesian_reflex']
