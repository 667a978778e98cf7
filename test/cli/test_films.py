"""Films and descriptions from the command line."""
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.execution import execute
from test.commands import gdmp


@pytest.fixture(scope='module')
def skill(letter):
    return letter


@pytest.fixture(scope='module')
def folder(skill, tmp_path_factory):
    path = tmp_path_factory.mktemp('films')
    skill.save(path / 'skill.json')
    return path


def test_a_skill_is_executed_by_the_simulated_arm(skill):
    done = execute(skill, Arm(), rest_s=0.3)
    deviation = np.linalg.norm(done.measured[:, :3] - done.references[:, :3], axis=1)
    assert len(done.joints) == len(done.references) > 4500
    assert deviation.max() < 0.002
    assert np.linalg.norm(done.references[-1, :3] - skill.goal[:3]) < 1e-3


@pytest.mark.long
def test_films_have_the_stated_number_of_pictures(folder):
    av = pytest.importorskip('av')
    done = gdmp('show', 'skill.json', '-o', 'skill.mp4', '--playback', '2', '--fps', '10',
                cwd=folder)
    if 'no picture of the arm' in done.stderr:
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    count = int(done.stdout.split(': ')[1].split()[0])
    with av.open(str(folder / 'skill.mp4')) as film:
        frames = [frame.to_ndarray(format='rgb24').astype(float)
                  for frame in film.decode(video=0)]
        assert film.streams.video[0].average_rate == 10
    assert len(frames) == count > 5
    assert frames[0].std() > 20.0  # not one colour
    assert np.abs(frames[-1] - frames[0]).max() > 100.0  # something has moved


def test_invalid_arguments_are_refused(folder):
    for words, said in ((('skill.json', '-o', 'x.avi'), 'ends in .png'),
                        (('skill.json', '-o', 'x.mp4', '--playback', '0'), '--playback: is 0'),
                        (('nothing.json', '-o', 'x.mp4'), 'nothing.json'),
                        (('skill.json', '-o', 'x.mp4', '--model', 'oven.xml'), 'no such file')):
        done = gdmp('show', *words, cwd=folder)
        assert done.returncode in (1, 2) and said in done.stderr
    assert not list(folder.glob('x.*')) and not list(folder.glob('.*'))


def test_the_description_goes_to_the_terminal_or_to_a_file(folder):
    shown = gdmp('arm', 'urdf', '--frame', 'left_link0')
    assert shown.returncode == 0
    robot = ET.fromstring(shown.stdout)
    assert robot.find('link').get('name') == 'left_link0'
    done = gdmp('arm', 'urdf', '-o', 'panda.urdf', cwd=folder)
    assert done.returncode == 0
    assert ET.parse(folder / 'panda.urdf').getroot().get('name') == 'panda'
