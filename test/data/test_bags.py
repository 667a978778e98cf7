"""Recordings: written, read back, and refused with file, topic, sample and reason."""
import numpy as np
import pytest

from gdmp_ros.data import bags, recordings
from gdmp_ros.data.bags import BagWriter, NS
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds import SymmetricPositiveDefinite

START = 1_700_000_000 * NS
POSE, STIFFNESS = recordings.POSE_TOPIC, recordings.STIFFNESS_TOPIC
STORAGES = ['mcap', 'sqlite3']


def poses(count=50):
    t = np.linspace(0.0, 1.0, count)
    turn = 0.4 * t
    return np.column_stack([0.3 + 0.2 * t, 0.1 * np.sin(3 * t), 0.5 + 0 * t,
                            np.cos(turn), np.sin(turn), 0 * t, 0 * t])


def matrices(count=50, size=3):
    return np.array([np.diag(np.linspace(300, 500, size)) * (1.0 + 0.2 * x)
                     for x in np.linspace(0, 1, count)])


def write(path, rows=None, stiffness=None, stamps=None, storage='mcap', frame='base'):
    rows = poses() if rows is None else rows
    stamps = START + np.arange(len(rows)) * 10_000_000 if stamps is None else stamps
    with BagWriter(path, storage) as writer:
        for i, (stamp, row) in enumerate(zip(stamps, rows)):
            writer.pose(POSE, int(stamp), row, frame, bag_ns=START + i * 10_000_000)
            if stiffness is not None:
                writer.matrix(STIFFNESS, int(stamp), stiffness[i])
    return path


@pytest.mark.parametrize('storage', STORAGES)
def test_what_is_written_is_read_back(tmp_path, storage):
    path = write(tmp_path / 'bag', stiffness=matrices(), storage=storage)
    recording = recordings.read(path)
    demonstration = recording.demonstration
    assert recording.frame == 'base'
    assert [f.kind for f in demonstration.manifold.factors] == ['euclidean', 'quaternion', 'spd']
    np.testing.assert_allclose(demonstration.points[:, :7], poses(), atol=1e-15)
    np.testing.assert_allclose(demonstration.points[:, 7:].reshape(-1, 3, 3), matrices())
    np.testing.assert_allclose(demonstration.times, np.arange(50) * 0.01, atol=1e-12)
    again = tmp_path / 'again'
    recordings.write(again, demonstration, 'base', START, storage)
    np.testing.assert_array_equal(recordings.read(again).demonstration.points,
                                  demonstration.points)


@pytest.mark.parametrize('storage', STORAGES)
def test_joint_states_and_wrenches_are_read_as_numbers(tmp_path, storage):
    with BagWriter(tmp_path / 'bag', storage) as writer:
        for i in range(4):
            writer.joints('/joints', START + i * NS, ['a', 'b'], [0.1 * i, -0.2 * i])
            writer.wrench('/wrench', START + i * NS, [i, 2, 3, 4, 5, 6], 'base')
    path = tmp_path / 'bag'
    with bags.opened(path) as reader:
        joints = bags.series_in(reader, path, '/joints')
        wrenches = bags.series_in(reader, path, '/wrench', bags.WRENCH)
    np.testing.assert_allclose(joints.values[:, 1], -0.2 * np.arange(4))
    np.testing.assert_array_equal(wrenches.values[2], [2, 2, 3, 4, 5, 6])
    assert wrenches.frame == 'base'


def test_header_stamps_are_used_instead_of_bag_times(tmp_path):
    path = tmp_path / 'bag'
    with BagWriter(path) as writer:
        for i, row in enumerate(poses(20)):
            late = START + NS + i * 20_000_000 + (i % 3) * 7_000_000
            writer.pose(POSE, START + i * 20_000_000, row, 'base', bag_ns=late)
    np.testing.assert_allclose(recordings.read(path).demonstration.times, np.arange(20) * 0.02)


def test_quaternion_signs_are_made_continuous(tmp_path):
    rows = poses()
    rows[::3, 3:] *= -1.0
    quaternions = recordings.read(write(tmp_path / 'bag', rows)).demonstration.points[:, 3:7]
    assert (np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.0).all()


def test_rest_at_both_ends_is_cut_off(tmp_path):
    rows = poses()
    rested = np.vstack([np.tile(rows[0], (40, 1)), rows, np.tile(rows[-1], (60, 1))])
    demonstration = recordings.read(write(tmp_path / 'bag', rested)).demonstration
    assert 50 <= len(demonstration.times) <= 52
    assert demonstration.times[0] == 0.0


def test_stiffness_at_another_rate_is_interpolated_at_the_stamps_of_the_poses(tmp_path):
    path, slow = tmp_path / 'bag', matrices(26)
    with BagWriter(path) as writer:
        for i, row in enumerate(poses(51)):
            writer.pose(POSE, START + i * 10_000_000, row, 'base')
            if i % 2 == 0:
                writer.matrix(STIFFNESS, START + i * 10_000_000, slow[i // 2])
    points = recordings.read(path).demonstration.points[:, 7:].reshape(-1, 3, 3)
    np.testing.assert_allclose(points[::2], slow, rtol=1e-12)
    between = SymmetricPositiveDefinite(3).geodesic(slow[3], slow[4], 0.5)
    np.testing.assert_allclose(points[7], between, rtol=1e-9)


def test_uncoupled_6x6_stiffness_becomes_spd3_and_coupled_stays(tmp_path):
    full = np.zeros((50, 6, 6))
    full[:, :3, :3], full[:, 3:, 3:] = matrices(), 30.0 * np.eye(3)
    recording = recordings.read(write(tmp_path / 'uncoupled', stiffness=full))
    assert recording.demonstration.manifold.factors[2].size == 3
    np.testing.assert_allclose(recording.rotational_stiffness, 30.0 * np.eye(3))
    full[:, 0, 4] = full[:, 4, 0] = 5.0
    recording = recordings.read(write(tmp_path / 'coupled', stiffness=full))
    assert recording.demonstration.manifold.factors[2].size == 6


def bad_quaternion():
    rows = poses()
    rows[17, 3:] *= 0.93
    return {'rows': rows}


def not_a_number():
    rows = poses()
    rows[12, 1] = np.nan
    return {'rows': rows}


def not_definite():
    bad = matrices()
    bad[9] = np.diag([300.0, -1.0, 200.0])
    return {'stiffness': bad}


def backward():
    stamps = START + np.arange(50) * 10_000_000
    stamps[20] = stamps[18]
    return {'stamps': stamps}


@pytest.mark.parametrize('storage', STORAGES)
@pytest.mark.parametrize('make, topic, sample, reason', [
    (bad_quaternion, POSE, 17, 'quaternion norm is 0.93'),
    (not_a_number, POSE, 12, 'NaN or infinite'),
    (not_definite, STIFFNESS, 9, 'not symmetric positive definite'),
    (backward, POSE, 20, 'stamp does not increase'),
])
def test_bad_samples_are_refused_with_their_place(tmp_path, storage, make, topic, sample, reason):
    path = tmp_path / 'bag'
    write(path, storage=storage, **make())
    with pytest.raises(DataError) as caught:
        recordings.read(path)
    text = str(caught.value)
    assert str(path) in text and topic in text and f'sample {sample}' in text and reason in text


@pytest.mark.parametrize('storage', STORAGES)
def test_a_two_sample_bag_is_refused(tmp_path, storage):
    path = write(tmp_path / 'bag', poses(2), storage=storage)
    with pytest.raises(DataError, match='2 samples, expected at least 3') as caught:
        recordings.read(path)
    assert str(path) in str(caught.value) and POSE in str(caught.value)


@pytest.mark.parametrize('storage', STORAGES)
@pytest.mark.parametrize('keep', [0.0, 0.3, 0.9])
def test_a_truncated_file_is_refused(tmp_path, storage, keep):
    path = write(tmp_path / 'bag', poses(400), storage=storage)
    data = next(p for p in path.iterdir() if p.suffix in ('.mcap', '.db3'))
    data.write_bytes(data.read_bytes()[:int(keep * data.stat().st_size)])
    with pytest.raises(DataError) as caught:
        recordings.read(path)
    assert str(path) in str(caught.value)


def test_missing_topics_wrong_types_and_missing_bags_are_refused(tmp_path):
    path = write(tmp_path / 'bag', stiffness=matrices())
    with pytest.raises(DataError, match='no topic /other; the bag has /demonstration/pose'):
        recordings.read(path, pose_topic='/other')
    with pytest.raises(DataError, match='is of type std_msgs/msg/Float64MultiArray, expected'):
        recordings.read(path, pose_topic=STIFFNESS)
    with pytest.raises(DataError, match='no such bag'):
        recordings.read(tmp_path / 'nowhere')
    with BagWriter(tmp_path / 'forces') as writer:
        writer.wrench('/wrench', START, [0] * 6, 'base')
    with pytest.raises(DataError, match='no topic holds a pose'):
        recordings.read(tmp_path / 'forces')
    (tmp_path / 'folder').mkdir()
    with pytest.raises(DataError, match='it is no rosbag2 recording'):
        recordings.read(tmp_path / 'folder')


def test_one_of_several_pose_topics_must_be_named(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        for i, row in enumerate(poses()):
            writer.pose('/left', START + i * 10_000_000, row, 'base')
            writer.pose('/right', START + i * 10_000_000, row, 'base')
    with pytest.raises(DataError, match='several topics hold a pose'):
        recordings.read(tmp_path / 'bag')
    assert len(recordings.read(tmp_path / 'bag', '/left').demonstration.times) == 50


def test_an_interrupted_writer_leaves_no_files(tmp_path):
    with pytest.raises(RuntimeError), BagWriter(tmp_path / 'bag') as writer:
        writer.pose(POSE, START, poses()[0], 'base')
        raise RuntimeError('interrupted')
    assert list(tmp_path.iterdir()) == []
    write(tmp_path / 'bag')
    with pytest.raises(DataError, match='exists already'):
        write(tmp_path / 'bag')


def test_recordings_without_motion_are_refused(tmp_path):
    with pytest.raises(DataError, match='nothing moves'):
        recordings.read(write(tmp_path / 'bag', np.tile(poses()[0], (50, 1))))
