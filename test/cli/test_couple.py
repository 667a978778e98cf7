"""`gdmp edit couple`: two skill files become one."""
import numpy as np
import pytest

from gdmp_ros.demo.tray import taught_skills
from gdmp_ros.dmp.skill import Skill
from test.commands import gdmp


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp('skills')
    for name, skill in zip(('left', 'right'), taught_skills(np.random.default_rng(5))):
        skill.save(made / f'{name}.json')
    return made


@pytest.mark.parametrize('kind', ['pose', 'relative', 'distance'])
def test_two_files_become_one(folder, kind):
    done = gdmp('edit', 'couple', 'left.json', 'right.json', '-o', f'{kind}.json', '--kind', kind,
                cwd=folder)
    assert done.returncode == 0, done.stderr
    assert 'left_position' in done.stdout and 'right_position' in done.stdout
    skill = Skill.load(folder / f'{kind}.json')
    coupling, = skill.couplings
    assert coupling.kind == kind and not coupling.leads
    for point in skill.reproduce(0.05).points:
        assert coupling.deviation(skill.manifold, point).max() < 1e-4


def test_another_relation_and_a_leader(folder):
    relation = ['0', '0.56', '0', '1', '0', '0', '0']
    done = gdmp('edit', 'couple', 'left.json', 'right.json', '-o', 'led.json', '--leads',
                '--relation', *relation, '--names', 'one', 'two', cwd=folder)
    assert done.returncode == 0, done.stderr
    coupling, = Skill.load(folder / 'led.json').couplings
    assert coupling.leads and coupling.relation == tuple(map(float, relation))
    assert coupling.first == ('one_position', 'one_orientation')


@pytest.mark.parametrize(('words', 'message'), [
    (['--relation', '1', '2'], 'expected 7'), (['--kind', 'distance', '--relation', '-1'], '-1'),
    (['--kind', 'glue'], 'glue')])
def test_a_wrong_relation_is_refused_and_nothing_is_written(folder, words, message):
    done = gdmp('edit', 'couple', 'left.json', 'right.json', '-o', 'wrong.json', *words,
                cwd=folder)
    assert done.returncode in (1, 2) and message in done.stderr
    assert not (folder / 'wrong.json').exists()
