"""A skill executed by a simulated arm, from end to end, without ROS and without waiting."""
from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.controller import HOLD_STIFFNESS, Tick
from gdmp_ros.control.impedance import POSE
from gdmp_ros.dmp import Skill
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.tool_skill import PlayerSettings
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.arm import Arm

#: Longest motion, and time after it [s].
MOST_S, REST_S = 120.0, 0.5


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


def ticks(skill: Skill, loop: ClosedLoop, rest_s: float = REST_S
          ) -> Iterator[tuple[np.ndarray, Tick]]:
    """
    Let an arm execute a skill of pose and stiffness from where it stands, tick by tick.

    :param rest_s: time after the motion, which may last `MOST_S` [s]
    :returns: the reference (`gdmp_ros.control.impedance.TARGET_SIZE` numbers, the same array every
        time) and what the arm did
    :raises DataError: if the skill is not one of pose and stiffness
    """
    player = Player(skill, PlayerSettings(HOLD_STIFFNESS))
    player.start(loop.arm.measure().pose.copy())
    left, period = MOST_S, loop.arm.period
    while left > 0.0:
        target = player.tick(period)
        if target is None:
            raise RuntimeError('a motion that was started has no reference')
        loop.follow(target)
        yield target, loop.tick()
        if player.status == 'holding':
            left = min(left, rest_s)
        left -= period


def play(skill: Skill, arm: Arm, rest_s: float = REST_S) -> Played:
    """Collect the `ticks` of a skill."""
    joints, references, measured = [], [], []
    for target, tick in ticks(skill, ClosedLoop(arm), rest_s):
        references.append(target[POSE:POSE + 7].copy())
        joints.append(tick.measurement.position.copy())
        measured.append(tick.measurement.pose.copy())
    return Played(np.array(joints), np.array(references), np.array(measured))
