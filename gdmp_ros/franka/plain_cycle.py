"""A cycle of a Franka in which it only goes on, compiled."""
from __future__ import annotations

from typing import NamedTuple

from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.law import compare_with
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.plain_tick import decide, MADE
from gdmp_ros.franka.channel import read_joints, read_taken, send, Wire
from gdmp_ros.franka.driver import FrankaDriver
from gdmp_ros.kernels import kernel, local_matrix
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.sim.native import look, ModelView
from gdmp_ros.sim.native import measure as measure_model


class Link(NamedTuple):
    """What a kernel knows of a robot: its channel and its model."""

    wire: Wire
    known: ModelView


def link_of(driver: FrankaDriver) -> Link:
    """A robot, for kernels; until it is connected again."""
    return Link(driver.robot.channel.wire, driver.known.view)


@kernel
def measure(link, arm):
    """Write the last state, and the model in it, into the memory of a controller."""
    known = link.known
    read_joints(link.wire, arm.position, arm.velocity, arm.external)
    copy_into(arm.position, known.position)
    copy_into(arm.velocity, known.velocity)
    look(known)
    measure_model(known, arm.velocity, arm.pose, arm.jacobian, arm.inertia, arm.bias,
                  arm.acceleration)
    # The robot compensates gravity itself.
    arm.scalars.potential = 0.0


@kernel
def plain_cycle(link, controller, dt, cycle):
    """
    Answer the last state of a robot.

    :param dt: time for which the torque acts [s]
    :param cycle: time for which the rate of the torque counts [s]
    :returns: see `gdmp_ros.control.plain_tick.decide`
    """
    arm = arm_view(controller.numbers)
    measure(link, arm)
    taken = local_matrix(2, arm.position.size)
    read_taken(link.wire, taken)
    compare_with(controller.numbers, taken, cycle)
    event = decide(controller, dt)
    if event in (MADE, CALLED):
        send(link.wire, arm.torque)
    return event
