"""
Commands and Python on every page are run, or their arguments are checked; all links exist.

The first line of a block says what it is. ``bash`` is run (``make test-long``): each page is one
script, in its own folder. After ``bash`` may follow: ``long`` (run by ``make pages``; otherwise
the arguments are checked), ``by-hand`` (needs a person, a robot, or files of one's own: the
arguments are checked), ``ros2`` (run if the ROS tools are installed), ``web`` (run if there is a
network), ``elsewhere`` (another machine, or administrator rights). ``python`` is run. ``python
file=`` and ``python patch=`` change a copy of the package, in which ``python test`` is run.
"""
import importlib
import importlib.util
import os
from pathlib import Path
import re
import shlex
import shutil
import socket
import subprocess
import sys
from typing import NamedTuple

import mujoco
import pytest
import yaml

from experiments.__main__ import PROGRAM as EXPERIMENTS
from gdmp_ros.cli.main import PROGRAM as GDMP
from gdmp_ros.ros import messages
from gdmp_ros.util.dds_network import Domain
from test.urdf import ur5e

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')])
TABLES = (ROOT / 'docs' / 'nodes.md').read_text()
KINDS = ('', 'long', 'by-hand', 'ros2', 'web', 'elsewhere')
#: Whether everything that pages tell is run, for hours.
EVERYTHING = bool(os.environ.get('GDMP_TEST_PAGES'))
#: Longest time for the commands of a page [s].
_LONGEST_S = 4 * 3600 if EVERYTHING else 560
#: Processes that a page has started, and not ended, must still run at its end.
_END = 'the page has ended'
_STILL_THERE = ('set +x; if [ -n "$(jobs -p)" ]; then sleep 4; fi\n'
                'for job in $(jobs -p); do kill -0 "$job" || { echo "$job has died"; exit 7; }; '
                f'done; echo {_END}\n')
#: What a page assumes: files of an earlier page, names in pieces of Python.
_SKILL = 'gdmp examples lasa GShape -o demos\ngdmp learn demos/GShape_1 -o skill.json\n'
BEFORE = {f'docs/{name}.md': _SKILL for name in ('looking', 'nodes', 'controllers')}
BEFORE['docs/own_robot.md'] = f"cat > robot.urdf <<'URDF'\n{ur5e()}\nURDF\n"
_SKILLS = """
import gdmp_ros
import numpy as np
from gdmp_ros import *
from gdmp_ros.learning import fit_report
from gdmp_ros.data import lasa
shown = lasa.robot_demonstrations('GShape')[0]
times, points, manifold = shown.times, shown.points, shown.manifold
one = other = left = right = Skill.learn(shown)
measured = y = one.start
motion = one.reproduce(one.duration / 10)
v, a = motion.velocities[5], 0.0 * motion.velocities[5]
point, other_point = motion.points[4], motion.points[7]
takes = lasa.robot_demonstrations('GShape')[:4]
first, second, third, _ = takes
start, goal, via = first.points[0], first.points[-1], motion.points[4]
covariance = 1e-4 * np.eye(shown.manifold.tangent_size)
"""
NAMES = {'docs/skills.md': _SKILLS, 'docs/adapting_skills.md': _SKILLS, 'docs/obstacles.md': """
from gdmp_ros.cli.main import main
main(['examples', 'skills', 'pick-and-place', '-o', 'gallery'])
""", 'docs/frames.md': """
import numpy as np
from gdmp_ros.data import lasa
one = lasa.robot_demonstrations('GShape')[0]
times, points, manifold = one.times, one.points, one.manifold
box, hole = points[0, :7], points[-1, :7]
hole_now = seen = hole + [0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0]
seconds, conveyor = 0.0, [0.01, 0.0, 0.0, 0.0, 0.0, 0.0]
""", 'docs/rhythmic.md': """
import numpy as np
from gdmp_ros import *
times = np.arange(0.0, 8.0, 0.01)
angle = 2.0 * np.pi * times / 2.5
shown = Demonstration(times, 0.1 * np.column_stack([np.cos(angle), np.sin(angle)]), Euclidean(2))
first = second = third = shown
point, centre = np.array([0.2, 0.1]), np.array([0.3, 0.0])
"""}


def reaches_the_network():
    """Whether models can be fetched."""
    try:
        socket.create_connection(('github.com', 443), timeout=5.0).close()
    except OSError:
        return False
    return True


def docker_answers():
    """Whether images can be built: the client alone, without an engine, cannot."""
    return bool(EVERYTHING and shutil.which('docker')) and subprocess.run(
        ['docker', 'version'], capture_output=True).returncode == 0


class Block(NamedTuple):
    """A fenced block of a page: language, the rest of its first line, text."""

    language: str
    kind: str
    text: str


def blocks(page):
    found = re.findall(r'^```([^\n`]*)\n(.*?)^```$', page.read_text(), re.M | re.S)
    return [Block(*(head.split(maxsplit=1) + ['', ''])[:2], text) for head, text in found]


def name_of(page):
    return str(page.relative_to(ROOT))


def with_blocks(language, kinds):
    return [pytest.param(page, id=name_of(page)) for page in PAGES
            if any(b.language == language and b.kind in kinds for b in blocks(page))]


def make_folder(path):
    """Make a folder with the configuration of the project."""
    path.mkdir()
    (path / 'config').symlink_to(ROOT / 'config')
    return path


def run_script(text, place):
    """
    Run the commands of a page.

    :returns: the folder in which they ran, and their output
    """
    folder = make_folder(place / 'folder')
    code, said = run_once(text, folder)
    assert code == 0, said[-6000:]
    return folder, said


def run_once(text, folder):
    """Run the commands of a page in their own DDS domain; end everything they started."""
    script = folder / '.page.sh'
    script.write_text('set -eo pipefail\n'
                      "trap 'kill $(jobs -p) 2>/dev/null || true; wait || true' EXIT\n"
                      + text.replace('; wait\n', '; wait; jobs\n') + _STILL_THERE)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ['PATH']])
    with Domain() as domain, (folder / '.log').open('w') as log:
        done = subprocess.run(['bash', '-x', str(script)], cwd=folder,
                              env={**os.environ, **domain.environment(), 'PATH': path,
                                   'PYTHONPATH': str(ROOT)},
                              stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                              start_new_session=True, timeout=_LONGEST_S)
    return done.returncode, (folder / '.log').read_text()


@pytest.mark.long
@pytest.mark.timeout(_LONGEST_S + 640)
@pytest.mark.parametrize('page', with_blocks('bash', ['', 'ros2', 'web'] + EVERYTHING * ['long']))
def test_commands_work_as_written(page, tmp_path):
    wanted = ['', *(['ros2'] if shutil.which('ros2') else []),
              *(['long'] if EVERYTHING else []),
              *(['web'] if EVERYTHING and reaches_the_network() else [])]
    text = BEFORE.get(name_of(page), '') + ''.join(
        b.text for b in blocks(page) if b.language == 'bash' and b.kind in wanted)
    folder, said = run_script(text, tmp_path)
    for output in re.findall(r'-o (\S+\.(?:png|webp|mp4|json|html|csv|urdf|npz))', text):
        assert (folder / output).stat().st_size > 200, f'{output}: {said[-3000:]}'
        if output.endswith('.urdf'):
            mujoco.MjModel.from_xml_path(str(folder / output))
    # What is killed at the end may just be starting.
    assert 'Traceback' not in said.split(_END)[0]


@pytest.mark.skipif(not docker_answers(), reason='make pages, where a Docker engine answers')
@pytest.mark.timeout(_LONGEST_S)
def test_the_image_of_the_docker_file_is_built_and_runs():
    for words in (['build', '-t', 'gdmp_ros', '-f', 'examples/docker/Dockerfile', '.'],
                  ['run', '--rm', 'gdmp_ros', 'gdmp', '--version']):
        subprocess.run(['docker', *words], cwd=ROOT, check=True)


def commands(text):
    lines = re.sub(r'\\\n', ' ', text).splitlines()
    return [shlex.split(line, comments=True) for line in lines if line.split('#')[0].strip()]


@pytest.mark.parametrize('page', with_blocks('bash', ['long', 'by-hand']))
def test_long_commands_are_well_formed(page):
    for block in blocks(page):
        if block.language != 'bash' or block.kind not in ('long', 'by-hand'):
            continue
        for words in commands(block.text):
            if words[0] == 'gdmp':
                GDMP.parse(words[1:])
            elif words[:3] == ['python', '-m', 'experiments']:
                EXPERIMENTS.parse(words[3:])
            elif words[0] == 'make':
                assert re.search(rf'^{words[1]}:', (ROOT / 'Makefile').read_text(), re.M)
            elif words[:2] == ['python', '-m']:
                assert importlib.util.find_spec(words[2]), words
            elif words[0] != 'export':
                check_node(words)


def check_node(words):
    """A node that is started without ROS's launch: it exists, with the parameters of ``-p``."""
    (table,) = yaml.safe_load((ROOT / 'config' / f'{words[0]}.yaml').read_text()).values()
    given = [words[k + 1].split(':=')[0] for k, word in enumerate(words) if word == '-p']
    assert set(given) <= set(table['ros__parameters']), words


def test_every_block_says_what_it_is_and_commands_stand_in_blocks():
    for page in PAGES:
        for block in blocks(page):
            if block.language == 'bash':
                assert block.kind in KINDS, f'{page}: {block.kind}'
        outside = re.sub(r'^```.*?^```$', '', page.read_text(), flags=re.M | re.S)
        loose = re.findall(r'^ {4}(?:gdmp|make|ros2|pip|export|panda_sim|trajectory_server) .*',
                           outside, re.M)
        assert not loose, f'{page}: {loose}'


def test_what_needs_ros_s_tools_names_topics_services_and_arguments_that_there_are():
    """Without the ROS tools, at least the arguments are compared with the package."""
    launched = ''.join(path.read_text() for path in (ROOT / 'launch').glob('*.py'))
    seen = 0
    for page in PAGES:
        for block in blocks(page):
            if block.language != 'bash':
                continue
            for words in commands(block.text):
                if words[:2] == ['ros2', 'launch']:
                    assert (ROOT / 'launch' / words[3]).is_file(), words
                    for argument in words[4:]:
                        name = argument.split(':=')[0]
                        assert name == '--show-args' or f"'{name}'" in launched, words
                    seen += 1
                elif words[:3] == ['ros2', 'topic', 'pub']:
                    set_message_fields(interface(words[5]), yaml.safe_load(words[6]))
                    seen += 1
                elif words[:2] in (['ros2', 'service'], ['ros2', 'action']):
                    name, kind, *fields = words[3:]
                    package, what, of = kind.split('/')
                    shown = f'{"action " if what == "action" else ""}{package}/{of}'
                    assert any(f'`~/{name.rpartition("/")[2]}`' in line and f'| {shown} |' in line
                               for line in TABLES.splitlines()), words
                    request = interface(kind)
                    set_message_fields(request.Goal if what == 'action' else request.Request,
                                       yaml.safe_load(fields[0]) if fields else {})
                    seen += 1
    assert seen > 3


def interface(name):
    package, what, kind = name.split('/')
    return getattr(importlib.import_module(f'{package}.{what}'), kind)


def set_message_fields(kind, values):
    """Make a message of a type as the command line does; other fields keep their default."""
    message = kind()
    for name, value in values.items():
        if isinstance(value, dict):
            value = set_message_fields(type(getattr(message, name)), value)
        setattr(message, name, value)
    if hasattr(message, 'header') and hasattr(message, 'pose'):
        messages.checked_pose(message, 'panda_link0')  # our nodes accept it
    return message


@pytest.mark.long
@pytest.mark.parametrize('page', with_blocks('python', ['']))
def test_python_works_as_written(page, tmp_path):
    code = NAMES.get(name_of(page), '') + ''.join(
        b.text for b in blocks(page) if b.language == 'python' and not b.kind)
    done = subprocess.run([sys.executable, '-c', code], cwd=make_folder(tmp_path / 'folder'),
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize('page', with_blocks('python', ['test']))
def test_changes_of_the_package_work_as_written(page, tmp_path):
    for folder in ('gdmp_ros', 'test/manifolds'):
        shutil.copytree(ROOT / folder, tmp_path / folder,
                        ignore=shutil.ignore_patterns('__pycache__'))
    for name in ('__init__.py', 'conftest.py'):
        shutil.copy(ROOT / 'test' / name, tmp_path / 'test' / name)
    code = ''
    for block in blocks(page):
        what, _, path = block.kind.partition('=')
        if what == 'file':
            (tmp_path / path).write_text(block.text)
        elif what == 'patch':
            apply_patch(tmp_path / path, block.text)
        elif block.language == 'python' and block.kind == 'test':
            code += block.text
    run_in_copy(tmp_path, '-c', code)
    # The laws, for the manifold that the page adds.
    run_in_copy(tmp_path, '-m', 'pytest', '-q', '-k', 'Torus', 'test/manifolds')


def apply_patch(path, patch):
    text = path.read_text()
    for old, new in hunks(patch):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text)


def run_in_copy(folder, *arguments):
    """Run Python with a copy of the package; its kernels have the cache of all."""
    done = subprocess.run([sys.executable, *arguments], cwd=folder,
                          env={**os.environ, 'PYTHONPATH': str(folder)}, capture_output=True,
                          text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def hunks(text):
    """Removed lines and their replacement, in pairs."""
    found = re.findall(r'((?:^- .*\n)+)((?:^\+ .*\n)+)', text, re.M)
    return [tuple(''.join(line[2:] for line in side.splitlines(keepends=True))
                  for side in pair) for pair in found]


def anchors(page):
    heads = re.findall(r'^#+ (.*)$', re.sub(r'^```.*?^```$', '', page.read_text(),
                                            flags=re.M | re.S), re.M)
    return {re.sub(r'[^\w\- ]', '', head.lower()).strip().replace(' ', '-') for head in heads}


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    for target in re.findall(r'\]\(([^)\s]+)\)', page.read_text()):
        if re.match(r'[a-z]+:', target):
            continue
        path, _, anchor = target.partition('#')
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f'{page}: {target}'
        if anchor:
            assert anchor in anchors(there), f'{page}: {target}'


@pytest.mark.long
def test_the_site_is_built_without_a_warning(tmp_path):
    done = subprocess.run([sys.executable, '-m', 'sphinx', '-q', '-W', '--keep-going', '-d',
                           str(tmp_path / 'doctrees'), str(ROOT / 'docs'),
                           str(tmp_path / 'site')], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-6000:]
    index = (tmp_path / 'site' / 'index.html').read_text()
    built = {path.relative_to(tmp_path / 'site').with_suffix('.md')
             for path in (tmp_path / 'site').rglob('*.html')}
    for page in (ROOT / 'docs').rglob('*.md'):
        assert page.relative_to(ROOT / 'docs') in built
    api = (tmp_path / 'site' / 'api.html').read_text()
    for name in ('gdmp_ros.dmp.skill.Skill.learn', 'gdmp_ros.dmp.rollout.Rollout.retarget'):
        assert f'id="{name}"' in api
    assert 'first_skill.html' in index and (tmp_path / 'site' / 'skill.schema.json').is_file()
