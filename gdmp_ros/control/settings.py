"""Settings of the controller. Nodes declare their parameters from these fields."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.util.settings import numbers_type, setting


@dataclass(frozen=True)
class ImpedanceGains:
    """Constants of the impedance law (`gdmp_ros.control.impedance`)."""

    position_clip: float = setting(0.1, 'largest position error that acts', 'm', 0.001, 1.0)
    rotation_clip: float = setting(0.5, 'largest rotation error that acts', 'rad', 0.01, 3.0)
    posture_stiffness: float = setting(
        5.0, 'stiffness of the posture in the null space', 'Nm/rad', 0.0, 100.0)
    posture_damping: float = setting(
        2.0, 'damping of the posture in the null space', 'Nm s/rad', 0.0, 50.0)
    feed_forward: bool = setting(
        True, 'add the inertial force and the joint friction of the reference motion')
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
    jump_stiffness: float = setting(
        1.0, 'largest stiffness step between references that are followed: log of the ratio in '
        'any direction', '', 1e-3, 100.0)


@dataclass(frozen=True)
class LimitSettings:
    """Limits of the motion; the defaults are those of a Franka Emika Panda where it has one."""

    torque_share: float = setting(1.0, "fraction of the motors' torque limits", '', 0.01, 1.0)
    torque_rate: float = setting(
        1.0, 'largest change of a joint torque per tick', 'Nm', 0.01, 100.0)
    joint_margin: float = setting(
        0.3, 'distance from a joint limit at which repulsion begins', 'rad', 1e-3, 1.0)
    joint_repulsion: float = setting(
        5.0, 'repulsion torque at the joint limit itself', 'Nm', 0.0, 50.0)
    joint_speed: float = setting(
        2.175, 'speed limit of every joint; braking begins at 90 %', 'rad/s', 0.01, 20.0)
    joint_brake: float = setting(
        20.0, 'damping of a joint above 90 % of its speed limit', 'Nm s/rad', 0.0, 200.0)
    speed: float = setting(1.7, 'speed limit of the reference', 'm/s', 1e-3, 10.0)
    angular_speed: float = setting(
        2.5, 'angular speed limit of the reference', 'rad/s', 1e-3, 20.0)
    acceleration: float = setting(
        13.0, 'acceleration limit of the reference', 'm/s^2', 0.01, 100.0)
    angular_acceleration: float = setting(
        25.0, 'angular acceleration limit of the reference', 'rad/s^2', 0.01, 200.0)
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
    refill: float = setting(
        0.0, 'power that flows into the tank, for tasks that do work continuously; with 0 the '
        'controller is passive', 'W', 0.0, 100.0)
    passive: bool = setting(
        True, 'restrict what the tank has no energy for; False only records the energy')


@dataclass(frozen=True)
class ControllerSettings:
    """All settings of a controller."""

    gains: ImpedanceGains = field(default_factory=ImpedanceGains)
    guard: GuardSettings = field(default_factory=GuardSettings)
    limits: LimitSettings = field(default_factory=LimitSettings)
    tank: TankSettings = field(default_factory=TankSettings)
    damping_ratio: float = setting(
        0.7, 'damping ratio while holding without a reference; 1 is critical', '', 0.0, 2.0)


#: The numbers of the gains and of the limits, as kernels see them.
GAIN_NUMBERS, LIMIT_NUMBERS = numbers_type(ImpedanceGains), numbers_type(LimitSettings)
