"""Ctrl-C: noted even if compiled code turns it into another exception."""
import os
import signal
import subprocess
import sys

import pytest

from gdmp_ros.cli import arm_urdf, main
from gdmp_ros.util.processes import held_interrupts, noted_interrupts


@pytest.fixture(autouse=True)
def usual_handler():
    """Without it, Ctrl-C would reach rclpy's handler if the tests run as a background job."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def test_an_interrupt_is_noted_and_the_handler_is_restored():
    with noted_interrupts() as noted:
        assert not noted.is_set()
        with pytest.raises(KeyboardInterrupt):
            press_ctrl_c()
        assert noted.is_set()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_background_job_goes_on_ignoring_ctrl_c():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with noted_interrupts() as noted:
        press_ctrl_c()
    assert not noted.is_set()
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_a_verb_that_fails_because_of_ctrl_c_was_interrupted(monkeypatch, capsys):
    def fails(options):
        raise RuntimeError('unable to convert call argument')

    def fails_by_ctrl_c(options):
        try:
            press_ctrl_c()
        except KeyboardInterrupt:
            fails(options)
    monkeypatch.setattr(arm_urdf, 'run', fails_by_ctrl_c)
    assert main.main(['arm', 'urdf']) == 130
    assert 'interrupted' in capsys.readouterr().err
    monkeypatch.setattr(arm_urdf, 'run', fails)
    with pytest.raises(RuntimeError, match='unable to convert'):
        main.main(['arm', 'urdf'])


def test_ctrl_c_comes_at_the_end_of_what_it_must_not_interrupt():
    done = []
    with noted_interrupts() as noted:
        with pytest.raises(KeyboardInterrupt), held_interrupts():
            os.kill(os.getpid(), signal.SIGINT)
            done.append('not interrupted')
        assert noted.is_set() and done
        with held_interrupts():
            done.append('once')
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            done.append('interrupted')
    assert done == ['not interrupted', 'once']


def test_ctrl_c_while_a_text_is_executed_does_not_end_the_process_by_the_signal(tmp_path):
    """As while a module is imported that makes a dataclass."""
    (tmp_path / 'program.py').write_text("""
from gdmp_ros.util.processes import noted_interrupts
def main():
    with noted_interrupts():
        try:
            exec("import signal; signal.raise_signal(signal.SIGINT)")
        except KeyboardInterrupt:
            return 130
raise SystemExit(main())
""")
    done = subprocess.run([sys.executable, '-m', 'program'], cwd=tmp_path, capture_output=True,
                          text=True, timeout=60.0)
    assert (done.returncode, done.stderr) == (130, '')


@pytest.mark.parametrize('handler', ['noted_interrupts', 'interrupt_on_sigterm'])
def test_a_signal_in_a_finalizer_is_not_lost(tmp_path, handler):
    """CPython drops what a finalizer raises; one runs at the end of nearly every import."""
    (tmp_path / 'program.py').write_text(f"""
import contextlib, signal, time
from gdmp_ros.util.processes import Interrupt, {handler}
number = signal.SIGINT if '{handler}' == 'noted_interrupts' else signal.SIGTERM
class Finalized:
    def __del__(self):
        signal.raise_signal(number)
def main():
    with {handler}() or contextlib.nullcontext():
        try:
            Finalized()
            time.sleep(30.0)
        except Interrupt:
            return 130
raise SystemExit(main())
""")
    done = subprocess.run([sys.executable, '-m', 'program'], cwd=tmp_path, capture_output=True,
                          text=True, timeout=60.0)
    assert (done.returncode, done.stderr) == (130, '')
