"""A skill executed by a simulated arm, from end to end, without ROS and without waiting."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.controller import HOLD_STIFFNESS
from gdmp_ros.dmp import Skill
from gdmp_ros.realtime.player import Player
from gdmp_ros.realtime.tool_skill import PlayerSettings
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.panda import Arm


class Played(NamedTuple):
    """
    What the arm did, a row for each tick.

    :ivar joints: shape ``(T, n)`` [rad]
    :ivar references: poses (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``
    :ivar measured: the same
    """

    joints: np.ndarray
    references: np.ndarray
    measured: np.ndarray


def play(skill: Skill, arm: Arm, rest_s: float = 0.5, most_s: float = 120.0,
         step: Callable[[], object] = lambda: None) -> Played:
    """
    Let an arm execute a skill of pose and stiffness from where it stands.

    :param rest_s: time after the motion [s]
    :param most_s: longest motion [s]
    :param step: called after every tick
    :raises DataError: if the skill is not one of pose and stiffness
    """
    loop = ClosedLoop(arm)
    player = Player(skill, PlayerSettings(HOLD_STIFFNESS))
    player.start(arm.measure().pose.copy())
    joints, references, measured = [], [], []
    left = most_s
    while left > 0.0:
        target = player.tick(arm.period)
        if target is not None:
            loop.follow(target)
            references.append(target[:7].copy())
        tick = loop.tick()
        joints.append(tick.measurement.position.copy())
        measured.append(tick.measurement.pose.copy())
        if player.status == 'holding':
            left = min(left, rest_s)
        left -= arm.period
        step()
    return Played(np.array(joints), np.array(references), np.array(measured))
