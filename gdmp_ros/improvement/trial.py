"""Roll-outs of a skill by an arm: recorded, ended at a limit, and the way back."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.target import POSE
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, RefusedError
from gdmp_ros.manifolds.poses import POSE_SIZE
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.execution import execution_ticks
from gdmp_ros.sim.path_check import check_skill, PathChecker

#: Poses of a path that are checked before it is executed.
POSES = 60
#: Time in which an arm comes to rest after its motion was ended [s].
STOP_S = 0.5
#: Largest speed of a joint on the way back [rad/s].
BACK_SPEED = 0.5
#: Ticks between two postures that are remembered for the way back.
REMEMBER_EVERY = 10


class Trial(NamedTuple):
    """
    What a roll-out was like; one row for each tick until it ended.

    :ivar times: [s], shape ``(T,)``
    :ivar references: poses (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``
    :ivar measured: the same
    :ivar stiffness: applied, shape ``(T, 6, 6)``
    :ivar wrenches: external, at the tool [N, Nm], shape ``(T, 6)``
    :ivar joints: positions [rad], shape ``(T, n)``
    :ivar torques: commanded [Nm], shape ``(T, n)``
    :ivar others: positions of objects at the end (`SimulatedDriver.others`)
    :ivar ended: why it was ended early; empty if it was not
    """

    times: np.ndarray
    references: np.ndarray
    measured: np.ndarray
    stiffness: np.ndarray
    wrenches: np.ndarray
    joints: np.ndarray
    torques: np.ndarray
    others: np.ndarray
    ended: str


def refused(reason: str, joints: int) -> Trial:
    """Return the trial of a roll-out that was not begun."""
    return Trial(np.empty(0), np.empty((0, 7)), np.empty((0, 7)), np.empty((0, 6, 6)),
                 np.empty((0, 6)), np.empty((0, joints)), np.empty((0, joints)), np.empty(0),
                 reason)


def perform(skill: Skill, loop: ClosedLoop, checker: PathChecker | None = None,
            largest_force: float = np.inf) -> Trial:
    """
    Execute a skill from where the arm is, which is where the arm is again if it is ended early.

    It is ended when a limit of the controller would be violated, but for those that only smooth,
    when the guard refuses a reference, or the tank is empty.

    :param checker: refuses a path before it is begun; None checks nothing
    :param largest_force: also ends it [N]
    :raises DataError: if the way back is blocked, or the simulation is unstable
    """
    count = len(loop.joints.torque)
    if checker is not None:
        problems = check_skill(skill, checker, POSES)[0].problems()
        if problems:
            return refused(f'not begun: {"; ".join(problems)}', count)
    rows, ended = list[tuple[np.ndarray, ...]](), ''
    try:
        for target, tick in execution_ticks(skill, loop):
            # Copies: the arrays are those of the next tick too.
            rows.append(tuple(part.copy() for part in (
                target[POSE:POSE + POSE_SIZE], tick.measurement.pose, tick.stiffness, tick.wrench,
                tick.measurement.position, tick.torque)))
            ended = problem(tick.violation, tick.tank, tick.wrench, largest_force)
            if ended:
                break
    except RefusedError as error:
        ended = str(error)
    if not rows:
        return refused(f'not begun: {ended}', count)
    references, measured, stiffness, wrenches, joints, torques = map(np.array, zip(*rows))
    trial = Trial(loop.arm.period * np.arange(1, len(rows) + 1), references, measured,
                  stiffness.reshape(-1, 6, 6), wrenches, joints, torques, loop.driver.others,
                  ended)
    if ended:
        go_back(loop, trial.joints, ended)
    return trial


def go_back(loop: ClosedLoop, postures: np.ndarray, reason: str) -> None:
    """
    Stop, and go back along the postures that were passed.

    :raises DataError: if something is in the way
    """
    loop.controller.guard.stop(reason)
    for _ in range(round(STOP_S / loop.arm.period)):
        loop.tick()
    path = np.vstack([postures[::REMEMBER_EVERY][::-1], postures[0]])
    loop.move(PostureMotion(loop.joints, path, BACK_SPEED))
    while loop.moves_joints:
        loop.tick()
    if loop.joint_motion_problem:
        raise DataError(f'the way back is blocked: {loop.joint_motion_problem}')
    loop.hold(loop.arm.measure())


def problem(violation: np.ndarray, tank: float, wrench: np.ndarray, largest_force: float) -> str:
    """
    Why a roll-out must end; empty if it may go on.

    :param violation: by how much each of `gdmp_ros.control.limits.LIMITS` would be exceeded
    :param tank: energy [J]
    :param wrench: external, at the tool [N, Nm]
    """
    for limit, value in zip(LIMITS, violation):
        if value > 0.0 and not limit.smooths:
            return f'limit {limit.name}, by {value:.3g} {limit.unit}'
    if tank <= 0.0:
        return 'the energy tank is empty'
    force = float(np.linalg.norm(wrench[:3]))
    return f'a force of {force:.1f} N, allowed {largest_force:g}' if force > largest_force else ''


