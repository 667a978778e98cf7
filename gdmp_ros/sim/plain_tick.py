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
from gdmp_ros.manifolds.linalg import copy_into, multiply_vector
from gdmp_ros.sim.arm import FATAL
from gdmp_ros.sim.gripper import advance_gripper, GripperView, NO_GRIPPER
from gdmp_ros.sim.native import external_torque, look, ModelView, step, TouchedBody
from gdmp_ros.sim.native import measure as measure_model
from gdmp_ros.sim.plant import act, Channel, disturb
from gdmp_ros.sim.teaching import HandView, NO_HAND, pull

if TYPE_CHECKING:
    from gdmp_ros.sim.closed_loop import SimulatedDriver

#: What `plain_tick` returns beside what `decide` does: the simulation is unstable.
BROKEN = 21
_FATAL = np.array(FATAL)
_MOTION = float(StreamMode.STREAMING)


class Robot(NamedTuple):
    """
    What a kernel knows of a simulation with one arm.

    :ivar true: the simulated robot itself
    :ivar known: the model that the controller has
    :ivar shared: whether it is the robot itself
    :ivar energy: of the model, as ``level`` (`gdmp_ros.sim.known_model.KnownModel`)
    :ivar smooth: torques in the simulation, as ``passive``, ``actuator``, ``constraint``
    :ivar fatal: `gdmp_ros.sim.arm.FATAL`
    :ivar touched: the body of the tool
    """

    true: ModelView
    known: ModelView
    shared: bool
    energy: np.ndarray
    level: np.ndarray
    smooth: np.ndarray
    passive: np.ndarray
    actuator: np.ndarray
    constraint: np.ndarray
    control: np.ndarray
    warnings: np.ndarray
    fatal: np.ndarray
    channel: Channel
    gripper: GripperView
    hand: HandView
    touched: TouchedBody


@kernel
def measure(robot, arm):
    """Write what is measured into the memory of a controller."""
    true, known = robot.true, robot.known
    copy_into(true.position, arm.position)
    copy_into(true.velocity, arm.velocity)
    disturb(robot.channel, arm.position, arm.velocity)
    if not robot.shared:
        copy_into(arm.position, known.position)
        copy_into(arm.velocity, known.velocity)
        look(known)
    measure_model(known, arm.velocity, arm.pose, arm.jacobian, arm.inertia, arm.bias,
                  arm.acceleration)
    external_torque(robot.smooth, robot.passive, true.bias, robot.actuator, robot.constraint, 0,
                    arm.external)
    arm.scalars.potential = robot.energy[0] + robot.level[0]


@kernel
def plain_tick(robot, controller, dt):
    """
    Make a tick, if the arm only goes on.

    :returns: `MADE`, `CALLED`, `OTHER`, `BROKEN`, or an event: then the torque has not been sent
    """
    arm = arm_view(controller.numbers)
    measure(robot, arm)
    # For the hand; `decide` computes it for itself.
    multiply_vector(arm.jacobian, arm.velocity, arm.twist)
    pull(robot.hand, robot.touched, arm.pose, arm.twist, dt)
    event = decide(controller, dt)
    if event not in (MADE, CALLED):
        return event
    true = robot.true
    advance_gripper(robot.gripper, true.position, true.velocity, robot.control, dt)
    act(robot.channel, arm.torque, robot.control)
    step(true.functions, true.places[0], true.places[1])
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
    return ((driver.gripper is None or driver.gripper.only_goes_on) and driver.arm.only_goes_on
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


def robot_of(driver: SimulatedDriver) -> Robot:
    """A simulated arm that is alone, for kernels; until its hand or its payload is another."""
    arm, hand, gripper = driver.arm, driver.hand, driver.gripper
    data, known = arm.data, arm.known
    return Robot(arm.view, known.view, known.shared, known.data.energy, known.level,
                 data.qfrc_smooth, data.qfrc_passive, data.qfrc_actuator, data.qfrc_constraint,
                 data.ctrl, data.warning.number, _FATAL, arm.channel,
                 NO_GRIPPER if gripper is None else gripper.view,
                 NO_HAND if hand is None else hand.view, arm.touched)
