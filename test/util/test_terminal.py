"""Progress without a terminal: a line every two seconds, also during a long step."""
import time

from gdmp_ros.util import terminal


def test_a_long_step_is_seen(capsys, monkeypatch):
    monkeypatch.setattr(terminal._Lines, 'EVERY_S', 0.05)
    with terminal.progress('reading', 3) as step:
        step()
        time.sleep(0.3)
    lines = capsys.readouterr().err.splitlines()
    assert lines and all(line.startswith('reading: 1 of 3, ') for line in lines[1:])
    time.sleep(0.15)
    assert capsys.readouterr().err == ''


def test_a_short_work_is_silent(capsys):
    with terminal.progress('reading', 1) as step:
        step()
    assert capsys.readouterr().err == ''
