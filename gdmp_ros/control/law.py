"""
One tick of an arm's impedance law, compiled: from what was measured to the torque.

There are two laws, a spring at the tool and springs at the joints. Each has a governed reference,
which moves within the limits and as far as the energy tank pays for it. Without a reference the
joints are damped, or follow a motion of their own.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.contact import correct, feel
from gdmp_ros.control.energy_budget import apply_energy_budget, LEAST_SOFTENING, release
from gdmp_ros.control.friction import without_friction
from gdmp_ros.control.governor import govern, hold_back_smoothly
from gdmp_ros.control.impedance import external_wrench, impedance_torque, TOOL_BRAKE
from gdmp_ros.control.joint_spring import joint_energy, joint_law, move_joint_reference
from gdmp_ros.control.joint_target import LEAST_STIFFNESS
from gdmp_ros.control.limits import ENERGY, TOOL_SPEED, TORQUE, WRENCH_LIMIT
from gdmp_ros.control.memory import arm_view, FREE, JOINT_MOTION, JOINT_SPRINGS, TOOL_SPRING
from gdmp_ros.control.own_body import push_apart
from gdmp_ros.control.reference_kinds import HOLD_JOINT_STIFFNESS
from gdmp_ros.control.settings import GAIN_NUMBERS, LIMIT_NUMBERS, SMALLEST_DAMPING_RATIO
from gdmp_ros.control.spring import spring_power, stored_energy
from gdmp_ros.control.surroundings import move_volumes, push_away
from gdmp_ros.control.tank import draw, measure_energy, missing_energy, remember, spendable
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    resting_target,
    TARGET_SIZE,
    TWIST,
    WRENCH,
)
from gdmp_ros.control.torque_limits import distance_outside, limit_torque, push_from_walls
from gdmp_ros.control.weight import add_weight, change_weight, is_weightless
from gdmp_ros.kernels import kernel, local_numbers, local_zeros, records_at
from gdmp_ros.manifolds.linalg import copy_into, is_finite, multiply_vector, norm

#: Band below the speed limit of the tool in which what drives it decreases [m/s].
TOOL_SPEED_BAND = 0.15
#: Braking of a tool that a hand moves too fast: 40 N move it 10 % too fast at most [Ns/m].
GUIDED_BRAKE = 300.0
#: Speed of a guided tool at which three quarters of its friction act [m/s].
FREE_SMOOTHING = 0.005
#: Time constant with which an arm comes to rest whose reference stands before what comes [s].
STANDS_S = 0.02
#: Bandwidth with which joints follow a motion of their own [1/s].
BANDWIDTH = 20.0
#: A new posture of the null space is approached with this speed [rad/s].
POSTURE_RATE = 0.3
#: `compute` has found no torque; smaller numbers are those of `gdmp_ros.control.contact.feel`.
NOT_FINITE = 10
#: Pose aside, what a reference at the tool begins with.
_AT_REST = resting_target(np.zeros(7))


@kernel
def hold_tool(numbers):
    """Hold the tool where it is from now on, with the stiffness before the first reference."""
    arm = arm_view(numbers)
    for i in range(TARGET_SIZE):
        arm.reference[i] = _AT_REST[i]
    copy_into(arm.pose, arm.reference[POSE:POSE + 7])
    copy_into(arm.position, arm.governed)
    arm.governed_rate[:], arm.past[:] = 0.0, 0.0
    for axis in range(3):
        arm.outside[axis] = distance_outside(arm.pose, arm.limits, axis)[0]
    arm.scalars.blocked, arm.scalars.blocking = 0.0, -1.0
    arm.scalars.way, arm.scalars.returns = 1.0, 0.0


@kernel
def hold_joints(position, damping_ratio, reference, mean):
    """Hold the joints from now on, with the stiffness before the first reference."""
    n = position.size
    for i in range(n):
        reference[i], reference[n + i] = position[i], 0.0
        reference[2 * n + i], mean[i] = HOLD_JOINT_STIFFNESS, 0.0
    reference[3 * n] = damping_ratio


@kernel
def _keep_posture(arm):
    """The null space keeps the measured posture from now on."""
    copy_into(arm.position, arm.posture)
    copy_into(arm.position, arm.wanted_posture)


@kernel
def _change_posture(arm, dt):
    """Let the posture of the null space approach the one that is wanted."""
    step = POSTURE_RATE * dt
    for i in range(arm.posture.size):
        arm.posture[i] += min(max(arm.wanted_posture[i] - arm.posture[i], -step), step)


@kernel
def _ratio(asked, usual):
    """Damping ratio of a reference; 0 in a message stands for nothing."""
    return max(asked if asked != 0.0 else usual, SMALLEST_DAMPING_RATIO)


@kernel
def _free(velocity, bias, jacobian, damping, friction, torque, twist):
    """Compensate gravity, damp the joints, and let friction act at the tool."""
    moving = local_numbers(3)
    multiply_vector(jacobian[:3], velocity, moving)
    speed = norm(3, moving)
    # Against the motion: a tool at rest feels no friction.
    hold = friction * math.tanh(speed / FREE_SMOOTHING) / max(speed, 1e-9)
    for i in range(velocity.size):
        torque[i] = bias[i] - damping * velocity[i]
        for j in range(3):
            torque[i] -= jacobian[j, i] * hold * moving[j]
    twist[:] = 0.0


@kernel
def _follow_joints(position, velocity, bias, jacobian, inertia, wanted, wanted_rate, gains, torque,
                   twist):
    """
    Let the joints follow a motion of their own, with a bounded wrench at the tool.

    :param twist: written: of the tool, as it is wanted
    :returns: fraction by which the wrench was reduced
    """
    n, share = position.size, 1.0
    acceleration, active, pushed = local_numbers(n), local_numbers(n), local_numbers(6)
    for i in range(n):
        acceleration[i] = (BANDWIDTH ** 2 * (wanted[i] - position[i])
                           + 2.0 * BANDWIDTH * (wanted_rate[i] - velocity[i]))
    multiply_vector(inertia, acceleration, active)
    external_wrench(jacobian, inertia, active, gains.singularity, pushed)
    for part in range(2):
        size = norm(3, pushed[3 * part:3 * part + 3])
        share = min(share, gains.wrench_max[part] / max(size, 1e-9))
    for i in range(n):
        torque[i] = bias[i] + share * active[i]
    multiply_vector(jacobian, wanted_rate, twist)
    return 1.0 - share


@kernel
def _slow_tool(jacobian, velocity, bias, largest, damping, torque):
    """
    Reduce what drives a tool that is too fast, and brake it.

    :param largest: speed of the tool [m/s]
    :param damping: of what is too fast [Ns/m]
    :returns: excess [m/s]
    """
    band, moving = min(TOOL_SPEED_BAND, 0.5 * largest), local_numbers(3)
    multiply_vector(jacobian[:3], velocity, moving)
    speed = norm(3, moving)
    excess = speed - largest + band
    if excess <= 0.0:
        return 0.0
    driving, left = 0.0, 1.0
    for i in range(velocity.size):
        driving += (torque[i] - bias[i]) * velocity[i]
    if driving > 0.0:
        left = max(1.0 - excess / band, 0.0)
    for i in range(velocity.size):
        brake = 0.0
        for j in range(3):
            brake -= jacobian[j, i] * moving[j] * damping * excess / speed
        torque[i] = bias[i] + left * (torque[i] - bias[i]) + brake
    return excess


@kernel
def _soften_joints(position, reference, energy):
    """Soften the springs of the joints until they have released an energy; what they did [J]."""
    n, before = position.size, joint_energy(position, reference)
    if before <= 0.0:
        return 0.0
    factor = max(1.0 - energy / before, LEAST_SOFTENING)
    for i in range(2 * n, 3 * n):
        # The lower bound has priority: a spring below it would not come back.
        reference[i] = max(factor * reference[i], min(LEAST_STIFFNESS, reference[i]))
    return before - joint_energy(position, reference)


@kernel
def _joint_power(position, velocity, reference, stored, dt):
    """Rate of the energy in the springs of the joints at the measured motion [W]."""
    ahead = local_numbers(position.size)
    for i in range(position.size):
        ahead[i] = position[i] + dt * velocity[i]
    return (joint_energy(ahead, reference) - stored) / dt


@kernel
def finish(numbers, failed):
    """
    Limit the torque and send it: the end of a tick.

    :param failed: whether none could be computed
    """
    arm = arm_view(numbers)
    s = arm.scalars
    _note_rates(arm)
    _push(arm)
    _limit(numbers)
    if not failed and (s.does == TOOL_SPRING or s.does == JOINT_SPRINGS):
        _pay(numbers)
    if failed:
        arm.violation[TORQUE] = math.inf
    remember(s, arm.tank, arm.sent, arm.velocity, arm.bias, arm.velocity_before, arm.bias_before,
             arm.torque, s.stored)
    copy_into(arm.torque, arm.last)
    for i in range(arm.violation.size):
        if arm.violation[i] > 0.0:
            arm.counts[i] += 1.0
            arm.recent[i] = max(arm.recent[i], arm.violation[i])


@kernel
def compare_with(numbers, taken, cycle):
    """
    Let the next torque be near all with which the arm may compare it.

    :param taken: lowest and highest of these torques [Nm], shape (2, n)
    :param cycle: time for which the rate of the torque counts [s]
    """
    arm, apart = arm_view(numbers), 0.0
    limits = records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0]
    for i in range(arm.last.size):
        apart = max(apart, taken[1, i] - taken[0, i])
        arm.last[i] = 0.5 * (taken[0, i] + taken[1, i])
    arm.scalars.cycle = max(cycle - 0.5 * apart / limits.torque_slew, 0.0)


@kernel
def _note_rates(arm):
    """Keep the velocities of what the joints follow in this tick."""
    does, n = arm.scalars.does, arm.rates.size
    for i in range(n):
        arm.rates[i] = (arm.governed_rate[i] if does == TOOL_SPRING
                        else arm.joint_reference[n + i] if does == JOINT_SPRINGS
                        else arm.wanted_rate[i] if does == JOINT_MOTION else 0.0)


@kernel
def _push(arm):
    """Write the torque that comes before that of the law."""
    arm.push[:] = 0.0
    if arm.scalars.does == TOOL_SPRING:
        push_from_walls(arm.pose, arm.twist, arm.jacobian, arm.limits, arm.outside, arm.push)
    push_apart(arm.frames, arm.axes, arm.position, arm.velocity, arm.capsules, arm.pairs,
               arm.nearness, arm.push)
    s = arm.scalars
    s.left = push_away(arm.frames, arm.axes, arm.position, arm.velocity, arm.capsules,
                       arm.volumes, s.dt, arm.depth, arm.push)
    left = min(s.slowed, s.left) if records_at(
        arm.limits, 0, 1, LIMIT_NUMBERS)[0].retreat_speed == 0.0 else 1.0
    if left < 1.0:
        # A soft arm lags behind its reference, and would go on when that stands.
        for i in range(arm.velocity.size):
            arm.torque[i] = arm.bias[i] + left * (arm.torque[i] - arm.bias[i])
            for j in range(arm.velocity.size):
                arm.push[i] -= (1.0 - left) / STANDS_S * arm.inertia[i, j] * arm.velocity[j]


@kernel
def _limit(numbers):
    """Limit the torque."""
    arm = arm_view(numbers)
    s = arm.scalars
    limit_torque(arm.position, arm.velocity, arm.inertia, arm.bias, arm.push, arm.last,
                 arm.joint_limits[0], arm.joint_limits[1], arm.largest, arm.fastest,
                 min(s.dt, s.cycle), arm.limits, arm.relief, arm.torque, arm.violation)


@kernel
def _missing(arm, power):
    """Energy that the torque would draw beyond what may be drawn [J]; see `missing_energy`."""
    return missing_energy(arm.scalars, arm.tank, arm.credit, arm.velocity, arm.rates, arm.bias,
                          arm.torque, power)


@kernel
def _pay(numbers):
    """With too little energy for a torque, shed wrench, brake, then shed stiffness."""
    arm = arm_view(numbers)
    s, n = arm.scalars, arm.position.size
    if s.law == TOOL_SPRING:
        power = spring_power(arm.pose, arm.twist, arm.reference, arm.gains, s.stored, s.dt)
    else:
        power = _joint_power(arm.position, arm.velocity, arm.joint_reference, s.stored, s.dt)
    missing = _missing(arm, power)
    if not missing > 0.0:
        return
    arm.violation[ENERGY] += missing
    # Without the law: what the weight, Coriolis forces and the springs would draw is braked.
    whole, known, square = local_numbers(n), local_numbers(arm.violation.size), 0.0
    driving = 0.0
    for i in range(n):
        square += arm.velocity[i] ** 2
        driving += s.dt * arm.velocity[i] * (arm.torque[i] - arm.bias[i])
    brake = min(max(missing - driving, 0.0) / max(s.dt * square, 1e-12),
                records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0].joint_brake)
    copy_into(arm.torque, whole)
    copy_into(arm.violation, known)
    for i in range(n):
        arm.torque[i] = arm.bias[i] - brake * arm.velocity[i]
    _limit(numbers)
    copy_into(known, arm.violation)
    # Both torques may be sent, and so may what is between them: the limits are convex.
    driving = 0.0
    for i in range(n):
        driving += s.dt * arm.velocity[i] * (whole[i] - arm.torque[i])
    left = max(1.0 - missing / driving, 0.0) if driving > 0.0 else 1.0
    for i in range(n):
        arm.torque[i] += left * (whole[i] - arm.torque[i])
    missing = _missing(arm, power)
    if missing > 0.0:
        if s.law == TOOL_SPRING:
            released = release(arm.pose, arm.reference, arm.gains, arm.bounds, missing)
        else:
            released = _soften_joints(arm.position, arm.joint_reference, missing)
        draw(s, arm.tank, -released)
        s.stored -= released


@kernel
def _account(arm, stored):
    """
    Draw the work of the last torque, and add the weight that the model lacks to what was measured.

    :param stored: energy in the spring now [J]
    """
    s = arm.scalars
    potential = s.potential
    weighs = not (is_weightless(arm.moments) and is_weightless(arm.wanted_moments))
    if weighs:
        # That of the last torque: other moments are no work.
        s.potential += add_weight(arm.frames, arm.axes, arm.position, arm.moments,
                                  local_numbers(arm.position.size))
    measure_energy(s, arm.tank, arm.sent, arm.credit, arm.velocity, arm.velocity_before,
                   arm.rates, arm.bias_before, stored)
    if weighs:
        change_weight(arm.moments, arm.wanted_moments, s.dt)
        s.potential = potential + add_weight(arm.frames, arm.axes, arm.position, arm.moments,
                                             arm.bias)


@kernel
def compute(numbers):
    """
    Compute the torque of one tick, and send it.

    :param numbers: memory (`gdmp_ros.control.memory`), with what was measured, the target, and
        what the tick is to do
    :returns: what was felt (`gdmp_ros.control.contact.feel`), or `NOT_FINITE`: then nothing is
        sent before `finish`
    """
    arm = arm_view(numbers)
    s, n = arm.scalars, arm.position.size
    gains = records_at(arm.gains, 0, 1, GAIN_NUMBERS)[0]
    limits = records_at(arm.limits, 0, 1, LIMIT_NUMBERS)[0]
    springs = s.does == TOOL_SPRING or s.does == JOINT_SPRINGS
    stored = 0.0
    if springs:
        stored = (stored_energy(arm.pose, arm.reference, arm.gains) if s.law == TOOL_SPRING
                  else joint_energy(arm.position, arm.joint_reference))
    _account(arm, stored)
    move_volumes(arm.volumes, s.seen, s.dt)
    s.seen += s.dt
    arm.violation[:] = 0.0
    external, twist, exerted = local_numbers(n), local_numbers(6), local_zeros(6)
    without_friction(arm.external, arm.velocity, arm.friction[1], gains.friction_smoothing,
                     external)
    if not springs:
        s.law, s.stored, s.slowed = TOOL_SPRING, 0.0, 1.0
        hold_back_smoothly(s)
        hold_tool(numbers)
        _keep_posture(arm)
        arm.commanded[:] = 0.0
        if s.does == FREE:
            _free(arm.velocity, arm.bias, arm.jacobian, s.free_damping, s.free_friction,
                  arm.torque, twist)
            arm.violation[TOOL_SPEED] = _slow_tool(arm.jacobian, arm.velocity, arm.bias,
                                                   limits.tool_speed, GUIDED_BRAKE, arm.torque)
        else:
            arm.violation[WRENCH_LIMIT] = _follow_joints(
                arm.position, arm.velocity, arm.bias, arm.jacobian, arm.inertia, arm.wanted,
                arm.wanted_rate, gains, arm.torque, twist)
        external_wrench(arm.jacobian, arm.inertia, external, gains.singularity, arm.wrench)
    elif s.does == TOOL_SPRING:
        if s.law != TOOL_SPRING:
            hold_tool(numbers)
            _keep_posture(arm)
        s.law = TOOL_SPRING
        _change_posture(arm, s.dt)
        _spring_at_tool(numbers, external, limits)
        for i in range(6):
            twist[i], exerted[i] = arm.reference[TWIST + i], arm.reference[WRENCH + i]
    else:
        if s.law != JOINT_SPRINGS:
            hold_joints(arm.position, s.damping_ratio, arm.joint_reference, arm.joint_mean)
        s.law = JOINT_SPRINGS
        _springs_at_joints(numbers, external, limits)
        arm.commanded[:] = 0.0
        multiply_vector(arm.jacobian, arm.joint_reference[n:2 * n], twist)
    if springs and not is_finite(arm.torque):
        return NOT_FINITE
    contact = feel(s, arm.felt, arm.wrench, twist, exerted)
    finish(numbers, False)
    return contact


@kernel
def let_move(numbers, damping):
    """
    Make a tick of an arm that a hand moves; see `compute`.

    :param damping: of the joints [Nm s/rad]
    """
    s = arm_view(numbers).scalars
    s.does, s.free_damping = FREE, damping
    return compute(numbers)


@kernel
def _spring_at_tool(numbers, external, limits):
    """Move the reference of the tool, and compute the torque that follows it."""
    arm = arm_view(numbers)
    s, target, reference = arm.scalars, arm.target, arm.reference
    budget = spendable(s, arm.tank)
    govern(numbers)
    for i in range(WRENCH, TARGET_SIZE):
        reference[i] = target[i]
    correct(s, arm.felt, arm.correction, reference)
    reference[DAMPING_RATIO] = _ratio(target[DAMPING_RATIO], s.damping_ratio)
    drawn, s.stored = apply_energy_budget(numbers, s.dt * limits.stiffness_rate, budget)
    draw(s, arm.tank, drawn)
    wanted = local_numbers(TARGET_SIZE)
    copy_into(reference, wanted)
    # Subtract J̇q̇: the arm produces it without torque.
    for i in range(6):
        wanted[ACCELERATION + i] -= arm.acceleration[i]
    scale, too_fast = impedance_torque(
        arm.position, arm.velocity, arm.pose, arm.jacobian, arm.inertia, arm.bias, arm.friction,
        wanted, arm.governed, arm.governed_rate, arm.gains, limits.tool_speed, external,
        arm.torque, arm.wrench, arm.commanded)
    arm.violation[WRENCH_LIMIT], arm.violation[TOOL_SPEED] = 1.0 - scale, too_fast


@kernel
def _springs_at_joints(numbers, external, limits):
    """Move the reference of the joints, and compute the torque that follows it."""
    arm = arm_view(numbers)
    s, reference = arm.scalars, arm.joint_reference
    gains = records_at(arm.gains, 0, 1, GAIN_NUMBERS)[0]
    last = reference.size - 1
    reference[last] = _ratio(arm.joint_target[last], s.damping_ratio)
    drawn, s.stored = move_joint_reference(numbers, s.dt * limits.stiffness_rate,
                                           spendable(s, arm.tank))
    draw(s, arm.tank, drawn)
    joint_law(arm.position, arm.velocity, arm.inertia, arm.bias, arm.friction, arm.gains,
              reference, arm.joint_mean, arm.torque)
    excess = _slow_tool(arm.jacobian, arm.velocity, arm.bias, limits.tool_speed, TOOL_BRAKE,
                        arm.torque)
    if excess > 0.0:
        arm.violation[TOOL_SPEED] = excess
    external_wrench(arm.jacobian, arm.inertia, external, gains.singularity, arm.wrench)
