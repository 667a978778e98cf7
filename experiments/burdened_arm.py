"""The node ``franka_arm`` with a thread that keeps the interpreter busy, and much garbage."""
from __future__ import annotations

import gc
import threading
import time

from gdmp_ros.ros.arm.franka_arm import main

#: Objects in a cycle that a collection visits: about 50 ms.
GARBAGE = 550_000
#: Time between two collections [s].
EVERY_S = 1.0


def burn() -> None:
    """Compute in Python for ever, and collect garbage by the way."""
    kept: list[object] = [[index] for index in range(GARBAGE)]
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
