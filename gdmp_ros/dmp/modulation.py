"""How fast a motion passes, and how large its cycle is: changed while it runs."""
from __future__ import annotations

import math

from gdmp_ros.dmp.goal import SETTLED
from gdmp_ros.dmp.layout import Motion
from gdmp_ros.dmp.options import check_range, MAX_AMPLITUDE, MAX_SPEED
from gdmp_ros.dmp.primitive import Primitive
from gdmp_ros.errors import ParameterError


class Modulation:
    """
    Speed of a motion; frequency and amplitude of a rhythmic one: a part of `gdmp_ros.dmp.Rollout`.

    The centre of a cycle is changed as any goal is (`Rollout.retarget`).
    """

    skill: Primitive
    motion: Motion
    _duration: float

    @property
    def speed(self) -> float:
        """Present speed of the phase; 1 is as demonstrated."""
        return float(self.motion.scalars.speed)

    @property
    def progress(self) -> float:
        """``s = ∫ dt/τ``: 1 at the nominal end, or after one cycle, and increases further."""
        return float(self.motion.scalars.progress)

    @property
    def phase(self) -> float:
        """``x``, from 1 towards 0; of a rhythmic motion φ, 0 to 2π."""
        if self.skill.rhythmic:
            return 2.0 * math.pi * (self.progress % 1.0)
        return math.exp(-self.skill.gains.alpha_x * self.progress)

    @property
    def duration(self) -> float:
        """Duration at speed 1, of a rhythmic motion the period [s]."""
        return self._duration

    @property
    def amplitude(self) -> float:
        """Present factor of the cycle: 1 as demonstrated; 0 for a skill that is not rhythmic."""
        return float(self.motion.scalars.amplitude)

    @property
    def frequency(self) -> float:
        """Cycles per second at present [Hz]; 0 for a skill that is not rhythmic."""
        scalars = self.motion.scalars
        return float(scalars.rhythmic * scalars.speed / scalars.duration)

    def set_speed(self, scale: float) -> None:
        """
        Change the speed to ``scale`` (1 as demonstrated, 0 a stop) at a bounded rate.

        The path does not change.

        :raises ParameterError: outside 0 … 2
        """
        self.motion.scalars.speed_goal = check_range('speed', scale, 0.0, MAX_SPEED)

    def resume(self) -> None:
        """Return to speed 1, as if the robot had caught up (`observe`)."""
        self.motion.scalars.slowdown = 1.0
        self.set_speed(1.0)

    def set_amplitude(self, amplitude: float) -> None:
        """
        Change the amplitude, smoothly: 1 as demonstrated, 0 ends the motion at the centre.

        The factor acts on the forcing term. On a flat space it scales the cycle exactly; on a
        curved one nearly, the better the smaller the cycle.

        :raises ParameterError: outside 0 … 2, or if the skill is not rhythmic
        """
        self._check_rhythmic('amplitude')
        check_range('amplitude', amplitude, 0.0, MAX_AMPLITUDE)
        scalars = self.motion.scalars
        scalars.amplitude_goal = amplitude
        scalars.finished = scalars.not_settled = 0
        scalars.arrived_at = -1.0
        # The amplitude needs as long as a goal; half a cycle more for the filter behind it.
        # A centre that moves slowly may need longer.
        scalars.settle_by = max(scalars.settle_by if scalars.goal_is_moving else 0.0,
                                scalars.progress + 0.5 + max(1.0, SETTLED / scalars.alpha_g))

    def set_frequency(self, frequency: float) -> None:
        """
        Change the number of cycles per second, at a bounded rate; the cycle does not change.

        :param frequency: 0 to twice the demonstrated one [Hz]
        :raises ParameterError: for another number, or if the skill is not rhythmic
        """
        self._check_rhythmic('frequency')
        check_range('frequency', frequency, 0.0, MAX_SPEED / self._duration)
        self.set_speed(frequency * self._duration)

    def _check_rhythmic(self, what: str) -> None:
        if not self.skill.rhythmic:
            raise ParameterError(f'{what}: the skill is not rhythmic; learn it with '
                                 'Skill.learn_rhythmic or gdmp learn --rhythmic')
