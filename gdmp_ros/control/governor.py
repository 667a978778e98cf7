"""
What is asked of the arm: the reference, with its speed, acceleration and place inside limits.

The follower's own reference moves with the given one as long as that stays inside the limits. What
it has fallen behind, at a limit or after an interruption, it catches up with at a bounded speed.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled
from gdmp_ros.control.impedance import (
    ACCELERATION,
    POSE,
    rotation_error,
    task_inertia_inverse,
    TWIST,
)
from gdmp_ros.control.limits import (
    ACCELERATION_LIMIT,
    JOINT_SPEED,
    LimitSettings,
    SINGULARITY,
    SPEED,
    SPEED_MARGIN,
    TURN_ACCELERATION,
    TURN_SPEED,
    WORKSPACE,
)
from gdmp_ros.manifolds.linalg import cholesky, invert_lower
from gdmp_ros.manifolds.spectral import symmetric_eigen

#: What falls behind is caught up with in about this time, more slowly where it is far [s].
CATCH_UP_S = 0.02
#: A given acceleration is believed as far as it is within this of the mean of what the reference
#: has done over about so long [m/s^2, rad/s^2, s]: a false one would drive the arm.
SLACK, TURN_SLACK, MEAN_S = 3.0, 15.0, 0.03
#: Where the follower keeps that mean, in its own reference: a target has its stiffness there.
MEAN_ACCELERATION = 19
#: Rotations count as motions of a point at this distance, in the Jacobian's singular values [m].
SINGULAR_LENGTH = 0.3
(_SPEED, _TURN_SPEED, _ACCELERATION, _TURN_ACCELERATION, _CATCH_UP, _CATCH_UP_TURN, _JOINT_SPEED,
 _SINGULAR_START, _SINGULAR_STOP, _LOW, _HIGH) = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 12)
_EPSILON = 0.02


def limit_numbers(settings: LimitSettings) -> np.ndarray:
    """Return the limits as `follow` takes them."""
    return np.array([settings.speed, settings.turn_speed, settings.acceleration,
                     settings.turn_acceleration, settings.catch_up_speed,
                     settings.catch_up_turn_speed, SPEED_MARGIN * settings.joint_speed,
                     settings.singularity_start, settings.singularity_stop,
                     *settings.workspace_min, *settings.workspace_max])


@compiled
def _norm(v):
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@compiled
def _inside(place, twist, limits):
    """Pull a position into the workspace; the distance it was outside."""
    outside = 0.0
    for i in range(3):
        inside = min(max(place[i], limits[_LOW + i]), limits[_HIGH + i])
        if inside != place[i]:
            outside += (place[i] - inside) ** 2
            place[i] = inside
            twist[i] = 0.0
    return math.sqrt(outside)


@compiled
def _approach(lag, deceleration, fastest, velocity):
    """Add the velocity that closes a lag without overshooting."""
    far = _norm(lag)
    if far < 1e-12:
        return
    speed = min(far / CATCH_UP_S, fastest, math.sqrt(2.0 * deceleration * far))
    for i in range(3):
        velocity[i] += speed / far * lag[i]


@compiled
def _shortened(v, limit):
    """Shorten a vector to a limit; by how much it was longer."""
    norm = _norm(v)
    if norm <= limit:
        return 0.0
    for i in range(3):
        v[i] *= limit / norm
    return norm - limit


@compiled
def _before_walls(followed, velocity, limits):
    """Slow down before a wall of the workspace so that the acceleration allows to stop there."""
    for i in range(3):
        above = max(limits[_HIGH + i] - followed[POSE + i], 0.0)
        below = max(followed[POSE + i] - limits[_LOW + i], 0.0)
        velocity[i] = min(velocity[i], math.sqrt(limits[_ACCELERATION] * above))
        velocity[i] = max(velocity[i], -math.sqrt(limits[_ACCELERATION] * below))


@compiled
def _joint_velocity(jacobian, inertia, twist, out):
    """``M⁻¹ Jᵀ Λ ẋ``: how the joints move with a twist."""
    n = inertia.shape[0]
    solved = np.empty((n, 6))
    inverse = task_inertia_inverse(inertia, jacobian, _EPSILON, solved)
    lower, lower_inverse = np.empty(36), np.empty(36)
    cholesky(6, inverse.reshape(36), lower)
    invert_lower(6, lower, lower_inverse)
    half, force = np.zeros(6), np.zeros(6)
    for i in range(6):
        for j in range(i + 1):
            half[i] += lower_inverse[6 * i + j] * twist[j]
    for i in range(6):
        for j in range(i, 6):
            force[i] += lower_inverse[6 * j + i] * half[j]
    for i in range(n):
        out[i] = 0.0
        for j in range(6):
            out[i] += solved[i, j] * force[j]


@compiled
def singular_value(jacobian, direction):
    """
    Smallest singular value of the Jacobian, rotations scaled by `SINGULAR_LENGTH` [m].

    :param direction: result, its left singular vector, shape (6,)
    """
    n = jacobian.shape[1]
    square, values, vectors, work = np.empty(36), np.empty(6), np.empty(36), np.empty(36)
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(n):
                total += jacobian[i, k] * jacobian[j, k]
            square[6 * i + j] = (total * (SINGULAR_LENGTH if i > 2 else 1.0)
                                 * (SINGULAR_LENGTH if j > 2 else 1.0))
    symmetric_eigen(6, square, values, vectors, work)
    least = 0
    for i in range(1, 6):
        if values[i] < values[least]:
            least = i
    for i in range(6):
        direction[i] = vectors[6 * least + i]
    return math.sqrt(max(values[least], 0.0))


@compiled
def singular_rate(jacobian, velocity, direction):
    """
    Sign and size of the rate of half the squared smallest singular value.

    Of a chain of joints: turning joint k turns all that lies beyond it.

    :param velocity: of the joints, shape (n,)
    :param direction: left singular vector of `singular_value`
    """
    n = jacobian.shape[1]
    turn, beyond = np.zeros(3), np.zeros(3)
    for k in range(n):
        for i in range(3):
            beyond[i] += jacobian[i, k] * velocity[k]
    total = 0.0
    for k in range(n):
        # The turn up to joint k includes its own; axes are turned by the joints before it alone.
        z, j = jacobian[3:, k], jacobian[:3, k]
        axis = 0.0
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            axis += direction[3 + i] * (turn[p] * z[q] - turn[q] * z[p])
        for i in range(3):
            turn[i] += z[i] * velocity[k]
            beyond[i] -= j[i] * velocity[k]
        linear, amount = 0.0, 0.0
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            linear += direction[i] * (turn[p] * j[q] - turn[q] * j[p]
                                      + z[p] * beyond[q] - z[q] * beyond[p])
            amount += direction[i] * j[i] + SINGULAR_LENGTH * direction[3 + i] * z[i]
        total += amount * (linear + SINGULAR_LENGTH * axis)
    return total


@compiled
def _slowed(velocity, jacobian, inertia, limits, excess):
    """Slow a twist down for the joints' speed, and before a singularity."""
    n = inertia.shape[0]
    joints, direction = np.empty(n), np.empty(6)
    _joint_velocity(jacobian, inertia, velocity, joints)
    fastest = 0.0
    for i in range(n):
        fastest = max(fastest, abs(joints[i]))
    scale = 1.0
    if fastest > limits[_JOINT_SPEED]:
        excess[JOINT_SPEED] = fastest - limits[_JOINT_SPEED]
        scale = limits[_JOINT_SPEED] / fastest
    value = singular_value(jacobian, direction)
    if value < limits[_SINGULAR_START] and singular_rate(jacobian, joints, direction) < 0.0:
        left = ((value - limits[_SINGULAR_STOP])
                / (limits[_SINGULAR_START] - limits[_SINGULAR_STOP]))
        left = max(left, 0.0)
        excess[SINGULARITY] = 1.0 - left
        scale = min(scale, left)
    for i in range(6):
        velocity[i] *= scale


@compiled
def follow(followed, wanted, jacobian, inertia, limits, dt, excess):
    """
    Twist and acceleration of the follower's reference for the next tick.

    :param followed: the follower's reference: pose 7, twist 6, acceleration 6, mean acceleration
        6; all but the pose are written, the pose is moved with `moved`
    :param wanted: the given reference; its position is pulled into the workspace
    :param limits: `limit_numbers`
    :param excess: written: by how much each limit has bitten
    """
    velocity, lag = np.empty(6), np.empty(6)
    for i in range(6):
        velocity[i] = wanted[TWIST + i] - 0.5 * dt * wanted[ACCELERATION + i]
    excess[WORKSPACE] = _inside(wanted[POSE:POSE + 3], velocity, limits)
    rotation_error(followed[POSE + 3:POSE + 7], wanted[POSE + 3:POSE + 7], lag[3:])
    for i in range(3):
        lag[i] = wanted[POSE + i] - followed[POSE + i]
    for i in range(6):
        lag[i] -= dt * velocity[i]
    _approach(lag[:3], 0.5 * limits[_ACCELERATION], limits[_CATCH_UP], velocity[:3])
    _approach(lag[3:], 0.5 * limits[_TURN_ACCELERATION], limits[_CATCH_UP_TURN], velocity[3:])
    _slowed(velocity, jacobian, inertia, limits, excess)
    _before_walls(followed, velocity, limits)
    excess[SPEED] = _shortened(velocity[:3], limits[_SPEED])
    excess[TURN_SPEED] = _shortened(velocity[3:], limits[_TURN_SPEED])
    change = np.empty(6)
    for i in range(6):
        change[i] = (velocity[i] - followed[TWIST + i]) / dt
    excess[ACCELERATION_LIMIT] = _shortened(change[:3], limits[_ACCELERATION])
    excess[TURN_ACCELERATION] = _shortened(change[3:], limits[_TURN_ACCELERATION])
    for i in range(6):
        followed[TWIST + i] += dt * change[i]
        followed[MEAN_ACCELERATION + i] += dt / MEAN_S * (change[i]
                                                          - followed[MEAN_ACCELERATION + i])
    _believed(followed, wanted, 0, limits[_ACCELERATION], SLACK)
    _believed(followed, wanted, 3, limits[_TURN_ACCELERATION], TURN_SLACK)
    if _behind(excess):
        for i in range(6):
            followed[ACCELERATION + i] = 0.0


@compiled
def _believed(followed, wanted, part, limit, slack):
    """Acceleration to feed forward: the given one, as far as the motion has it."""
    deviation = followed[ACCELERATION + part:ACCELERATION + part + 3]
    for i in range(3):
        deviation[i] = (wanted[ACCELERATION + part + i]
                        - followed[MEAN_ACCELERATION + part + i])
    _shortened(deviation, slack)
    for i in range(3):
        deviation[i] += followed[MEAN_ACCELERATION + part + i]
    _shortened(deviation, limit)


@compiled
def _behind(excess):
    return (excess[WORKSPACE] > 0.0 or excess[SPEED] > 0.0 or excess[TURN_SPEED] > 0.0
            or excess[ACCELERATION_LIMIT] > 0.0 or excess[TURN_ACCELERATION] > 0.0
            or excess[JOINT_SPEED] > 0.0 or excess[SINGULARITY] > 0.0)


@compiled
def moved(followed, seconds, pose):
    """Write to ``pose`` (7 numbers) where a reference is after moving with its own twist."""
    rotation = np.empty(3)
    for i in range(3):
        pose[i] = followed[POSE + i] + seconds * followed[TWIST + i]
        rotation[i] = seconds * followed[TWIST + 3 + i]
    # A turn about the base frame's axes multiplies from the left.
    angle = _norm(rotation)
    factor = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    w, x, y, z = (math.cos(0.5 * angle), factor * rotation[0], factor * rotation[1],
                  factor * rotation[2])
    a, b, c, d = (followed[POSE + 3], followed[POSE + 4], followed[POSE + 5], followed[POSE + 6])
    pose[3] = w * a - x * b - y * c - z * d
    pose[4] = w * b + x * a + y * d - z * c
    pose[5] = w * c - x * d + y * a + z * b
    pose[6] = w * d + x * c - y * b + z * a
    norm = math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2 + pose[6] ** 2)
    for i in range(3, 7):
        pose[i] /= norm
