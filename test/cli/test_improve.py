"""``gdmp improve``: tasks as files and executables, refusals before any roll-out, the page."""
import json

import numpy as np
import pytest

from gdmp_ros import Demonstration, Skill
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.profiles import minimum_jerk
from test.commands import gdmp

#: Much tried is not needed to see that it works.
LITTLE = ('--updates', '2', '--samples', '3', '--situations', '1', '--held-out', '2',
          '--vary-path', '3')
SCORE = """
import numpy as np

def score(trial):
    away = np.linalg.norm(trial.measured[:, :3] - [0.35, 0.05, 0.45], axis=1).min()
    return {'away': away, 'torque': 1e-5 * np.abs(trial.torques).max()}
"""
EXECUTABLE = """#!/usr/bin/env python3
import sys
import numpy as np
trial = np.load(sys.argv[1])
print('cost', np.linalg.norm(trial['measured'][:, :3] - [0.35, 0.05, 0.45], axis=1).min())
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    made, s = tmp_path_factory.mktemp('improve'), np.linspace(0.0, 1.0, 100)
    points = np.tile(Arm().pose_at(Arm().home), (len(s), 1))
    points[:, 1] += 0.1 * minimum_jerk(s)
    Skill.learn(Demonstration(s, points, tool_manifold(None)), 20,
                provenance={'by': 'hand'}).save(made / 'skill.json')
    (made / 'reach.py').write_text(SCORE)
    (made / 'score').write_text(EXECUTABLE)
    (made / 'score').chmod(0o755)
    return made


def test_a_python_file_scores_and_a_killed_run_is_resumed(folder):
    words = ('improve', 'reach.py', '--skill', 'skill.json', *LITTLE, '--resume', 'made.jsonl')
    done = gdmp(*words, '-o', 'better.json', cwd=folder)
    assert done.returncode == 0, done.stderr
    assert 'before: median cost' in done.stdout and 'after: median cost' in done.stdout
    better = Skill.load(folder / 'better.json')
    source = better.provenance['improved']
    assert source['task'] == 'reach.py' and source['skill'] == {'by': 'hand'}
    assert source['rollouts'] == 6
    page = (folder / 'better.html').read_text()
    assert 'Cost over roll-outs' in page and 'http-equiv="refresh"' not in page

    lines = (folder / 'made.jsonl').read_text().splitlines()
    assert len(lines) == 1 + 6 + 4
    (folder / 'made.jsonl').write_text('\n'.join(lines[:5]) + '\n["1/')
    done = gdmp(*words, '-o', 'again.json', cwd=folder)
    assert done.returncode == 0, done.stderr
    assert json.loads((folder / 'again.json').read_text()) == json.loads(
        (folder / 'better.json').read_text())
    # A file of other roll-outs is not taken.
    done = gdmp(*words, '-o', 'again.json', '--seed', '1', cwd=folder)
    assert done.returncode == 1 and 'not a journal of' in done.stderr


def test_an_executable_scores(folder):
    done = gdmp('improve', './score', '--skill', 'skill.json', *LITTLE[:4], '--situations', '1',
                '--held-out', '0', '--vary-via', '0.5', '--vary-duration', '-o', 'other.json',
                '--page', 'pages/other.html', cwd=folder)
    assert done.returncode == 0, done.stderr
    assert '7 numbers vary' in done.stdout
    assert (folder / 'pages' / 'other.html').exists()


@pytest.mark.parametrize('words, reason', [
    (['nothing.py', '-o', 'x.json'], 'nothing.py: there is no such file'),
    (['skill.json', '-o', 'x.json'], 'neither a Python file nor executable'),
    (['reach.py', '-o', 'x.json'], 'the task brings no skill: give --skill'),
    (['reach.py', '--skill', 'skill.json', '-o', 'x.txt'], '.json'),
    (['reach.py', '--skill', 'skill.json', '-o', 'x.json', '--samples', '1'], 'samples is 1'),
    (['reach.py', '--skill', 'skill.json', '-o', 'x.json', '--vary-stiffness', '1'],
     "'stiffness'"),
    (['reach.py', '--skill', 'skill.json', '-o', 'x.json', '--vary-via', '1.5'], '--vary-via'),
    (['broken.py', '--skill', 'skill.json', '-o', 'x.json'], 'ZeroDivisionError'),
    (['empty.py', '--skill', 'skill.json', '-o', 'x.json'], 'expected a function score'),
    (['text.py', '--skill', 'skill.json', '-o', 'x.json', *LITTLE], 'expected a number'),
    (['./silent', '--skill', 'skill.json', '-o', 'x.json', *LITTLE], 'expected a number as the')])
def test_what_cannot_be_is_refused_and_nothing_is_written(folder, words, reason):
    (folder / 'broken.py').write_text('1 / 0')
    (folder / 'empty.py').write_text('')
    (folder / 'text.py').write_text('def score(trial):\n    return "good"\n')
    (folder / 'silent').write_text('#!/bin/sh\n')
    (folder / 'silent').chmod(0o755)
    done = gdmp('improve', *words, cwd=folder)
    assert done.returncode in (1, 2) and reason in done.stderr, done.stderr
    assert 'Traceback' not in done.stderr and not (folder / 'x.json').exists()
