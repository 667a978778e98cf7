"""Limits on what is sent to the motors."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class TorqueLimiter:
    """
    Joint-limit repulsion, then torque rate, then torque.

    :ivar lower: lowest joint positions [rad]
    :ivar upper: highest joint positions [rad]
    :ivar torque: largest torques [Nm]
    :ivar rate: largest change of a torque per tick [Nm]
    :ivar margin: distance from a joint limit at which repulsion begins [rad]
    :ivar repulsion: at the limit itself [Nm]
    """

    lower: np.ndarray
    upper: np.ndarray
    torque: np.ndarray
    rate: float = 1.0
    margin: float = 0.3
    repulsion: float = 5.0
    #: How often each limit has bitten.
    bites: dict[str, int] = field(default_factory=lambda: {'torque': 0, 'torque_rate': 0,
                                                           'joint': 0})
    _last: np.ndarray | None = None

    def reset(self, torque: np.ndarray) -> None:
        """Begin at ``torque``: the next one may differ from it by `rate`."""
        self._last = np.clip(torque, -self.torque, self.torque)

    def apply(self, position: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Return the torque to send [Nm]."""
        push = np.clip((self.lower + self.margin - position) / self.margin, 0.0, 1.0)
        push -= np.clip((position - self.upper + self.margin) / self.margin, 0.0, 1.0)
        if push.any():
            self.bites['joint'] += 1
            torque = torque + self.repulsion * push
        if self._last is not None:
            limited = np.clip(torque, self._last - self.rate, self._last + self.rate)
            self.bites['torque_rate'] += int((limited != torque).any())
            torque = limited
        limited = np.clip(torque, -self.torque, self.torque)
        self.bites['torque'] += int((limited != torque).any())
        self._last = limited
        return np.asarray(limited)
