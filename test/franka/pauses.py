"""How long this machine stands still: a robot stops when it misses 20 commands, one each ms."""
from contextlib import suppress
import os
import subprocess
import sys
import threading
import time

#: A pause after which the robot, with a few more late commands, may stop [s].
LONG_S = 0.015
_EACH_S = 0.002


class Pauses:
    """Measures from another process, with real-time priority if that is granted."""

    def __enter__(self):
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        return self

    def __exit__(self, *_):
        self._process.communicate()

    def longest(self):
        """Longest pause since the last call [s]."""
        self._process.stdin.write('\n')
        self._process.stdin.flush()
        return float(self._process.stdout.readline())


def _measure():
    """One thread for each core; the parent asks by a line and ends by closing the pipe."""
    longest = {}

    def watch(core):
        os.sched_setaffinity(0, {core})
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
        last = time.monotonic()
        while True:
            time.sleep(_EACH_S)
            now = time.monotonic()
            longest[core] = max(longest.get(core, 0.0), now - last - _EACH_S)
            last = now
    for core in os.sched_getaffinity(0):
        threading.Thread(target=watch, args=(core,), daemon=True).start()
    for _ in sys.stdin:
        print(max(longest.values(), default=0.0), flush=True)
        longest.clear()


if __name__ == '__main__':
    _measure()
