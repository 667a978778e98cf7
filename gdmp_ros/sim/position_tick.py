"""A tick of an arm that takes joint positions in which it only goes on, compiled."""
from __future__ import annotations

from typing import NamedTuple

from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.memory import arm_view
from gdmp_ros.control.plain_tick import decide, MADE, write_state
from gdmp_ros.control.servo import answer, FINE, pay, SCALARS, Servo, take_state
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.manifolds.linalg import copy_into
from gdmp_ros.sim.native import look, measure, ModelView
from gdmp_ros.sim.position_driver import PositionDriver

#: What `plain_tick` returns beside what `decide` does, plus why a state cannot be used
#: (`gdmp_ros.control.servo.take_state`).
UNUSABLE = 40


class PositionArmView(NamedTuple):
    """What a kernel knows of an arm, and of the model of the virtual one."""

    servo: Servo
    known: ModelView


def view_of(driver: PositionDriver) -> PositionArmView:
    """An arm, for kernels; until its model has other data."""
    return PositionArmView(driver.servo, driver.known.view)


@kernel
def measure_virtual(view, arm):
    """Write the state of the virtual arm into the memory of a controller."""
    servo, known = view.servo, view.known
    copy_into(servo.virtual[0], arm.position)
    copy_into(servo.virtual[1], arm.velocity)
    copy_into(arm.position, known.position)
    copy_into(arm.velocity, known.velocity)
    look(known)
    measure(known, arm.velocity, arm.pose, arm.jacobian, arm.inertia, arm.bias, arm.acceleration)
    # It has no weight.
    arm.scalars.potential = 0.0
    for i in range(arm.external.size):
        arm.external[i] = 0.0
        for k in range(6):
            arm.external[i] += arm.jacobian[k, i] * servo.wrench[k]


@kernel
def plain_tick(view, controller):
    """
    Make a tick, if the arm only goes on; the command is then known.

    :returns: `MADE`, `CALLED`, `OTHER`, an event: then there is no command yet, or `UNUSABLE` and
        more
    """
    servo, numbers = view.servo, controller.numbers
    problem = take_state(servo)
    if problem != FINE:
        return UNUSABLE + problem
    pay(servo, numbers)
    arm = arm_view(numbers)
    measure_virtual(view, arm)
    event = decide(controller, records_at(servo.numbers, 0, 1, SCALARS)[0].dt)
    if event in (MADE, CALLED):
        answer(servo, numbers, arm.torque)
    return event


@kernel
def write_arm(view, controller, state):
    """See `write_state`; with the arm itself instead of the virtual one."""
    servo, arm = view.servo, arm_view(controller.numbers)
    of_joints = write_state(controller.numbers, controller.target, state)
    n = arm.position.size
    copy_into(servo.pose, state[:7])
    for k in range(6):
        state[7 + k] = 0.0
        for i in range(n):
            state[7 + k] += arm.jacobian[k, i] * servo.measured[1, i]
    joints = state[state.size - 6 * n:]
    copy_into(servo.measured[0], joints[:n])
    copy_into(servo.measured[1], joints[n:2 * n])
    return of_joints
