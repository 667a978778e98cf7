"""Contact: a wrench that is wished is kept by feedback, one that opposes a motion stops it."""
from __future__ import annotations

from gdmp_ros.control.target import WRENCH, WRENCH_GAIN
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import is_finite, is_zero, limit_norm, norm

#: The external wrench is smoothed with this time constant [s].
SMOOTHING_S = 0.01
#: A correction that is no longer wished decays with this time constant [s].
DECAY_S = 0.2
#: A motion is stopped if the external wrench is not finite for this time [s].
UNKNOWN_S = 0.1
#: A reference slower than this does not collide [m/s, rad/s].
LEAST_SPEED, LEAST_ANGULAR_SPEED = 0.005, 0.02
#: What `feel` returns.
NOTHING, FORCE, TORQUE, BLIND = range(4)


@kernel
def correct(scalars, felt, correction, reference):
    """
    Add the correction to the wrench of a reference.

    It grows with the difference between the wished and the measured wrench, at the rate
    ``wrench_gain``, up to ``force_feedback_max``.

    :param scalars: those of `gdmp_ros.control.memory`
    :param felt: smoothed external wrench, acting on the tool [N, Nm]
    :param correction: changed [N, Nm]
    :param reference: `TARGET_SIZE` numbers, changed
    """
    if is_zero(reference[WRENCH_GAIN:WRENCH_GAIN + 6]) and is_zero(correction):
        return
    dt = scalars.dt
    for i in range(6):
        gain = reference[WRENCH_GAIN + i]
        # What the tool exerts is the opposite of what acts on it.
        if gain > 0.0:
            correction[i] += dt * gain * (reference[WRENCH + i] + felt[i])
        else:
            correction[i] -= min(dt / DECAY_S, 1.0) * correction[i]
    for first in range(0, 6, 3):
        largest = scalars.feedback_force if first == 0 else scalars.feedback_torque
        limit_norm(3, correction[first:first + 3], largest)
        for i in range(first, first + 3):
            if abs(correction[i]) < 1e-6:
                correction[i] = 0.0
            reference[WRENCH + i] += correction[i]


@kernel
def feel(scalars, felt, wrench, twist, exerted):
    """
    Use a measured external wrench.

    :param felt: smoothed, changed [N, Nm]
    :param wrench: acting on the tool [N, Nm]
    :param twist: of the reference
    :param exerted: wrench of the reference
    :returns: `FORCE` or `TORQUE` if one opposes the motion, with its size in ``scalars.against``;
        `BLIND` if none would be felt, though it is to be; else `NOTHING`
    """
    dt = scalars.dt
    if not is_finite(wrench):
        scalars.unknown += dt
        asked = scalars.collision_force != 0.0 or scalars.collision_torque != 0.0
        return BLIND if asked and scalars.unknown > UNKNOWN_S else NOTHING
    scalars.unknown = 0.0
    for i in range(6):
        felt[i] += min(dt / SMOOTHING_S, 1.0) * (wrench[i] - felt[i])
    for first in range(0, 6, 3):
        largest = scalars.collision_force if first == 0 else scalars.collision_torque
        if largest == 0.0:
            continue
        speed, along = norm(3, twist[first:first + 3]), 0.0
        for i in range(first, first + 3):
            along += (felt[i] + exerted[i]) * twist[i]
        if speed < (LEAST_SPEED if first == 0 else LEAST_ANGULAR_SPEED):
            continue
        if -along / speed > largest:
            scalars.against = -along / speed
            return FORCE if first == 0 else TORQUE
    return NOTHING


def described(event: int, against: float) -> str:
    """
    Describe what `feel` returns, for people.

    :param against: what opposes the motion [N, Nm]
    """
    if event == BLIND:
        return 'the external torque is not finite: a collision would not be felt'
    return f'collision: {against:.3g} {"N" if event == FORCE else "Nm"} against the motion'
