"""A Franka does not move by itself either: the states of the arm, with the robot's stand-in."""
from gdmp_msgs.action import MoveJoints
from gdmp_msgs.srv import SetPayload
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from std_srvs.srv import SetBool, Trigger

from experiments.reliability.trial import short_skill
from gdmp_ros.ros.arm_choice import FRANKA
from test.franka.bed import FAULT, HOLD
from test.ros.nodes import act, ACTIVATE, DEACTIVATE, interrupt_joints

STILL_M = 5e-3


@pytest.fixture(scope='module')
def skill(tmp_path_factory):
    return short_skill(tmp_path_factory.mktemp('skill'), 10.0)


def call(bed, name, kind=Trigger, **fields):
    return bed.call(kind, f'{FRANKA}/{name}', **fields)


def change(bed, number):
    request = ChangeState.Request()
    request.transition.id = number
    assert call(bed, 'change_state', ChangeState, transition=request.transition).success


@pytest.mark.parametrize('seconds', [1.0, 4.0])
def test_activated_again_in_mid_motion_it_holds(bed, skill, seconds):
    bed.begin(skill)
    bed.states.clear()
    change(bed, DEACTIVATE)
    assert np.abs(bed.states[-1].velocity).max() < 0.03
    bed.spend(seconds)
    change(bed, ACTIVATE)
    assert bed.still(2.0) < STILL_M
    assert {one.mode for one in bed.states} == {HOLD}
    bed.again()
    assert not bed.robot.aborted


def test_what_a_disconnected_robot_carries_cannot_change(bed, skill):
    bed.begin(skill)
    bed.robot.kill()
    bed.wait_mode(FAULT)
    for name, kind, fields in (('set_payload', SetPayload, {'mass': 1.0}),
                               ('teach', SetBool, {'data': True}), ('comply', Trigger, {}),
                               ('arm', Trigger, {})):
        reply = call(bed, name, kind, **fields)
        assert not reply.success and 'call ~/recover first' in reply.message, reply.message
    result = act(bed, MoveJoints, f'{FRANKA}/move_joints')
    assert not result.success and 'call ~/recover first' in result.message
    bed.robot.start()
    bed.recover()
    assert call(bed, 'set_payload', SetPayload, mass=1.0).success


def test_the_load_is_told_in_the_frame_of_the_end_effector_and_zero_too(bed):
    bed.wait_mode(HOLD)
    assert bed.robot.load[0] == 0.0
    reply = call(bed, 'set_payload', SetPayload, mass=1.0, center=[0.01, 0.0, 0.05],
                 inertia=[0.001, 0.002, 0.003, 0.0, 0.0, 0.0])
    assert reply.success, reply.message
    mass, center, inertia = bed.robot.load
    driver = bed.children.node(FRANKA).control.driver
    place = driver.robot.end_effector
    w, x, y, z = place.rotation
    first = np.array([w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)])
    third = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z])
    np.testing.assert_allclose(center, place.position + 0.01 * first + 0.05 * third, atol=1e-9)
    assert mass == 1.0 and np.trace(np.reshape(inertia, (3, 3))) == pytest.approx(0.006)
    bed.spend(0.5)
    assert bed.status.mode == HOLD and not bed.robot.aborted


def test_a_payload_in_motion_is_refused(bed, skill):
    bed.begin(skill)
    reply = call(bed, 'set_payload', SetPayload, mass=1.0)
    assert not reply.success and 'while it rests' in reply.message


@pytest.mark.parametrize('name', ['comply', 'stop'])
def test_joints_that_move_give_way_or_stop(bed, name):
    bed.wait_mode(HOLD)
    before = interrupt_joints(bed, FRANKA, bed.states, name)
    bed.spend(1.0)
    assert abs(bed.states[-1].position[0] - before) < 0.1
    assert not bed.robot.aborted
