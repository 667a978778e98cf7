"""A skill executed by a simulated arm, without ROS and faster than real time."""
from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.target import POSE
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.playback.gripper_sequence import GripperCommands, GripperSequence
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.states import Status
from gdmp_ros.playback.streamed_skill import Kind
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.gripper import GripperOfLoop, SimulatedGripper

#: Longest motion [s].
LONGEST_S = 120.0
#: Time after the motion [s].
REST_S = 0.5


class Execution(NamedTuple):
    """
    What the arm did, one row for each tick.

    :ivar joints: shape ``(T, n)`` [rad]
    :ivar references: poses (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``
    :ivar measured: the same
    """

    joints: np.ndarray
    references: np.ndarray
    measured: np.ndarray


def execution_ticks(skill: Skill, loop: ClosedLoop, rest_s: float = REST_S
                    ) -> Iterator[tuple[np.ndarray, Tick]]:
    """
    Execute a skill of pose and stiffness from the present pose of an arm, tick by tick.

    :param rest_s: time after the motion [s]; the motion lasts at most `LONGEST_S`
    :returns: the reference (`gdmp_ros.control.target.TARGET_SIZE` numbers, valid until the next
        tick) and the tick of the controller
    :raises DataError: if the skill is not one of pose and stiffness, or the gripper fails
    :raises RefusedError: if the arm does not follow a reference
    """
    player = Player(skill, PlayerSettings())
    if player.tool.kind is Kind.TWO_TOOLS:
        raise DataError('the skill is one of two arms, expected one of one arm '
                        '(gdmp_ros.sim.two_arms executes it)')
    gripper = loop.driver.gripper
    fingers = (None if gripper is None or not skill.events else
               GripperSequence(GripperCommands(GripperOfLoop(gripper))))
    motion = player.start(loop.arm.measure().pose.copy())
    left, period = LONGEST_S, loop.arm.period
    while left > 0.0:
        target = player.tick(period)
        if target is None:
            raise RuntimeError('a motion that was started has no reference')
        if fingers is not None:
            fingers.advance(player, period)
            if fingers.problem(motion):
                raise DataError(fingers.problem(motion))
        loop.must_follow(target)
        yield target, loop.tick()
        if player.status is Status.HOLDING:
            left = min(left, rest_s)
        left -= period


def execute(skill: Skill, arm: Arm, rest_s: float = REST_S,
            gripper: SimulatedGripper | None = None) -> Execution:
    """Execute a skill (`execution_ticks`), and collect what the arm did."""
    joints, references, measured = [], [], []
    for target, tick in execution_ticks(skill, ClosedLoop(arm, gripper=gripper), rest_s):
        references.append(target[POSE:POSE + 7].copy())
        joints.append(tick.measurement.position.copy())
        measured.append(tick.measurement.pose.copy())
    return Execution(np.array(joints), np.array(references), np.array(measured))
