"""The node ``franka_arm`` with a thread that keeps the interpreter busy, and much garbage."""
from __future__ import annotations

import gc
import threading
import time

from gdmp_ros.ros.arm.franka_arm import main

#: CPU time of a collection [s], and time between two [s].
COLLECTION_S, EVERY_S = 0.05, 1.0
#: Objects whose collection is timed first.
FIRST = 100_000


def burn() -> None:
    """Compute in Python for ever, and collect garbage by the way."""
    kept: list[object] = [[index] for index in range(FIRST)]
    gc.collect()
    begun = time.thread_time()
    gc.collect()
    count = round(FIRST * COLLECTION_S / (time.thread_time() - begun))
    kept = [[index] for index in range(count)]
    due = time.monotonic()
    while True:
        sum(range(1000))
        if time.monotonic() > due:
            kept.append([kept])
            gc.unfreeze()
            gc.collect()
            due = time.monotonic() + EVERY_S


if __name__ == '__main__':
    threading.Thread(target=burn, daemon=True).start()
    raise SystemExit(main())
