"""A gripper through its topics and action; a skill that picks and places; over DDS."""
from gdmp_msgs.action import MoveGripper
from gdmp_msgs.msg import GripperCommand, GripperState
from gdmp_msgs.srv import LoadSkill
import numpy as np
import pytest
from sensor_msgs.msg import JointState

from gdmp_ros.control import gripper
from gdmp_ros.control.gripper import DEFAULT_SPEED
from gdmp_ros.demo.objects import home_pose
from gdmp_ros.demo.tasks import picking_motion
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.ros.clients.testbed import SERVER
from gdmp_ros.ros.gripper import PARALLEL, parallel_command
from test.ros.nodes import open_testbed


@pytest.fixture(scope='session')
def picking(tmp_path_factory):
    shown, closes = picking_motion(home_pose())
    events = [GripperEvent(0.0, 0.08, 0.0, 0.1),
              GripperEvent(closes / shown.duration, 0.0, 20.0, 0.1),
              GripperEvent(1.0, 0.08, 0.0, 0.1)]
    path = tmp_path_factory.mktemp('picking') / 'skill.json'
    Skill.learn(shown, 120).with_events(events).save(path)
    return path


@pytest.fixture(scope='module')
def shared_nodes(tmp_path_factory, picking):
    with open_testbed(tmp_path_factory.mktemp('nodes'), picking) as made:
        made.start(arm={'scene': 'pick_and_place'})
        yield made


def watch(running):
    """States of the gripper, as they come."""
    states = []
    running.subscribe(GripperState, 'gripper/state', states.append)
    running.wait('the gripper', lambda: bool(states))
    return states


def move(running, **goal):
    client = running.participant.action_client(MoveGripper, 'gripper/move')
    running.wait('the action', client.server_is_ready)
    sent = client.send_goal_async(MoveGripper.Goal(**goal))
    running.wait('the goal', sent.done)
    done = sent.result().get_result_async()
    running.wait('the result', done.done, 30.0)
    running.participant.destroy(client)
    return done.result().result


def test_topic_and_action_move_the_fingers(running):
    states = watch(running)
    publisher = running.publisher(GripperCommand, 'gripper/command')
    publisher.publish(GripperCommand(width=0.03))
    running.wait('the width', lambda: abs(states[-1].width - 0.03) < 1e-3
                 and not states[-1].moving)
    result = move(running, width=0.06)
    assert result.success and result.width == pytest.approx(0.06, abs=1e-3)
    result = move(running, width=0.0, force=20.0)
    assert not result.success and 'nothing between the fingers' in result.message
    result = move(running, width=0.5)
    assert not result.success and 'width is 0.5 m, expected 0 to 0.08 m' in result.message


def test_a_skill_picks_the_cube_and_places_it(running):
    states = watch(running)
    running.client.execute()
    result = running.client.result(60.0)
    assert result.error_code == 0, result.error_string
    assert any(state.holding for state in states)
    assert states[-1].commands == 3 and states[-1].width == pytest.approx(0.08, abs=2e-3)
    # While something was held, it was as wide as the cube.
    held = [state.width for state in states if state.holding]
    assert np.median(held) == pytest.approx(0.04, abs=2e-3)


def test_a_pick_that_fails_ends_the_motion_with_the_reason(running, picking, tmp_path):
    skill = Skill.load(picking)
    early = tmp_path / 'early.json'
    skill.with_events([GripperEvent(0.1, 0.0, 20.0, 0.1)]).save(early)
    assert running.call(LoadSkill, f'{SERVER}/load_skill', path=str(early)).success
    running.client.execute()
    result = running.client.result(30.0)
    assert result.error_code == result.GRIPPER_FAILED
    assert 'there is nothing between the fingers' in result.error_string
    running.wait_rest()
    assert running.tool()[2] > 0.25  # far above the box


def test_the_action_of_parallel_grippers(running):
    """Where control_msgs is installed."""
    kind = pytest.importorskip('control_msgs.action').ParallelGripperCommand
    states = watch(running)

    def act(**command):
        action = running.client.action(kind, PARALLEL)
        sent = running.client.send(action, kind.Goal(command=JointState(**command)), 10.0)
        return sent.result(30.0), sent.succeeded()
    names = ['panda_finger_joint1', 'panda_finger_joint2']
    result, succeeded = act(name=names[:1], position=[0.04], effort=[10.0])
    assert succeeded and result.reached_goal and not result.stalled
    assert states[-1].width == pytest.approx(0.08, abs=2e-3)
    result, succeeded = act(name=names, position=[0.01, 0.01], velocity=[0.05, 0.05])
    assert succeeded and result.reached_goal
    assert list(result.state.position) == pytest.approx([0.01, 0.01], abs=1e-3)
    for wrong in ({}, {'name': names, 'position': [0.01]}, {'name': names, 'position': [0.5] * 2}):
        assert not act(**wrong)[1]


def test_commands_of_parallel_grippers():
    names = ['one', 'other']
    assert parallel_command(JointState(name=names, position=[0.01, 0.02]), 0.08) == (
        gripper.GripperCommand(0.03, 0.0, DEFAULT_SPEED))
    closes = JointState(name=names[:1], position=[0.01], velocity=[0.1], effort=[20.0])
    assert parallel_command(closes, 0.08) == (0.02, 20.0, 0.2)
    assert parallel_command(closes, 0.01) == (0.02, 0.0, 0.2)
    for fields in ({}, {'position': [0.1]}, {'effort': [1.0] * 3}):
        with pytest.raises(ParameterError, match='expected'):
            parallel_command(JointState(**{'name': names, 'position': [0.0, 0.0], **fields})
                             if fields else JointState(), 0.08)
