"""`gdmp watch` shows what server and arm do, and which of them is silent."""
from contextlib import redirect_stdout
import io
import re

from gdmp_ros.cli.main import main
from gdmp_ros.ros.clients.testbed import SERVER
from test.commands import gdmp
from test.ros.nodes import CLEANUP, DEACTIVATE


def test_it_prints_the_state_of_server_and_arm_and_which_is_silent(running):
    running.client.execute()
    done = gdmp('watch', '--seconds', '1.5')
    assert done.returncode == 0
    line = done.stdout.splitlines()[0]
    assert re.search(r'trajectory_server: moving, \d+%.*panda_sim: at', line)
    assert re.search(r'rate: \d+\.\d Hz', line) and 'lateness: p50' in line
    assert 'distance to goal: position' in line and 'energy tank: ' in line
    assert re.search(r'stiffness: \d+ to \d+ N/m', line)
    assert running.transition(SERVER, DEACTIVATE, CLEANUP)
    running.spend(1.0)
    lines = gdmp('watch', '--seconds', '1.5').stdout.splitlines()
    assert lines[-1].startswith('trajectory_server: silent; panda_sim: at')


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_on_a_terminal_it_draws_in_place(running, monkeypatch):
    monkeypatch.setenv('TERM', 'xterm')
    monkeypatch.setenv('COLUMNS', '120')
    assert running.transition(SERVER, DEACTIVATE, CLEANUP)
    with redirect_stdout(Terminal()) as seen:
        assert main(['watch', '--seconds', '1']) == 0
    assert 'energy tank' in seen.getvalue() and 'silent' in seen.getvalue()
    assert '\x1b[' in seen.getvalue()


def test_ctrl_c_ends_it(running):
    def interrupt():
        raise KeyboardInterrupt
    with running.meanwhile(interrupt):
        assert gdmp('watch').returncode == 130
