"""A topic published at the rate of the loop."""
from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from gdmp_ros.nodes.wire import Patched

#: Time between two looks whether somebody listens [s].
LOOK_S = 0.01


class Stream:
    """
    Messages that differ in numbers, stamp and sequence number only.

    While nobody listens no message is made: what a volatile topic carried then would reach no one.
    """

    def __init__(self, publisher: Any, message: Patched):
        self._publisher = publisher
        self._message = message
        self._listened = False
        self._looked = -math.inf

    def publish(self, numbers: np.ndarray, stamp_ns: int = 0, sequence: int = 0) -> None:
        """Publish, if somebody listens."""
        now = time.monotonic()
        if now - self._looked >= LOOK_S:
            self._looked = now
            self._listened = self._publisher.get_subscription_count() > 0
        if self._listened:
            self._publisher.publish(self._message.bytes(numbers, stamp_ns, sequence))
