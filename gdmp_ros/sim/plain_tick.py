"""
A tick of a simulated arm that only goes on, compiled: measure, guard, law, torque, simulation.

What it cannot do is left to `gdmp_ros.control.arm_control`; see `gdmp_ros.control.plain_tick`.
"""
from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.plain_tick import decide, MADE, OTHER
from gdmp_ros.control.stream import FOLLOWED, go_on
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.sim.arm import Arm, FATAL
from gdmp_ros.sim.native import external_torque, ModelView, step
from gdmp_ros.sim.native import measure as measure_model

if TYPE_CHECKING:
    from gdmp_ros.sim.closed_loop import SimulatedDriver

#: What `plain_tick` returns beside what `decide` does: the simulation is unstable.
BROKEN = 21
_FATAL = np.array(FATAL)
_MOTION = float(StreamMode.STREAMING)


class Robot(NamedTuple):
    """
    What a kernel knows of a simulation with one arm, whose model the controller has.

    :ivar known: the model
    :ivar fatal: `gdmp_ros.sim.arm.FATAL`
    """

    known: ModelView
    smooth: np.ndarray
    passive: np.ndarray
    actuator: np.ndarray
    constraint: np.ndarray
    energy: np.ndarray
    control: np.ndarray
    warnings: np.ndarray
    fatal: np.ndarray


@kernel
def measure(robot, arm):
    """Write what is measured into the memory of a controller."""
    known = robot.known
    copy_into(known.position, arm.position)
    copy_into(known.velocity, arm.velocity)
    measure_model(known, arm.velocity, arm.pose, arm.jacobian, arm.inertia, arm.bias,
                  arm.acceleration)
    external_torque(robot.smooth, robot.passive, known.bias, robot.actuator, robot.constraint, 0,
                    arm.external)
    arm.scalars.potential = robot.energy[0]


@kernel
def plain_tick(robot, controller, dt):
    """
    Make a tick, if the arm only goes on.

    :returns: `MADE`, `CALLED`, `OTHER`, `BROKEN`, or an event: then the torque has not been sent
    """
    arm = arm_view(controller.numbers)
    measure(robot, arm)
    event = decide(controller, dt)
    if event not in (MADE, CALLED):
        return event
    copy_into(arm.torque, robot.control)
    step(robot.known.functions, robot.known.places[0], robot.known.places[1])
    for kind in robot.fatal:
        if robot.warnings[kind] != 0:
            return BROKEN
    return event


@kernel
def follow_plainly(robot, controller, dt, references, poses):
    """
    Follow references of a motion, one in each tick.

    :param references: shape (n, `gdmp_ros.control.target.TARGET_SIZE`); their quaternions are
        normalised here
    :param poses: written: of the tool, measured at the beginning of each tick, shape (n, 7)
    :returns: how many ticks were made in full, and what the last one returned
    """
    arm = arm_view(controller.numbers)
    for k in range(len(references)):
        if go_on(controller.stream, controller.target, controller.held, references[k], 0.0, 0.0,
                 0.0, _MOTION) != FOLLOWED:
            return k, OTHER
        result = plain_tick(robot, controller, dt)
        copy_into(arm.pose, poses[k])
        if result not in (MADE, CALLED):
            return k, result
    return len(references), MADE


def only_goes_on(control: ArmControl, driver: SimulatedDriver) -> bool:
    """Whether the next tick may be one that a kernel makes."""
    return (driver.hand is None and driver.gripper is None and driver.arm.only_goes_on
            and control.only_goes_on)


def end_tick(control: ArmControl, driver: SimulatedDriver, event: int) -> Tick:
    """
    End a tick in which a kernel felt something, or could compute no torque.

    :raises DataError: if the simulation is unstable
    """
    if event == BROKEN:
        driver.arm.check()
    tick = control.end_tick(event)
    driver.command(tick.torque)
    driver.arm.advance()
    return tick


def robot_of(arm: Arm) -> Robot:
    """A simulated arm that is alone, for kernels."""
    data = arm.data
    return Robot(arm.known.view, data.qfrc_smooth, data.qfrc_passive, data.qfrc_actuator,
                 data.qfrc_constraint, data.energy, data.ctrl, data.warning.number, _FATAL)
