"""Files and data sets of other programs: read with stated guesses, written so that they read."""
import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from gdmp_ros import Demonstration, Euclidean, Skill
from gdmp_ros.cli.main import main
from gdmp_ros.data import episodes, foreign, lerobot, recordings, robomimic, tables
from gdmp_ros.data.arm_joints import ArmJoints
from gdmp_ros.data.foreign import Import
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.tip import from_model
from test.commands import gdmp

RATE_HZ = 50.0


@pytest.fixture(scope='module')
def shown(letters):
    return letters[:3]


def frames(one, rate_hz=RATE_HZ):
    times = np.arange(int(one.duration * rate_hz + 1e-6) + 1) / rate_hz
    return times, one.at(one.times[0] + times).reshape(len(times), -1)


def check_equal(found, one, rate_hz=RATE_HZ):
    """The same numbers as at the frames of a demonstration, to 1e-6."""
    times, points = frames(one, rate_hz)
    np.testing.assert_allclose(found.times, times, atol=1e-6)
    signs = np.sign(np.sum(found.points[:, 3:7] * points[:, 3:7], axis=1))
    points[:, 3:7] *= signs[:, None]
    np.testing.assert_allclose(found.points, points, atol=1e-6, rtol=1e-6)


def test_lerobot_and_back(shown, tmp_path):
    lerobot.write(tmp_path / 'set', shown, RATE_HZ, 'write a letter')
    found = episodes.sources(tmp_path / 'set')
    assert [str(one)[-2:] for one in found] == ['#0', '#1', '#2']
    for source, one in zip(found, shown):
        check_equal(episodes.read(source).demonstration, one)


def test_lerobot_has_what_its_readers_look_for(shown, tmp_path):
    folder = tmp_path / 'set'
    lerobot.write(folder, shown, RATE_HZ, 'write a letter')
    info = json.loads((folder / 'meta/info.json').read_text())
    assert info['codebase_version'] == 'v3.0' and info['fps'] == 50
    assert info['total_episodes'] == 3 and info['splits'] == {'train': '0:3'}
    table = pq.read_table(folder / info['data_path'].format(chunk_index=0, file_index=0))
    assert table.num_rows == info['total_frames'] and set(table.column_names) == set(
        info['features'])
    rows = pq.read_table(folder / lerobot.EPISODES).to_pylist()
    for number, row in enumerate(rows):
        inside = np.asarray(table['episode_index'])[row['dataset_from_index']:
                                                    row['dataset_to_index']]
        assert (inside == number).all() and len(inside) == row['length']
        assert row['tasks'] == ['write a letter']
        assert len(row['stats/observation.state/mean']) == 16
    state = np.array(table['observation.state'].to_pylist())
    action = np.array(table['action'].to_pylist())
    count = rows[0]['length']
    np.testing.assert_array_equal(action[:count - 1], state[1:count])
    statistics = json.loads((folder / 'meta/stats.json').read_text())
    np.testing.assert_allclose(statistics['action']['max'], action.max(axis=0), rtol=1e-6)


def test_robomimic_and_back(shown, tmp_path):
    robomimic.write(tmp_path / 'set.hdf5', shown, RATE_HZ)
    with h5py.File(tmp_path / 'set.hdf5') as file:
        demo = file['data/demo_1']
        assert demo.attrs['num_samples'] == len(demo['actions']) == len(demo['dones'])
        assert json.loads(file['data'].attrs['env_args'])['env_kwargs']['control_freq'] == RATE_HZ
        np.testing.assert_array_equal(demo['next_obs/robot0_eef_pos'][:-1],
                                      demo['obs/robot0_eef_pos'][1:])
    for source, one in zip(episodes.sources(tmp_path / 'set.hdf5'), shown):
        check_equal(episodes.read(source).demonstration, one)


def test_a_skill_is_learned_from_an_episode_and_its_roll_outs_written(shown, tmp_path):
    lerobot.write(tmp_path / 'set', shown, 100.0, 'write a letter')
    done = gdmp('learn', 'set', '-o', 'skill.json', cwd=tmp_path)
    assert done.returncode == 0 and 'set#2' in done.stdout
    skill = Skill.load(tmp_path / 'skill.json')
    direct = Skill.learn(shown, 'auto')
    assert np.linalg.norm(skill.goal[:3] - direct.goal[:3]) < 2e-3
    for result in ('again', 'rollouts.hdf5'):
        words = ['convert', str(tmp_path / 'skill.json'), '-o', str(tmp_path / result),
                 '--fps', '20', '--rollouts', '5']
        assert main(words + (['--as', 'lerobot'] if result == 'again' else [])) == 0
        read = [episodes.read(one).demonstration for one in episodes.sources(tmp_path / result)]
        ends = np.array([one.points[-1, :3] for one in read])
        assert len(read) == 5 and 1e-4 < ends.std(axis=0).max() < 0.1


def test_columns_are_found_by_their_names(shown, tmp_path):
    times, points = frames(shown[0])
    table = np.column_stack([times, 1e3 * points[:, :3], points[:, [4, 5, 6, 3]],
                             np.gradient(points[:, 0])])
    (tmp_path / 'a.csv').write_text('\n'.join(
        ['field.time;pose.position.x;pose.position.y;pose.position.z;pose.orientation.x;'
         'pose.orientation.y;pose.orientation.z;pose.orientation.w;twist.linear.x',
         *(';'.join(f'{value:.9f}' for value in row) for row in table)]))
    found = episodes.read(tmp_path / 'a.csv', Import(scale=1e-3))
    np.testing.assert_allclose(found.demonstration.points, points[:, :7], atol=1e-6)
    assert 'position: pose.position.x, pose.position.y, pose.position.z' in found.notes


@pytest.mark.parametrize('suffix', ['npz', 'mat', 'h5'])
def test_arrays_are_named_by_key_and_guesses_are_stated(shown, tmp_path, suffix):
    times, points = frames(shown[0])
    path, arrays = tmp_path / f'a.{suffix}', {'traj': points[:, [0, 1, 2, 4, 5, 6, 3]]}
    if suffix == 'npz':
        np.savez(path, **arrays)
    elif suffix == 'mat':
        savemat(path, {'traj': arrays['traj'].T})
    else:
        with h5py.File(path, 'w') as file:
            file.create_dataset('traj', data=arrays['traj'])
    with pytest.raises(DataError, match=r'no times were found; give --rate-hz.*traj'):
        episodes.read(path, Import({'points': 'traj'}, 'xyzw'))
    found = episodes.read(path, Import({'points': 'traj'}, 'xyzw', RATE_HZ))
    np.testing.assert_allclose(found.demonstration.points, points[:, :7], atol=1e-12)
    assert not any('traj' in note for note in found.notes)  # nothing was guessed
    guessed = episodes.read(path, Import(quaternion='xyzw', rate_hz=RATE_HZ))
    assert 'points: traj' in guessed.notes
    with pytest.raises(DataError, match='give --quaternion wxyz or'):
        episodes.read(path, Import(rate_hz=RATE_HZ))
    with pytest.raises(DataError, match="no array is called 'pose'.*there are traj"):
        episodes.read(path, Import({'points': 'pose'}))


def test_the_command_converts_and_says_how_it_was_read(shown, tmp_path):
    _, points = frames(shown[0])
    np.savez(tmp_path / 'a.npz', position=points[:, :3], quat=points[:, [4, 5, 6, 3]])
    words = ('convert', 'a.npz', '-o', 'take', '--rate-hz', RATE_HZ)
    done = gdmp(*words, cwd=tmp_path)
    assert done.returncode == 1 and '--quaternion wxyz or --quaternion xyzw' in done.stderr
    done = gdmp(*words, '--quaternion', 'xyzw', cwd=tmp_path)
    assert done.returncode == 0 and 'position: position; orientation: quat' in done.stdout
    read = recordings.read(tmp_path / 'take').demonstration
    assert np.abs(read.points[-1, :3] - points[-1, :3]).max() < 1e-3
    robomimic.write(tmp_path / 'set.hdf5', shown, RATE_HZ)
    several = gdmp('convert', 'set.hdf5', '-o', 'one.csv', cwd=tmp_path)
    assert several.returncode == 1 and 'there are 3 demonstrations' in several.stderr
    assert gdmp('convert', 'set.hdf5#1', '-o', 'one.csv', cwd=tmp_path).returncode == 0
    assert gdmp('convert', 'set.hdf5', '-o', 'bags', cwd=tmp_path).returncode == 0
    assert sorted(path.name for path in (tmp_path / 'bags').iterdir()) == [
        'take_001', 'take_002', 'take_003']


@pytest.mark.parametrize('damage, reason', [
    (lambda folder: (folder / 'meta/info.json').write_text('{'), 'info.json: damaged'),
    (lambda folder: (folder / 'meta/info.json').write_text(
        (folder / 'meta/info.json').read_text().replace('v3.0', 'v1.6')), 'version v1.6'),
    (lambda folder: next((folder / 'data').rglob('*.parquet')).write_bytes(b'PAR1'), 'damaged'),
    (lambda folder: next((folder / 'data').rglob('*.parquet')).unlink(), 'no files in data')])
def test_a_damaged_data_set_is_named(shown, tmp_path, damage, reason):
    lerobot.write(tmp_path / 'set', shown[:1], RATE_HZ, 'write')
    damage(tmp_path / 'set')
    with pytest.raises(DataError, match=reason):
        episodes.sources(tmp_path / 'set')


def test_version_2_of_lerobot_is_read(shown, tmp_path):
    """It has a file for each episode; the frames tell their episode themselves."""
    lerobot.write(tmp_path / 'set', shown, RATE_HZ, 'write')
    folder, info = tmp_path / 'set' / 'data' / 'chunk-000', tmp_path / 'set' / 'meta' / 'info.json'
    table = pq.read_table(folder / 'file-000.parquet')
    for number in range(len(shown)):
        rows = np.flatnonzero(np.asarray(table['episode_index']) == number)
        pq.write_table(table.take(rows), folder / f'episode_{number:06d}.parquet')
    (folder / 'file-000.parquet').unlink()
    info.write_text(info.read_text().replace('v3.0', 'v2.1'))
    for source, one in zip(episodes.sources(tmp_path / 'set'), shown):
        check_equal(episodes.read(source).demonstration, one)


def test_a_group_for_each_episode(shown, tmp_path):
    with h5py.File(tmp_path / 'set.h5', 'w') as file:
        for number, one in enumerate(shown):
            times, points = frames(one)
            group = file.create_group(f'episode_{number}')
            group['timestamp'], group['ee_pos'] = times, points[:, :3]
            group['ee_quat_wxyz'] = points[:, 3:7]
            group['depth'] = np.zeros((len(times), 8, 8))
    found = episodes.sources(tmp_path / 'set.h5')
    assert len(found) == 3
    for source, one in zip(found, shown):
        points = episodes.read(source).demonstration.points
        np.testing.assert_allclose(points, frames(one)[1][:, :7], atol=1e-12)


def test_nothing_half_written_is_left(shown, tmp_path):
    with pytest.raises(DataError, match='a whole number'):
        lerobot.write(tmp_path / 'set', shown, 29.97, 'write')
    with pytest.raises(DataError, match='nothing to write'):
        robomimic.write(tmp_path / 'set.hdf5', [], RATE_HZ)
    assert list(tmp_path.iterdir()) == []


def test_a_data_set_that_lerobot_has_written():
    # Made by test/data/lerobot/write_turns.py with lerobot 0.4.4.
    folder = Path(__file__).parent / 'lerobot' / 'turns'
    found = [episodes.read(one) for one in episodes.sources(folder)]
    for number, one in enumerate(found):
        shown = one.demonstration
        assert len(shown.times) == 40 and shown.duration == pytest.approx(39 / 25.0, abs=1e-6)
        turn = 2.0 * np.arccos(np.clip(shown.points[:, 3], -1.0, 1.0))
        assert turn[0] == 0.0 and turn[-1] == pytest.approx(1.2 * (number + 1), abs=1e-5)
    assert any('observation.state.x' in note for note in found[0].notes)


NAMES = ['time', 'x', 'y', 'z', 'qw', 'qx', 'qy', 'qz']


def test_a_data_set_that_robomimic_has_written(tmp_path):
    """
    Lift of robosuite 1.5.2, written by the scripts of robomimic 0.5.0; two of its episodes.

    It has no times, and two orientations: only the one of the site belongs to the position.
    """
    path = Path(__file__).parent / 'robomimic' / 'lift.hdf5'
    sources = episodes.sources(path)
    assert len(sources) == 2
    found = episodes.read(sources[1])
    with h5py.File(path) as file:
        observed = file['data/demo_2/obs']
        position = observed['robot0_eef_pos'][()]
        orientation = observed['robot0_eef_quat_site'][()]
    np.testing.assert_array_equal(found.demonstration.points[:, :3], position)
    turned = orientation[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(np.abs((found.demonstration.points[:, 3:] * turned).sum(axis=1)),
                               1.0, atol=1e-6)
    # The environment was controlled at 20 Hz.
    np.testing.assert_allclose(np.diff(found.demonstration.times), 0.05)
    assert any('robot0_eef_quat_site' in note for note in found.notes)
    assert any('control_freq' in note for note in found.notes)
    # The arm, not the fingers, whose array comes first.
    tool = episodes.read(sources[1], Import(joints=ArmJoints(from_model('panda')))).demonstration
    with h5py.File(path) as file:
        joints = file['data/demo_2/obs/robot0_joint_pos'][()]
    panda = Arm()
    for point, posture in zip(tool.points, joints):
        assert max(pose_distance(point, panda.pose_at(posture))) < 1e-7
    slower = episodes.read(sources[1], Import(rate_hz=10.0)).demonstration
    np.testing.assert_allclose(np.diff(slower.times), 0.1)
    assert gdmp('learn', path, '-o', 'skill.json', cwd=tmp_path).returncode == 0


def test_images_beside_the_numbers_do_not_count(shown, tmp_path, monkeypatch):
    robomimic.write(tmp_path / 'set.hdf5', shown, RATE_HZ)
    with h5py.File(tmp_path / 'set.hdf5', 'a') as file:
        file.create_dataset('data/demo_0/obs/image', data=np.zeros((40, 64, 64, 3), np.uint8))
    monkeypatch.setattr(tables, 'LARGEST', 460_000)
    check_equal(episodes.read(Path(f'{tmp_path}/set.hdf5#0')).demonstration, shown[0])
    monkeypatch.setattr(tables, 'LARGEST', 4_000)
    with pytest.raises(DataError, match='its numbers take .* bytes, expected at most 4000'):
        tables.read_arrays(tmp_path / 'set.hdf5')


@pytest.mark.parametrize('before', ['index', 'velocity', 'wx', 'Tx', 'goal_x', 'px_raw'])
def test_other_columns_are_no_axes(shown, before):
    times, points = frames(shown[0])
    arrays = {before: np.arange(len(times)) * 1.0,
              **dict(zip(NAMES, np.column_stack([times, points[:, :7]]).T))}
    found = foreign.demonstration('table', arrays, Import()).demonstration
    np.testing.assert_allclose(found.points, points[:, :7], atol=1e-12)


def test_several_bodies_are_asked_for(shown):
    times, points = frames(shown[0])
    arrays = {'time': times, 'cube_pos': points[:, :3] + 1.0, 'can_pos': points[:, :3],
              'can_quat': points[:, 3:7]}
    # The orientation tells which body it is.
    found = foreign.demonstration('table', arrays, Import(quaternion='wxyz'))
    np.testing.assert_allclose(found.demonstration.points, points[:, :7], atol=1e-12)
    two = {**arrays, 'cube_quat': points[:, 3:7]}
    with pytest.raises(DataError, match='cube_pos; can_pos may be the position: choose with'):
        foreign.demonstration('table', two, Import())
    found = foreign.demonstration('table', arrays, Import({'position': 'can_pos'}, 'wxyz'))
    np.testing.assert_allclose(found.demonstration.points, points[:, :7], atol=1e-12)
    with pytest.raises(DataError, match='have 10, .* samples'):
        foreign.demonstration('table', {**arrays, 'can_pos': points[:10, :3]},
                              Import({'position': 'can_pos'}, 'wxyz'))
    columns = dict(zip(NAMES, np.column_stack([times, points[:, :7]]).T))
    columns.update({f'other.{axis}': points[:, 0] for axis in 'xyz'})
    found = foreign.demonstration('table', columns, Import())
    np.testing.assert_allclose(found.demonstration.points, points[:, :7], atol=1e-12)
    columns.update({f'third.q{axis}': points[:, 3 + i] for i, axis in enumerate('wxyz')},
                   **{f'third.{axis}': points[:, 0] for axis in 'xyz'})
    with pytest.raises(DataError, match='may be the position: choose with --key position=x,y,z'):
        foreign.demonstration('table', columns, Import())
    found = foreign.demonstration('table', columns, Import({'position': 'x,y,z'}))
    np.testing.assert_allclose(found.demonstration.points, points[:, :7], atol=1e-12)


@pytest.mark.parametrize('factor, unit', [(1.0, 's'), (1e3, 'ms'), (1e6, 'us'), (1e9, 'ns')])
def test_units_of_times_are_found_and_stated(shown, factor, unit):
    times, points = frames(shown[0])
    arrays = dict(zip(NAMES, np.column_stack([1e9 + factor * times, points[:, :7]]).T))
    found = foreign.demonstration('table', arrays, Import())
    np.testing.assert_allclose(found.demonstration.times, times, atol=1e-6)
    assert any(note.startswith(f'times: time [{unit}]') for note in found.notes)
    arrays['time'] = 1e-9 * times
    with pytest.raises(DataError, match='no unit from s to ns fits'):
        foreign.demonstration('table', arrays, Import())


def test_a_skill_of_seven_joints_is_no_pose(shown, tmp_path):
    joints = Demonstration(shown[0].times, shown[0].points[:, :7], Euclidean(7))
    for write in (lambda: lerobot.write(tmp_path / 'set', [joints], 30, 'write'),
                  lambda: robomimic.write(tmp_path / 'set.hdf5', [joints], 30)):
        with pytest.raises(DataError, match='only poses'):
            write()
    assert list(tmp_path.iterdir()) == []


def test_a_stiffness_in_matrices_is_read(shown, tmp_path):
    times, points = frames(shown[0])
    savemat(tmp_path / 'a.mat', {'time': times, 'position': points[:, :3].T,
                                 'quat_wxyz': points[:, 3:7].T,
                                 'stiffness': points[:, 7:].reshape(-1, 3, 3).transpose(1, 2, 0)})
    found = episodes.read(tmp_path / 'a.mat')
    np.testing.assert_allclose(found.demonstration.points, points, atol=1e-9)
    done = gdmp('show', tmp_path / 'a.mat')
    assert done.returncode == 0 and 'stiffness' in done.stdout


MOTORS = ['shoulder_pan.pos', 'shoulder_lift.pos', 'elbow_flex.pos', 'wrist_flex.pos',
          'wrist_roll.pos', 'gripper.pos']


def teleoperated(folder, version, scale=1.0):
    """
    A data set of two takes of a low-cost arm; the follower's gripper stops at what it holds.

    :returns: the actions of the takes, as LeRobot has them
    """
    actions = []
    for number in range(2):
        s = np.arange(91) / 90.0
        rise = s ** 2 * (3.0 - 2.0 * s)
        joints = np.outer(rise, [60.0 + 4.0 * number, -35.0, 50.0, 20.0, -90.0])
        closes = 1.0 / (1.0 + np.exp(-(s - 0.6) / 0.03))
        actions.append(np.column_stack([[12.0, -80.0, 70.0, 5.0, 3.0] + joints,
                                        60.0 - 55.0 * closes]) * scale)
    states = [rows.copy() for rows in actions]
    for rows in states:
        rows[:, 5] = np.maximum(rows[:, 5], 20.0 * scale)
    part = {'dtype': 'float32', 'shape': [6], 'names': MOTORS}
    (folder / 'data' / 'chunk-000').mkdir(parents=True)
    (folder / 'meta').mkdir()
    (folder / 'meta' / 'info.json').write_text(json.dumps({
        'codebase_version': version, 'fps': 30, 'robot_type': 'so101_follower', 'features': {
            'observation.state': part, 'action': part,
            **{name: {'dtype': kind, 'shape': [1], 'names': None}
               for name, kind in (('timestamp', 'float32'), ('episode_index', 'int64'))}}}))
    count = len(actions[0])
    columns = {'observation.state': np.vstack(states), 'action': np.vstack(actions),
               'timestamp': np.tile(np.arange(count) / 30.0, 2),
               'episode_index': np.repeat([0, 1], count)}
    files = ([(0, 1, 'file-000')] if version == 'v3.0' else
             [(0, 0, 'episode_000000'), (1, 1, 'episode_000001')])
    for first, last, name in files:
        rows = slice(first * count, (last + 1) * count)
        pq.write_table(pa.table({key: array[rows].tolist() for key, array in columns.items()}),
                       folder / 'data' / 'chunk-000' / f'{name}.parquet')
    return actions


def actions_of(folder):
    """What `lerobot-replay` sends: the numbers of ``action`` by the names of its parts."""
    info = json.loads((folder / 'meta/info.json').read_text())
    assert info['features']['action']['names'] == MOTORS
    table = pq.read_table(folder / info['data_path'].format(chunk_index=0, file_index=0))
    return info, np.array(table['action'].to_pylist())


@pytest.mark.parametrize(('version', 'units'), [('v2.1', 'deg'), ('v3.0', 'percent'),
                                                ('v3.0', 'deg')])
def test_a_skill_of_motors_is_written_for_the_robot_that_replays_it(version, units, tmp_path):
    shown = teleoperated(tmp_path / 'set', version)
    skill = tmp_path / 'skill.json'
    gdmp('learn', f'{tmp_path / "set"}#0', '-o', skill, '--joints', 'action', '--units', units)
    gdmp('convert', skill, '-o', tmp_path / 'again', '--as', 'lerobot')
    info, sent = actions_of(tmp_path / 'again')
    assert (info['fps'], info['robot_type']) == (30, 'so101_follower')
    # The rest at both ends is cut off.
    at = np.array([np.linalg.norm(shown[0] - row, axis=1).min() for row in sent])
    assert at.max() < 1.0
    assert np.abs(sent[[0, -1]] - shown[0][[0, -1]]).max() < 0.6
    # The gripper is commanded beyond what it holds: it squeezes as it did when it was shown.
    assert sent[-1, 5] < 6.0
    here = shown[0][0] + [-6.0, 4.0, 0.0, 8.0, 0.0, -20.0]
    gdmp('convert', skill, '-o', tmp_path / 'here', '--as', 'lerobot', '--start', *here)
    _, sent = actions_of(tmp_path / 'here')
    assert np.abs(sent[0] - here).max() < 0.3
    assert np.abs(np.diff(sent, axis=0)).max() < 1.6 * np.abs(np.diff(shown[0], axis=0)).max()
    assert np.abs(sent[-1] - shown[0][-1]).max() < 0.6


def test_motors_of_takes_are_learned_in_one_unit(tmp_path):
    teleoperated(tmp_path / 'set', 'v3.0')
    teleoperated(tmp_path / 'rad', 'v3.0', np.pi / 180.0)
    done = gdmp('learn', f'{tmp_path / "set"}#0', f'{tmp_path / "rad"}#0', '-o',
                tmp_path / 'skill.json', '--joints', 'action')
    assert done.returncode == 1
    assert 'a unit of its joints is 1 rad, expected 0.01745 rad' in done.stderr
    done = gdmp('learn', tmp_path / 'set', '-o', tmp_path / 'skill.json', '--joints', 'commands')
    assert done.returncode == 1 and 'no array commands, and none whose name beg' in done.stderr
    assert not (tmp_path / 'skill.json').exists()


def test_where_a_robot_is_has_a_number_for_each_joint(tmp_path):
    teleoperated(tmp_path / 'set', 'v3.0')
    skill = tmp_path / 'skill.json'
    gdmp('learn', tmp_path / 'set', '-o', skill, '--joints', 'action', '--units', 'deg')
    for sources, given, reason in (([skill], (1, 2), 'has 2 numbers, expected 6'),
                                   ([tmp_path / 'set'], range(6), '--start is for skills')):
        done = gdmp('convert', *sources, '-o', tmp_path / 'none', '--as', 'lerobot', '--start',
                    *given)
        assert done.returncode == 1 and reason in done.stderr
    assert not (tmp_path / 'none').exists()
