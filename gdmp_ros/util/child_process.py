"""
Runs a module as ``python -m`` does, in a process that gets SIGTERM when its parent ends.

The child asks for the signal itself: running Python code between fork and exec is not safe in a
parent with threads, and copies the page tables of all its memory.
"""
from __future__ import annotations

import ctypes
import os
import runpy
import signal
import sys

_PR_SET_PDEATHSIG = 1


def command(module: str, *arguments: str) -> list[str]:
    """Command line that runs a module in a child of this process."""
    return [sys.executable, '-m', __name__, str(os.getpid()), module, *arguments]


def main(parent: str, module: str, *arguments: str) -> None:
    """
    Run a module.

    :param parent: process id of the parent
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != int(parent):  # it ended before the signal was asked for
        sys.exit(f'{module}: the parent process has ended')
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name='__main__', alter_sys=True)


if __name__ == '__main__':
    main(*sys.argv[1:])
