"""What the robot itself has to know before a motion."""
from __future__ import annotations

from dataclasses import dataclass

from gdmp_ros.errors import ParameterError
from gdmp_ros.util.settings import setting

JOINTS = 7
#: Port of a robot.
PORT = 1337
#: Time after which a robot that takes one client has seen the end of the last one [s].
BETWEEN_CLIENTS_S = 1.5


@dataclass(frozen=True)
class FrankaSettings:
    """Connection, and thresholds of the robot's own reflexes."""

    host: str = setting('', 'address of the robot')
    enforce_realtime: bool = setting(
        False, 'refuse to control without SCHED_FIFO and a PREEMPT_RT kernel; without them the '
        'robot may stop after lost cycles')
    reflex_torque: tuple[float, ...] = setting(
        (40.0,), 'external torque of a joint at which the robot stops by itself; one for all '
        'joints, or one for each', 'Nm', 1.0, 200.0, each=True)
    reflex_wrench: tuple[float, float] = setting(
        (60.0, 20.0), 'external force and torque at the tool at which the robot stops by itself',
        'N, Nm', 1.0, 200.0)
    rotor_inertia: float = setting(
        0.195, "rotor inertia of each joint, beyond the robot's own model; as in public models of "
        'the robot', 'kg m^2', 0.0, 2.0)

    wall_time: bool = setting(
        False, 'time passes as on this machine, not as the robot counts its cycles: for a server '
        'of the protocol whose simulation runs on while cycles are lost')

    def __post_init__(self) -> None:
        """:raises ParameterError: if there is not one torque, or one for each joint"""
        if len(self.reflex_torque) not in (1, JOINTS):
            raise ParameterError(f'reflex_torque has {len(self.reflex_torque)} numbers, '
                                 f'expected 1 or {JOINTS}')

    @property
    def joint_thresholds(self) -> list[float]:
        """Torque of each joint [Nm]."""
        given = list(self.reflex_torque)
        return given if len(given) == JOINTS else given * JOINTS

    @property
    def wrench_thresholds(self) -> list[float]:
        """Forces [N] and torques [Nm]."""
        force, torque = self.reflex_wrench
        return [force] * 3 + [torque] * 3
