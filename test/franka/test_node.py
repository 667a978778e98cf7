"""The nodes of a Franka, and what a stand-in of the robot does to them, in lockstep."""
from functools import partial
import json

from gdmp_msgs.action import MoveGripper, MoveJoints
from gdmp_msgs.msg import GripperState
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from std_srvs.srv import Trigger

from gdmp_ros import Demonstration, Skill
from gdmp_ros.demo.tasks import run_task
from gdmp_ros.improvement.one_by_one import OneByOne, RobotTask
from gdmp_ros.improvement.session import Effort, improve
from gdmp_ros.improvement.task import task_from_file
from gdmp_ros.improvement.variables import Variables, Weights
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.ros.arm_choice import FRANKA
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.testbed import SERVER
from gdmp_ros.ros.clients.trials_client import TrialsClient
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.path_check import Reach
from gdmp_ros.util.parallel import Journal
from gdmp_ros.util.profiles import minimum_jerk
from test.franka.bed import choice, FAULT, HOLD, makers
from test.lockstep.bed import lockstep_bed
from test.ros.nodes import act


def test_the_arm_moves_home_and_survives_the_end_of_the_robot(bed):
    move_joints(bed.client, FRANKA)
    bed.spend(0.2)
    home = np.array(bed.states[-1].position)
    assert np.abs(home - Arm('fr3').home).max() < 0.05
    refused = act(bed, MoveJoints, f'{FRANKA}/move_joints', position=[9.0] * 7)
    assert not refused.success and 'posture of joint 1 is 9 rad' in refused.message
    bed.robot.kill()
    bed.wait_mode(FAULT)
    assert 'does not answer' in bed.status.reason
    refused = bed.call(Trigger, f'{FRANKA}/recover')
    assert not refused.success and 'does not answer' in refused.message
    bed.robot.start()
    bed.spend(0.5)
    assert bed.status.mode == FAULT  # nothing begins by itself
    bed.recover()


def test_a_node_that_is_activated_without_its_robot_waits_for_recovery(bed):
    for step in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        if step == Transition.TRANSITION_ACTIVATE:
            bed.robot.kill()
            bed.spend(2.0)
        reply = bed.call(ChangeState, f'{FRANKA}/change_state', transition=Transition(id=step))
        assert reply.success
    bed.wait_mode(FAULT)
    assert 'does not answer' in bed.status.reason
    bed.robot.start()
    bed.recover()


def test_an_arm_that_ends_leaves_a_robot_that_holds(bed):
    bed.spend(0.5)
    assert bed.children.stop(FRANKA) == 0
    assert bed.robot.control is None and not bed.robot.aborted
    bed.start_arm()
    bed.status = None
    bed.wait_mode(HOLD)
    assert not bed.robot.aborted


@pytest.mark.long
def test_a_skill_is_tried_one_by_one(bed, tmp_path):
    arm, s = Arm('fr3'), np.linspace(0.0, 1.0, 100)
    points = np.tile(arm.pose_at(arm.home), (len(s), 1))
    points[:, 2] -= 0.05 * minimum_jerk(s)
    skill = Skill.learn(Demonstration(2.0 * s, points, tool_manifold(None)), 20)
    skill.save(tmp_path / 'skill.json')
    (tmp_path / 'low.py').write_text('def score(trial):\n    return trial.measured[:, 2].min()\n')
    move_joints(bed.client, FRANKA)
    bed.start_server(skill=str(tmp_path / 'skill.json'))
    bed.wait_holding()
    robot = TrialsClient(SERVER, FRANKA, 30.0)
    try:
        robot.begin_at(lambda present: Reach(arm).posture(skill.start, present), 60.0)
        variables = Variables(skill, [Weights(2, {'position': 0.005})])
        # Go, go, go on; a roll-out that does not count is not asked for again.
        answers = ['', '', '']
        execute = OneByOne(robot, Journal(None, ''), lambda _: answers.pop())
        task = RobotTask(task_from_file(tmp_path / 'low.py'), robot)
        *_, state = improve(task, variables, execute, Effort(1, 2, 1))
    finally:
        robot.close()
    lowest = points[-1, 2]
    assert all(abs(cost - lowest) < 0.02 for cost in state.updates[0].costs), state
    bed.wait('the arm to be back', lambda: (
        bed.states[-1].mode == HOLD
        and np.abs(np.array(bed.states[-1].position) - arm.home).max() < 0.05), 10.0)


@pytest.mark.long
@pytest.mark.parametrize('task', ['pick', 'joints'])
def test_a_task_that_was_shown_in_simulation(tmp_path, task):
    robots = []

    def made(network):
        found = makers(robots, network)
        robots[-1].object_width = 0.04
        return found
    code = run_task(task, tmp_path, choice(tmp_path), partial(lockstep_bed, makers=made))
    report = json.loads((tmp_path / 'report.json').read_text())
    assert code == 0 and report['arm'] == FRANKA, report
    assert not robots[-1].aborted
    if task == 'joints':
        assert report['joint_rmse_rad'] < 0.005 and report['final_position_error_m'] < 0.003


def test_the_hand_moves_grasps_and_is_found_again(bed):
    states = []
    bed.client.subscribe(GripperState, 'gripper/state', states.append)
    bed.children.start_node('hand', 'gdmp_ros.ros.arm.franka_gripper',
                            {'host': 'robot', 'homing': True})
    bed.wait('the hand', lambda: bool(states))
    assert states[-1].width == 0.08  # it has looked for the ends of its travel

    def move(**goal):
        client = bed.client.participant.action_client(MoveGripper, 'gripper/move')
        sent = client.send_goal_async(MoveGripper.Goal(**goal))
        bed.wait('the goal', sent.done)
        done = sent.result().get_result_async()
        bed.wait('the result', done.done, 30.0)
        bed.client.participant.destroy(client)
        return done.result().result
    result = move(width=0.06)
    assert result.success and result.width == pytest.approx(0.06)
    result = move(width=0.0, force=20.0)
    assert not result.success and 'there is nothing between the fingers' in result.message
    bed.robot.object_width = 0.04
    assert move(width=0.08).success
    result = move(width=0.0, force=20.0)
    assert result.success and result.holding and result.width == pytest.approx(0.04)
    result = move(width=0.01)
    assert not result.success and 'do not reach 0.0100 m' in result.message
    result = move(width=0.5)
    assert not result.success and '0.5' in result.message
    bed.robot.kill()
    bed.wait('the problem', lambda: 'does not answer' in states[-1].problem)
    assert 'does not answer' in move(width=0.08).message
    bed.robot.start()
    bed.wait('the hand', lambda: not states[-1].problem)
    assert move(width=0.08).success
