"""The node ``franka_arm`` against a server of the robot's protocol, as processes."""
import json

from gdmp_msgs.msg import RobotState
from gdmp_msgs.srv import MoveJoints
import numpy as np
import pytest
from std_srvs.srv import Trigger

from experiments import timing
from experiments.bench import franka as bench
from gdmp_ros import Demonstration, Skill
from gdmp_ros.data.tool import tool_manifold
from gdmp_ros.demo.run import run_demo
from gdmp_ros.demo.tasks import run_task
from gdmp_ros.improvement.one_by_one import OneByOne, RobotTask
from gdmp_ros.improvement.session import Effort, improve
from gdmp_ros.improvement.task import task_from_file
from gdmp_ros.improvement.variables import Variables, Weights
from gdmp_ros.ros.arm_choice import ArmChoice, FRANKA
from gdmp_ros.ros.clients.joints_client import move_joints
from gdmp_ros.ros.clients.trials_client import TrialsClient
from gdmp_ros.ros.testbed import SERVER
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.reach import Reach
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.parallel import Journal
from gdmp_ros.util.profiles import minimum_jerk
from test.franka.bed import FrankaBed, FRICTION

CHOICE = ArmChoice('franka', protocol_server=True)
HOLD, FAULT = RobotState.HOLD, RobotState.FAULT


@pytest.fixture
def bed(server, tmp_path):
    with Domain() as domain, FrankaBed(
            tmp_path, domain.environment(), CHOICE, server) as made:
        made.start_arm()
        made.wait_mode(HOLD)
        yield made


def test_the_arm_moves_home_and_survives_the_end_of_the_robot(bed):
    move_joints(bed.client, FRANKA)
    bed.spend(0.2)
    home = np.array(bed.states[-1].position)
    assert np.abs(home - Arm('fr3').home).max() < 0.05
    refused = bed.call(MoveJoints, f'{FRANKA}/move_joints', position=[9.0] * 7)
    assert not refused.success and 'posture of joint 1 is 9 rad' in refused.message
    bed.server.kill()
    bed.wait_mode(FAULT)
    assert 'does not answer' in bed.status.reason
    refused = bed.call(Trigger, f'{FRANKA}/recover')
    assert not refused.success and 'does not answer' in refused.message
    bed.server.start()
    bed.spend(0.5)
    assert bed.status.mode == FAULT  # nothing begins by itself
    assert bed.call(Trigger, f'{FRANKA}/recover').success
    bed.wait_mode(HOLD)


def test_an_arm_that_ends_leaves_a_robot_that_holds(bed):
    bed.spend(0.5)
    assert bed.children.stop(FRANKA) == 0
    log = bed.server.log()
    assert 'violat' not in log.lower().replace('violations', ''), log[-3000:]
    bed.start_arm()
    bed.status = None
    bed.wait_mode(HOLD)


@pytest.mark.long
def test_the_letter_with_a_goal_switch(tmp_path):
    """The dry friction is that of the server; `gdmp identify-friction` finds it within 2 %."""
    friction = tmp_path / 'friction.yaml'
    friction.write_text(FRICTION)
    choice = ArmChoice('franka', protocol_server=True, friction=friction)
    assert run_demo(tmp_path / 'demo', 'GShape', choice) == 0
    report = json.loads((tmp_path / 'demo' / 'report.json').read_text())
    assert report['arm'] == FRANKA
    assert all(report['limits'].values()), report['limits']
    # In 20 runs at most 2.4 mm and 2.9 mm.
    assert report['tracking']['position_rmse_m'] < 0.004
    assert report['goal_switch']['final_position_error_m'] < 0.0035
    assert report['robot']['commands_in_time'] > 0.9
    log = (tmp_path / 'demo' / 'logs' / 'protocol_server.log').read_text()
    assert 'reflex' not in log.lower()


@pytest.mark.long
def test_the_bench_measures_both_clients():
    document = bench.run(timing.Settings(seconds=1.0))
    assert 0.0 < document['bare']['cpu_50_us'] < document['loop']['cpu_50_us']
    assert document['loop']['wall_50_us'] <= document['loop']['wall_99_us']
    assert min(one['in_time'] for one in document.values()) > 0.5
    assert len(bench.rows(document)) == 3


@pytest.mark.long
@pytest.mark.parametrize('task', ['pick', 'joints'])
def test_a_task_that_was_shown_in_simulation(tmp_path, task):
    friction = tmp_path / 'friction.yaml'
    friction.write_text(FRICTION)
    choice = ArmChoice('franka', protocol_server=True, friction=friction)
    code = run_task(task, tmp_path / 'task', choice)
    report = json.loads((tmp_path / 'task' / 'report.json').read_text())
    assert code == 0 and report['arm'] == FRANKA, report
    if task == 'joints':
        assert report['joint_rmse_rad'] < 0.005 and report['final_position_error_m'] < 0.003


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
    robot = TrialsClient(SERVER, FRANKA, tmp_path, 30.0)
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
