"""
What is known of an arm that takes joint positions, in a cycle: what it measures, how far it is
behind its commands, what touches it, and where it is told to be.

The state is in the arrays of `Servo`; Python and kernels use the same.
"""
from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from gdmp_ros.control.admittance import (
    AdmittanceSettings,
    advance,
    DAMPING_SHARE,
    external_wrench,
    LEVER_M,
)
from gdmp_ros.control.kinematics import Chain, place_links
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.weight import GRAVITY
from gdmp_ros.kernels import (
    inlined,
    kernel,
    local_matrix,
    local_numbers,
    local_zeros,
    records_at,
)
from gdmp_ros.manifolds.linalg import copy_into, is_finite
from gdmp_ros.manifolds.quaternion import multiply, rotate

#: Time of motion in which an estimate of the delay forgets [s], what its first value weighs
#: [rad²/s], and the speed of all joints from which it learns [rad/s].
FORGETS_S, FIRST_WEIGHT, LEAST_SPEED = 1.0, 2e-4, 0.005
#: Largest acceleration of what is sent ahead, and from which the inertia of what hangs at the
#: sensor is known [rad/s²]: the reference jerks at a limit.
AHEAD_ACCELERATION = 10.0
#: Why a state cannot be used; 0: it can.
(FINE, NOT_RUNNING, NOT_FINITE, OLD, WRENCH_NOT_FINITE, WRENCH_OLD, FORCE_SATURATED,
 TORQUE_SATURATED, LATE, ASTRAY) = range(10)

#: The scalars of a `Servo`; flags are 0 or 1.
SCALARS = np.dtype([(name, np.float64) for name in (
    'dt',                  # time between the last command and the next [s]
    'age', 'wrench_age',   # of what was measured [s]
    'runs', 'senses',      # flags: the arm takes commands; there is a sensor
    'delay',               # by which the arm is behind its commands [s]
    'first_delay',         # the same before it was measured [s]
    'first_dt',            # time between two commands of `past` [s]
    'mass',                # that hangs at the sensor [kg]
    'damping',             # of the tool, in units of contact stiffness times delay
    'contact_stiffness', 'delay_max', 'timeout', 'following_error', 'force_max', 'torque_max',
    'found', 'joint')])    # what was found wrong: how much, at which joint


class ServoState(NamedTuple):
    """
    What an arm that takes joint positions reports.

    :ivar position: of the joints [rad], shape ``(n,)``
    :ivar velocity: of the joints [rad/s], shape ``(n,)``
    :ivar wrench: that acts on the sensor from the side of the tool, in its frame [N, Nm], shape
        ``(6,)``; None without a sensor
    :ivar age: time since the joints were measured [s]
    :ivar wrench_age: time since the wrench was measured [s]
    :ivar runs: whether the arm takes commands
    """

    position: np.ndarray
    velocity: np.ndarray
    wrench: np.ndarray | None = None
    age: float = 0.0
    wrench_age: float = 0.0
    runs: bool = True


class PositionLink(Protocol):
    """
    An arm that takes joint positions.

    :ivar cycle: time between two commands [s]
    """

    cycle: float

    def read(self) -> ServoState | None:
        """The newest state; None if there was none yet."""

    def send(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Send a command: where the joints are to be now [rad], and their velocities [rad/s]."""


class Servo(NamedTuple):
    """
    The arrays; n is the number of joints, k that of the delays that are told apart.

    :ivar numbers: `SCALARS`
    :ivar measured: position [rad] and velocity [rad/s] of the joints, shape (2, n)
    :ivar felt: wrench in the frame of the sensor [N, Nm], as measured
    :ivar virtual: position and velocity of the virtual arm, shape (2, n)
    :ivar command: where the arm was told to be last, and the velocity of that, shape (2, n)
    :ivar past: commands, the last one first, shape (k, n)
    :ivar errors: of each delay: how badly it explains where the arm was, shape (k,)
    :ivar ahead: velocities of the joints that are sent ahead [rad/s], shape (n,)
    :ivar twists: of the tool, with ``ahead``, the last one first, shape (k, 6)
    :ivar frames: of the joints (`gdmp_ros.control.kinematics.Chain`)
    :ivar axes: the same
    :ivar ends: poses of sensor, tool and site in the frame of the last joint, shape (3, 7)
    :ivar bias: what the sensor measures without a load
    :ivar center: of what hangs at the sensor, in the frame of the site [m], shape (3,)
    :ivar bounds: least and largest positions of the joints, shape (2, n)
    :ivar pose: of the tool, where the arm is
    :ivar wrench: of the environment at the tool, in the frame of the base
    """

    numbers: np.ndarray
    measured: np.ndarray
    felt: np.ndarray
    virtual: np.ndarray
    command: np.ndarray
    past: np.ndarray
    errors: np.ndarray
    ahead: np.ndarray
    twists: np.ndarray
    frames: np.ndarray
    axes: np.ndarray
    ends: np.ndarray
    bias: np.ndarray
    center: np.ndarray
    bounds: np.ndarray
    pose: np.ndarray
    wrench: np.ndarray


def servo_of(chain: Chain, joints: JointLimits, settings: AdmittanceSettings, cycle: float
             ) -> Servo:
    """
    Arrays of an arm that was not measured yet.

    :param cycle: time between two commands [s]
    """
    n, count = len(joints.torque), math.ceil(settings.servo_delay_max / cycle) + 3
    measured, virtual, command = np.zeros((3, 2, n))
    servo = Servo(
        np.zeros(len(SCALARS.names or ())), measured, np.zeros(6), virtual, command,
        np.zeros((count, n)), _first_errors(count, cycle, settings.servo_delay),
        np.zeros(n), np.zeros((count, 6)), chain.frames, chain.axes, np.zeros((3, 7)),
        np.array(settings.sensor_bias), np.zeros(3), np.array([joints.lower, joints.upper]),
        np.zeros(7), np.zeros(6))
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    s.dt = s.first_dt = cycle
    s.delay = s.first_delay = settings.servo_delay
    s.delay_max = settings.servo_delay_max
    s.damping, s.contact_stiffness = DAMPING_SHARE, settings.contact_stiffness
    s.timeout, s.following_error = settings.measured_timeout, settings.following_error
    s.force_max, s.torque_max = settings.sensor_max
    return servo


def _first_errors(count: int, cycle: float, delay: float) -> np.ndarray:
    """`Servo.errors` before anything was measured."""
    return np.asarray(FIRST_WEIGHT * (cycle * np.arange(count) - delay) ** 2)


def write_measured(servo: Servo, state: ServoState) -> None:
    """Write down what was measured."""
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    servo.measured[:] = state.position, state.velocity
    s.senses = state.wrench is not None
    servo.felt[:] = 0.0 if state.wrench is None else state.wrench
    s.age, s.wrench_age, s.runs = state.age, state.wrench_age, state.runs


def rest(servo: Servo) -> None:
    """
    Put the virtual arm to rest where the arm is, and forget what it was told.

    A delay that is too long is forgotten, too: at rest it would stay.
    """
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    if s.delay > s.delay_max:
        s.delay = s.first_delay
        servo.errors[:] = _first_errors(len(servo.errors), s.first_dt, s.delay)
    servo.virtual[0], servo.virtual[1] = servo.measured[0], 0.0
    servo.command[:], servo.past[:] = servo.virtual, servo.measured[0]
    servo.ahead[:], servo.twists[:] = 0.0, 0.0


def problem_of(servo: Servo, code: int) -> str:
    """Why a state could not be used; empty if it could; see `take_state`."""
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    limit = f'expected within {s.timeout:g} s (measured_timeout)'
    return {
        FINE: '',
        NOT_RUNNING: 'the arm does not take commands: its own program does not run',
        NOT_FINITE: 'the measured joints are not finite',
        OLD: f'no measured joints for {s.age:.2g} s, {limit}',
        WRENCH_NOT_FINITE: 'the measured wrench is not finite',
        WRENCH_OLD: f'no measured wrench for {s.wrench_age:.2g} s, {limit}',
        FORCE_SATURATED: f'the sensor is saturated: {s.found:.3g} N, its range is '
                         f'{s.force_max:g} N (sensor_max)',
        TORQUE_SATURATED: f'the sensor is saturated: {s.found:.3g} Nm, its range is '
                          f'{s.torque_max:g} Nm (sensor_max)',
        LATE: f'the arm is {1e3 * s.delay:.0f} ms behind its commands, expected at most '
              f'{1e3 * s.delay_max:g} ms (servo_delay_max)',
        ASTRAY: f'joint {s.joint + 1:.0f} is {s.found:.2g} rad from where its command leads, '
                f'expected at most {s.following_error:g} rad (following_error)'}[code]


@kernel
def check(servo):
    """Why what was measured cannot be used: `FINE` or another one."""
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    if s.runs == 0.0:
        return NOT_RUNNING
    if not (is_finite(servo.measured[0]) and is_finite(servo.measured[1])):
        return NOT_FINITE
    if s.age > s.timeout:
        return OLD
    if s.senses == 0.0:
        return FINE
    if not is_finite(servo.felt):
        return WRENCH_NOT_FINITE
    if s.wrench_age > s.timeout:
        return WRENCH_OLD
    for part in range(2):
        s.found = 0.0
        for i in range(3):
            s.found = max(s.found, abs(servo.felt[3 * part + i]))
        if s.found >= (s.force_max if part == 0 else s.torque_max):
            return FORCE_SATURATED if part == 0 else TORQUE_SATURATED
    return FINE


@kernel
def remember(rows, newest, cycles):
    """
    Put a row before those of before.

    :param rows: one for each cycle, the last one first
    :param cycles: that have passed since the last one; rows between them are interpolated
    """
    for i in range(newest.size):
        before = rows[0, i]
        for k in range(len(rows) - 1, cycles - 1, -1):
            rows[k, i] = rows[k - cycles, i]
        for k in range(min(cycles, len(rows))):
            rows[k, i] = newest[i] + k / cycles * (before - newest[i])


@inlined
def _cycles(scalars):
    """Cycles since the last tick: more than one if this one is late."""
    return max(int(scalars.dt / scalars.first_dt + 0.5), 1)


@kernel
def _estimate_delay(servo):
    """
    Estimate the time by which the arm is behind its commands, from how it follows them.

    That which makes the positions most like the commands so long before.
    """
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    past, errors, square = servo.past, servo.errors, 0.0
    valid = local_numbers(past.shape[1])
    for i in range(valid.size):
        # The command that is valid now.
        valid[i] = servo.command[0, i] + s.dt * servo.command[1, i]
        square += ((valid[i] - past[0, i]) / s.dt) ** 2
    remember(past, valid, _cycles(s))
    if not square > LEAST_SPEED ** 2:
        return  # at rest nothing is learned, and nothing forgotten
    lowest = 0
    for k in range(len(past)):
        error = 0.0
        for i in range(past.shape[1]):
            error += (past[k, i] - servo.measured[0, i]) ** 2
        errors[k] = math.exp(-s.dt / FORGETS_S) * errors[k] + s.dt * error
        if errors[k] < errors[lowest]:
            lowest = k
    at = float(lowest)
    if 0 < lowest < len(errors) - 1:
        # Between two of them: of a parabola through three.
        before, here, after = errors[lowest - 1], errors[lowest], errors[lowest + 1]
        bend = before - 2.0 * here + after
        if bend > 0.0:
            at += 0.5 * (before - after) / bend
    s.delay = s.first_dt * at


@kernel
def _astray(servo):
    """Why an arm does not follow as it should: `FINE`, `LATE` or `ASTRAY`."""
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    if s.delay > s.delay_max:
        return LATE
    lag = min(s.delay / s.first_dt, len(servo.past) - 1.001)
    k, s.found = int(lag), 0.0
    share = lag - k
    for i in range(servo.past.shape[1]):
        error = abs(servo.measured[0, i] - (1.0 - share) * servo.past[k, i]
                    - share * servo.past[k + 1, i])
        if error > s.found:
            s.found, s.joint = error, float(i)
    return ASTRAY if s.found > s.following_error else FINE


@kernel
def feel(servo):
    """Write where the tool is, and the wrench of the environment without what hangs there."""
    s = records_at(servo.numbers, 0, 1, SCALARS)[0]
    n = servo.measured.shape[1]
    links, turns, places = local_matrix(n + 1, 7), local_matrix(n, 3), local_matrix(3, 7)
    place_links(servo.frames, servo.axes, servo.measured[0], links, turns)
    last = links[n]
    for k in range(3):
        rotate(last[3:], servo.ends[k, :3], places[k])
        for i in range(3):
            places[k, i] += last[i]
        multiply(last[3:], servo.ends[k, 3:], places[k, 3:])
    copy_into(places[1], servo.pose)
    if s.senses == 0.0:
        servo.wrench[:] = 0.0
        return
    measured, carried = local_numbers(6), local_numbers(3)
    # The tool moves as its reference did a delay ago.
    ago = min(max(int((s.delay - s.dt) / s.first_dt + 1.5), 1), len(servo.twists) - 1)
    for i in range(3):
        carried[i] = -s.mass / s.first_dt * (servo.twists[ago - 1, i] - servo.twists[ago, i])
    carried[2] -= s.mass * GRAVITY
    for i in range(6):
        measured[i] = servo.felt[i] - servo.bias[i]
    external_wrench(measured, places[0], servo.pose, places[2], servo.center, carried,
                    servo.wrench)


@kernel
def take_state(servo):
    """
    Use what was measured in a cycle.

    :returns: `FINE`, or why it cannot be used (`problem_of`)
    """
    problem = check(servo)
    if problem == FINE:
        _estimate_delay(servo)
        problem = _astray(servo)
    if problem == FINE:
        feel(servo)
    return problem


@kernel
def pay(servo, numbers):
    """
    Let the energy tank pay what the arm gives to the world beyond what the virtual one gives.

    The books of the law are those of the virtual arm; the real one is behind it.

    :param numbers: memory of the controller
    """
    s, arm, power = records_at(servo.numbers, 0, 1, SCALARS)[0], arm_view(numbers), 0.0
    for k in range(6):
        for i in range(servo.virtual.shape[1]):
            ahead = servo.virtual[1, i] - servo.measured[1, i]
            power += servo.wrench[k] * arm.jacobian[k, i] * ahead
    arm.scalars.energy = min(arm.scalars.energy - s.dt * power, arm.tank.capacity)


@kernel
def answer(servo, numbers, torque):
    """
    Let the virtual arm move by a torque of the law, and find the next command.

    :param numbers: memory of the controller, with what was measured and the rates of the joints
    :param torque: [Nm], shape (n,)
    """
    s, arm = records_at(servo.numbers, 0, 1, SCALARS)[0], arm_view(numbers)
    n, ahead = torque.size, servo.ahead
    for i in range(n):
        most = AHEAD_ACCELERATION * s.dt
        ahead[i] += min(max(arm.rates[i] - ahead[i], -most), most)
    twist, sent = local_zeros(6), local_zeros(6)
    for k in range(6):
        for i in range(n):
            twist[k] += arm.jacobian[k, i] * arm.rates[i]
            sent[k] += arm.jacobian[k, i] * ahead[i]
    remember(servo.twists, sent, _cycles(s))
    driving, damping = local_numbers(n), local_numbers(2)
    for i in range(n):
        driving[i] = torque[i] - arm.bias[i]
    damping[0] = s.damping * s.contact_stiffness * s.delay
    damping[1] = LEVER_M ** 2 * damping[0]
    advance(servo.virtual[0], servo.virtual[1], arm.inertia, arm.jacobian, driving, servo.wrench,
            twist, damping, s.dt)
    for i in range(n):
        # What is known of the motion is sent earlier.
        wanted = servo.virtual[0, i] + s.delay * ahead[i]
        wanted = min(max(wanted, servo.bounds[0, i]), servo.bounds[1, i])
        servo.command[1, i] = (wanted - servo.command[0, i]) / s.dt
        servo.command[0, i] = wanted
