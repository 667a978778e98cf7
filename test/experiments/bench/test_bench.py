"""The figures that ``python -m experiments bench`` writes; not the speed of this machine."""
from dataclasses import replace
from functools import partial
import json
import sys

import mujoco
import numpy as np
import pytest

from experiments import frame_tasks, timing
from experiments.bench import accuracy, generalise, goal_switch, peers, tempo, tick
from experiments.cli.bench import SUBJECTS
from gdmp_ros.data import lasa
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.execution import Execution
from gdmp_ros.util.profiles import minimum_jerk
from test.commands import experiments

SETTINGS = timing.TimingSettings(repetitions=7, classes=('GShape', 'Sine'))
bench = partial(experiments, 'bench')


@pytest.fixture(scope='module')
def switched():
    return goal_switch.run(SETTINGS)


@pytest.mark.parametrize('kind', ['linear', 'angular'])
def test_a_goal_switch_steps_less_than_its_filter_allows_and_less_than_the_peers(switched, kind):
    figures = switched[kind]
    assert 0.0 < figures['step'] <= figures['allowed']
    assert figures['peak'] <= 0.5 * figures['peer_peak']
    assert figures['peer_step'] > 10.0 * figures['step']


@pytest.mark.parametrize('kind', ['linear', 'angular'])
def test_a_goal_switch_steps_less_than_the_peer_with_smooth_scaling_too(switched, kind):
    figures = switched[kind]
    assert figures['peak'] <= 0.55 * figures['peer_smooth_peak']
    assert figures['peer_smooth_step'] > 10.0 * figures['step']
    # The option has an effect: it makes the peer smoother.
    assert figures['peer_smooth_step'] < 0.95 * figures['peer_step']
    assert len(figures['peer_smooth_curve']) == len(figures['curve'])


@pytest.fixture(scope='module')
def changed():
    return tempo.run(SETTINGS)


def test_a_change_of_tempo_keeps_our_path_at_a_bounded_rate(changed):
    assert changed['path_deviation'] < 1e-9
    assert 1.0 < changed['largest_rate'] <= 5.0 + 1e-9


def test_the_peer_leaves_its_path_unless_its_velocity_is_changed_too(changed):
    deviation = {name: one['path_deviation_m'] for name, one in changed['peer'].items()}
    assert list(deviation) == list(tempo.CHANGES)
    assert deviation['duration'] > 0.01 and deviation['duration_and_clock'] > 0.01
    assert deviation['duration_clock_and_velocity'] < 0.002


@pytest.mark.parametrize('name', tempo.CHANGES)
def test_the_duration_of_the_peer_did_change(changed, name):
    one = changed['peer'][name]
    assert one['execution_time_'] == 2.0 * tempo.DURATION
    path, unchanged = np.array(one['path']), np.array(changed['peer_unchanged'])
    half = len(unchanged) // 2
    np.testing.assert_array_equal(path[:half], unchanged[:half])
    # At the end of the first duration it is under way, half a duration later it is at the goal.
    under_way = np.linalg.norm(path[2 * half - 1] - unchanged[-1])
    at_end = np.linalg.norm(path[3 * half - 1] - unchanged[-1])
    assert len(path) == 3 * half and under_way > 0.05
    if tempo.CHANGES[name].clock:
        assert at_end < 0.005
    else:  # its phase has jumped back: it is late
        assert at_end > 0.05
    if tempo.CHANGES[name].velocity:  # half as fast along the same path
        assert np.abs(path[half + 1::2] - unchanged[half:half + half]).max() < 0.002


def test_accuracy_rows_are_means_over_the_classes(monkeypatch):
    def figures(task):
        name, mapping, connection, n_basis = task
        base = 1.0 + 10.0 * (name == 'Sine') + 100.0 * (connection == 'published')
        return [base + 1000.0 * i + 0.1 * n_basis for i in range(len(accuracy.STEPS_MS))]
    monkeypatch.setattr(accuracy, 'one_class', figures)
    rows = accuracy.run(SETTINGS)['rows']
    main = [row for row in rows if not row.get('separate')]
    assert len(main) == 5 * 2 * 4 and len(rows) == len(main) + 2 * 4
    assert {row['manifold'] for row in main} == set(lasa.MAPPINGS)
    for row in rows:
        low = (7.0 + 100.0 * (row['connection'] == 'published')
               + 1000.0 * accuracy.STEPS_MS.index(row['dt_ms']))
        assert row['classes'] == 2
        assert row['mean_relative_error'] == pytest.approx(low + 5.0)
        assert row['max_relative_error'] == pytest.approx(low + 10.0)


@pytest.mark.parametrize('mapping', ['S3', accuracy.COVARIANCES])
def test_the_accuracy_of_a_class_is_its_reproduction_error(mapping):
    separate = mapping == accuracy.COVARIANCES
    shown = (lasa.covariance_profile('Sine') if separate
             else lasa.riemannian(lasa.strokes('Sine')[0], mapping))
    skill = Skill.learn(shown, 40, connection='published', end='moving')
    assert accuracy.one_class(('Sine', mapping, 'published', 40)) == [
        reproduction_error(skill, shown, 1e-3 * ms)[0] for ms in accuracy.STEPS_MS]


def test_learning_writes_its_keys_and_shows_a_table(tmp_path):
    done = bench('learn', '--json', tmp_path / 'learn.json', '--repetitions', 7)
    assert done.returncode == 0 and 'movement_primitives' in done.stdout
    document = json.loads((tmp_path / 'learn.json').read_text())
    assert all(document[key] > 0.0 for key in ('pose_ms', 'pose_stiffness_ms', 'peer_pose_ms'))
    assert document['environment']['python']


def test_the_help_names_every_subject_and_bad_options_are_refused():
    text = bench('--help').stdout
    for what in SUBJECTS:
        assert what in text
    refused = bench('accuracy', '--class', 'Elephant')
    assert refused.returncode == 1 and 'expected one of Angle' in refused.stderr
    assert 'at least 7' in bench('learn', '--repetitions', 3).stderr


def test_the_closed_loop_follows_in_every_repetition():
    document = tick.run(timing.TimingSettings(repetitions=2))
    assert document['position_rmse_m'] < 1e-3
    assert document['mj_step_us'] > 0.0
    assert document['ratio'] == pytest.approx(document['tick_us'] / document['mj_step_us'])
    assert document['limited_ratio'] == pytest.approx(document['limited_tick_us']
                                                      / document['tick_us'])
    assert len(tick.rows(document)) == 7


def test_a_missing_peer_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, 'movement_primitives.dmp', None)
    with pytest.raises(DataError, match=r'\.\[bench\]'):
        peers.CartesianPeer(timing.demonstration(timing.POSE, 1.0, samples=50), 10)


def test_subjects_are_smooth_and_at_rest_at_both_ends():
    shown = timing.demonstration(timing.pose_with_stiffness(3), 2.0)
    skill = timing.skill(timing.pose_with_stiffness(3), 2.0)
    assert np.linalg.norm(skill.velocity) < 1e-2 and len(shown.times) == 1000


def frame_takes(folder, count=4):
    """A planar set as the published one: out of a start frame, into a goal frame."""
    rng, arrays, s = np.random.default_rng(3), {}, np.linspace(0.0, 1.0, 40)[:, None]
    for k in range(count):
        angles, origins = rng.uniform(-1.0, 1.0, 2), np.array([[0.0, 0.0], [60.0, 30.0]])
        origins = origins + rng.uniform(-15.0, 15.0, (2, 2))
        turns = np.array([[[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]] for a in angles])
        ways = [np.hstack([0.0 * s, 40.0 * s]) @ turns[0].T + origins[0],
                np.hstack([0.0 * s, 40.0 * (s - 1.0)]) @ turns[1].T + origins[1]]
        late = minimum_jerk(s)
        arrays |= {f'take{k}_points': (1.0 - late) * ways[0] + late * ways[1],
                   f'take{k}_rotations': turns, f'take{k}_origins': origins}
    np.savez(folder / generalise.FILE, **arrays)
    return folder


def test_generalise_compares_takes_in_the_frames_of_others(tmp_path):
    found = generalise.run(replace(SETTINGS, frames=frame_takes(tmp_path)))
    assert found['pairs'] == 12 and list(found['several']) == ['2', '3']
    ours, switched = found['one_take']['frames'], found['one_take']['goal_switch']
    assert ours['frechet'] < 0.7 * switched['frechet']
    assert ours['final_angle'] < 0.3 * switched['final_angle']
    # Takes that are exactly blends of single ones: nothing is better than their mean.
    for count in ('2', '3'):
        taken, single = (found['several'][count][name] for name in ('frames', 'single_takes'))
        assert taken['frechet'] <= 1.03 * single['frechet']
        assert taken['warping'] <= 1.03 * single['warping']
    assert any('task frames' in row[0] for row in generalise.rows(found))
    (tmp_path / generalise.FILE).write_bytes(b'PK not an archive')
    with pytest.raises(DataError, match='not the takes'):
        generalise.run(replace(SETTINGS, frames=tmp_path))


def test_generalise_says_what_was_not_measured():
    found = generalise.run(SETTINGS)
    assert 'one_take' not in found
    assert any('not measured' in row[0] for row in generalise.rows(found))


def test_the_measures_of_generalise_are_those_published():
    take = Demonstration(np.linspace(0.0, 1.0, 11), np.linspace([0.0, 0.0], [10.0, 0.0], 11),
                         generalise.PLANE, frames={'goal': (np.eye(2), [10.0, 0.0])})
    assert np.allclose(generalise.measures(take.points, take), 0.0)
    beside = take.points + [0.0, 2.0]
    assert np.allclose(generalise.measures(beside, take), [2.0, 22.0, 2.0, 0.0])
    back = generalise.measures(take.points[::-1], take)
    assert back[2] == 10.0 and np.isclose(back[3], np.pi)


@pytest.mark.long
@pytest.mark.parametrize('name', frame_tasks.TASKS)
def test_a_task_with_objects_is_done_where_they_are(name):
    found = frame_tasks.measure(name, 3, 1, lambda: None)
    assert found['five_takes'] == found['one_take'] == 1.0
    assert found['without_frames'] < 1.0


def test_a_peg_beside_its_hole_has_not_succeeded(rng):
    task = frame_tasks.TASKS['peg']
    where = task.situation(rng)
    skill = Skill.learn(task.shown(where, rng))
    poses = np.array([skill.goal[:7]])
    assert task.succeeded(where, Execution(np.zeros((1, 7)), poses, poses), Arm())
    for offset in ([0.003, 0.0, 0.0], [0.0, 0.0, 0.01]):
        moved = poses + np.append(offset, np.zeros(4))
        assert not task.succeeded(where, Execution(np.zeros((1, 7)), moved, moved), Arm())


def test_a_cube_beside_its_box_is_not_placed(rng):
    task = frame_tasks.TASKS['pick']
    where = task.situation(rng)
    arm = task.arm(where)
    done = Execution(*3 * [np.zeros((1, 7))])
    assert not task.succeeded(where, done, arm)
    cube = arm.data.joint(int(arm.model.body('cube').jntadr[0])).qpos
    cube[:3] = where.goal[:3] + [0.05, 0.0, 0.03]
    mujoco.mj_forward(arm.model, arm.data)
    assert task.succeeded(where, done, arm)
    cube[2] += 0.1
    mujoco.mj_forward(arm.model, arm.data)
    assert not task.succeeded(where, done, arm)
