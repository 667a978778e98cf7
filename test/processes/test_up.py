"""``gdmp up``: nodes in one command, for every other one; nothing is left after Ctrl-C."""
import os
import signal
import subprocess
import threading

import psutil
import pytest

from gdmp_ros.util.dds_network import Domain
from test.commands import GDMP, gdmp, gdmp_process


@pytest.fixture
def domain():
    with Domain() as made:
        yield made.environment()


def test_nodes_are_started_used_and_ended(domain, skill_file, tmp_path):
    process = subprocess.Popen([*GDMP, 'up', str(skill_file), '--takes', str(tmp_path / 'takes')],
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                               env={**os.environ, **domain})
    guard = threading.Timer(120.0, process.kill)
    guard.start()
    try:
        lines = []
        for line in process.stdout:
            lines.append(line)
            if line.startswith('running:'):
                break
        assert lines and lines[-1].startswith('running:'), ''.join(lines)
        children = psutil.Process(process.pid).children(recursive=True)
        assert len(children) >= 3
        done = gdmp_process('run', **domain)
        # A busy machine may keep the robot from the goal; then this is what it says.
        assert done.returncode in (0, 1), done.stderr
        assert '; distance of the reference: position' in done.stdout
        again = gdmp_process('up', **domain)
        assert again.returncode == 1 and 'run already' in again.stderr
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=30)
        assert process.returncode == 0 and 'Traceback' not in rest
        assert not [one for one in children if one.is_running()
                    and one.status() != psutil.STATUS_ZOMBIE]
    finally:
        guard.cancel()
        if process.poll() is None:
            process.kill()
            process.wait()


def test_a_skill_that_is_not_there_is_refused_at_once(tmp_path):
    done = gdmp('up', tmp_path / 'none.json')
    assert done.returncode == 1 and 'there is no such skill file' in done.stderr
