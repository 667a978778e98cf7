"""The live view says what server and arm do, and who is silent."""
import os
import pty
import re
import subprocess

from test.commands import GDMP

WATCH = [*GDMP, 'watch', '--seconds']


def test_it_prints_what_goes_on_and_who_is_silent(world):
    world.start()
    world.operator.execute()
    lines = subprocess.run([*WATCH, '5'], capture_output=True, text=True,
                           timeout=60).stdout.splitlines()
    assert len(lines) >= 3
    last = lines[-1]
    assert re.search(r'trajectory_server: (moving|holding), \d+%', last)
    assert re.search(r'rate: \d+\.\d Hz', last) and 'lateness: p50' in last
    assert 'distance to goal: position' in last and 'energy tank: ' in last
    assert re.search(r'stiffness: \d+ to \d+ N/m', last)
    world.children.kill('trajectory_server')
    gone = subprocess.run([*WATCH, '3'], capture_output=True, text=True, timeout=60).stdout
    assert 'trajectory_server: silent; panda_sim: at' in gone.splitlines()[-1]


def test_on_a_terminal_it_draws_in_place(world):
    world.start_sim()
    world.wait('the arm', lambda: len(world.robot) > 0, 60.0)
    ours, theirs = pty.openpty()
    process = subprocess.Popen([*WATCH, '3'], stdout=theirs, stderr=theirs,
                               env={**os.environ, 'TERM': 'xterm', 'COLUMNS': '120'})
    os.close(theirs)
    seen = b''
    try:
        while part := os.read(ours, 4096):
            seen += part
    except OSError:  # how a pseudo-terminal ends
        pass
    assert process.wait(30) == 0
    assert b'energy tank' in seen and b'\x1b[' in seen and b'silent' in seen
