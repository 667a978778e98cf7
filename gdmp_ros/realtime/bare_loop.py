"""Reference for lateness: a process that only sleeps to 1 kHz deadlines."""
from __future__ import annotations

import sys

from gdmp_ros.realtime.loop import periodic, run, SystemClock
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.util.processes import stop_event

PERIOD_NS = 1_000_000


def main(path: str, capacity: str = '131072') -> int:
    """Run until SIGTERM or SIGINT, then write deadline and lateness of the ticks to ``path``."""
    recorder, clock = LatenessRecorder(PERIOD_NS, int(capacity)), SystemClock()
    run(periodic(recorder.add, PERIOD_NS, clock), clock, stop_event().is_set)
    recorder.save(path)
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
