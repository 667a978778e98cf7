"""Parameters of the trajectory server."""
from __future__ import annotations

from typing import Any

from gdmp_ros.choices import CONNECTIONS, STIFFNESSES
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.robot_watch import RobotSettings
from gdmp_ros.playback.stream_settings import StreamSettings
from gdmp_ros.ros.parameters import settings_from, Spec, specs_of
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.path_check import PathChecker
from gdmp_ros.sim.reach import Reach
from gdmp_ros.sim.tool import ToolTransform

#: Frame in which goals are checked with the built-in Panda by default.
PANDA_FRAME = 'panda_link0'
_TOOL = {'position': 'tool_position', 'rotation': 'tool_rotation'}
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
    Spec('frame_id', 'panda_link0', 'frame of references; goals and measured poses in another '
         'one are transformed by /tf'),
    Spec('tf_timeout', 1.0, 'a goal in a frame of which nothing is known yet waits this long', 's',
         0.0, 60.0, changes='live'),
    Spec('rate_hz', 1000, 'ticks per second', 'Hz', 10, 2000),
    Spec('execute_on_activate', False, 'start the skill when the node is activated'),
    Spec('reach_model', '', 'arm with which goals, and skills when they are loaded, are checked: '
         'MJCF file, menagerie:NAME or robot_descriptions:NAME; empty: the built-in Panda if '
         'frame_id is panda_link0; none: no check'),
    Spec('tool_site', 'tcp', 'site of that model that is the tool'),
    *specs_of(ToolTransform, 'configure', names=_TOOL),
    Spec('measured_pose_topic', '~/measured_pose', "PoseStamped of the robot's tool"),
    Spec('second_frame_id', '', 'for skills of two arms: base frame of the second arm and of its '
         'references; /tf_static tells where it is in frame_id. Empty: there is one arm'),
    Spec('second_measured_pose_topic', '~/second/measured_pose', "PoseStamped of the second arm's "
         'tool'),
    Spec('measured_joints_topic', 'joint_states', 'JointState of the robot, for skills of the '
         'joints'),
    Spec('gripper', 'gripper', 'name before the topics of the gripper: gripper/command, '
         'gripper/state'),
    Spec('arm_status_topic', 'panda_sim/status', 'gdmp_msgs/ArmStatus of the arm, if it has one'),
    *specs_of(StreamSettings),
    *specs_of(RobotSettings),
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


def kinematics(parameters: Any) -> tuple[Reach, PathChecker] | tuple[None, None]:
    """
    Inverse kinematics of the arm, and what checks paths with it; None without a model.

    :raises DataError: if the model cannot be loaded
    """
    model, tool = parameters.reach_model, parameters.tool_site
    if model == 'none' or (not model and parameters.frame_id != PANDA_FRAME):
        return None, None
    arm = Arm(model, tool)
    arm.put_tool(settings_from(parameters, ToolTransform, _TOOL))
    return Reach(arm, tool), PathChecker(arm, tool)


def robot_settings(parameters: Any) -> RobotSettings:
    """How far the robot may be from goal and path."""
    return settings_from(parameters, RobotSettings)


def player_settings(parameters: Any) -> PlayerSettings:
    """Settings of the player."""
    return settings_from(parameters, PlayerSettings)
