"""`experiments soak`: a short run, and verdicts on runs in which something went wrong."""
import json

import pytest

from experiments.__main__ import PROGRAM
from experiments.reliability import soak
from test.pictures import drawn


def window(**changes):
    """Extreme values of ten seconds."""
    return {'states': 10_000, 'torque': [20.0] * 4 + [2.0] * 3, 'rate': 0.95, 'speed': 0.25,
            'joint_speed': 1.5, 'tank': 4.5, 'lower': [-0.2, -0.8, -0.2, -2.5, -0.2, 1.5, 0.6],
            'upper': [0.2, 0.2, 0.2, -2.0, 0.2, 2.2, 1.0], **changes}


def sample(seconds):
    """What is known of the processes at a time."""
    return {'seconds': seconds, 'trajectory_server memory': 2.7e8, 'panda_sim memory': 2.5e8,
            'trajectory_server cpu': 2.0 + 0.15 * seconds, 'panda_sim cpu': 2.5 + 0.4 * seconds,
            'ticks': 4_000 + round(1000 * seconds), 'missed': round(seconds), 'refused': 0}


def document(minutes=0.4):
    """A run in which everything holds."""
    seconds = 60.0 * minutes
    return {
        'minutes': minutes,
        'samples': [sample(k * seconds / 360) for k in range(361)],
        'actions': {'motions': 3, 'reached': 3, 'skills loaded': 1, 'goals switched': 7,
                    'tempo changes': 2, 'pauses': 4},
        'seen': {'received': round(1000 * seconds), 'lost': 0, 'states': round(1000 * seconds),
                 'windows': [window(), window(), window(states=4_000)]},
        'bare': {'ticks': round(1000 * seconds), 'missed': 20, 'rate_hz': 999.0, 'p50_us': 90.0,
                 'p99_us': 700.0, 'max_us': 6000.0, 'missed_per_window': [10, 5, 5]}}


def test_a_soak_in_which_everything_went_well_holds():
    outcome = soak.judge(document())
    assert outcome.holds is True and outcome.failed + outcome.late == []
    assert outcome.measured['ticks'] == 24_000 and outcome.measured['motions'] == 3


@pytest.mark.parametrize('spoil, reason', [
    (lambda d: d['seen'].update(lost=1), 'references lost'),
    (lambda d: d['seen'].update(states=20_000), 'states of the arm'),
    (lambda d: d['seen']['windows'][1].update(states=4_000), 'states in a window'),
    (lambda d: d['samples'][-1].update(ticks=20_000), 'ticks'),
    (lambda d: d['samples'][-1].update(missed=5_000), 'missed ticks'),
    (lambda d: d['samples'][-1].update(seconds=25.0), 'rate [Hz]'),
    (lambda d: d['seen']['windows'][0]['torque'].__setitem__(0, 90.0), 'torque [fraction'),
    (lambda d: d['seen']['windows'][0].update(rate=1.5), 'torque rate'),
    (lambda d: d['seen']['windows'][0].update(joint_speed=3.0), 'joint speed'),
    (lambda d: d['seen']['windows'][2].update(speed=2.0), 'speed [m/s]'),
    (lambda d: d['seen']['windows'][1]['upper'].__setitem__(3, 0.0), 'joint limits'),
    (lambda d: d['seen']['windows'][0].update(tank=-1.0), 'energy in the tank'),
    (lambda d: d['actions'].update(reached=0), 'did not reach')])
def test_a_soak_in_which_something_went_wrong_does_not_hold(spoil, reason):
    spoiled = document()
    spoil(spoiled)
    outcome = soak.judge(spoiled)
    assert outcome.holds is False and any(
        reason in text for text in outcome.failed + outcome.late)


def test_memory_that_grows_is_seen_in_a_run_long_enough():
    for minutes, seen in ((30.0, True), (5.0, False)):
        run = document(minutes)
        for k, one in enumerate(run['samples']):
            one['panda_sim memory'] = 2e8 + 6000 * k
        grown = [text for text in soak.judge(run).failed if 'memory' in text]
        assert len(grown) == seen
        if seen:
            assert grown[0].startswith('panda_sim: memory grew by [MiB]: 1.3')


def test_minutes_are_checked(capsys, tmp_path):
    with pytest.raises(SystemExit):
        PROGRAM.main(['soak', '--minutes', '0', '--out', str(tmp_path)])
    assert '--minutes: is 0, expected a finite number, at least 0.2' in capsys.readouterr().err


@pytest.mark.long
def test_a_short_soak_holds_and_leaves_report_and_picture(tmp_path):
    code = PROGRAM.main(['soak', '--minutes', '0.4', '--out', str(tmp_path)])
    found = json.loads((tmp_path / 'soak.json').read_text())
    assert found['failed'] == [] and code == (1 if found['late'] else 0)
    assert found['measured']['ticks'] >= 23_000
    assert found['measured']['references lost'] == 0
    assert found['seen']['received'] > 23_000 and found['seen']['states'] > 20_000
    assert found['actions']['motions'] >= 2
    assert drawn(tmp_path / 'soak.png') > 0.01
    assert not (tmp_path / 'monitor.json').exists()
    # The other tests judge runs with the same entries.
    made = document()
    assert set(found) == {*made, 'measured', 'failed', 'late', 'holds'}
    for key in ('actions', 'seen', 'bare'):
        assert set(found[key]) == set(made[key]), key
    assert set(found['samples'][0]) == set(made['samples'][0])
    assert set(found['seen']['windows'][0]) == set(window())
