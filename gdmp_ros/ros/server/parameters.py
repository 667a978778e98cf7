"""Parameters of the trajectory server."""
from __future__ import annotations

from typing import Any

from gdmp_ros.choices import CONNECTIONS, STIFFNESSES
from gdmp_ros.playback.streamer import StreamSettings
from gdmp_ros.playback.tool_skill import PlayerSettings
from gdmp_ros.ros.parameters import settings_from, Spec, specs_of

SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('skill', '', 'skill file to load; empty: learn from `demonstrations`, or load later'),
    Spec('demonstrations', [''], 'rosbag2 folders to learn from if there is no skill file'),
    Spec('n_basis', 0, 'number of basis functions when learning; 0: as many as the data need',
         low=0, high=2000),
    Spec('connection', 'parallel', 'connection when learning', choices=CONNECTIONS),
    Spec('learned_stiffness', 'auto', 'origin of the stiffness when learning: as recorded, from '
         'the variance of several demonstrations, or none; auto: the first of these that is '
         'possible', choices=STIFFNESSES),
    Spec('frame_id', 'panda_link0', 'frame of references and goals; others are refused'),
    Spec('rate_hz', 1000, 'ticks per second', 'Hz', 10, 2000),
    Spec('execute_on_activate', False, 'start the skill when the node is activated'),
    Spec('measured_pose_topic', '~/measured_pose', "PoseStamped of the robot's tool"),
    *specs_of(StreamSettings),
    *specs_of(PlayerSettings, 'motion', formerly={'goal_angular_speed': 'goal_turn_speed'}),
    Spec('realtime_priority', -1, 'SCHED_FIFO priority of the streaming thread; -1: 40 if the '
         'system grants it; 0: never', low=-1, high=99),
    Spec('lateness_file', '', 'NumPy file for deadline and lateness of all ticks'),
)


def stream_settings(parameters: Any) -> StreamSettings:
    """
    Settings of the streamer.

    :raises ParameterError: if two of them contradict each other
    """
    return settings_from(parameters, StreamSettings)


def player_settings(parameters: Any) -> PlayerSettings:
    """Settings of the player."""
    return settings_from(parameters, PlayerSettings)
