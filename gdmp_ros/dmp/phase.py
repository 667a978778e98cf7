"""How time becomes progress: ``s = ∫ dt/τ`` with a speed that changes at a bounded rate."""
from __future__ import annotations

import math

from gdmp_ros.kernels import always_inline

#: Time constant with which the speed follows its ramp, so that its rate is continuous [s].
SPEED_LAG = 0.02
#: Below this difference the speed is set to that of the ramp.
_ARRIVED = 1e-5


@always_inline
def _follow_ramp(scalars, rate, dt):
    """
    Let the speed follow its ramp, which changes by ``rate``, for ``dt``; return the time passed.

    The ramp is continuous with a bounded rate. Behind a first-order lag the speed has a bounded
    and continuous rate, and never leaves the range of the ramp. In closed form, so that the result
    does not depend on how time is cut into steps.
    """
    ramp, speed = scalars.speed_ramp, scalars.speed
    scalars.speed_ramp = ramp + rate * dt
    if rate == 0.0 and abs(speed - ramp) < _ARRIVED:
        scalars.speed, scalars.speed_slope = ramp, 0.0
        return ramp * dt
    gap = speed - ramp + rate * SPEED_LAG
    decay = math.exp(-dt / SPEED_LAG)
    scalars.speed = scalars.speed_ramp - rate * SPEED_LAG + gap * decay
    scalars.speed_slope = rate - gap * decay / SPEED_LAG
    return ((ramp + 0.5 * rate * dt - rate * SPEED_LAG) * dt
            - gap * SPEED_LAG * math.expm1(-dt / SPEED_LAG))


@always_inline
def pass_time(scalars, dt):
    """Advance the progress by ``dt`` [s] while the speed moves to its goal at a bounded rate."""
    goal = scalars.speed_goal * scalars.slowdown
    left = goal - scalars.speed_ramp
    ramp = min(dt, abs(left) / scalars.speed_rate)
    passed = 0.0
    if ramp > 0.0:
        passed += _follow_ramp(scalars, math.copysign(scalars.speed_rate, left), ramp)
    if ramp < dt or left == 0.0:
        scalars.speed_ramp = goal
        passed += _follow_ramp(scalars, 0.0, dt - ramp)
    if passed > 0.0:
        scalars.time_per_progress = scalars.duration * dt / passed
    scalars.progress += passed / scalars.duration
    scalars.time += dt
