"""The simulated arm: what it publishes, its services, and what it refuses."""
import re

from diagnostic_msgs.msg import DiagnosticArray
from gdmp_msgs.action import IdentifyFriction, MoveJoints
from gdmp_msgs.msg import Reference, RobotState
from gdmp_msgs.srv import StepSimulation
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
import yaml

from gdmp_ros.ros import messages
from gdmp_ros.ros.arm.state_publisher import StatePublisher
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.sim.arm import Arm
from test.commands import gdmp
from test.ros.nodes import act, begin_action, DEACTIVATE, FRAME

STEP = f'{ARM}/step_simulation'


def stamp_of(message):
    return message.header.stamp.sec, message.header.stamp.nanosec


def pause(nodes):
    """Pause, and wait until the last state has arrived."""
    assert nodes.call(SetBool, f'{ARM}/set_pause', data=True).success
    nodes.wait_quiet(nodes.robot)


def test_the_simulation_pauses_steps_and_resets(running):
    refused = running.call(StepSimulation, STEP, steps=10)
    assert not refused.success and 'not paused' in refused.message
    pause(running)
    count = len(running.robot)
    first = running.call(StepSimulation, STEP, steps=1)
    second = running.call(StepSimulation, STEP, steps=250)
    assert first.success and second.success
    assert second.time - first.time == pytest.approx(0.25, abs=1e-9)
    running.wait('251 states', lambda: len(running.robot) >= count + 251)
    running.wait_quiet(running.robot)
    assert len(running.robot) == count + 251
    too_many = running.call(StepSimulation, STEP, steps=10**6)
    assert not too_many.success and 'expected 1 to 100000' in too_many.message
    assert running.call(SetBool, f'{ARM}/set_pause', data=False).success
    assert running.transition(SERVER, DEACTIVATE)  # the arm would follow it
    assert running.call(Trigger, f'{ARM}/reset_world').success
    reset = len(running.robot)
    running.wait('the arm again', lambda: len(running.robot) > reset + 400)
    np.testing.assert_allclose(running.tool()[:3], Arm().measure().pose[:3], atol=1e-3)


def test_who_looks_while_time_stands_still_sees_the_last_tick(running):
    pause(running)
    assert running.call(StepSimulation, STEP, steps=3).success
    running.wait_quiet(running.robot)
    joints, poses = (running.collect(kind, topic) for kind, topic in (
        (JointState, '/joint_states'), (PoseStamped, f'{ARM}/measured_pose')))
    running.wait('both', lambda: len(joints) > 3 and len(poses) > 3)
    last = running.robot[-1]
    assert {stamp_of(one) for one in [*joints, *poses]} == {stamp_of(last)}
    assert list(joints[-1].position) == list(last.position) and poses[-1].pose == last.pose
    assert running.call(StepSimulation, STEP, steps=1).success
    running.wait_quiet(running.robot)
    latest = stamp_of(running.robot[-1])
    assert latest > stamp_of(last)
    running.wait('the next', lambda: stamp_of(joints[-1]) == stamp_of(poses[-1]) == latest)


def test_the_arm_answers_and_publishes_while_it_makes_many_steps(running):
    diagnostics = []
    running.subscribe(DiagnosticArray, '/diagnostics', lambda message: diagnostics.extend(
        status for status in message.status if status.name.startswith(ARM)))
    pause(running)
    assert running.call(StepSimulation, STEP, steps=1).success
    count = len(running.robot)
    reply = running.client.service(StepSimulation, STEP).call_async(
        StepSimulation.Request(steps=100_000))
    running.wait('some steps', lambda: len(running.robot) > count + 10)
    # If the steps blocked the executor, these would be answered after 100 s of simulated time.
    second = running.call(StepSimulation, STEP, steps=1)
    assert not second.success and 'steps are left of another request' in second.message
    values = running.call(GetParameters, f'{ARM}/get_parameters', names=['pace']).values
    assert values[0].string_value == 'wall'
    diagnostics.clear()
    running.wait('diagnostics', lambda: len(diagnostics) > 2)
    assert not reply.done()
    # A pause ends the request, and the reply says how much of it was not made.
    assert running.call(SetBool, f'{ARM}/set_pause', data=True).success
    running.wait('the reply', reply.done)
    assert not reply.result().success
    assert re.search(r'^\d+ of 100000 steps were not made', reply.result().message)
    running.wait_quiet(running.robot)
    assert running.call(StepSimulation, STEP, steps=5).success


def test_the_simulation_runs_as_fast_as_it_can_with_a_clock(nodes):
    clocks = nodes.collect(Clock, '/clock')
    nodes.start_arm(pace='fast')
    nodes.wait('the clock', lambda: len(clocks) > 200, 60.0)
    stamps = np.array([m.clock.sec + m.clock.nanosec * 1e-9 for m in clocks])
    assert (np.diff(stamps) > 0.0).all()
    assert np.median(np.diff(stamps)) == pytest.approx(1e-3, abs=1e-6)


def test_invalid_references_are_refused_and_counted_and_the_arm_holds(running):
    assert running.transition(SERVER, DEACTIVATE)
    diagnostics = []
    running.subscribe(DiagnosticArray, '/diagnostics', diagnostics.append)
    publisher = running.publisher(Reference, f'{SERVER}/reference')
    running.wait_rest()
    start = running.tool()
    target = np.zeros(56)
    target[:7] = start
    target[0] += 0.1
    target[19:55] = np.diag([400.0] * 3 + [30.0] * 3).reshape(-1)
    target[55] = 0.7

    def counted():
        found = [{v.key: v.value for v in m.status[0].values} for m in diagnostics
                 if m.status[0].name.startswith(ARM)]
        return found[-1] if found else {}

    running.wait('diagnostics', counted)
    assert counted()['references refused'] == '0'
    invalid = []
    for change in (lambda t: None, lambda t: t.__setitem__(2, np.nan),
                   lambda t: t.__setitem__(slice(3, 7), 0.7),
                   lambda t: t.__setitem__(19, -400.0)):
        numbers = target.copy()
        change(numbers)
        invalid.append(numbers)
    for count, (numbers, reason) in enumerate(zip(invalid, (
            "frame is 'world'", 'NaN', 'quaternion norm', 'not positive definite')), start=1):
        message = Reference()
        message.header.frame_id = 'world' if count == 1 else FRAME
        message.header.stamp = messages.stamp_of(running.client.clock.wall())
        messages.fill_reference(message, numbers)
        publisher.publish(message)
        running.wait(f'the refusal: {reason}',
                     lambda n=count: counted().get('references refused') == str(n))
        assert reason in counted()['last refusal']
    count = len(running.robot)
    running.wait('300 more states', lambda: len(running.robot) > count + 300)
    assert np.linalg.norm(running.tool()[:3] - start[:3]) < 1e-4
    assert 'reference refused' in running.log(ARM)


def test_parts_of_the_state_have_100_hz(running):
    joints = running.collect(JointState, 'joint_states')
    poses = running.collect(PoseStamped, f'{ARM}/measured_pose')
    running.wait('both', lambda: len(joints) > 100 and len(poses) > 100)
    for received in (joints, poses):
        stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in received]
        # In the time of the arm; how much of it passes in a second depends on the machine.
        assert np.median(np.diff(stamps)) == pytest.approx(0.01, abs=1e-4)
    assert joints[-1].name == [f'panda_joint{i}' for i in range(1, 8)]
    assert len(joints[-1].effort) == 7


def test_a_late_subscriber_gets_the_robot_description(running):
    received = []
    running.subscribe(String, '/robot_description', received.append, 1, late=True)
    running.wait('the description', lambda: len(received) > 0)
    assert '<link name="panda_link0">' in received[0].data
    assert all(f'<joint name="panda_joint{i}" type="revolute">' in received[0].data
               for i in range(1, 8))


@pytest.mark.long
def test_friction_is_identified_and_used(nodes, tmp_path):
    """As fast as the machine can, on a plant with dry friction."""
    nodes.start_arm(pace='fast', plant_dry_friction=1.0)
    output = tmp_path / 'friction.yaml'
    done = gdmp('arm', 'friction', '-o', str(output), '--set')
    assert done.returncode == 0, done.stderr
    found = yaml.safe_load(output.read_text())['/**/panda_sim']['ros__parameters']
    np.testing.assert_allclose(found['friction_dry'], 1.0, atol=0.15)
    values = nodes.call(GetParameters, f'{ARM}/get_parameters', names=['friction_dry']).values
    assert list(values[0].double_array_value) == found['friction_dry']


def test_the_tank_is_filled_and_identification_is_refused_under_references(running):
    running.client.execute()
    running.wait('a motion', lambda: running.state.status == 'moving')
    refused = act(running, IdentifyFriction, f'{ARM}/identify_friction')
    assert not refused.success and 'follows a motion' in refused.message
    assert not running.call(Trigger, f'{ARM}/refill_tank').success
    assert running.call(Trigger, f'{ARM}/stop').success
    running.wait_rest()
    assert 'filled to 5 J' in running.call(Trigger, f'{ARM}/refill_tank').message


def test_joints_move_by_way_of_postures_until_stop_is_called(running):
    home = np.array(running.robot[-1].position)
    via, goal = home + 0.2, home + [0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    refused = act(running, MoveJoints, f'{ARM}/move_joints', position=goal.tolist(),
                  via=[0.0] * 8)
    assert not refused.success and 'via has 8 numbers' in refused.message
    moved = act(running, MoveJoints, f'{ARM}/move_joints', position=goal.tolist(),
                via=[*via, *(via + [0.1, 0, 0, 0, 0, 0, 0])], speed=1.0)
    assert moved.success, moved.message
    positions = np.array([message.position for message in running.robot])
    assert np.abs(positions - via).max(axis=1).min() < 0.01
    assert np.abs(positions[-1] - goal).max() < 0.01
    motion = begin_action(running, MoveJoints, f'{ARM}/move_joints', position=home.tolist(),
                          speed=0.1)
    running.wait('the motion', lambda: np.abs(
        np.array(running.robot[-1].position) - goal).max() > 0.05, 10.0)
    assert running.call(Trigger, f'{ARM}/stop').success
    assert motion.result(5.0).message == '~/stop was called'
    running.wait_rest()
    assert np.abs(np.array(running.robot[-1].position) - home).max() > 0.05
    assert running.robot[-1].mode == RobotState.HOLD


def test_joints_move_by_name_until_the_goal_is_cancelled(running):
    names = list(running.children.node(ARM).joint_names)
    begun = np.array(running.robot[-1].position)
    goal = dict(zip(names, (begun + [0.2, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0]).tolist()))
    order = names[::-1]
    name = f'{ARM}/move_joints'
    moved = act(running, MoveJoints, name, joint_names=order,
                position=[goal[joint] for joint in order])
    assert moved.success, moved.message
    np.testing.assert_allclose(running.robot[-1].position, list(goal.values()), atol=0.01)
    for wrong in (['nothing', *order[1:]], order[1:]):
        refused = act(running, MoveJoints, name, joint_names=wrong, position=begun.tolist())
        assert not refused.success and ('missing' in refused.message or '6 joint' in
                                        refused.message), refused.message
    feedback = []
    motion = running.client.send(
        running.client.action(MoveJoints, name),
        MoveJoints.Goal(position=begun.tolist(), speed=0.1), 10.0, feedback.append)
    motion.accepted(10.0)
    running.spend(2.0)
    assert motion.cancel()
    result = motion.result(10.0)
    assert not result.success and '~/stop was called' in result.message
    left = [message.remaining for message in feedback]
    assert left[0] == pytest.approx(0.2 / 0.1 * 1.875 + 0.3, abs=0.1)
    assert left == sorted(left)[::-1]
    running.wait_rest()
    assert running.robot[-1].mode == RobotState.HOLD
    assert np.abs(np.array(running.robot[-1].position) - begun).max() > 0.05


def test_an_arm_that_does_not_look_for_subscribers_any_more_is_deactivated(nodes, monkeypatch):
    def broken(publisher):
        raise ValueError('broken')
    nodes.start_arm()
    nodes.wait('the arm', lambda: bool(nodes.robot))
    # The testbed would end the test: this failure is what is tested.
    monkeypatch.setattr(nodes.children, 'check', lambda may_end=(): None)
    monkeypatch.setattr(StatePublisher, '_check', broken)
    nodes.wait('the arm to be inactive', lambda: nodes.lifecycle_state(ARM) == 'inactive', 10.0)
    nodes._states[ARM] = 'inactive'
    assert 'the loop failed' in nodes.log(ARM)
