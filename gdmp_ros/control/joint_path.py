"""
A motion of the joints as polynomials of time, and the compiled tick that makes it.

Every motion of the joints is planned as such a path: to a posture, slow motions for friction, and
coming to rest. What it measures on its way is kept with it.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.governor import HELD_IN_S, share_of_way, TOOL_SPEED_SHARE
from gdmp_ros.control.law import compute
from gdmp_ros.control.memory import arm_view, JOINT_MOTION
from gdmp_ros.control.settings import LIMIT_NUMBERS
from gdmp_ros.kernels import kernel, local_numbers, records_at
from gdmp_ros.manifolds.linalg import copy_into, multiply_vector, norm

#: Coefficients of a polynomial.
ORDER = 6
#: A joint that is further than this from where it is to be does not move freely [rad].
LARGEST_ERROR = 0.2
#: A motion with a smaller share of its speed waits; one that waits for longer is ended [s].
WAITS, LONGEST_WAIT_S = 0.02, 10.0
#: Time between two samples of a torque [s].
SAMPLE_S = 0.02
#: A tick was made, and Python is to find out what comes next (`ArmControl.catch_up`): what is done
#: goes on until then.
CALLED = 22
#: Problems: a joint does not follow; the motion waited for too long; it was slowed down.
FINE, HELD, WAITED, SLOWED = range(4)

#: How far a motion is; flags are 0 or 1.
PROGRESS = np.dtype([(name, np.float64) for name in (
    'time', 'seconds',  # that has passed for it, and after which it has been made [s]
    'brakes',           # flag: it comes to rest, and nothing keeps it from that
    'steady',           # flag: it may not be slowed down
    'tempo',            # part of the time that passed for it in the last tick
    'waited',           # how long it has made no way [s]
    'problem',          # `FINE`, `HELD` …
    'joint', 'apart',   # that is furthest from where it is to be, and how far [rad]
    'sampled',          # number of samples
    'next')])           # when the next one is due [s]


class JointPath(NamedTuple):
    """
    A motion of n joints in K pieces, and what it has measured.

    :ivar progress: a `PROGRESS` record
    :ivar begins: time at which each piece begins [s], the first at 0; shape (K,)
    :ivar coefficients: of the powers of the time since then, shape (K, `ORDER`, n)
    :ivar measured: joint whose torque is measured in each piece, or -1
    :ivar sums: for each piece: sum of this torque beyond the model [Nm], and number of ticks
    :ivar samples: piece, torque, positions of the joints; shape (S, 2 + n)
    """

    progress: np.ndarray
    begins: np.ndarray
    coefficients: np.ndarray
    measured: np.ndarray
    sums: np.ndarray
    samples: np.ndarray


#: Nothing moves the joints.
NO_PATH = JointPath(np.zeros(len(PROGRESS.names or ())), np.zeros(0), np.zeros((0, ORDER, 0)),
                    np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2)))


@kernel
def place_at(path, time, position, velocity):
    """
    Write where the joints are to be [rad], and how fast [rad/s].

    :returns: the piece
    """
    low, high = 0, path.begins.size
    while high - low > 1:
        middle = (low + high) // 2
        if path.begins[middle] <= time:
            low = middle
        else:
            high = middle
    passed = time - path.begins[low]
    for i in range(position.size):
        value = rate = 0.0
        for k in range(ORDER - 1, -1, -1):
            rate = rate * passed + value
            value = value * passed + path.coefficients[low, k, i]
        position[i], velocity[i] = value, rate
    return low


@kernel
def _share(numbers, rates, dt):
    """
    Share of the speed that is left to a motion of the joints; it grows slowly.

    What is in the way or comes nearer takes the rest, and whether the arm is held.

    :param rates: velocities that are wanted [rad/s]
    :param dt: time since the last tick of the motion [s]
    """
    arm = arm_view(numbers)
    s = arm.scalars
    # A motion of the joints has no reference that stands: the measured arm does.
    beside = s.left if records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0].retreat_speed == 0.0 else 1.0
    before = s.share if s.does == JOINT_MOTION else 1.0
    s.share = min(share_of_way(numbers, rates), beside, s.allowed, before + dt / HELD_IN_S)
    return s.share


@kernel
def _tempo(numbers, rates, dt):
    """
    Part of the time that passes for a motion of the joints.

    The tool is not too fast; beside what is in the way or comes nearer, and while the arm is
    held, it waits.
    """
    arm, moving = arm_view(numbers), local_numbers(3)
    multiply_vector(arm.jacobian[:3], rates, moving)
    largest = TOOL_SPEED_SHARE * records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0].tool_speed
    return min(_share(numbers, rates, dt), largest / max(norm(3, moving), largest))


@kernel
def _sample(path, piece, position, more):
    """
    Keep a torque.

    :param more: beyond the model [Nm]
    """
    p = records_at(path.progress, 0, 1, PROGRESS)[0]
    path.sums[piece, 0] += more
    path.sums[piece, 1] += 1.0
    if p.time >= p.next and p.sampled < path.samples.shape[0]:
        row = path.samples[int(p.sampled)]
        row[0], row[1] = piece, more
        copy_into(position, row[2:])
        p.sampled += 1.0
        p.next = p.time + SAMPLE_S


@kernel
def _look(arm, p, dt):
    """Find out whether a motion may go on."""
    p.apart = 0.0
    for i in range(arm.position.size):
        apart = abs(arm.wanted[i] - arm.position[i])
        if not apart <= p.apart and p.apart == p.apart:  # NaN stays
            p.joint, p.apart = i, apart
    p.waited = p.waited + dt if arm.scalars.share < WAITS else 0.0
    if not p.apart <= LARGEST_ERROR:
        p.problem = HELD
    elif p.waited > LONGEST_WAIT_S:
        p.problem = WAITED
    elif p.steady != 0.0 and arm.scalars.share < 1.0:
        p.problem = SLOWED


@kernel
def make_way(numbers, path, dt):
    """
    Make a tick of a motion of the joints.

    :param numbers: memory of the controller, with what was measured
    :param path: a `JointPath`
    :param dt: time for which the torque acts [s]
    :returns: 0, an event of `compute`, or `CALLED`: it has arrived, or has a problem; it stays
        where it is
    """
    arm, p = arm_view(numbers), records_at(path.progress, 0, 1, PROGRESS)[0]
    piece = place_at(path, p.time, arm.wanted, arm.wanted_rate)
    if p.problem != FINE:
        p.tempo = 0.0
    else:
        p.tempo = 1.0 if p.brakes != 0.0 else _tempo(numbers, arm.wanted_rate, dt)
    for i in range(arm.wanted_rate.size):
        arm.wanted_rate[i] *= p.tempo
    joint = path.measured[piece]
    known = arm.bias[joint]  # the law adds the weight that the model lacks
    arm.scalars.does = JOINT_MOTION
    event = compute(numbers)
    if joint >= 0:
        _sample(path, piece, arm.position, arm.torque[joint] - known)
    if p.brakes == 0.0 and p.problem == FINE:
        _look(arm, p, dt)
    if p.problem == FINE:
        p.time += p.tempo * dt
    if event != 0:
        return event
    return CALLED if p.problem != FINE or p.time >= p.seconds else 0
