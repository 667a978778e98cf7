"""
Commands and Python on every page are run, or else checked; every link leads somewhere.

Blocks say in their first line what they are: ``bash`` is run, page by page, each page as one
script in a folder of its own. After ``bash`` may come: ``long`` (covered by other tests: the
arguments are checked), ``by-hand`` (needs somebody: the arguments are checked), ``ros2`` (run
where the tools of ROS are), ``web`` (run where the web is), ``elsewhere`` (another machine, or
the administrator's rights). ``python`` is run; ``python file=`` and ``patch=`` change a copy of
the package, in which ``python test`` is run (``test-long`` if GDMP_TEST_LONG is set).
"""
import importlib
import os
from pathlib import Path
import re
import shlex
import shutil
import subprocess
import sys
from typing import NamedTuple

import mujoco
import pytest
import yaml

from gdmp_ros.cli.main import parser
from gdmp_ros.ros import messages

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')])
KINDS = ('', 'long', 'by-hand', 'ros2', 'web', 'elsewhere')
#: What a page has left running must not have died.
_STILL_THERE = ('set +x; if [ -n "$(jobs -p)" ]; then sleep 4; fi\n'
                'for job in $(jobs -p); do kill -0 "$job" || { echo "$job has died"; exit 7; }; '
                'done\n')
#: What a page takes for granted: files that an earlier page has made, names in pieces of Python.
_SKILL = 'gdmp record lasa GShape -o demos\ngdmp learn demos/GShape_1 -o skill.json\n'
BEFORE = {f'docs/{name}.md': _SKILL for name in ('looking', 'nodes', 'controllers')}
NAMES = {'docs/skills.md': """
import numpy as np
from gdmp_ros import *
from gdmp_ros.dmp import fit_report
from gdmp_ros.data import lasa
shown = lasa.robot_demonstrations('GShape')[0]
times, points, manifold = shown.times, shown.points, shown.manifold
one = other = Skill.learn(shown)
measured = y = one.start
motion = one.reproduce(one.duration / 10)
v, a = motion.velocities[5], 0.0 * motion.velocities[5]
point, other_point = motion.points[4], motion.points[7]
"""}


class Block(NamedTuple):
    """A fenced block of a page: language, what stands behind it, text."""

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
    """Make a folder with what lies in the project's."""
    path.mkdir()
    (path / 'config').symlink_to(ROOT / 'config')
    return path


def run_script(text, place):
    """
    Run a page's commands, and once more if they failed on a machine that stood still meanwhile.

    :returns: the folder in which they ran, and what they said
    """
    for attempt in ('first', 'second'):
        folder = make_folder(place / attempt)
        code, said = run_once(text, folder)
        if code == 0 or 'the time jumped' not in said:
            break
    assert code == 0, said[-6000:]
    return folder, said


def run_once(text, folder):
    """Run a page's commands on a DDS domain of their own; whatever is left running ends."""
    from gdmp_ros.util.dds_network import Domain
    domain = Domain()
    script = folder / '.page.sh'
    script.write_text('set -eo pipefail\n'
                      "trap 'kill $(jobs -p) 2>/dev/null || true; wait || true' EXIT\n"
                      + text + _STILL_THERE)
    environment = {**os.environ, **domain.environment(),
                   'PATH': os.pathsep.join([str(Path(sys.executable).parent),
                                            os.environ['PATH']])}
    try:
        with (folder / '.log').open('w') as log:
            done = subprocess.run(['bash', '-x', str(script)], cwd=folder, env=environment,
                                  stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                  start_new_session=True, timeout=560)
    finally:
        domain.release()
    return done.returncode, (folder / '.log').read_text()


@pytest.mark.timeout(1200)
@pytest.mark.parametrize('page', with_blocks('bash', ['', 'ros2', 'web']))
def test_commands_work_as_written(page, tmp_path):
    wanted = ['', *(['ros2'] if shutil.which('ros2') else []),
              *(['web'] if os.environ.get('GDMP_TEST_WEB') else [])]
    text = BEFORE.get(name_of(page), '') + ''.join(
        b.text for b in blocks(page) if b.language == 'bash' and b.kind in wanted)
    folder, said = run_script(text, tmp_path)
    for output in re.findall(r'-o (\S+\.(?:png|webp|mp4|json|html|csv|urdf|npz))', text):
        assert (folder / output).stat().st_size > 200, f'{output}: {said[-3000:]}'
        if output.endswith('.urdf'):
            mujoco.MjModel.from_xml_path(str(folder / output))
    assert 'Traceback' not in said


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
                parser().parse_args(words[1:])
            elif words[0] == 'make':
                assert re.search(rf'^{words[1]}:', (ROOT / 'Makefile').read_text(), re.M)
            else:
                assert words[0] == 'export', words


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
    """Where the tools are missing, at least their words are held against the package."""
    launched = (ROOT / 'launch' / 'arm.launch.py').read_text()
    launched += (ROOT / 'launch' / 'several.launch.py').read_text()
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
                    set_message_fields(message_class(words[5]), yaml.safe_load(words[6]))
                    seen += 1
    assert seen > 3


def message_class(name):
    package, _, kind = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), kind)


def set_message_fields(kind, values):
    """Make a message of a type as the command line does: what is not named has its default."""
    message = kind()
    for name, value in values.items():
        if isinstance(value, dict):
            value = set_message_fields(type(getattr(message, name)), value)
        setattr(message, name, value)
    if hasattr(message, 'header') and hasattr(message, 'pose'):
        messages.checked_pose(message, 'panda_link0')  # our nodes would take it
    return message


@pytest.mark.parametrize('page', with_blocks('python', ['']))
def test_python_works_as_written(page, tmp_path):
    code = NAMES.get(name_of(page), '') + ''.join(
        b.text for b in blocks(page) if b.language == 'python' and not b.kind)
    done = subprocess.run([sys.executable, '-c', code], cwd=make_folder(tmp_path / 'folder'),
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize('page', with_blocks('python', ['test']))
def test_changes_of_the_package_work_as_written(page, tmp_path):
    copy = tmp_path / 'gdmp_ros'
    shutil.copytree(ROOT / 'gdmp_ros', copy, ignore=shutil.ignore_patterns('__pycache__'))
    wanted = ['test', *(['test-long'] if os.environ.get('GDMP_TEST_LONG') else [])]
    code = ''
    for block in blocks(page):
        what, _, path = block.kind.partition('=')
        if what == 'file':
            (tmp_path / path).write_text(block.text)
        elif what == 'patch':
            text = (tmp_path / path).read_text()
            for old, new in hunks(block.text):
                assert text.count(old) == 1, old
                text = text.replace(old, new)
            (tmp_path / path).write_text(text)
        elif block.language == 'python' and block.kind in wanted:
            code += block.text
    environment = {**os.environ, 'PYTHONPATH': str(tmp_path),
                   'GDMP_CACHE': str(tmp_path / 'cache')}
    done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, env=environment,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def hunks(text):
    """Lines taken away and lines put in their place, one pair after another."""
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
