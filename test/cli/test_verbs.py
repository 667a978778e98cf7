"""The command ``gdmp`` as a user runs it: as processes."""
import csv
import json
from pathlib import Path
import re
import signal
import subprocess
import sys

import pytest

import gdmp_ros
from gdmp_ros import Skill
from gdmp_ros.cli.main import PROGRAM
from gdmp_ros.data import recordings
from test.commands import GDMP, gdmp, gdmp_process
from test.motions import circles
from test.pictures import drawn

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Recordings of a letter and a skill learned from the first."""
    path = tmp_path_factory.mktemp('letters')
    assert gdmp('examples', 'lasa', 'GShape', '-o', path / 'demos').returncode == 0
    assert gdmp('learn', path / 'demos' / 'GShape_1', '-o', path / 'skill.json').returncode == 0
    return path


def test_every_verb_has_help_with_an_example(capsys):
    for verb in PROGRAM.verbs:
        with pytest.raises(SystemExit) as ended:
            PROGRAM.parse([*verb.split(), '--help'])
        assert ended.value.code == 0
        assert re.search(rf'examples?:\n(  .*\n)*?  gdmp {verb}', capsys.readouterr().out), verb


def test_help_imports_neither_the_library_nor_ros():
    code = """
import sys
from gdmp_ros.cli.main import PROGRAM
for verb in PROGRAM.verbs:
    try:
        PROGRAM.parse([*verb.split(), '--help'])
    except SystemExit:
        pass
heavy = {'numba', 'numpy', 'scipy', 'sklearn', 'plotly', 'matplotlib', 'rclpy', 'mujoco',
         'rosbags', 'rich'} & set(sys.modules)
assert not heavy, heavy
"""
    subprocess.run([sys.executable, '-c', code], check=True, stdout=subprocess.DEVNULL)


def test_gdmp_alone_its_version_and_misspelt_verbs_are_answered():
    alone = gdmp()
    assert alone.returncode == 0 and 'gdmp learn demos -o skill.json' in alone.stdout
    assert all(f'\n  {verb}' in alone.stdout for verb in PROGRAM.verbs)
    assert gdmp('--help').stdout == alone.stdout
    assert gdmp('--version').stdout == f'gdmp {gdmp_ros.__version__}\n'
    misspelt = gdmp('lern')
    assert misspelt.returncode == 2 and "did you mean 'learn'?" in misspelt.stderr
    former = gdmp('inspect', 'skill.json')
    assert former.returncode == 2 and "did you mean 'show'?" in former.stderr
    half = gdmp('edit', 'skill.json')
    assert half.returncode == 2 and 'edit couple, edit refine' in half.stderr
    unknown = gdmp('xyzzy')
    assert unknown.returncode == 2 and 'see gdmp --help' in unknown.stderr


@pytest.mark.parametrize('line, expected', [
    ('gdmp e', {'edit', 'examples'}), ('gdmp edit ', {'couple', 'refine'}),
    ('gdmp arm f', {'friction'}), ('gdmp learn takes --end ', {'rest', 'moving'}),
    ('gdmp check skill.json --goal', {'--goal-position'})])
def test_the_shell_completes_verbs_options_and_choices(tmp_path, line, expected):
    answer = tmp_path / 'answer'
    done = gdmp_process(_ARGCOMPLETE='1', _ARGCOMPLETE_STDOUT_FILENAME=str(answer), COMP_LINE=line,
                        COMP_POINT=str(len(line)), COMP_TYPE='9')
    assert done.returncode == 0, done.stderr
    assert {word.strip() for word in answer.read_text().split('\v')} == expected


def test_warm_up_compiles_what_the_verbs_and_nodes_need():
    assert gdmp('doctor', '--compile').returncode == 0
    again = gdmp('doctor', '--compile')
    assert again.returncode == 0 and 'the kernels are compiled: ' in again.stdout
    assert 'compiling' not in again.stderr
    needed = """
import numpy as np
from gdmp_ros.kernels import on_compile
from gdmp_ros.data import gallery
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.execution import execution_ticks
names = []
with on_compile(names.append, lambda: None):
    ticks = execution_ticks(gallery.learned('polish'), ClosedLoop(Arm()))
    for _ in range(3):
        next(ticks)
assert not names, names
"""
    subprocess.run([sys.executable, '-c', needed], check=True)


@pytest.mark.parametrize('imported', ['argparse', 'gdmp_ros.util.processes', 'numpy'])
def test_ctrl_c_during_start_up_is_no_traceback(imported, tmp_path):
    python, *words = GDMP
    # Python tells of every module that it has imported (-X importtime).
    process = subprocess.Popen([python, '-X', 'importtime', *words, 'examples', 'skills',
                                '-o', str(tmp_path / 'gallery')],
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               # A shell starts background jobs, and so perhaps this test,
                               # without SIGINT.
                               preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    for line in process.stderr:
        if line.split('|')[-1].strip() == imported:
            break
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode in (130, -signal.SIGINT)
    assert 'Traceback' not in errors


def test_recordings_are_named_by_class_and_not_overwritten(folder):
    bags = sorted(p.name for p in (folder / 'demos').iterdir())
    assert bags == [f'GShape_{i}' for i in range(1, 8)]
    again = gdmp('examples', 'lasa', 'GShape', '-o', folder / 'demos')
    assert again.returncode == 1 and 'exists already' in again.stderr
    assert gdmp('examples', 'lasa', 'GShape', '-o', folder / 'demos',
                '--overwrite').returncode == 0
    unknown = gdmp('examples', 'lasa', 'Elephant', '-o', folder / 'other')
    assert unknown.returncode == 1 and 'expected one of Angle' in unknown.stderr
    assert not (folder / 'other').exists()


def test_learn_reports_as_a_table_and_as_json(folder):
    bags = sorted((folder / 'demos').iterdir())
    done = gdmp('learn', *bags, '-o', folder / 'all.json', '--json')
    report = json.loads(done.stdout)
    assert report['demonstrations'] == 7 and 5.0 < report['duration'] < 7.0
    assert 0.0 < report['mean_relative_error'] < 0.1
    table = gdmp('learn', folder / 'demos' / 'GShape_2', '-o', folder / 'two.json')
    assert 'position × orientation × stiffness' in table.stdout and '[s]' in table.stdout


def test_learn_refuses_with_one_line_and_leaves_no_file(folder):
    bad = gdmp('learn', folder / 'nowhere', '-o', folder / 'bad.json')
    assert bad.returncode == 1
    assert bad.stderr.strip() == f'error: {folder / "nowhere"}: no such bag'
    assert not (folder / 'bad.json').exists()


def test_inspect_tells_bags_from_skills(folder):
    bag = gdmp('show', folder / 'demos' / 'GShape_1').stdout
    assert '/demonstration/pose' in bag and 'panda_link0' in bag and '1000' in bag
    skill = gdmp('show', folder / 'skill.json').stdout
    assert 'Euclidean(3) × UnitQuaternion() × SymmetricPositiveDefinite(3)' in skill
    assert 'GShape_1' in skill


def test_plot_draws_a_picture(folder):
    assert gdmp('show', folder / 'skill.json', '-o', folder / 'skill.png').returncode == 0
    data = (folder / 'skill.png').read_bytes()
    assert data.startswith(b'\x89PNG') and len(data) > 20_000


def test_rollout_writes_the_path_to_the_new_goal(folder):
    out = folder / 'path.csv'
    assert gdmp('rollout', folder / 'skill.json', '--goal-position', 0.5, 0.1, 0.4,
                '--switch-at', 2.0, '-o', out).returncode == 0
    with out.open() as lines:
        rows = list(csv.DictReader(lines))
    assert float(rows[0]['time']) == 0.0 and float(rows[0]['phase']) == 1.0
    last = [float(rows[-1][f'position_{axis}']) for axis in 'xyz']
    assert last == pytest.approx([0.5, 0.1, 0.4], abs=1e-3)
    bad = gdmp('rollout', folder / 'skill.json', '--goal', 1.0, 2.0)
    assert bad.returncode == 1 and '--goal has 2 numbers, expected 16' in bad.stderr


def test_a_folder_of_bags_is_learned_one_by_one_and_resumed(folder):
    words = ['learn', folder / 'demos', '-o', folder / 'each', '--each', '--jobs', 2,
             '--resume', folder / 'done.jsonl']
    first = gdmp(*words)
    assert first.returncode == 0, first.stderr
    assert sorted(p.name for p in (folder / 'each').iterdir()) == [
        f'GShape_{i}.json' for i in range(1, 8)]
    kept = (folder / 'each' / 'GShape_1.json').stat().st_mtime_ns
    (folder / 'each' / 'GShape_3.json').unlink()
    again = gdmp(*words)
    assert again.returncode == 0 and (folder / 'each' / 'GShape_3.json').exists()
    assert (folder / 'each' / 'GShape_1.json').stat().st_mtime_ns == kept
    empty = folder / 'empty'
    empty.mkdir()
    refused = gdmp('learn', empty, '-o', folder / 'x.json')
    assert refused.returncode == 1 and 'neither a rosbag2 folder nor a folder' in refused.stderr


def test_learning_finds_its_own_number_of_basis_functions_and_reports_the_fit(folder):
    done = gdmp('learn', folder / 'demos' / 'GShape_1', '-o', folder / 'auto.json', '--n-basis',
                'auto', '--tolerance', '1e-3', '--smooth', '20', '--json')
    report = json.loads(done.stdout)
    assert 10 <= report['n_basis'] <= 100 and report['mean_relative_error'] < 5e-3
    assert report['fit']['factors'] == ['position', 'orientation', 'stiffness']
    assert len(report['fit']['demonstrations'][0]['mean_error']) == 3


def test_a_cycle_is_learned_shown_and_used_in_a_sequence(folder):
    home = Skill.load(folder / 'skill.json').start[:7]
    recordings.write(folder / 'wiping', circles(home, 0.05, 5.0), 'panda_link0',
                     recordings.EPOCH_NS)
    done = gdmp('learn', 'wiping', '-o', 'wipe.json', '--rhythmic', cwd=folder)
    assert done.returncode == 0, done.stderr
    assert 'period [s]' in done.stdout and 'cycles of 1.000 s' in done.stdout
    assert 'period [s]' in gdmp('show', 'wipe.json', cwd=folder).stdout
    out = gdmp('rollout', 'wipe.json', '--cycles', 2, '--dt', 0.1, cwd=folder).stdout
    assert len(out.splitlines()) == 22  # names, and 2 s
    done = gdmp('show', 'wipe.json', '-o', 'wipe.png', '--demonstrations', 'wiping', cwd=folder)
    assert done.returncode == 0, done.stderr
    (folder / 'clean.yaml').write_text('steps: [{skill: wipe.json, until: clean}, {hold: 0.2}]')
    done = gdmp('show', 'clean.yaml', '-o', 'clean.png', cwd=folder)
    assert done.returncode == 0 and drawn(folder / 'clean.png') > 0.01
    for words, reason in (
            (('learn', 'wiping', '-o', 'x.json', '--period', 2.0), 'belongs to a rhythmic skill'),
            (('learn', 'demos/GShape_1', '-o', 'x.json', '--rhythmic'), 'no period was found'),
            (('learn', 'wiping', '-o', 'x.json', '--rhythmic', '--stiffness', 'variance'),
             'not for rhythmic skills'),
            (('rollout', 'wipe.json', '--cycles', 0), 'cycles')):
        refused = gdmp(*words, cwd=folder)
        assert refused.returncode in (1, 2) and reason in refused.stderr, refused.stderr


def test_a_skill_is_drawn_over_its_demonstrations(folder, letters):
    alone = gdmp('show', 'skill.json', '-o', 'alone.png', cwd=folder)
    both = gdmp('show', 'skill.json', '-o', 'both.png', '--demonstrations', 'demos', cwd=folder)
    assert alone.returncode == both.returncode == 0, both.stderr
    shares = [drawn(folder / name) for name in ('alone.png', 'both.png')]
    assert shares[1] > 1.02 * shares[0]
    # A skill of several takes is drawn with what is likely.
    Skill.learn(letters[:3], 40).save(folder / 'several.json')
    done = gdmp('show', 'demos/GShape_1', '-o', 'demo.png', cwd=folder)
    assert done.returncode == 0 and drawn(folder / 'demo.png') > 0.01, done.stderr
    done = gdmp('show', 'several.json', '-o', 'band.png', cwd=folder)
    assert done.returncode == 0 and drawn(folder / 'band.png') > 1.02 * shares[0], done.stderr


@pytest.mark.parametrize('words, reason', [
    (('show', 'skill.json', '-o', 'demos'), 'is a folder'),
    (('show', 'skill.json', '-o', 'skill.txt'), 'a name that ends in .png'),
    (('rollout', 'skill.json', '-o', 'demos'), 'is a folder'),
    (('learn', 'demos', '--suggest', '--plot', 'skill.json/x.png'), 'skill.json is no folder'),
    (('takes', 'demos', '--plot', 'demos'), 'is a folder'),
    (('show', 'demos/GShape_1', '-o', 'page.txt'), 'or .html'),
    (('learn', 'demos', '-o', 'demos'), 'is a folder'),
    (('arm', 'urdf', '-o', 'demos'), 'is a folder'),
    (('show', 'demos'), 'no rosbag2 recording')])
def test_what_cannot_be_written_is_refused_before_the_work(folder, words, reason):
    before = {path: path.stat().st_mtime_ns for path in folder.rglob('*')}
    done = gdmp(*words, cwd=folder)
    assert done.returncode == 1 and reason in done.stderr and len(done.stderr.splitlines()) == 1
    assert {path: path.stat().st_mtime_ns for path in folder.rglob('*')} == before


def test_skills_and_roll_outs_are_printed_in_one_line(folder):
    skill = gdmp_ros.Skill.load(folder / 'skill.json')
    assert re.fullmatch(r'Skill\(.*, \d+ basis functions, [\d.]+ s\)', repr(skill))
    assert repr(skill.rollout()).startswith('Rollout(progress=0, speed=1, finished=False, skill=')


def test_the_reference_lists_every_option():
    text = (ROOT / 'docs' / 'cli.md').read_text()
    sections = dict(part.partition('\n')[::2] for part in text.split('### gdmp ')[1:])
    assert list(sections) == list(PROGRAM.verbs)
    for verb, section in sections.items():
        for action in PROGRAM.verb_parser(verb)._actions:
            assert all(option in section for option in action.option_strings), (
                f'gdmp {verb} {action.option_strings}: run python docs/cli_page.py')
