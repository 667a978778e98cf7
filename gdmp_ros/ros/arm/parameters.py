"""Parameters of the simulated Panda, and the settings of its controller made from them."""
from dataclasses import fields, replace
from functools import partial
from typing import Any

from gdmp_ros.control.controller import ControllerSettings
from gdmp_ros.control.impedance import ImpedanceGains
from gdmp_ros.control.limits import LimitSettings
from gdmp_ros.control.tank import TankSettings
from gdmp_ros.control.guard import GuardSettings
from gdmp_ros.ros.parameters import Parameters, Spec
from gdmp_ros.sim.hand import GripSettings

#: A parameter that changes at once.
live = partial(Spec, changes='live')
SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('model', '', 'another arm: MJCF file, menagerie:NAME or robot_descriptions:NAME; empty: '
         'the built-in Panda'),
    Spec('tool_site', 'tcp', 'site of the model that is controlled'),
    Spec('frame_id', 'panda_link0', "frame of the robot's base; references in others are refused"),
    Spec('reference_topic', 'trajectory_server/reference', 'gdmp_msgs/Reference to follow'),
    Spec('pace', 'wall', 'in step with wall time, or as fast as it can with /clock',
         choices=('wall', 'fast')),
    Spec('headless', True, 'without a viewer window'),
    Spec('viewer_rate_hz', 100, 'joint states, measured pose and stiffness for viewers', 'Hz', 1,
         100),
    live('reference_timeout', 0.1, 'without a reference for this long the arm stops and holds',
         's', 0.005, 10.0),
    live('stop_time', 0.3, 'the speed of the last reference fades over this', 's', 0.01, 5.0),
    live('stamp_tolerance', 0.5, 'largest difference between the stamp of a reference and the '
         'present time', 's', 0.001, 1e6),
    live('jump_position', 0.05, 'largest step of the references that are being followed', 'm',
         1e-4, 10.0),
    live('jump_rotation', 0.2, 'the same for their rotation', 'rad', 1e-3, 4.0),
    live('jump_stiffness', 1.0, 'the same for their stiffness: log of its ratio in any direction',
         low=1e-3, high=100.0),
    live('damping_ratio', 0.7, 'while holding without a reference; 1 is critical', low=0.0,
         high=2.0),
    live('torque_share', 1.0, "of the motors' torque limits", low=0.01, high=1.0),
    live('torque_rate', 1.0, 'largest change of a joint torque per tick', 'Nm', 0.01, 100.0),
    live('joint_margin', 0.3, 'distance from a joint limit at which repulsion begins', 'rad',
         1e-3, 1.0),
    live('joint_repulsion', 5.0, 'at the joint limit itself', 'Nm', 0.0, 50.0),
    live('joint_speed', 2.175, 'of every joint; braking begins at nine tenths', 'rad/s', 0.01,
         20.0),
    live('joint_brake', 20.0, 'damping of a joint that is too fast', 'Nm s/rad', 0.0, 200.0),
    live('speed', 1.7, 'of the reference', 'm/s', 1e-3, 10.0),
    live('turn_speed', 2.5, 'of the reference', 'rad/s', 1e-3, 20.0),
    live('acceleration', 13.0, 'of the reference', 'm/s^2', 0.01, 100.0),
    live('turn_acceleration', 25.0, 'of the reference', 'rad/s^2', 0.01, 200.0),
    live('catch_up_speed', 0.25, 'at which a reference that was interrupted or delayed is caught '
         'up with', 'm/s', 1e-3, 2.0),
    live('catch_up_turn_speed', 1.0, 'the same for the rotation', 'rad/s', 1e-3, 3.0),
    live('workspace_min', [-1.0, -1.0, 0.0], 'lowest reference position', 'm', -10.0, 10.0),
    live('workspace_max', [1.0, 1.0, 1.3], 'highest reference position', 'm', -10.0, 10.0),
    live('stiffness_min', [1.0, 0.1], 'smallest eigenvalue, translational and rotational',
         'N/m, Nm/rad', 1e-3, 1e4),
    live('stiffness_max', [5000.0, 500.0], 'largest eigenvalue, translational and rotational',
         'N/m, Nm/rad', 1e-3, 1e5),
    live('stiffness_rate', 20.0, 'largest relative change of the stiffness in any direction',
         '1/s', 0.01, 1000.0),
    live('singularity_start', 0.06, 'smallest singular value of the Jacobian (rotations times '
         '0.3 m) below which the reference is slowed down on its way to a singularity', 'm', 0.0,
         1.0),
    live('singularity_stop', 0.015, 'and at which it stops', 'm', 0.0, 1.0),
    Spec('tank_energy', 5.0, 'energy that may be given away at the start', 'J', 0.0, 1000.0),
    live('tank_capacity', 10.0, 'most that comes back and is kept', 'J', 0.01, 1000.0),
    live('tank_refill', 0.0, 'power that flows into the tank for tasks that do work for ever; '
         'with 0 the controller is passive', 'W', 0.0, 100.0),
    live('passive', True, 'hold back what the tank has no energy for; otherwise it only meters'),
    Spec('position_clip', 0.1, 'largest position error acted upon', 'm', 0.001, 1.0),
    Spec('rotation_clip', 0.5, 'largest rotation error acted upon', 'rad', 0.01, 3.0),
    live('posture_stiffness', 5.0, 'of the posture in the null space', 'Nm/rad', 0.0, 100.0),
    live('posture_damping', 2.0, 'in the null space', 'Nm s/rad', 0.0, 50.0),
    live('feed_forward', True, "add the inertial force and the joint friction of the reference's "
         'motion'),
    live('hand_stiffness', 800.0, 'with which a hand that leads the arm pulls the tool to '
         '~/hand_pose', 'N/m', 1.0, 5000.0),
    live('hand_force', 40.0, 'largest of that hand', 'N', 0.1, 200.0),
    Spec('realtime_priority', 0, 'SCHED_FIFO priority of the simulation thread; -1: 40 if the '
         'system grants it; 0: never', low=-1, high=99),
    Spec('lateness_file', '', 'NumPy file for deadline and lateness of all ticks'),
)


def grip_settings(parameters: Parameters) -> GripSettings:
    """Settings of a hand that leads the arm; its damping goes with its stiffness."""
    usual = GripSettings()
    softer = (parameters.hand_stiffness / usual.stiffness) ** 0.5
    return replace(usual, stiffness=parameters.hand_stiffness, damping=softer * usual.damping,
                   force=parameters.hand_force)


def controller_settings(parameters: Parameters) -> ControllerSettings:
    """
    Settings of the controller.

    :raises ParameterError: if two of them contradict each other
    """
    p = parameters
    limits: dict[str, Any] = {}
    for field in fields(LimitSettings):
        value = getattr(p, field.name)
        limits[field.name] = value if isinstance(value, (int, float)) else tuple(value)
    gains = ImpedanceGains(position_clip=p.position_clip, rotation_clip=p.rotation_clip,
                           posture_stiffness=p.posture_stiffness,
                           posture_damping=p.posture_damping,
                           feed_forward=1.0 if p.feed_forward else 0.0)
    guard = GuardSettings(p.frame_id, p.reference_timeout, p.stop_time, p.stamp_tolerance,
                          p.jump_position, p.jump_rotation, p.jump_stiffness)
    tank = TankSettings(p.tank_energy, p.tank_capacity, p.tank_refill, p.passive)
    return ControllerSettings(gains, guard, LimitSettings(**limits), tank, p.damping_ratio)
