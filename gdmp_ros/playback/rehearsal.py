"""Calls every kernel of a player once, so that no tick has to load one."""
from __future__ import annotations

import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.playback.bounds import StreamBounds
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.prediction import prediction
from gdmp_ros.playback.settings import PlayerSettings, StreamSettings
from gdmp_ros.scene.route import clearances, Tool
from gdmp_ros.scene.volume import VOLUME_SIZE

_DT = 1e-3  # s
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def rehearse(skill: Skill, settings: PlayerSettings) -> None:
    """
    Carry out every kind of request with a player of its own.

    The first call of a kernel loads it from the cache, or compiles it; even loading takes longer
    than a tick.

    :raises DataError: if the skill is neither one of a pose, nor of two, nor of joints
    """
    player = Player(skill, settings)
    tool = player.tool
    start, goal = tool.place_of(skill.start), tool.place_of(skill.goal)
    player.start(None)
    player.tick(_DT)
    player.go_to(goal)
    player.set_speed(0.5)
    player.observe(start)
    player.request_copy()
    player.tick(_DT)
    copy = player.taken_copy()
    if copy is not None:
        prediction(copy, 2)
    player.distances()
    player.start(None)  # from a reference in motion
    player.tick(_DT)
    player.start(start)
    player.stop()
    player.tick(_DT)
    player.hold(start)
    player.start(goal)  # by way of the robot
    clearances(np.zeros((1, VOLUME_SIZE)), Tool.ball(0.1), np.zeros((1, 3)), _UPRIGHT)
    bounds = StreamBounds(StreamSettings())
    for _ in range(2):
        target = player.tick(_DT)
        if target is not None:
            bounds.apply(tool, target, _DT, player.rollout)
