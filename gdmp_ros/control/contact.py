"""Contact: a wrench that is wished is kept by feedback, one that opposes a motion stops it."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.settings import ContactSettings
from gdmp_ros.control.target import TWIST, WRENCH, WRENCH_GAIN
from gdmp_ros.manifolds.linalg import is_finite, is_zero

#: The external wrench is smoothed with this time constant [s].
SMOOTHING_S = 0.01
#: A correction that is no longer wished decays with this time constant [s].
DECAY_S = 0.2
#: A motion is stopped if the external wrench is not finite for this time [s].
UNKNOWN_S = 0.1
#: A reference slower than this does not collide [m/s, rad/s].
LEAST_SPEED, LEAST_ANGULAR_SPEED = 0.005, 0.02


class Contact:
    """
    Wrench feedback and collision reflex of one arm.

    :ivar wrench: smoothed external wrench, acting on the tool [N, Nm]
    """

    def __init__(self, settings: ContactSettings):
        self.settings = settings
        self.reset()

    def reset(self) -> None:
        """Without contact and correction."""
        self.wrench, self._correction = np.zeros(6), np.zeros(6)
        self._unknown = 0.0

    def correct(self, reference: np.ndarray, dt: float) -> None:
        """
        Add the correction to the wrench of a reference.

        It grows with the difference between the wished and the measured wrench, at the rate
        ``wrench_gain``, up to ``force_feedback_max``.
        """
        gain, wished = reference[WRENCH_GAIN:], reference[WRENCH:WRENCH_GAIN]
        correction = self._correction
        if is_zero(gain) and is_zero(correction):
            return
        # What the tool exerts is the opposite of what acts on it.
        correction += np.where(gain > 0.0, dt * gain * (wished + self.wrench),
                               -min(dt / DECAY_S, 1.0) * correction)
        for part, largest in zip((correction[:3], correction[3:]),
                                 self.settings.force_feedback_max):
            size = math.sqrt(part @ part)
            if size > largest:
                part *= largest / size
        correction[np.abs(correction) < 1e-6] = 0.0
        wished += correction

    def update(self, wrench: np.ndarray, reference: np.ndarray, dt: float) -> str:
        """
        Use a measured external wrench.

        :param wrench: acting on the tool [N, Nm]
        :param reference: with its twist, and the wrench that it exerts
        :returns: description of a collision, or that none would be felt; empty without one
        """
        settings = self.settings
        if not is_finite(wrench):
            self._unknown += dt
            felt = settings.collision_force or settings.collision_torque
            return ('the external torque is not finite: a collision would not be felt'
                    if felt and self._unknown > UNKNOWN_S else '')
        self._unknown = 0.0
        self.wrench += min(dt / SMOOTHING_S, 1.0) * (wrench - self.wrench)
        for first, least, largest, unit in (
                (0, LEAST_SPEED, settings.collision_force, 'N'),
                (3, LEAST_ANGULAR_SPEED, settings.collision_torque, 'Nm')):
            if not largest:
                continue
            twist = reference[TWIST + first:TWIST + first + 3]
            speed = math.sqrt(twist @ twist)
            if speed < least:
                continue
            unexpected = (self.wrench[first:first + 3]
                          + reference[WRENCH + first:WRENCH + first + 3])
            against = -float(unexpected @ twist) / speed
            if against > largest:
                return f'collision: {against:.3g} {unit} against the motion'
        return ''
