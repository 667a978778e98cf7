"""How long this machine stands still: a robot stops when it misses 20 commands, one each ms."""
from contextlib import suppress
import json
import os
import subprocess
import sys
import threading
import time

#: A pause after which the robot, with a few more late commands, may stop [s].
LONG_S = 0.015
#: Between the end of a pause and a motion that the robot ended for it [s].
NEAR_S = 0.5
_EACH_S = 0.002


class Pauses:
    """Measures from another process, with real-time priority if that is granted."""

    def __enter__(self):
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        return self

    def __exit__(self, *_):
        self._process.communicate()

    def at(self, when):
        """Longest pause that ended within `NEAR_S` of a wall time [s]; 0 if none was long."""
        self._process.stdin.write('\n')
        self._process.stdin.flush()
        return max((length for ended, length in json.loads(self._process.stdout.readline())
                    if abs(ended - when) < NEAR_S), default=0.0)


def _measure():
    """One thread for each core; the parent asks by a line and ends by closing the pipe."""
    long = []

    def watch(core):
        os.sched_setaffinity(0, {core})
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
        last = time.monotonic()
        while True:
            time.sleep(_EACH_S)
            now = time.monotonic()
            if now - last - _EACH_S > LONG_S:
                long.append((time.time(), now - last - _EACH_S))
            last = now
    for core in os.sched_getaffinity(0):
        threading.Thread(target=watch, args=(core,), daemon=True).start()
    for _ in sys.stdin:
        print(json.dumps(long), flush=True)


if __name__ == '__main__':
    _measure()
