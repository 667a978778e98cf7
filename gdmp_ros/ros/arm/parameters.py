"""Parameters of the simulated arm."""
from __future__ import annotations

from typing import Any

from gdmp_ros.control.settings import (
    ControllerSettings,
    GuardSettings,
    ImpedanceGains,
    LimitSettings,
    TankSettings,
)
from gdmp_ros.ros.parameters import settings_from, Spec, specs_of
from gdmp_ros.sim.hand import HandSettings

_GUARD = {'timeout': 'reference_timeout'}
_TANK = {'energy': 'tank_energy', 'capacity': 'tank_capacity', 'refill': 'tank_refill'}
_HAND = {'stiffness': 'hand_stiffness', 'force': 'hand_force'}
SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('model', '', 'another arm: MJCF file, menagerie:NAME or robot_descriptions:NAME; empty: '
         'the built-in Panda'),
    Spec('tool_site', 'tcp', 'site of the model that is controlled'),
    Spec('frame_id', 'panda_link0', "frame of the robot's base; references in others are refused"),
    Spec('reference_topic', 'trajectory_server/reference', 'gdmp_msgs/Reference to follow'),
    Spec('pace', 'wall', 'wall: simulated time passes like wall time; fast: as fast as possible, '
         'with /clock', choices=('wall', 'fast')),
    Spec('headless', True, 'without a viewer window'),
    Spec('viewer_rate_hz', 100, 'rate of joint states, measured pose and stiffness for viewers',
         'Hz', 1, 100),
    *specs_of(GuardSettings, names=_GUARD),
    *specs_of(ControllerSettings),
    *specs_of(LimitSettings, formerly={'angular_speed': 'turn_speed',
                                       'angular_acceleration': 'turn_acceleration',
                                       'catch_up_angular_speed': 'catch_up_turn_speed'}),
    *specs_of(TankSettings, names=_TANK, fixed=('energy',)),
    *specs_of(ImpedanceGains, fixed=('position_clip', 'rotation_clip')),
    *specs_of(HandSettings, names=_HAND),
    Spec('realtime_priority', 0, 'SCHED_FIFO priority of the simulation thread; -1: 40 if the '
         'system grants it; 0: never', low=-1, high=99),
    Spec('lateness_file', '', 'NumPy file for deadline and lateness of all ticks'),
)


def hand_settings(parameters: Any) -> HandSettings:
    """Settings of the hand that guides the arm."""
    return settings_from(parameters, HandSettings, _HAND)


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
        tank=settings_from(parameters, TankSettings, _TANK))
