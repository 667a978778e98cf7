"""Faults in mid-motion of a Franka, over the robot's protocol, with the nodes as processes."""
from contextlib import contextmanager, ExitStack
import os
import signal
import time

from gdmp_msgs.msg import Reference, RobotState
import numpy as np
import pytest
from std_srvs.srv import Trigger

from experiments.reliability.trial import FRAME, short_skill
from gdmp_ros.control.target import resting_target
from gdmp_ros.ros import messages
from gdmp_ros.ros.arm_choice import ArmChoice, FRANKA
from gdmp_ros.ros.clients.joints_client import move_joints
from gdmp_ros.ros.lifecycle import reliable
from gdmp_ros.ros.testbed import SERVER
from gdmp_ros.util.dds_network import Domain
from test.franka.bed import FrankaBed, FRICTION
from test.franka.server import Cable, Server

HOLD, FOLLOW, FAULT = RobotState.HOLD, RobotState.FOLLOW, RobotState.FAULT
#: An arm that only holds moves less than this in a second [m]: MuJoCo's dry friction creeps.
STILL_M = 2e-3
pytestmark = pytest.mark.long


@contextmanager
def robot_and_arm(folder, cable=None):
    """Robot and arm."""
    friction = folder / 'friction.yaml'
    friction.write_text(FRICTION)
    choice = ArmChoice('franka', protocol_server=True, friction=friction)
    where = {} if cable is None else {'host': cable.host, 'prefix': cable.prefix}
    with ExitStack() as stack:
        server = stack.enter_context(Server(folder / 'logs', os.environ, **where))
        domain = stack.enter_context(Domain())
        bed = stack.enter_context(FrankaBed(folder, domain.environment(), choice, server))
        bed.start_arm(host=server.host)
        bed.wait_mode(HOLD)
        yield bed


@pytest.fixture
def bed(tmp_path):
    with robot_and_arm(tmp_path) as made:
        yield made


@pytest.fixture(scope='module')
def skill(tmp_path_factory):
    return short_skill(tmp_path_factory.mktemp('skill'))


def recover(bed):
    """Nothing begins by itself; the service ends the fault; the next motion succeeds."""
    bed.spend(1.0)
    assert bed.status.mode == FAULT
    reply = bed.call(Trigger, f'{FRANKA}/recover')
    assert reply.success, reply.message
    bed.wait_mode(HOLD)
    assert bed.still() < STILL_M and bed.status.mode == HOLD
    bed.again()


def lost(bed):
    """The motion that was under way is not called reached."""
    result = bed.client.result(60.0)
    assert result.error_code in (result.BLOCKED, result.GOAL_TOLERANCE_VIOLATED), (
        result.error_string)


def test_the_robot_ends_in_mid_motion(bed, skill):
    bed.begin(skill)
    bed.server.kill()
    bed.wait_mode(FAULT)
    assert 'does not answer' in bed.status.reason
    lost(bed)
    bed.server.start()
    bed.spend(1.0)
    assert bed.status.mode == FAULT  # it does not begin by itself
    assert bed.call(Trigger, f'{FRANKA}/recover').success
    bed.wait_mode(HOLD)
    move_joints(bed.client, FRANKA)  # the new robot begins in another posture
    bed.again()
    assert not bed.server.aborted()


def test_the_network_is_cut_in_mid_motion(tmp_path, skill):
    if os.geteuid() != 0:
        pytest.skip('a network that can be cut needs the rights of root')
    with Cable() as cable, robot_and_arm(tmp_path, cable) as bed:
        bed.begin(skill)
        cable.cut()
        bed.wait_mode(FAULT)
        assert 'does not answer' in bed.status.reason
        lost(bed)
        refused = bed.call(Trigger, f'{FRANKA}/recover')
        assert not refused.success and 'does not answer' in refused.message
        cable.join()
        bed.spend(2.0)
        recover(bed)
        # What the robot ends: the motion that it did not hear of any more.
        assert all('communication_constraints_violation' in one for one in bed.server.aborted())


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
    assert not bed.server.aborted()


def test_the_arm_node_is_killed_in_mid_motion(bed, skill):
    bed.begin(skill)
    bed.children.kill(FRANKA)
    lost(bed)
    bed.status = None
    bed.start_arm(host=bed.server.host)
    bed.wait_mode(HOLD)
    assert bed.still() < STILL_M and bed.status.mode == HOLD
    bed.wait('the server to see the arm', lambda: 'no_robot' not in bed.state.flags, 60.0)
    bed.again()
    assert all('communication_constraints_violation' in one for one in bed.server.aborted())


def test_references_that_jump_and_stiffness_that_steps(bed):
    """A step of the stiffness is followed at the rate that is allowed; a jump is refused."""
    move_joints(bed.client, FRANKA)
    out = bed.client.node.create_publisher(Reference, f'/{SERVER}/reference', reliable(10))
    bed.wait('the arm', lambda: bed.states and out.get_subscription_count() > 0)
    begun = messages.pose_numbers(bed.states[-1].pose)
    message = Reference()
    message.header.frame_id = FRAME

    def stream(pose, stiffness, seconds):
        bed.states.clear()
        matrix = np.diag([stiffness] * 3 + [0.05 * stiffness] * 3)
        messages.fill_reference(message, resting_target(pose, matrix))
        ends = time.monotonic() + seconds
        while time.monotonic() < ends:
            message.sequence += 1
            message.header.stamp = messages.stamp_of(time.time_ns())
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
    assert not bed.server.aborted()


def test_a_reflex_in_mid_motion(bed, skill):
    """
    The robot stops by itself, here because its computer paused for 0.2 s.

    The server knows no push: it acknowledges the thresholds of collisions and has no such reflex.
    """
    bed.begin(skill)
    process = bed.children.processes[FRANKA]
    process.send_signal(signal.SIGSTOP)
    time.sleep(0.2)
    process.send_signal(signal.SIGCONT)
    bed.wait_mode(FAULT)
    assert 'communication_constraints_violation' in bed.status.reason
    lost(bed)
    assert len(bed.server.aborted()) == 1
    recover(bed)
    assert len(bed.server.aborted()) == 1
