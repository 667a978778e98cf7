"""The bounded part of `gdmp faults`: most faults once, quickly, judged as the long run is."""
import json
import os

import pytest

from gdmp_ros.cli.main import main
from gdmp_ros.experiments.reliability.faults import fault, FAULTS
from gdmp_ros.experiments.reliability.network import Quality, TwoHosts
from gdmp_ros.experiments.reliability.outcome import Outcome
from gdmp_ros.experiments.reliability.report import attempt
from gdmp_ros.experiments.reliability.trial import short_skill


@pytest.fixture(scope='session')
def skill(tmp_path_factory):
    return short_skill(tmp_path_factory.mktemp('skill'))


#: The others take longer, or differ from one of these in little but their figures.
BOUNDED = ('server-killed', 'server-stopped', 'two-servers', 'skill-file', 'disk-full',
           'wall-clock', 'garbage-flood', 'network-cut', 'adversarial-stiffness')


@pytest.mark.parametrize('name', BOUNDED)
def test_fault(name, skill, tmp_path):
    outcome = attempt(name, tmp_path / name, skill, True)
    if outcome.missing:
        pytest.skip(outcome.missing)
    assert outcome.failed == []
    assert len(outcome.measured) >= 3


def test_a_trial_that_breaks_down_has_failed(skill, tmp_path, monkeypatch):
    broken = tmp_path / 'broken.json'
    broken.write_text('{}')
    monkeypatch.setattr('gdmp_ros.experiments.reliability.trial.START_UP_S', 4.0)
    outcome = attempt('server-killed', tmp_path / 'x', broken, True)
    assert outcome.holds is False and 'in vain' in outcome.failed[0]


def test_outcomes_do_not_hold_on_figures_that_are_none():
    outcome = Outcome()
    outcome.need('speed', float('nan'), lambda v: True)
    outcome.claim('said so', True)
    assert outcome.holds is False and outcome.failed == ['speed: nan']
    assert Outcome(missing='no root').holds is None
    assert Outcome(measured={'a': 1.0}).holds is True


def test_the_command_names_faults_and_refuses_others(capsys, tmp_path):
    assert main(['faults', '--list']) == 0
    listed = capsys.readouterr().out
    assert all(name in listed and fault(name).__doc__.strip() in listed for name in FAULTS)
    assert main(['faults', 'earthquake', '--out', str(tmp_path)]) == 1
    assert "fault 'earthquake' is unknown" in capsys.readouterr().err


def test_the_command_writes_table_and_report(tmp_path):
    assert main(['faults', 'adversarial-stiffness', '--out', str(tmp_path)]) == 0
    document = json.loads((tmp_path / 'faults.json').read_text())['adversarial-stiffness']
    assert document['holds'] is True
    plain = document['measured']['plain law: largest energy of arm and spring [J]']
    assert plain > 5.0 > document['measured']['ours: largest energy of arm and spring [J]']
    assert '| holds |' in (tmp_path / 'faults.md').read_text()
    assert (tmp_path / 'adversarial-stiffness.png').stat().st_size > 10_000


def test_a_cable_loses_delays_and_is_cut():
    import subprocess
    import time
    receive = ('import socket\ns = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n'
               's.bind(("0.0.0.0", 7777)); s.settimeout(1.0)\nn = 0\nprint("ready", flush=True)\n'
               'try:\n while True: s.recv(100); n += 1\nexcept TimeoutError: print(n)')
    send = ('import socket, time\ns = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n'
            'for _ in range(200): s.sendto(b"x", ("10.93.7.2", 7777)); time.sleep(0.001)')

    def arrived(hosts):
        listener = subprocess.Popen([*hosts.on('robot'), 'python3', '-c', receive],
                                    stdout=subprocess.PIPE, text=True)
        assert listener.stdout.readline() == 'ready\n'
        subprocess.run([*hosts.on('server'), 'python3', '-c', send], check=True)
        return int(listener.communicate()[0])

    try:
        hosts = TwoHosts(Quality()).__enter__()
    except Exception as error:
        pytest.skip(str(error))
    try:
        assert arrived(hosts) == 200
        hosts.cable.quality = Quality(loss=0.3)
        assert 90 < arrived(hosts) < 180
        hosts.cable.quality = Quality(cut=True)
        assert arrived(hosts) == 0
        hosts.cable.quality = Quality(delay=0.2)
        begun = time.monotonic()
        assert arrived(hosts) == 200
        assert time.monotonic() - begun > 1.0
    finally:
        hosts.__exit__()
    left = subprocess.run(['ip', 'netns'], capture_output=True, text=True).stdout
    assert f'gdmp-{os.getpid()}-' not in left
