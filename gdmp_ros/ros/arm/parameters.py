"""Parameters of arms, and of the simulated one."""
from __future__ import annotations

from dataclasses import replace
from typing import Any

from gdmp_ros.control.admittance import AdmittanceSettings
from gdmp_ros.control.settings import (
    ContactSettings,
    ControllerSettings,
    FrictionSettings,
    GuardSettings,
    ImpedanceGains,
    LimitSettings,
    TankSettings,
)
from gdmp_ros.franka.settings import FrankaSettings
from gdmp_ros.ros.parameters import settings_from, Spec, specs_of
from gdmp_ros.ros.scene.bodies import SPECS as BODY_SPECS
from gdmp_ros.ros.scene.cloud import SPECS as CLOUD_SPECS
from gdmp_ros.ros.scene.topics import SPECS as SCENE_SPECS
from gdmp_ros.sim.arm import Arm, Extra
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.gripper import add_gripper, SimulatedGripper
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plant import PlantSettings
from gdmp_ros.sim.scenes import SCENES
from gdmp_ros.sim.teaching import HandSettings

_GUARD = {'timeout': 'reference_timeout'}
_TANK = {'energy': 'tank_energy', 'capacity': 'tank_capacity',
         'recharge_power': 'tank_recharge_power'}
_FRICTION = {'viscous': 'friction_viscous', 'dry': 'friction_dry',
             'credit_viscous': 'friction_credit_viscous', 'credit_dry': 'friction_credit_dry',
             'credit': 'friction_credit'}
_PLANT = {'dry_friction': 'plant_dry_friction', 'armature': 'plant_armature',
          'delay': 'plant_delay', 'position_noise': 'plant_position_noise',
          'velocity_noise': 'plant_velocity_noise', 'payload': 'plant_payload',
          'model': 'plant_model'}
_PAYLOAD = {'mass': 'payload_mass', 'center': 'payload_center', 'inertia': 'payload_inertia'}
_TOOL = {'position': 'tool_position', 'rotation': 'tool_rotation'}
_HAND = {'stiffness': 'hand_stiffness', 'force': 'hand_force'}
#: Parameters of every arm.
ARM = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('frame_id', 'panda_link0', "frame of the robot's base; references in others are refused"),
    Spec('reference_topic', 'trajectory_server/reference', 'gdmp_msgs/Reference to follow'),
    Spec('visualization_rate_hz', 100, 'rate of measured pose, stiffness and joint states', 'Hz',
         1, 100),
    *SCENE_SPECS,
    *CLOUD_SPECS,
    *BODY_SPECS,
    *specs_of(GuardSettings, names=_GUARD),
    *specs_of(ControllerSettings),
    *specs_of(LimitSettings),
    *specs_of(TankSettings, names=_TANK, fixed=('energy',)),
    *specs_of(FrictionSettings, names=_FRICTION),
    *specs_of(ContactSettings),
    *specs_of(ImpedanceGains, fixed=('position_clip', 'rotation_clip', 'wrench_max')),
    *specs_of(Payload, names=_PAYLOAD),
    *specs_of(ToolTransform, names=_TOOL),
    Spec('realtime_priority', -1, 'SCHED_FIFO priority of the control thread; -1: 40 if the '
         'system grants it; 0: never', low=-1, high=99),
    Spec('lateness_file', '', 'NumPy file for deadline and lateness of all ticks'),
)
SIMULATION = (
    *ARM,
    Spec('model', '', 'another arm: fr3, ur5e, xarm7, MJCF file, menagerie:NAME or '
         'robot_descriptions:NAME; empty: the built-in Panda'),
    Spec('tool_site', 'tcp', 'site of the model that is controlled'),
    Spec('pace', 'wall', 'wall: simulated time passes like wall time; fast: as fast as possible, '
         'with /clock', choices=('wall', 'fast')),
    Spec('headless', True, 'without a viewer window'),
    Spec('gripper', False, 'the fingers of the built-in hand move: gripper/command, '
         'gripper/state, gripper/move'),
    Spec('scene', '', 'objects around the arm, with a gripper; pick_and_place: two boxes and a '
         'cube; clutter: three objects between them; soft_table: gives way with 20 kN/m',
         choices=('', *SCENES)),
    *specs_of(HandSettings, names=_HAND),
    *specs_of(PlantSettings, 'configure', names=_PLANT),
)
FRANKA = (
    *ARM,
    *specs_of(FrankaSettings, 'configure'),
    Spec('publish_clock', False, "publish the robot's time on /clock, for a robot that is slower "
         'than real time: a server of its protocol on a small machine', changes='configure'),
)
#: An arm that takes joint positions.
POSITION = (
    *(replace(spec, default='base_link') if spec.name == 'frame_id' else spec for spec in ARM),
    Spec('model', 'ur5e', 'model of the arm: ur5e, xarm7, panda, fr3, MJCF file, menagerie:NAME '
         'or robot_descriptions:NAME'),
    Spec('tool_site', 'tcp', 'site of the model that is controlled'),
    Spec('sensor_site', 'flange', 'site of the model with the frame of the measured wrench'),
    Spec('rate_hz', 500, 'rate of the commands', 'Hz', 20, 1000, changes='configure'),
    Spec('joint_states_topic', 'joint_states', 'sensor_msgs/JointState of the arm'),
    Spec('wrench_topic', 'force_torque_sensor_broadcaster/wrench', 'geometry_msgs/WrenchStamped '
         'that acts on the tool, with its weight; empty: there is no sensor'),
    Spec('running_topic', '', 'std_msgs/Bool, false while the arm takes no commands, such as '
         'io_and_status_controller/robot_program_running of a UR; empty: it always does'),
    Spec('speed_scaling_topic', '', 'std_msgs/Float64, speed at which the arm executes commands '
         'in percent, such as speed_scaling_state_broadcaster/speed_scaling of a UR: a server '
         'slows its motions by it; empty: always 100'),
    Spec('output', 'forward_position_controller', 'controller of the arm',
         choices=('forward_position_controller', 'joint_trajectory_controller')),
    Spec('command_topic', '', 'topic of the controller; empty: forward_position_controller/'
         'commands or joint_trajectory_controller/joint_trajectory'),
    Spec('joint_names', [''], 'joints in the order of the parameter of the controller; empty: as '
         'in the model'),
    Spec('horizon', 0.01, 'a trajectory leads to where the joints will be after this time: longer '
         'than the period of rate_hz', 's', 0.001, 1.0),
    *specs_of(AdmittanceSettings, 'configure'),
)
#: The hand of a Franka.
GRIPPER = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('host', '', 'address of the robot'),
    Spec('homing', False, 'let the fingers find the ends of their travel first: they open and '
         'close'),
)


def hand_settings(parameters: Any) -> HandSettings:
    """Settings of the hand that guides the arm."""
    return settings_from(parameters, HandSettings, _HAND)


def payload(parameters: Any) -> Payload:
    """
    Read what the arm carries.

    :raises ParameterError: if no body has this mass and inertia
    """
    return settings_from(parameters, Payload, _PAYLOAD)


def tool_transform(parameters: Any) -> ToolTransform:
    """
    Read where the tool is.

    :raises ParameterError: if its rotation is none
    """
    return settings_from(parameters, ToolTransform, _TOOL)


def plant_settings(parameters: Any) -> PlantSettings | None:
    """How the simulated robot differs from its model; None if it does not."""
    settings = settings_from(parameters, PlantSettings, _PLANT)
    return None if settings == PlantSettings() else settings


def simulated_arm(parameters: Any) -> tuple[Arm, SimulatedGripper | None]:
    """
    The simulated arm, and its gripper if it has one.

    :raises DataError: if the model cannot be loaded, or has no gripper
    """
    p, extras = parameters, list[Extra]()
    if p.gripper or p.scene:
        extras.append(add_gripper)
    if p.scene:
        extras.append(SCENES[p.scene])
    arm = Arm(p.model, p.tool_site, plant=plant_settings(p), extras=extras)
    return arm, SimulatedGripper(arm.model, arm.data) if extras else None


def controller_settings(parameters: Any) -> ControllerSettings:
    """
    Settings of the controller.

    :raises ParameterError: if two of them contradict each other
    """
    return settings_from(
        parameters, ControllerSettings,
        gains=settings_from(parameters, ImpedanceGains),
        guard=settings_from(parameters, GuardSettings, _GUARD, frame=parameters.frame_id),
        limits=settings_from(parameters, LimitSettings),
        tank=settings_from(parameters, TankSettings, _TANK),
        friction=settings_from(parameters, FrictionSettings, _FRICTION),
        contact=settings_from(parameters, ContactSettings))
