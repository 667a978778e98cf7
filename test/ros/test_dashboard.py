"""`gdmp watch` shows what server and arm do, and which of them is silent."""
from contextlib import contextmanager
import os
import pty
import re
import signal
import subprocess

from gdmp_ros.ros.testbed import SERVER
from test.commands import GDMP, gdmp
from test.ros.nodes import CLEANUP, DEACTIVATE

WATCH = [*GDMP, 'watch']


@contextmanager
def watching(**streams):
    """The live view; Ctrl-C ends it."""
    process = subprocess.Popen(WATCH, **streams)
    try:
        yield process
        process.send_signal(signal.SIGINT)
        assert process.wait(30) in (0, 130)
    finally:
        process.kill()
        process.wait()


def first_line(process, pattern):
    """First line with a pattern; the arm and the server are silent until they are discovered."""
    for line in process.stdout:
        if re.search(pattern, line):
            return line
    raise AssertionError(f'no line with {pattern}')


def test_it_prints_the_state_of_server_and_arm_and_which_is_silent(running):
    running.client.execute()
    with watching(stdout=subprocess.PIPE, text=True) as process:
        line = first_line(process, r'trajectory_server: \w+, \d+%.*panda_sim: at')
        assert re.search(r'trajectory_server: (moving|holding), \d+%', line)
        assert re.search(r'rate: \d+\.\d Hz', line) and 'lateness: p50' in line
        assert 'distance to goal: position' in line and 'energy tank: ' in line
        assert re.search(r'stiffness: \d+ to \d+ N/m', line)
        assert running.transition(SERVER, DEACTIVATE, CLEANUP)
        first_line(process, 'trajectory_server: silent; panda_sim: at')


def test_it_ends_after_the_given_time(running):
    done = gdmp('watch', '--seconds', '1')
    assert done.returncode == 0
    assert re.match('trajectory_server: .*; panda_sim: |trajectory_server: silent', done.stdout)


def test_on_a_terminal_it_draws_in_place(running):
    assert running.transition(SERVER, DEACTIVATE, CLEANUP)
    ours, theirs = pty.openpty()
    seen = b''
    with watching(stdout=theirs, stderr=theirs,
                  env={**os.environ, 'TERM': 'xterm', 'COLUMNS': '120'}):
        os.close(theirs)
        while b'energy tank' not in seen or b'silent' not in seen:
            seen += os.read(ours, 4096)
    os.close(ours)
    assert b'\x1b[' in seen
