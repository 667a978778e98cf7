"""
A tick of a simulated arm that only goes on, compiled: measure, guard, law, torque, simulation.

What it cannot do is left to `gdmp_ros.control.arm_control`: requests, the beginning and the end of
a motion, faults, joint motions, hand guiding.
"""
from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.law import compute
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.memory import arm_view, TOOL_SPRING
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.stream import advance, elapse, FOLLOWED, go_on, is_plain
from gdmp_ros.control.target import STIFFNESS
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import copy_into, is_finite
from gdmp_ros.sim.arm import Arm, FATAL
from gdmp_ros.sim.native import address, external_torque, functions, step
from gdmp_ros.sim.native import measure as measure_arm

if TYPE_CHECKING:
    from gdmp_ros.sim.closed_loop import SimulatedDriver

#: What `plain_tick` returns beside the events of `gdmp_ros.control.law.compute`: it has made the
#: tick; it has done nothing, and the tick is to be made; the simulation is unstable.
MADE, OTHER, BROKEN = 0, 20, 21
_FATAL = np.array(FATAL)
_MOTION = float(StreamMode.STREAMING)


class Robot(NamedTuple):
    """
    What a kernel knows of a simulation with one arm, whose model the controller has.

    :ivar functions: `gdmp_ros.sim.native.functions`
    :ivar places: address of the model, of the data, id of the site and of its body
    :ivar fatal: `gdmp_ros.sim.arm.FATAL`
    """

    functions: np.ndarray
    places: np.ndarray
    site_position: np.ndarray
    site_axes: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    bias: np.ndarray
    smooth: np.ndarray
    passive: np.ndarray
    actuator: np.ndarray
    constraint: np.ndarray
    energy: np.ndarray
    control: np.ndarray
    warnings: np.ndarray
    fatal: np.ndarray


class Controller(NamedTuple):
    """
    What a kernel knows of a controller.

    :ivar numbers: `gdmp_ros.control.memory`
    :ivar stream: `gdmp_ros.control.stream.STREAM`
    :ivar target: of the guard
    :ivar held: see `gdmp_ros.control.guard.ReferenceGuard`
    """

    numbers: np.ndarray
    stream: np.ndarray
    target: np.ndarray
    held: np.ndarray


@kernel
def measure(robot, arm):
    """Write what is measured into the memory of a controller."""
    model, data = robot.places[0], robot.places[1]
    copy_into(robot.position, arm.position)
    copy_into(robot.velocity, arm.velocity)
    measure_arm(robot.functions, model, data, robot.places[2], robot.places[3],
                robot.site_position, robot.site_axes, robot.bias, arm.velocity, arm.pose,
                arm.jacobian, arm.inertia, arm.bias, arm.acceleration)
    external_torque(robot.smooth, robot.passive, robot.bias, robot.actuator, robot.constraint, 0,
                    arm.external)
    arm.scalars.potential = robot.energy[0]
    for i in range(6):
        arm.twist[i] = 0.0
        for j in range(arm.velocity.size):
            arm.twist[i] += arm.jacobian[i, j] * arm.velocity[j]


@kernel
def plain_tick(robot, controller, dt):
    """
    Make a tick, if nothing but following or holding is to be done.

    :returns: `MADE`, `OTHER`, `BROKEN`, or an event: then the torque has not been sent
    """
    stream = controller.stream
    if not is_plain(stream):
        return OTHER
    arm = arm_view(controller.numbers)
    measure(robot, arm)
    if not (is_finite(arm.pose) and is_finite(arm.twist)):
        return OTHER
    elapse(stream, dt)
    advance(stream, controller.target, dt)
    copy_into(controller.target, arm.target)
    arm.scalars.dt, arm.scalars.does = dt, TOOL_SPRING
    event = compute(controller.numbers)
    if event != 0:
        return event
    copy_into(arm.torque, robot.control)
    step(robot.functions, robot.places[0], robot.places[1])
    for kind in robot.fatal:
        if robot.warnings[kind] != 0:
            return BROKEN
    return MADE


@kernel
def follow_plainly(robot, controller, dt, references, poses):
    """
    Follow references of a motion, one in each tick.

    :param references: shape (n, `gdmp_ros.control.target.TARGET_SIZE`); their quaternions are
        normalised here
    :param poses: written: of the tool, measured at the beginning of each tick, shape (n, 7)
    :returns: how many ticks were made, and what the last one returned
    """
    arm = arm_view(controller.numbers)
    for k in range(len(references)):
        if go_on(controller.stream, controller.target, controller.held, references[k], 0.0, 0.0,
                 0.0, _MOTION) != FOLLOWED:
            return k, OTHER
        result = plain_tick(robot, controller, dt)
        copy_into(arm.pose, poses[k])
        if result != MADE:
            return k, result
    return len(references), MADE


@kernel
def write_state(numbers, target, state):
    """
    Write the numbers of the state of a tick, as `gdmp_ros.ros.messages.robot_state_numbers` does.

    :param state: written; what no limit uses stays
    """
    arm = arm_view(numbers)
    n = arm.position.size
    copy_into(arm.pose, state[:7])
    copy_into(arm.twist, state[7:13])
    copy_into(arm.wrench, state[13:19])
    copy_into(arm.reference[STIFFNESS:STIFFNESS + 36], state[19:55])
    copy_into(target[STIFFNESS:STIFFNESS + 36], state[55:91])
    state[91], state[92] = arm.scalars.stored, arm.scalars.energy
    copy_into(arm.commanded, state[93:99])
    copy_into(arm.violation, state[99:99 + arm.violation.size])
    joints = state[state.size - 3 * n:]
    copy_into(arm.position, joints[:n])
    copy_into(arm.velocity, joints[n:2 * n])
    copy_into(arm.torque, joints[2 * n:])


def only_goes_on(control: ArmControl, driver: SimulatedDriver) -> bool:
    """Whether nothing but following or holding is to be done in the next tick."""
    return (driver.hand is None and driver.gripper is None and not control.moves_joints
            and driver.arm.only_goes_on and control.controller.only_goes_on)


def end_tick(control: ArmControl, driver: SimulatedDriver, event: int) -> Tick:
    """
    End a tick in which a kernel felt something, or could compute no torque.

    :raises DataError: if the simulation is unstable
    """
    if event == BROKEN:
        driver.arm.check()
    tick = control.controller.end_tick(event)
    driver.command(tick.torque)
    driver.arm.advance()
    return tick


def robot_of(arm: Arm) -> Robot:
    """A simulated arm that is alone, for kernels."""
    data, known = arm.data, arm.known
    return Robot(
        functions(),
        np.array([address(arm.model), address(data), known.site, known.body]),
        data.site_xpos[known.site], data.site_xmat[known.site], data.qpos, data.qvel,
        data.qfrc_bias, data.qfrc_smooth, data.qfrc_passive, data.qfrc_actuator,
        data.qfrc_constraint, data.energy, data.ctrl, data.warning.number, _FATAL)


def controller_of(control: ArmControl) -> Controller:
    """The controller of an arm, for kernels."""
    controller = control.controller
    guard = controller.guard
    return Controller(controller.numbers, guard.numbers, guard.tool_target, guard.held)
