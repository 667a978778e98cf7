"""Parameters of a stream of references."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdmp_ros.control.reference_check import LARGEST_WRENCH_GAIN
from gdmp_ros.errors import ManifoldError, ParameterError
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


@dataclass(frozen=True)
class StreamSettings:
    """Where motions may start, and where goals may be."""

    start_from: str = setting(
        'measured', "where motions start: at the measured pose, or at the skill's own start",
        choices=('measured', 'skill'))
    measured_pose_age: float = setting(
        0.5, 'oldest measured pose from which a motion may start', 's', 0.01, 10.0)
    stream_speed: float = setting(
        1.5, 'largest speed of the references; 0: no bound', 'm/s', 0.0, 10.0)
    stream_acceleration: float = setting(
        10.0, 'largest acceleration of the references; 0: no bound', 'm/s^2', 0.0, 100.0)
    stream_angular_speed: float = setting(
        2.0, 'largest angular speed of the references; 0: no bound', 'rad/s', 0.0, 20.0)
    stream_angular_acceleration: float = setting(
        20.0, 'largest angular acceleration of the references; 0: no bound', 'rad/s^2', 0.0,
        200.0)
    follow_goal_after_end: bool = setting(
        False, 'whether a goal that comes after the end of a motion moves the arm; otherwise it '
        'is refused')
    moving_goal_timeout: float = setting(
        1.0, 'time without a new message after which a goal of ~/moving_goal rests', 's', 0.05,
        3600.0)
    workspace_min: tuple[float, float, float] = setting(
        (-0.2, -0.8, 0.02), 'lowest goal position accepted', 'm', -10.0, 10.0)
    workspace_max: tuple[float, float, float] = setting(
        (0.8, 0.8, 1.1), 'highest goal position accepted', 'm', -10.0, 10.0)

    def __post_init__(self) -> None:
        """:raises ParameterError: if the workspace is empty"""
        for axis, low, high in zip('xyz', self.workspace_min, self.workspace_max):
            if low >= high:
                raise ParameterError(f'workspace_min {axis} is {low:g} m, expected less than '
                                     f'workspace_max {axis}, {high:g} m')

    def inside(self, pose: np.ndarray) -> np.ndarray:
        """Pose with its position moved into the workspace."""
        return np.concatenate([np.clip(pose[:3], self.workspace_min, self.workspace_max),
                               pose[3:]])

    def check_twist(self, twist: np.ndarray) -> None:
        """
        Check the twist of a goal that moves on.

        :raises ManifoldError: if it is faster than the stream may be
        """
        for name, part, limit, unit in (('speed', twist[:3], self.stream_speed, 'm/s'),
                                        ('angular speed', twist[3:], self.stream_angular_speed,
                                         'rad/s')):
            fast = float(np.linalg.norm(part))
            if limit and fast > limit:
                raise ManifoldError(f'the {name} of the goal is {fast:.3g} {unit}, expected at '
                                    f'most stream_{name.replace(" ", "_")}, {limit:g} {unit}')

    def check_goal(self, pose: np.ndarray, arm: str = '') -> None:
        """
        Check the position of a goal.

        :param arm: of which it is, for the message
        :raises ManifoldError: if it lies outside the workspace
        """
        for axis, value, least, most in zip('xyz', pose, self.workspace_min, self.workspace_max):
            if not least <= value <= most:
                raise ManifoldError(f'{arm}goal {axis} is {value:.3f} m, outside the workspace '
                                    f'{least:g} to {most:g} m')
