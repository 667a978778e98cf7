"""
Runs a module as ``python -m`` does, in a process that ends (SIGTERM) with its parent.

That is asked for here, in the child: code of ours between fork and exec is not safe in a parent
that has threads, and costs a fork of all its memory.
"""
from __future__ import annotations

import ctypes
import os
import runpy
import signal
import sys

_PR_SET_PDEATHSIG = 1


def command(module: str, *arguments: str) -> list[str]:
    """Command that runs a module in a child of this process."""
    return [sys.executable, '-m', __name__, str(os.getpid()), module, *arguments]


def main(parent: str, module: str, *arguments: str) -> None:
    """
    Run a module.

    :param parent: process that it ends with
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != int(parent):  # before it could be asked for
        sys.exit(f'{module}: who started it has gone')
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name='__main__', alter_sys=True)


if __name__ == '__main__':
    main(*sys.argv[1:])
