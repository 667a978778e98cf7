"""Takes of one motion: comparison, outliers, dropped takes, stiffness."""
import numpy as np
import pytest

from gdmp_ros.data import recordings, takes
from gdmp_ros.data.bags import BagWriter, NS
from gdmp_ros.errors import DataError
from gdmp_ros.learning.stiffness import stiffness_at_samples
from test.commands import gdmp
from test.pictures import drawn

START = 1_700_000_000 * NS


def take(folder, name, shift=0.0, seconds=2.0, turn=0.3, count=80, stiffness=False):
    """An arc in the plane, as a bag; faster at the beginning than at the end."""
    with BagWriter(folder / name) as writer:
        for i, s in enumerate(np.linspace(0.0, 1.0, count)):
            angle = turn * s
            stamp = START + round(i / (count - 1) * seconds * NS)
            writer.pose('/pose', stamp, [0.4 + 0.2 * np.sqrt(s), 0.1 * np.sin(3 * s) + shift * s,
                                         0.5, np.cos(angle), np.sin(angle), 0.0, 0.0], 'base')
            if stiffness:
                writer.matrix('/stiffness', stamp, np.diag([300.0, 400.0, 500.0]))


def shown(folder):
    return [recordings.read(bag) for bag in takes.takes_in(folder)]


def test_similar_takes_are_no_outliers(tmp_path):
    for i, shift in enumerate((0.0, 0.004, -0.004, 0.002)):
        take(tmp_path, f'take_{i}', shift, seconds=2.0 + 0.2 * i)
    compared = takes.compare(shown(tmp_path))
    assert [one.outlier for one in compared] == [''] * 4
    assert compared[0].duration == pytest.approx(2.0)
    assert all(0.2 < one.length < 0.4 and one.distance < 0.01 for one in compared)


@pytest.mark.parametrize('bad, reason', [
    ({'shift': 0.12}, 'path is'), ({'turn': 1.2}, 'rotation is'),
    ({'seconds': 6.0}, 'lasts 6.0 s, usual is 2.0 s')])
def test_an_outlier_is_found_with_its_reason(tmp_path, bad, reason):
    for i in range(4):
        take(tmp_path, f'take_{i}', shift=0.002 * i)
    take(tmp_path, 'take_9', **bad)
    compared = takes.compare(shown(tmp_path))
    assert [bool(one.outlier) for one in compared] == [False] * 4 + [True]
    assert reason in compared[-1].outlier
    done = gdmp('takes', '.', '--plot', 'takes.png', cwd=tmp_path)
    assert done.returncode == 0 and drawn(tmp_path / 'takes.png') > 0.01, done.stderr


def test_an_outlier_among_three_takes_is_found(tmp_path):
    for name, shift in (('a', 0.0), ('b', 0.004), ('c', 0.12)):
        take(tmp_path, name, shift)
    assert [bool(one.outlier) for one in takes.compare(shown(tmp_path))] == [False, False, True]


def test_one_long_take_of_three_does_not_make_the_others_outliers(tmp_path):
    for name, seconds in (('a', 2.0), ('b', 2.1), ('c', 9.0)):
        take(tmp_path, name, seconds=seconds)
    assert [one.outlier for one in takes.compare(shown(tmp_path))] == [
        '', '', 'lasts 9.0 s, usual is 2.1 s']


def test_uneven_stamps_do_not_change_the_stiffness(tmp_path):
    s = np.linspace(0.0, 1.0, 200)
    paths, times = [], []
    for shift, warp in ((0.0, 1.0), (0.05, 1.0), (-0.05, 1.6), (0.02, 1.6)):
        t = s ** warp
        paths.append(np.column_stack([0.3 * t, shift * t ** 2, 0.01 * shift + 0 * t]))
        times.append(t)
    even = stiffness_at_samples([np.column_stack([0.3 * s, shift * s ** 2, 0.01 * shift + 0 * s])
                                 for shift in (0.0, 0.05, -0.05, 0.02)], [s] * 4)
    uneven = stiffness_at_samples(paths, times)
    np.testing.assert_allclose(np.linalg.eigvalsh(uneven[0]), np.linalg.eigvalsh(even[0]),
                               rtol=0.05)


def test_of_two_takes_none_is_an_outlier(tmp_path):
    take(tmp_path, 'a')
    take(tmp_path, 'b', shift=0.2)
    assert not any(one.outlier for one in takes.compare(shown(tmp_path)))


def test_a_dropped_take_is_moved_and_kept(tmp_path):
    for name in ('a', 'b'):
        take(tmp_path, name)
    assert takes.drop(tmp_path, 'a') == tmp_path / 'dropped' / 'a'
    take(tmp_path, 'a')
    assert takes.drop(tmp_path, 'a') == tmp_path / 'dropped' / 'a_2'
    assert [bag.name for bag in takes.takes_in(tmp_path)] == ['b']
    recordings.read(tmp_path / 'dropped' / 'a')
    with pytest.raises(DataError, match='no such take; there are b'):
        takes.drop(tmp_path, 'c')


def test_stiffness_is_high_where_takes_agree_and_low_where_they_vary(tmp_path):
    for i, shift in enumerate((0.0, 0.08, -0.08, 0.04)):
        take(tmp_path, f'take_{i}', shift)
    stiff, source = recordings.with_stiffness(shown(tmp_path), 'auto', 100.0, 900.0)
    assert source == 'variance'
    # They differ in y towards the end.
    profile = stiff[0].points[:, 7:].reshape(-1, 3, 3)
    assert profile[5, 1, 1] > 2.0 * profile[-5, 1, 1]
    values = np.linalg.eigvalsh(profile)
    assert values.min() > 99.0 and values.max() < 901.0


def test_the_source_of_the_stiffness_can_be_chosen(tmp_path):
    for name in ('a', 'b'):
        take(tmp_path, name, stiffness=True)
    both = shown(tmp_path)
    assert recordings.with_stiffness(both)[1] == 'recorded'
    assert recordings.with_stiffness(both, 'none')[0][0].points.shape[1] == 7
    assert recordings.with_stiffness(both, 'variance')[0][0].points.shape[1] == 16
    take(tmp_path, 'c')
    with pytest.raises(DataError, match='c: no stiffness was recorded'):
        recordings.with_stiffness(shown(tmp_path))
    with pytest.raises(DataError, match='two takes or more'):
        recordings.with_stiffness(shown(tmp_path)[2:], 'variance')
    assert recordings.with_stiffness(shown(tmp_path)[2:])[1] == 'none'
