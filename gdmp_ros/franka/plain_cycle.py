"""A cycle of a Franka in which nothing but following or holding is done, compiled."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.law import compare_with
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.plain_tick import decide
from gdmp_ros.franka.channel import read_joints, read_taken, send, Wire
from gdmp_ros.franka.driver import FrankaDriver
from gdmp_ros.kernels import kernel, local_matrix
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.sim.native import address, functions, look
from gdmp_ros.sim.native import measure as measure_model


class Link(NamedTuple):
    """
    What a kernel knows of a robot: its channel and its model.

    :ivar functions: `gdmp_ros.sim.native.functions`
    :ivar places: address of the model, of its data, id of the site and of its body
    """

    wire: Wire
    functions: np.ndarray
    places: np.ndarray
    site_position: np.ndarray
    site_axes: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    bias: np.ndarray


def link_of(driver: FrankaDriver) -> Link:
    """A robot, for kernels; until it is connected again, or has another tool."""
    known = driver.known
    data = known.data
    return Link(driver.robot.channel.wire, functions(),
                np.array([address(known.model), address(data), known.site, known.body]),
                data.site_xpos[known.site], data.site_xmat[known.site], data.qpos, data.qvel,
                data.qfrc_bias)


@kernel
def measure(link, arm):
    """Write the last state, and the model in it, into the memory of a controller."""
    model, data = link.places[0], link.places[1]
    read_joints(link.wire, arm.position, arm.velocity, arm.external)
    copy_into(arm.position, link.position)
    copy_into(arm.velocity, link.velocity)
    look(link.functions, model, data)
    measure_model(link.functions, model, data, link.places[2], link.places[3],
                  link.site_position, link.site_axes, link.bias, arm.velocity, arm.pose,
                  arm.jacobian, arm.inertia, arm.bias, arm.acceleration)
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
    if event == 0:
        send(link.wire, arm.torque)
    return event
