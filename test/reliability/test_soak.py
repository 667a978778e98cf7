"""A short soak, and its verdicts on runs that went wrong."""
import copy
import json

import pytest

from gdmp_ros.cli.main import main
from gdmp_ros.experiments.reliability import soak


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp('soak')
    code = main(['soak', '--minutes', '0.4', '--out', str(folder)])
    return code, folder, json.loads((folder / 'soak.json').read_text())


def test_a_short_soak_holds_and_leaves_report_and_picture(run):
    code, folder, document = run
    assert document['failed'] == [] and code == 0
    assert document['measured']['ticks'] >= 23_000
    assert document['measured']['references lost'] == 0
    assert document['seen']['received'] > 23_000 and document['seen']['states'] > 20_000
    assert document['deeds']['motions'] >= 2
    assert (folder / 'soak.png').stat().st_size > 10_000
    assert not (folder / 'monitor.json').exists()


@pytest.mark.parametrize('spoil, said', [
    (lambda d: d['seen'].update(lost=1), 'references lost'),
    (lambda d: d['samples'][-1].update(missed=5_000), 'missed ticks'),
    (lambda d: d['seen']['windows'][0].update(rate=1.5), 'torque rate'),
    (lambda d: d['seen']['windows'][0].update(joint_speed=3.0), 'joint speed'),
    (lambda d: d['seen']['windows'][0].update(tank=-1.0), 'energy in the tank'),
    (lambda d: d['deeds'].update(reached=0), 'did not reach')])
def test_a_soak_in_which_something_went_wrong_does_not_hold(run, spoil, said):
    document = copy.deepcopy(run[2])
    spoil(document)
    outcome = soak.judge(document)
    assert outcome.holds is False and any(said in text for text in outcome.failed)


def test_memory_that_grows_is_seen_in_a_run_long_enough(run):
    document = copy.deepcopy(run[2])
    document['minutes'] = 30.0
    document['samples'] = [{**document['samples'][0], 'seconds': 5.0 * k,
                            'ticks': 5000 * k, 'missed': 0,
                            'panda_sim memory': 2e8 + 6000 * k} for k in range(361)]
    outcome = soak.judge(document)
    grown = [text for text in outcome.failed if 'memory' in text]
    assert len(grown) == 1 and grown[0].startswith('panda_sim: memory grew by [MiB]: 1.3')


def test_minutes_are_checked(capsys, tmp_path):
    assert main(['soak', '--minutes', '0', '--out', str(tmp_path)]) == 1
    assert '--minutes is 0, expected 0.2 to 10000' in capsys.readouterr().err
