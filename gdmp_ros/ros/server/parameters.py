"""Parameters of the trajectory server, and the settings of its player made from them."""
from functools import partial

import numpy as np

from gdmp_ros.dmp.skill import CONNECTIONS
from gdmp_ros.data.recordings import STIFFNESSES
from gdmp_ros.ros.parameters import Parameters, Spec
from gdmp_ros.playback.tool_skill import PlayerSettings

#: A parameter that changes at once, and one that changes with the next motion.
live, later = partial(Spec, changes='live'), partial(Spec, changes='motion')
SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('skill', '', 'skill file to load; empty: learn from `demonstrations`, or load later'),
    Spec('demonstrations', [''], 'rosbag2 folders to learn from when there is no skill file'),
    Spec('n_basis', 60, 'basis functions when learning', low=2, high=2000),
    Spec('connection', 'parallel', 'connection when learning', choices=CONNECTIONS),
    Spec('learned_stiffness', 'auto', 'where stiffness comes from when learning: as recorded, '
         'from the variance of several demonstrations, or none; auto: the first that there is',
         choices=STIFFNESSES),
    Spec('frame_id', 'panda_link0', 'frame of references and goals; others are refused'),
    Spec('rate_hz', 1000, 'ticks per second', 'Hz', 10, 2000),
    live('start_from', 'measured', "where motions start: at the measured pose, or the skill's",
         choices=('measured', 'skill')),
    Spec('execute_on_activate', False, 'start the skill as soon as the node is active'),
    Spec('measured_pose_topic', '~/measured_pose', "PoseStamped of the robot's tool"),
    live('measured_pose_age', 0.5, 'oldest measured pose a motion may start from', 's', 0.01,
         10.0),
    later('damping_ratio', 0.7, 'sent with the reference; 1 is critical', low=0.0, high=2.0),
    later('stiffness', [400.0, 400.0, 400.0], 'translational, where a skill has none', 'N/m', 1.0,
         5000.0),
    later('rotational_stiffness', [30.0, 30.0, 30.0], 'rotational, where a skill has none',
         'Nm/rad', 0.1, 500.0),
    later('speed_rate', 5.0, 'largest change of the tempo', '1/s', 0.1, 100.0),
    later('goal_speed', 0.0, 'fastest a goal position moves after a switch; 0: no limit', 'm/s',
         0.0, 10.0),
    later('goal_turn_speed', 0.0, 'fastest a goal orientation turns after a switch; 0: no limit',
         'rad/s', 0.0, 50.0),
    later('phase_stopping', 0.0, 'kappa: the tempo is divided by 1 + kappa e^2 while the '
         'measured pose is behind; 0: never', low=0.0, high=1000.0),
    later('phase_stopping_weights', [400.0, 4.0], 'e^2 = first x position error^2 [m^2] + second '
         'x rotation error^2 [rad^2]', '1/m^2, 1/rad^2', 0.0, 1e6),
    live('workspace_min', [-0.2, -0.8, 0.02], 'lowest goal position accepted', 'm', -10.0, 10.0),
    live('workspace_max', [0.8, 0.8, 1.1], 'highest goal position accepted', 'm', -10.0, 10.0),
    Spec('realtime_priority', -1, 'SCHED_FIFO priority of the streaming thread; -1: 40 if the '
         'system grants it; 0: never', low=-1, high=99),
    Spec('lateness_file', '', 'NumPy file for deadline and lateness of all ticks'),
)


def player_settings(parameters: Parameters) -> PlayerSettings:
    """Settings of the player."""
    p = parameters
    return PlayerSettings(np.diag([*p.stiffness, *p.rotational_stiffness]), p.damping_ratio,
                          p.speed_rate, p.goal_speed, p.goal_turn_speed, p.phase_stopping,
                          tuple(p.phase_stopping_weights))
