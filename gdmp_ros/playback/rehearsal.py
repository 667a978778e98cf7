"""Calls every kernel of a player once, so that no tick has to load one."""
from __future__ import annotations

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.playback.bounds import StreamBounds
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.prediction import predicted_poses
from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.playback.tool_skill import PlayerSettings

_DT = 1e-3  # s


def rehearse(skill: Skill, settings: PlayerSettings) -> None:
    """
    Carry out every kind of request with a player of its own.

    The first call of a kernel loads it from the cache, or compiles it; even loading takes longer
    than a tick.

    :raises DataError: if the skill is not one of pose and stiffness
    """
    player = Player(skill, settings)
    player.start(None)
    player.tick(_DT)
    player.goal_pose(skill.goal[:7])
    player.set_speed(0.5)
    player.observe(skill.start[:7])
    player.request_copy()
    player.tick(_DT)
    copy = player.taken_copy()
    if copy is not None:
        predicted_poses(copy, 2)
    player.distances()
    player.start(None)  # from a reference in motion
    player.tick(_DT)
    player.start(skill.start[:7])
    player.stop()
    player.tick(_DT)
    player.hold(skill.start[:7])
    player.start(skill.goal[:7].copy())  # by way of the robot
    bounds = StreamBounds(StreamSettings())
    for _ in range(2):
        target = player.tick(_DT)
        if target is not None:
            bounds.apply(target, _DT)
