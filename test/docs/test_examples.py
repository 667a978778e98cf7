"""The scripts in examples/ run, and leave their picture; the gallery shows them all."""
import ast
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import threading

import pytest

from gdmp_ros.util.dds_network import Domain
from test.commands import GDMP
from test.pictures import drawn

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / 'examples').glob('*.py'))


#: Those that are clients of running nodes.
CLIENTS = [path for path in EXAMPLES if 'import rclpy' in path.read_text()]


def run(script, folder, **environment):
    """Run an example in a folder, and look at its picture."""
    shutil.copy(script, folder)
    done = subprocess.run([sys.executable, script.name], cwd=folder, capture_output=True,
                          text=True, timeout=300,
                          env={**os.environ, 'MPLBACKEND': 'Agg', **environment})
    assert done.returncode == 0, done.stderr[-3000:]
    assert drawn(folder / f'{script.stem}.png') > 0.01
    return done.stdout


@pytest.mark.long
@pytest.mark.parametrize('script', [one for one in EXAMPLES if one not in CLIENTS],
                         ids=lambda path: path.stem)
def test_an_example_runs_and_leaves_a_picture(script, tmp_path):
    run(script, tmp_path)


@pytest.mark.long
def test_clients_of_running_nodes_run_and_leave_a_picture(letter, tmp_path):
    assert len(CLIENTS) == 2
    letter.save(tmp_path / 'skill.json')
    with Domain() as domain:
        environment = domain.environment()
        nodes = subprocess.Popen([*GDMP, 'up', 'skill.json'], cwd=tmp_path, text=True,
                                 stdout=subprocess.PIPE, env={**os.environ, **environment})
        guard = threading.Timer(240.0, nodes.kill)
        guard.start()
        try:
            assert any(line.startswith('running:') for line in nodes.stdout)
            said = [run(script, tmp_path, **environment) for script in CLIENTS]
        finally:
            guard.cancel()
            nodes.send_signal(signal.SIGINT)
            nodes.wait(30.0)
    assert said[0].startswith('the goal was reached, within 0.00')
    # How many are lost depends on how fast the machine is; eight seconds of them are received.
    received, lost = map(int, re.fullmatch(r'(\d+) references, (\d+) lost\n', said[1]).groups())
    assert received > 1 and lost >= 0


def test_examples_are_in_the_gallery():
    page = (ROOT / 'docs' / 'examples.md').read_text()
    for script in EXAMPLES:
        idea = ast.get_docstring(ast.parse(script.read_text()))
        assert idea in page and f'pictures/examples/{script.stem}.png' in page, script
        assert (ROOT / 'docs' / 'pictures' / 'examples' / f'{script.stem}.png').is_file()
