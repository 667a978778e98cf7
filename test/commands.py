"""
The command line: in this process, or as a user has it, as a process.

A process costs two to three seconds of CPU time, most of it for imports; what a verb does is the
same without.
"""
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from functools import partial
import io
import os
import subprocess
import sys
from typing import NamedTuple

from experiments.__main__ import PROGRAM as EXPERIMENTS
from gdmp_ros.cli.main import PROGRAM

GDMP = [sys.executable, '-m', 'gdmp_ros.cli.start']


class Done(NamedTuple):
    """What a command returned and printed, named as those of a process."""

    returncode: int
    stdout: str
    stderr: str


def _run(program, *words, given='', cwd=None, **environment):
    """
    Run a command to its end, in this process.

    :param given: what is typed
    :param environment: variables that the command has too
    """
    out, errors = io.StringIO(), io.StringIO()
    with (_environment(environment), _typed(given), chdir(cwd or os.curdir),
          redirect_stdout(out), redirect_stderr(errors)):
        try:
            code = program.main([*map(str, words)])
        except SystemExit as ended:
            code = ended.code
    return Done(code, out.getvalue(), errors.getvalue())


gdmp = partial(_run, PROGRAM)
experiments = partial(_run, EXPERIMENTS)


def gdmp_process(*words, given=None, cwd=None, timeout=280, **environment):
    """Run ``gdmp`` to its end, as a process."""
    return subprocess.run([*GDMP, *map(str, words)], input=given, capture_output=True, text=True,
                          cwd=cwd, timeout=timeout, env={**os.environ, **environment})


@contextmanager
def _environment(values):
    before = dict(os.environ)
    os.environ.update({name: str(value) for name, value in values.items()})
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


@contextmanager
def _typed(text):
    before, sys.stdin = sys.stdin, io.StringIO(text)
    try:
        yield
    finally:
        sys.stdin = before
