"""Rhythmic skills and sequences through the server, over DDS."""
from gdmp_msgs.action import ExecuteSequence, ExecuteSkill
from gdmp_msgs.srv import LearnSkill
import numpy as np
import pytest
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.data import recordings, runs
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import SERVER
from gdmp_ros.sim.arm import Arm
from test.motions import circles
from test.ros.nodes import FRAME, open_testbed

PERIOD, RADIUS = 1.0, 0.04


def _circles():
    """The tool goes round, and turns to and fro, near where the arm stands."""
    return circles(Arm().pose_at(Arm().home), RADIUS, 4.3, 0.03)


@pytest.fixture(scope='session')
def folder(tmp_path_factory):
    """A rhythmic skill, two skills that end, and a sequence of them."""
    made, manifold = tmp_path_factory.mktemp('rhythmic'), tool_manifold(None)
    Skill.learn_rhythmic(_circles()).save(made / 'wipe.json')
    home = Arm().pose_at(Arm().home)
    s = np.linspace(0.0, 1.0, 200)
    blend = (s ** 3 * (10.0 - 15.0 * s + 6.0 * s ** 2))[:, None]
    for name, way in (('left', [0.0, 0.1, -0.05]), ('right', [0.05, -0.1, 0.0])):
        points = np.tile(home, (len(s), 1))
        points[:, :3] += blend * way
        Skill.learn(Demonstration(1.5 * s, points, manifold), 30).save(made / f'{name}.json')
    (made / 'sequence.yaml').write_text("""
steps:
  - {skill: left.json, blend: 0.3}
  - {skill: wipe.json, cycles: 2, amplitude: 0.7, blend: 0.1}
  - {skill: right.json}
  - {hold: 0.2}
  - {skill: wipe.json, until: clean, name: polish}
  - {skill: left.json}
""")
    return made


@pytest.fixture(scope='module')
def shared_nodes(tmp_path_factory, folder):
    with open_testbed(tmp_path_factory.mktemp('nodes'), folder / 'wipe.json') as made:
        made.start()
        yield made


def _largest_change(references):
    """Largest change of the acceleration in a millisecond [m/s², rad/s²]."""
    stamps = np.array([m.header.stamp.sec * 10 ** 9 + m.header.stamp.nanosec for m in references])
    twists = np.array([[m.twist.linear.x, m.twist.linear.y, m.twist.linear.z,
                        m.twist.angular.x, m.twist.angular.y, m.twist.angular.z]
                       for m in references])
    spacing = np.diff(1e-9 * stamps)[:, None]
    changes = np.abs(np.diff(np.diff(twists, axis=0) / spacing, axis=0))
    # A tick may come late, and the motion then passes two milliseconds or more.
    return float((changes / np.maximum(1e3 * np.maximum(spacing[1:], spacing[:-1]), 1.0)).max())


def _centre(references):
    points = np.array([messages.pose_numbers(m.pose)[:3] for m in references])
    return 0.5 * (points.min(axis=0) + points.max(axis=0)), np.ptp(points, axis=0)


def test_frequency_amplitude_and_centre_change_by_topic_and_it_ends_at_its_centre(running):
    running.listen()
    client = running.client
    client.execute()
    running.wait('two cycles', lambda: running.state.progress > 2.0, 30.0)
    assert running.state.rhythmic and running.state.frequency == pytest.approx(
        1.0 / PERIOD, rel=0.02)  # phase stopping waits for the arm
    running.references.clear()
    running.spend(1.2 * PERIOD)
    centre, size = _centre(running.references)
    assert size[:2] == pytest.approx([2.0 * RADIUS] * 2, rel=0.02)

    client.frequency(1.6)
    client.amplitude(0.5)
    running.wait('the frequency', lambda: abs(running.state.frequency - 1.6) < 0.08, 5.0)
    running.spend(1.0)
    running.references.clear()
    running.spend(1.4 / 1.6)
    assert _centre(running.references)[1][:2] == pytest.approx([RADIUS] * 2, rel=0.02)
    assert running.state.amplitude == pytest.approx(0.5, abs=1e-3)

    goal = np.array(messages.pose_numbers(running.state.goal[0]))
    goal[:3] += [0.02, 0.05, -0.03]
    client.goal_pose(goal, FRAME)
    running.spend(2.0)
    running.references.clear()
    running.spend(1.4 / 1.6)
    moved, _ = _centre(running.references)
    assert moved == pytest.approx(centre + [0.02, 0.05, -0.03], abs=1e-3)

    for wrong in (client.amplitude, client.frequency):
        refused = running.state.refused
        wrong(7.0)
        running.wait('the refusal', lambda r=refused: running.state.refused > r, 5.0)
        assert 'expected a number from 0' in running.state.last_refusal
    client.amplitude(0.0)
    result = client.result(20.0)
    assert result.error_code == ExecuteSkill.Result.SUCCESSFUL, result.error_string
    client.wait_status('holding', 5.0)
    away = np.array(messages.pose_numbers(running.references[-1].pose)) - goal
    assert np.abs(away[:3]).max() < 1e-3


def test_it_makes_so_many_cycles(running):
    running.client.execute(ExecuteSkill.Goal(cycles=2.0))
    result = running.client.result(20.0)
    assert result.error_code == ExecuteSkill.Result.SUCCESSFUL, result.error_string
    assert 2.0 < running.state.progress < 3.6


def test_cycles_of_a_skill_that_ends_are_refused(running, folder):
    running.client.execute(ExecuteSkill.Goal(skill=str(folder / 'left.json'), cycles=2.0))
    result = running.client.result(20.0)
    assert result.error_code == ExecuteSkill.Result.INVALID_GOAL
    assert 'not rhythmic' in result.error_string


def test_the_entry_and_the_exit_are_smooth_in_the_stream(running):
    running.listen()
    running.client.execute(ExecuteSkill.Goal(cycles=1.0))
    running.client.result(20.0)
    # The cycle itself has 0.04 m (2 pi)^2 = 1.6 m/s²; a step of it in a tick would be as large.
    assert _largest_change(running.references) < 0.4


def test_a_sequence_with_joins_in_motion_a_signal_and_feedback(running, folder):
    running.listen()
    running.record()
    steps = []
    action = running.participant.action_client(ExecuteSequence, f'{SERVER}/execute_sequence')
    running.wait('the action', action.server_is_ready)
    sent = action.send_goal_async(
        ExecuteSequence.Goal(sequence=str(folder / 'sequence.yaml')),
        feedback_callback=lambda message: steps.append(message.feedback.step))
    running.wait('the goal', sent.done)
    done = sent.result().get_result_async()
    running.wait('the last but one step', lambda: running.state.step == 5, 30.0)
    assert running.state.steps == 6 and running.state.step_name == 'polish'
    assert running.state.sequence.endswith('sequence.yaml')
    running.spend(1.5)
    assert running.state.step == 5
    running.client.signal('clean')
    running.wait('the result', done.done, 30.0)
    result = done.result().result
    assert result.error_code == result.SUCCESSFUL, result.error_string
    assert result.step == 6 and steps == sorted(steps) and {1, 2, 3, 5, 6} <= set(steps)
    # Motions and cycle have up to 1.5 m/s² and 1.5 rad/s; the filter of a motion of 1.5 s has a
    # time constant of 50 ms, that of the cycle 33 ms.
    assert _largest_change(running.references) < 0.8
    end = np.array(messages.pose_numbers(running.references[-1].pose))
    goal = Skill.load(folder / 'left.json').goal
    assert np.abs(end - goal).max() < 2e-3
    # The recorded run tells the steps, too.
    happened = [event.text for event in runs.events(running.recorded())]
    assert 'step 5 of 6 begins: polish' in happened
    running.participant.destroy(action)


def test_a_sequence_begins_at_a_step_is_cancelled_and_preempted(running, folder):
    path, client = str(folder / 'sequence.yaml'), running.client
    client.execute_sequence(path, 5)
    running.wait('its step', lambda: running.state.step == 5, 20.0)
    assert client.cancel()
    result = client.result(20.0)
    assert result.error_code == ExecuteSequence.Result.CANCELED and result.step == 5
    client.execute_sequence(path, 3)
    running.wait('its step', lambda: running.state.step == 3 and running.state.progress > 0.3,
                 20.0)
    running.call(Trigger, f'{SERVER}/start')
    result = client.result(20.0)
    assert result.error_code == ExecuteSequence.Result.PREEMPTED
    # The result may come before the next state.
    running.wait('the state without the sequence', lambda: (
        running.state.sequence == '' and running.state.status == 'moving'), 5.0)
    running.call(Trigger, f'{SERVER}/stop')
    # Another sequence takes over from one that is paused.
    client.execute_sequence(path, 5)
    running.wait('its step', lambda: running.state.progress > 0.5, 20.0)
    running.call(SetBool, f'{SERVER}/pause', data=True)
    client.execute_sequence(path, 6)
    result = client.result(20.0)
    assert result.error_code == ExecuteSequence.Result.SUCCESSFUL, result.error_string


def test_a_sequence_that_cannot_be_executed_is_refused_with_the_reason(running, folder, tmp_path):
    client = running.client
    action = running.participant.action_client(ExecuteSequence, f'{SERVER}/execute_sequence')

    def refused(goal, reason):
        result = client.send(action, goal, 20.0).result(20.0)
        assert result.error_code == ExecuteSequence.Result.INVALID_GOAL
        assert reason in result.error_string
    for text, reason in (('steps: [{skill: none.json}]', 'none.json'),
                         ('steps: [{hold: 1}]', 'needs a step with a skill'),
                         (f'steps: [{{skill: {folder}/left.json, goal: [5, 0, 0]}}]', 'goal'),
                         (f'steps: [{{skill: {folder}/left.json}}, {{gripper: {{width: 0}}}}]',
                          'no state of one is known')):
        path = tmp_path / 'wrong.yaml'
        path.write_text(text)
        refused(ExecuteSequence.Goal(sequence=str(path)), reason)
    with pytest.raises(DataError, match='cannot read'):
        client.execute_sequence(str(tmp_path / 'none.yaml'))
    refused(ExecuteSequence.Goal(sequence='here.yaml', files=['here.yaml']), '1 files and 0')
    refused(ExecuteSequence.Goal(sequence='here.yaml', files=['here.yaml'],
                                 contents=['steps: [{skill: there.json}]']), 'there.json')
    client.execute_sequence(str(folder / 'sequence.yaml'), 9)
    assert 'step is 9, expected 1 to 6' in client.result(20.0).error_string
    running.participant.destroy(action)


def test_the_files_of_a_sequence_need_not_be_where_the_server_is(running, folder, monkeypatch):
    """The server has no file of this relative name in its folder."""
    monkeypatch.chdir(folder)
    running.client.execute_sequence('sequence.yaml', 6)
    result = running.client.result(20.0)
    assert result.error_code == ExecuteSequence.Result.SUCCESSFUL, result.error_string


def test_a_rhythmic_skill_is_learned_by_service(running, tmp_path):
    recordings.write(tmp_path / 'take', _circles(), FRAME, recordings.EPOCH_NS)
    reply = running.call(LearnSkill, f'{SERVER}/learn_skill', bags=[str(tmp_path / 'take')],
                         rhythmic=True)
    assert reply.success, reply.message
    running.client.execute(ExecuteSkill.Goal(cycles=1.0))
    assert running.client.result(20.0).error_code == ExecuteSkill.Result.SUCCESSFUL
