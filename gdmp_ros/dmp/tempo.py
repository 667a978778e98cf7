"""How time becomes progress: the tempo, its ramp, and ``s = ∫ dt/τ``."""
from __future__ import annotations

import math

from gdmp_ros.compilation import inlined
from gdmp_ros.dmp.memory import (
    DURATION,
    RAMP,
    S,
    SLOWDOWN,
    SPEED,
    SPEED_GOAL,
    SPEED_RATE,
    SPEED_SLOPE,
    TIME,
)

#: Time constant with which the tempo follows its ramp, so that it has no kink [s].
TEMPO_LAG = 0.02
#: The tempo has arrived when this near: with the lag a step of 0.05 % of nominal speed per second.
_TEMPO_ARRIVED = 1e-5


@inlined
def _follow(numbers, rate, dt):
    """
    Let the tempo follow its ramp, which changes by ``rate``, for ``dt``; return the time passed.

    The ramp is continuous and of bounded rate; behind a first-order lag the tempo has a bounded
    and continuous rate, and never leaves the range of the ramp. In closed form, so that the result
    does not depend on how time is cut into steps.
    """
    ramp, speed = numbers[RAMP], numbers[SPEED]
    numbers[RAMP] += rate * dt
    if rate == 0.0 and abs(speed - ramp) < _TEMPO_ARRIVED:
        numbers[SPEED], numbers[SPEED_SLOPE] = ramp, 0.0
        return ramp * dt
    gap = speed - ramp + rate * TEMPO_LAG
    decay = math.exp(-dt / TEMPO_LAG)
    numbers[SPEED] = numbers[RAMP] - rate * TEMPO_LAG + gap * decay
    numbers[SPEED_SLOPE] = rate - gap * decay / TEMPO_LAG
    return ((ramp + 0.5 * rate * dt - rate * TEMPO_LAG) * dt
            - gap * TEMPO_LAG * math.expm1(-dt / TEMPO_LAG))


@inlined
def pass_time(numbers, dt):
    """Advance ``s`` by ``dt`` of time while the tempo moves to its goal at a bounded rate."""
    goal = numbers[SPEED_GOAL] * numbers[SLOWDOWN]
    left = goal - numbers[RAMP]
    ramp = min(dt, abs(left) / numbers[SPEED_RATE])
    travelled = 0.0
    if ramp > 0.0:
        travelled += _follow(numbers, math.copysign(numbers[SPEED_RATE], left), ramp)
    if ramp < dt or left == 0.0:
        numbers[RAMP] = goal
        travelled += _follow(numbers, 0.0, dt - ramp)
    numbers[S] += travelled / numbers[DURATION]
    numbers[TIME] += dt
