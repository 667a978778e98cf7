"""
A tick in which the arm goes on with what it does, compiled: guard, law, torque.

It follows or holds, comes to rest, is moved by a hand, or makes a motion of the joints. Each kind
of arm adds what is measured, and what the torque does. What such a tick cannot do is left to
`gdmp_ros.control.arm_control`: requests, settings, the beginning and the end of a motion.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.joint_path import CALLED, JointPath, make_way
from gdmp_ros.control.law import compute, let_move, NOT_FINITE
from gdmp_ros.control.memory import arm_view, JOINT_SPRINGS, TOOL_SPRING
from gdmp_ros.control.stream import (
    advance,
    elapse,
    free_damping,
    has_changed,
    rest_at,
    STREAM,
)
from gdmp_ros.control.target import STIFFNESS
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.manifolds.linalg import copy_into, is_finite, multiply_vector

#: What a tick returns beside `CALLED` and the events of `compute`: it was made; nothing was done,
#: so it is to be made.
MADE, OTHER = 0, 20


class Controller(NamedTuple):
    """
    What a kernel knows of a controller.

    :ivar numbers: `gdmp_ros.control.memory`
    :ivar stream: `gdmp_ros.control.stream.STREAM`
    :ivar target: of the guard
    :ivar joints: its target of the joints
    :ivar held: see `gdmp_ros.control.guard.ReferenceGuard`
    :ivar path: on which the joints move
    """

    numbers: np.ndarray
    stream: np.ndarray
    target: np.ndarray
    joints: np.ndarray
    held: np.ndarray
    path: JointPath


def controller_of(control: ArmControl) -> Controller:
    """The controller of an arm, for kernels; until its state changes."""
    controller = control.controller
    guard = controller.guard
    return Controller(controller.numbers, guard.numbers, *guard.targets, guard.held, control.path)


def is_event(why: int) -> bool:
    """Whether a tick of a kernel is to be ended by Python (`ArmControl.end_tick`)."""
    return MADE < why <= NOT_FINITE


@kernel
def decide(controller, dt):
    """
    Compute the torque for what was measured.

    :returns: `MADE` or `CALLED`: the torque is to be sent; `OTHER`; or an event: then Python ends
        the tick
    """
    moves = controller.path.begins.size > 0
    arm = arm_view(controller.numbers)
    multiply_vector(arm.jacobian, arm.velocity, arm.twist)
    if not (is_finite(arm.pose) and is_finite(arm.twist)):
        return OTHER
    arm.scalars.dt = dt
    elapse(controller.stream, dt)
    damping = free_damping(controller.stream)
    if moves or damping > 0.0:
        rest_at(controller.stream, controller.target, arm.pose)
        if moves:
            return make_way(controller.numbers, controller.path, dt)
        return let_move(controller.numbers, damping)
    advance(controller.stream, controller.target, controller.joints, dt)
    if records_at(controller.stream, 0, 1, STREAM)[0].of_joints != 0.0:
        copy_into(controller.joints, arm.joint_target)
        arm.scalars.does = JOINT_SPRINGS
    else:
        copy_into(controller.target, arm.target)
        arm.scalars.does = TOOL_SPRING
    event = compute(controller.numbers)
    return CALLED if event == 0 and has_changed(controller.stream) else event


@kernel
def write_state(numbers, target, state):
    """
    Write the numbers of the state of a tick, as `gdmp_ros.ros.messages.robot_state_numbers` does.

    :param state: written, with room for a reference of the joints; what no limit uses stays
    :returns: whether the joints follow a reference, which is written at the end
    """
    arm = arm_view(numbers)
    n, at_tool = arm.position.size, arm.scalars.does == TOOL_SPRING
    copy_into(arm.pose, state[:7])
    copy_into(arm.twist, state[7:13])
    copy_into(arm.wrench, state[13:19])
    for i in range(36):
        state[19 + i] = arm.reference[STIFFNESS + i] if at_tool else 0.0
        state[55 + i] = target[STIFFNESS + i] if at_tool else 0.0
    state[91], state[92] = arm.scalars.stored, arm.scalars.energy
    copy_into(arm.commanded, state[93:99])
    copy_into(arm.violation, state[99:99 + arm.violation.size])
    joints = state[state.size - 6 * n:]
    copy_into(arm.position, joints[:n])
    copy_into(arm.velocity, joints[n:2 * n])
    copy_into(arm.torque, joints[2 * n:3 * n])
    if arm.scalars.does != JOINT_SPRINGS:
        return False
    copy_into(arm.joint_reference[:3 * n], joints[3 * n:])
    return True
