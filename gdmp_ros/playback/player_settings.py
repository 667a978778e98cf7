"""What a stream of references needs besides the skill."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdmp_ros.control.reference_check import LARGEST_WRENCH_GAIN
from gdmp_ros.util.settings import setting


@dataclass(frozen=True)
class PlayerSettings:
    """What a reference needs besides the skill."""

    damping_ratio: float = setting(
        0.7, 'damping ratio of the reference; 1 is critical', '', 0.0, 2.0)
    stiffness: tuple[float, float, float] = setting(
        (400.0, 400.0, 400.0), 'translational stiffness if the skill has none', 'N/m', 1.0, 5000.0)
    rotational_stiffness: tuple[float, float, float] = setting(
        (30.0, 30.0, 30.0), 'rotational stiffness if the skill has none', 'Nm/rad', 0.1, 500.0)
    wrench_gain: float = setting(
        0.0, 'rate at which the measured wrench is corrected to that of the skill, if it has one; '
        '0: never', '1/s', 0.0, LARGEST_WRENCH_GAIN)
    joint_stiffness: tuple[float, ...] = setting(
        (200.0,), 'stiffness of the joints for skills of the joints; one for all, or one for each',
        'Nm/rad', 1.0, 5000.0, each=True)
    speed_rate: float = setting(5.0, 'largest rate of change of the tempo', '1/s', 0.1, 100.0)
    goal_speed: float = setting(
        0.0, 'largest speed of the goal position after a goal switch; 0: no limit', 'm/s', 0.0,
        10.0)
    goal_angular_speed: float = setting(
        0.0, 'largest angular speed of the goal orientation after a goal switch; 0: no limit',
        'rad/s', 0.0, 50.0)
    phase_stopping: float = setting(
        1.0, 'kappa: the tempo is divided by 1 + kappa e^2 while the measured pose lags behind; '
        '0: never', '', 0.0, 1000.0)
    phase_stopping_weights: tuple[float, float] = setting(
        (400.0, 4.0), 'weights in e^2: first x position error^2 [m^2] + second x rotation '
        'error^2 [rad^2]', '1/m^2, 1/rad^2', 0.0, 1e6)

    @property
    def stiffness_matrix(self) -> np.ndarray:
        """6×6 stiffness for skills without one; its rotational block is also used with SPD(3)."""
        return np.diag([*self.stiffness, *self.rotational_stiffness])
