"""Steering a motion around point obstacles."""
from __future__ import annotations

import math

from gdmp_ros.compilation import compiled, kept_apart

#: How quickly the steering fades with the angle between motion and obstacle [1/rad].
_ANGLE_DECAY = 3.0


@compiled
def steer(position, velocity, obstacles, gain, reach, bound, out):
    """
    Acceleration across ``velocity`` that turns it away from the obstacles, at most ``bound``.

    ``γ |v| e^(-β θ) (1 - d/r)²`` for each obstacle nearer than r, with θ the angle between the
    velocity and the obstacle, d its distance: strongest when heading for it, none when it is
    behind or at rest. Head-on, where both sides are as good, one is chosen.

    :param position: shape (2,) or (3,)
    :param velocity: by s, as the acceleration is
    :param obstacles: their positions one after another

    Source: after Hoffmann, Pastor, Park, Schaal 2009 (ICRA), eqs. (9), (10), with a finite reach.
    """
    kept_apart()
    size = position.size
    speed2 = 0.0
    for i in range(size):
        out[i] = 0.0
        speed2 += velocity[i] * velocity[i]
    speed = math.sqrt(speed2)
    if speed < 1e-9:
        return
    least = 0
    for i in range(size):
        if abs(velocity[i]) < abs(velocity[least]):
            least = i
    for k in range(0, obstacles.size, size):
        far2, along = 0.0, 0.0
        for i in range(size):
            away = obstacles[k + i] - position[i]
            far2 += away * away
            along += away * velocity[i] / speed
        far = math.sqrt(far2)
        if far >= reach or far < 1e-12:
            continue
        # The obstacle's direction splits into a part along the velocity and one across.
        across = math.sqrt(max(far2 - along * along, 0.0))
        angle = math.atan2(across, along)
        strength = gain * speed * math.exp(-_ANGLE_DECAY * angle) * (1.0 - far / reach) ** 2
        if across > 1e-9 * far:
            for i in range(size):
                side = obstacles[k + i] - position[i] - along * velocity[i] / speed
                out[i] -= strength * side / across
        else:
            share = velocity[least] / speed
            length = math.sqrt(1.0 - share * share)
            for i in range(size):
                unit = (1.0 if i == least else 0.0) - share * velocity[i] / speed
                out[i] += strength * unit / length
    total = 0.0
    for i in range(size):
        total += out[i] * out[i]
    if total > bound * bound:
        for i in range(size):
            out[i] *= bound / math.sqrt(total)
