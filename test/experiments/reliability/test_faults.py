"""
`experiments faults`: each fault once, quickly, with the requirements of the long run.

Whether the nodes are fast enough is judged by `make faults`, on a machine with nothing else to do.
"""
import json
import os
import subprocess

import pytest

from experiments.__main__ import PROGRAM
from experiments.reliability.faults import fault, FAULTS
from experiments.reliability.network import Quality, TwoHosts
from experiments.reliability.report import attempt
from experiments.reliability.trial import short_skill
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.errors import GdmpError
from test.pictures import drawn


@pytest.fixture(scope='session')
def skill(tmp_path_factory):
    return short_skill(tmp_path_factory.mktemp('skill'))


@pytest.mark.long
@pytest.mark.parametrize('name', [
    name for name in FAULTS if name != 'adversarial-stiffness'])  # tested below
def test_fault(name, skill, tmp_path):
    outcome = attempt(name, tmp_path / name, skill, True)
    if outcome.missing:
        pytest.skip(outcome.missing)
    assert outcome.failed == []
    assert len(outcome.measured) >= 3


@pytest.mark.long
def test_a_trial_that_breaks_down_has_failed(tmp_path):
    broken = tmp_path / 'broken.json'
    broken.write_text('{}')
    outcome = attempt('server-killed', tmp_path / 'x', broken, True)
    assert outcome.holds is False and 'trajectory_server ended with code 1' in outcome.failed[0]


def test_an_outcome_does_not_hold_with_a_value_that_is_nan():
    outcome = TrialResult()
    outcome.need('speed', float('nan'), lambda v: True)
    outcome.claim('said so', True)
    assert outcome.holds is False and outcome.failed == ['speed: nan']
    assert TrialResult(missing='no root').holds is None
    assert TrialResult(measured={'a': 1.0}).holds is True


def test_an_outcome_does_not_hold_if_something_is_late():
    outcome = TrialResult()
    outcome.need('missed ticks [%]', 3.0, lambda v: v < 1.0, of_speed=True)
    assert outcome.holds is False and outcome.failed == [] and outcome.late


def test_the_command_names_faults_and_refuses_others(capsys, tmp_path):
    assert PROGRAM.main(['faults', '--list']) == 0
    listed = capsys.readouterr().out
    assert all(name in listed and fault(name).__doc__.strip() in listed for name in FAULTS)
    assert PROGRAM.main(['faults', 'earthquake', '--out', str(tmp_path)]) == 1
    assert "fault 'earthquake' is unknown" in capsys.readouterr().err


def test_the_adversarial_stiffness_is_contained_and_reported(tmp_path):
    assert PROGRAM.main(['faults', 'adversarial-stiffness', '--out', str(tmp_path)]) == 0
    document = json.loads((tmp_path / 'faults.json').read_text())['adversarial-stiffness']
    assert document['holds'] is True
    largest = [document['measured'][f'{which} the tank: largest energy of arm and spring [J]']
               for which in ('without', 'with')]
    assert largest[0] > 5.0 > largest[1]
    assert '| holds |' in (tmp_path / 'faults.md').read_text()
    assert drawn(tmp_path / 'adversarial-stiffness.png') > 0.01


#: Counts messages until none comes for a second, and prints their number and smallest age.
RECEIVE = """
import socket, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(('0.0.0.0', 7777))
s.settimeout(1.0)
print('ready', flush=True)
ages = []
try:
    while True:
        sent = float(s.recv(100))
        ages.append(time.monotonic() - sent)
except TimeoutError:
    print(len(ages), min(ages, default=float('nan')))
"""
SEND = """
import socket, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for _ in range(200):
    s.sendto(str(time.monotonic()).encode(), ('10.93.7.2', 7777))
    time.sleep(0.001)
"""


def received(hosts):
    """Number and smallest age [s] of 200 messages that arrive."""
    listener = subprocess.Popen([*hosts.on('robot'), 'python3', '-c', RECEIVE],
                                stdout=subprocess.PIPE, text=True)
    assert listener.stdout.readline() == 'ready\n'
    subprocess.run([*hosts.on('server'), 'python3', '-c', SEND], check=True)
    count, age = listener.communicate()[0].split()
    return int(count), float(age)


@pytest.mark.long
def test_a_cable_loses_delays_and_is_cut():
    try:
        hosts = TwoHosts(Quality()).__enter__()
    except (GdmpError, OSError) as error:
        pytest.skip(str(error))
    try:
        assert received(hosts)[0] == 200
        hosts.cable.quality = Quality(loss=0.3)
        assert 90 < received(hosts)[0] < 180
        hosts.cable.quality = Quality(cut=True)
        assert received(hosts)[0] == 0
        hosts.cable.quality = Quality(delay=0.2)
        count, age = received(hosts)
        assert count == 200 and age >= 0.2
    finally:
        hosts.__exit__()
    left = subprocess.run(['ip', 'netns'], capture_output=True, text=True).stdout
    assert f'gdmp-{os.getpid()}-' not in left
