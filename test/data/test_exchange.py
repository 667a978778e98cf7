"""Demonstrations and skills are converted to other formats and back."""
import json

import numpy as np
import pytest

from gdmp_ros import Skill
from gdmp_ros.cli.main import main
from gdmp_ros.data import episodes, foreign, recordings
from gdmp_ros.errors import DataError


@pytest.fixture(scope='module')
def shown(letters):
    return letters[0]


@pytest.fixture(scope='module')
def skill_file(shown, tmp_path_factory):
    path = tmp_path_factory.mktemp('skill') / 'skill.json'
    Skill.learn(shown).save(path)
    return path


@pytest.mark.parametrize('suffix', ['csv', 'npz'])
def test_a_demonstration_is_read_back_exactly(shown, tmp_path, suffix):
    path = tmp_path / f'shown.{suffix}'
    getattr(foreign, f'write_{suffix}')(path, shown)
    again = episodes.read(path).demonstration
    np.testing.assert_array_equal(again.times, shown.times)
    np.testing.assert_array_equal(again.points, shown.points)
    assert again.manifold == shown.manifold


def test_bags_are_converted_to_tables_and_back(shown, tmp_path):
    bag, table, again = tmp_path / 'bag', tmp_path / 'new' / 'table.csv', tmp_path / 'again'
    recordings.write(bag, shown, 'base', 10 ** 18)
    assert main(['convert', str(bag), '-o', str(table)]) == 0
    assert table.read_text().startswith('time,x,y,z,qw,qx,qy,qz,k11,k12,k13,k21')
    assert main(['convert', str(table), '-o', str(again), '--frame', 'base']) == 0
    first, second = recordings.read(bag), recordings.read(again)
    np.testing.assert_allclose(second.demonstration.points, first.demonstration.points,
                               atol=1e-15)
    assert second.frame == 'base'
    assert main(['convert', str(table), '-o', str(again)]) == 1  # exists already
    assert main(['convert', str(table), '-o', str(again), '--overwrite']) == 0


@pytest.mark.parametrize('change, reason', [
    (lambda lines: lines[1:], 'the first line has numbers'),
    (lambda lines: [*lines[:4], lines[4].replace(',', ',x', 1), *lines[5:]], 'sample 3'),
    (lambda lines: [*lines[:4], lines[4] + ',1.0', *lines[5:]], 'line 5: 18 numbers'),
    (lambda lines: [*lines[:4], lines[3], *lines[5:]], 'sample 3: time does not increase'),
    (lambda lines: [], 'there is nothing in it')])
def test_a_damaged_table_is_refused_with_its_line(shown, tmp_path, change, reason):
    path = tmp_path / 'shown.csv'
    foreign.write_csv(path, shown)
    path.write_text('\n'.join(change(path.read_text().splitlines())))
    with pytest.raises(DataError, match=reason):
        episodes.read(path)


def test_an_archive_with_objects_or_other_shapes_is_refused(tmp_path):
    path = tmp_path / 'bad.npz'
    np.savez(path, times=np.array([{}], dtype=object), points=np.zeros((1, 7)))
    with pytest.raises(DataError, match='cannot be read'):
        episodes.read(path)
    np.savez(path, times=np.arange(5.0), points=np.zeros((5, 9)))
    with pytest.raises(DataError, match=r'points \(5, 9\)'):
        episodes.read(path)


def test_a_skill_is_converted_to_its_motion(skill_file, tmp_path):
    path = tmp_path / 'motion.csv'
    assert main(['convert', str(skill_file), '-o', str(path), '--rate-hz', '50']) == 0
    moved, skill = episodes.read(path).demonstration, Skill.load(skill_file)
    assert moved.times[1] == pytest.approx(0.02) and moved.duration == skill.duration
    np.testing.assert_allclose(moved.points[0], skill.start, atol=1e-9)


def test_movement_primitives_and_back(skill_file, tmp_path, capsys):
    pytest.importorskip('movement_primitives')
    theirs, ours = tmp_path / 'cartesian_dmp.json', tmp_path / 'ours.json'
    assert main(['convert', str(skill_file), '-o', str(theirs),
                 '--as', 'movement_primitives']) == 0
    assert 'the pose only' in capsys.readouterr().out
    from movement_primitives.io import read_json
    _, poses = read_json(str(theirs)).open_loop()
    assert main(['convert', str(theirs), '-o', str(ours)]) == 0
    back = foreign.motion(Skill.load(ours), 0.01)
    near = np.min(np.linalg.norm(back.points[:, None, :3] - poses[None, :, :3], axis=2), axis=1)
    assert near.max() < 2e-3 and list(back.manifold.names) == ['position', 'orientation']


def test_modules_named_in_a_file_are_not_imported(skill_file, tmp_path):
    pytest.importorskip('movement_primitives')
    path = tmp_path / 'evil.json'
    path.write_text(json.dumps({'module': 'movement_primitives.os', 'class': 'system'}))
    with pytest.raises(DataError, match="is a 'system', expected a CartesianDMP"):
        foreign.from_movement_primitives(path)
    path.write_text(json.dumps({**foreign._DMP, 'n_weights_per_dim': 'many'}))
    with pytest.raises(DataError, match='damaged CartesianDMP'):
        foreign.from_movement_primitives(path)
    assert not foreign.is_foreign(skill_file)
