"""Tasks that are shown by hand, learned and executed, as commands."""
import json

import pytest

from test.commands import gdmp


@pytest.mark.long
@pytest.mark.timeout(900)  # wiping starts the nodes six times
@pytest.mark.parametrize('task', ['pick', 'joints', 'wipe'])
def test_a_task_is_shown_learned_and_executed(tmp_path, task):
    done = gdmp('demo', '--task', task, '--out', tmp_path, timeout=840)
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((tmp_path / 'report.json').read_text())
    assert report['succeeded'] and report['task'] == task and not report.get('error')
