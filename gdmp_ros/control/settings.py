"""Settings of the controller. Nodes declare their parameters from these fields."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.util.settings import numbers_type, setting

#: A spring with less damping would hardly come to rest.
SMALLEST_DAMPING_RATIO = 0.1


@dataclass(frozen=True)
class ImpedanceGains:
    """Constants of the impedance law (`gdmp_ros.control.impedance`)."""

    position_clip: float = setting(
        0.1, 'position error beyond which the force of the spring grows no further, in the '
        'stiffest direction', 'm', 0.001, 1.0)
    rotation_clip: float = setting(0.5, 'the same for the rotation error', 'rad', 0.01, 3.0)
    wrench_max: tuple[float, float] = setting(
        (60.0, 15.0), 'largest commanded force and torque at the tool, without gravity', 'N, Nm',
        0.1, 1000.0)
    posture_stiffness: float = setting(
        30.0, 'stiffness of the posture in the null space', 'Nm/rad', 0.0, 100.0)
    posture_damping: float = setting(
        2.0, 'damping of the posture in the null space', 'Nm s/rad', 0.0, 50.0)
    feed_forward: bool = setting(
        True, 'add the inertial force and the joint friction of the reference motion')
    friction_smoothing: float = setting(
        0.02, 'joint speed at which three quarters of the dry friction are compensated', 'rad/s',
        1e-3, 1.0)
    friction_at_rest: float = setting(
        0.95, 'share of the dry friction that is compensated while the reference rests, in the '
        'direction of the spring: the robot comes nearer to its goal; 0: none', '', 0.0, 1.0)
    #: ε in ``Λ = (J M⁻¹ Jᵀ + ε² I)⁻¹`` [1/√kg]: keeps Λ finite at singularities.
    singularity: float = 0.02


@dataclass(frozen=True)
class GuardSettings:
    """Which references are accepted (`gdmp_ros.control.guard`)."""

    #: The only ``frame_id`` accepted.
    frame: str = 'panda_link0'
    timeout: float = setting(
        0.1, 'without an accepted reference for this time the arm stops and holds', 's', 0.005,
        10.0)
    stop_time: float = setting(
        0.3, 'time in which the last reference velocity decreases to zero', 's', 0.01, 5.0)
    stamp_tolerance: float = setting(
        0.5, 'largest difference between the stamp of a reference and the present time', 's',
        0.001, 1e6)
    jump_position: float = setting(
        0.05, 'largest position step between references that are followed', 'm', 1e-4, 10.0)
    jump_rotation: float = setting(
        0.2, 'largest rotation step between references that are followed', 'rad', 1e-3, 4.0)
    jump_joints: float = setting(
        0.1, 'largest step of a joint between references of the joints that are followed', 'rad',
        1e-3, 4.0)
    resume_time: float = setting(
        1.0, 'after a gap in the stream shorter than this the same stream is followed on', 's',
        0.0, 10.0)
    arming_position: float = setting(
        0.02, 'largest distance from the robot at which the arm begins to follow a motion', 'm',
        0.0, 1.0)
    arming_rotation: float = setting(0.1, 'the same for the rotation', 'rad', 0.0, 3.0)
    arming_joints: float = setting(
        0.05, 'the same for each joint, for references of the joints', 'rad', 0.0, 3.0)
    arming_speed: float = setting(
        0.05, 'largest difference from the speed of the robot at which it begins', 'm/s', 0.0,
        1.0)
    arming_angular_speed: float = setting(
        0.25, 'the same for the angular speed', 'rad/s', 0.0, 3.0)


@dataclass(frozen=True)
class LimitSettings:
    """Limits of the motion; the defaults are those of a Franka Emika Panda where it has one."""

    torque_share: float = setting(
        1.0, "part of the motors' torque that the law may use; gravity, brakes and repulsion may "
        'use all', '', 0.01, 1.0)
    torque_slew: float = setting(
        950.0, 'largest rate of change of a joint torque; 5 % inside the limit of a Franka',
        'Nm/s', 1.0, 1e6)
    joint_margin: float = setting(
        0.05, 'distance that the reference keeps from a joint limit; a joint that comes closer is '
        'pushed back', 'rad', 1e-3, 1.0)
    joint_repulsion: float = setting(
        40.0, 'torque that pushes a joint back, at the joint limit itself, at most half of what '
        'the motor can do', 'Nm', 0.0, 50.0)
    joint_speed: float = setting(
        2.61, 'largest speed of any joint; the model may have less for some, as the built-in '
        'Panda: 2.175 rad/s except for the wrist. Braking begins at 90 %', 'rad/s', 0.01, 20.0)
    joint_acceleration: float = setting(
        7.0, 'acceleration limit of each joint, for references of the joints', 'rad/s^2', 0.1,
        100.0)
    joint_brake: float = setting(
        20.0, 'damping of a joint above 90 % of its speed limit', 'Nm s/rad', 0.0, 200.0)
    speed: float = setting(1.7, 'speed limit of the reference', 'm/s', 1e-3, 10.0)
    angular_speed: float = setting(
        2.5, 'angular speed limit of the reference', 'rad/s', 1e-3, 20.0)
    acceleration: float = setting(
        13.0, 'acceleration limit of the reference', 'm/s^2', 0.01, 100.0)
    angular_acceleration: float = setting(
        25.0, 'angular acceleration limit of the reference', 'rad/s^2', 0.01, 200.0)
    jerk: float = setting(6000.0, 'jerk limit of the reference', 'm/s^3', 1.0, 1e6)
    angular_jerk: float = setting(
        11000.0, 'angular jerk limit of the reference', 'rad/s^3', 1.0, 1e6)
    tool_speed: float = setting(
        1.6, 'largest speed of the tool, measured; it is braked before', 'm/s', 0.01, 10.0)
    catch_up_speed: float = setting(
        0.25, 'speed at which the arm catches up with a reference after an interruption or a '
        'delay', 'm/s', 1e-3, 2.0)
    catch_up_angular_speed: float = setting(
        1.0, 'angular speed at which the arm catches up', 'rad/s', 1e-3, 3.0)
    workspace_min: tuple[float, float, float] = setting(
        (-1.0, -1.0, 0.0), 'lowest reference position', 'm', -10.0, 10.0)
    workspace_max: tuple[float, float, float] = setting(
        (1.0, 1.0, 1.3), 'highest reference position', 'm', -10.0, 10.0)
    stiffness_min: tuple[float, float] = setting(
        (1.0, 0.1), 'smallest stiffness eigenvalue, translational and rotational', 'N/m, Nm/rad',
        1e-3, 1e4)
    stiffness_max: tuple[float, float] = setting(
        (5000.0, 500.0), 'largest stiffness eigenvalue, translational and rotational',
        'N/m, Nm/rad', 1e-3, 1e5)
    stiffness_rate: float = setting(
        20.0, 'largest relative change of the stiffness in any direction', '1/s', 0.01, 1000.0)
    retreat_speed: float = setting(
        0.0, 'speed at which the arm goes away from what comes nearer than the margin; 0: it '
        'stands still', 'm/s', 0.0, 1.0)
    singularity_start: float = setting(
        0.06, 'smallest singular value of the Jacobian (rotations times 0.3 m) below which the '
        'reference is slowed down on its way to a singularity', 'm', 0.0, 1.0)
    singularity_stop: float = setting(
        0.015, 'singular value at which the reference stops on its way to a singularity', 'm',
        0.0, 1.0)

    def __post_init__(self) -> None:
        """:raises ParameterError: if two limits contradict each other"""
        for low, high in (('workspace_min', 'workspace_max'), ('stiffness_min', 'stiffness_max'),
                          ('singularity_stop', 'singularity_start')):
            least, most = getattr(self, low), getattr(self, high)
            if not np.less(least, most).all():
                raise ParameterError(f'{low} is {least}, expected less than {high}, {most}')


@dataclass(frozen=True)
class TankSettings:
    """The energy tank (`gdmp_ros.control.tank`)."""

    energy: float = setting(5.0, 'energy in the tank at the start', 'J', 0.0, 1000.0)
    capacity: float = setting(
        10.0, 'capacity of the tank; energy beyond it is lost', 'J', 0.01, 1000.0)
    recharge_power: float = setting(
        2.5, 'power that flows into the tank, for friction and tasks that do work; the controller '
        'gives no more than this to the world, with 0 it is passive', 'W', 0.0, 100.0)
    delay: float = setting(
        0.001, 'longest delay of the torque commands with which the energy is still counted '
        'correctly', 's', 0.0, 0.01)
    passive: bool = setting(
        True, 'slow down or soften what the tank has no energy for; False: the energy is only '
        'counted')


@dataclass(frozen=True)
class FrictionSettings:
    """
    Friction of the joints, one number for each joint or one for all.

    What is compensated need not be exact. What counts as dissipated must be there for certain.
    """

    viscous: tuple[float, ...] = setting(
        (0.0,), 'viscous friction that is compensated; a single 0 for that of the model',
        'Nm s/rad', 0.0, 1000.0, each=True)
    dry: tuple[float, ...] = setting(
        (0.0,), 'dry friction that is compensated', 'Nm', 0.0, 100.0, each=True)
    credit_viscous: tuple[float, ...] = setting(
        (0.0,), 'lower bound of the viscous friction, which refills the tank', 'Nm s/rad', 0.0,
        1000.0, each=True)
    credit_dry: tuple[float, ...] = setting(
        (0.0,), 'lower bound of the dry friction, which refills the tank', 'Nm', 0.0, 100.0,
        each=True)
    credit: float = setting(
        0.8, 'share of the compensated friction that is there for certain: it refills the tank '
        'while a joint moves with its reference', '', 0.0, 1.0)


@dataclass(frozen=True)
class ContactSettings:
    """Contact with the environment (`gdmp_ros.control.contact`)."""

    collision_force: float = setting(
        0.0, 'external force against the motion at which the arm reacts; 0: never', 'N', 0.0,
        1000.0)
    collision_torque: float = setting(0.0, 'the same for the torque', 'Nm', 0.0, 1000.0)
    collision_reaction: str = setting(
        'stop', 'reaction to a collision: stop and hold, or stop and give way',
        choices=('stop', 'comply'))
    force_feedback_max: tuple[float, float] = setting(
        (20.0, 3.0), 'largest correction of the wrench of a reference', 'N, Nm', 0.0, 1000.0)


@dataclass(frozen=True)
class ControllerSettings:
    """All settings of a controller."""

    gains: ImpedanceGains = field(default_factory=ImpedanceGains)
    guard: GuardSettings = field(default_factory=GuardSettings)
    limits: LimitSettings = field(default_factory=LimitSettings)
    tank: TankSettings = field(default_factory=TankSettings)
    friction: FrictionSettings = field(default_factory=FrictionSettings)
    contact: ContactSettings = field(default_factory=ContactSettings)
    posture: tuple[float, ...] = setting(
        (0.0,), 'posture of the null space, a number for each joint; a single 0: as at the start',
        'rad', -10.0, 10.0, each=True)
    weight_moments: tuple[float, ...] = setting(
        (0.0,), 'moments of weight that the model lacks, three numbers for each joint in its '
        'frame, as `gdmp arm friction` finds them; a single 0: none', 'Nm', -100.0, 100.0,
        each=True)
    damping_ratio: float = setting(
        0.7, 'damping ratio while holding without a reference, and of references with 0; 1 is '
        'critical', '', SMALLEST_DAMPING_RATIO, 2.0)


#: The numbers of gains, limits and tank, as kernels see them.
GAIN_NUMBERS, LIMIT_NUMBERS, TANK_NUMBERS = (
    numbers_type(kind) for kind in (ImpedanceGains, LimitSettings, TankSettings))
