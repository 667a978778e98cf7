"""How a simulated robot differs from the model with which it is controlled."""
from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import mujoco
import numpy as np

from gdmp_ros.sim.frames import Mount
from gdmp_ros.sim.payload import Load, Payload
from gdmp_ros.util.settings import setting


@dataclass(frozen=True)
class PlantSettings:
    """What the controller does not know of the robot; the defaults change nothing."""

    dry_friction: float = setting(0.0, 'dry friction of every joint', 'Nm', 0.0, 20.0)
    armature: float = setting(
        0.0, 'rotor inertia of every joint; 0: that of the model', 'kg m^2', 0.0, 10.0)
    delay: float = setting(
        0.0, 'time from a torque command until it acts, in whole ticks', 's', 0.0, 0.003)
    position_noise: float = setting(
        0.0, 'standard deviation of the measured joint positions', 'rad', 0.0, 0.01)
    velocity_noise: float = setting(
        0.0, 'standard deviation of the measured joint velocities', 'rad/s', 0.0, 1.0)
    payload: float = setting(0.0, 'mass at the tool that nobody announced', 'kg', 0.0, 10.0)
    model: str = setting('', "model of the robot itself, as for model; empty: the controller's")


#: A robot as public models of a Franka describe it, with a cycle of delay and encoder noise.
REAL = PlantSettings(dry_friction=1.1, armature=0.2, delay=0.001, position_noise=1e-5,
                     velocity_noise=2e-3)


def change(model: mujoco.MjModel, site: int, joints: slice, settings: PlantSettings) -> None:
    """
    Change the dynamics of a model.

    :param site: of the tool
    :param joints: those of the arm
    """
    model.dof_frictionloss[joints] += settings.dry_friction
    if settings.armature > 0.0:
        model.dof_armature[joints] = settings.armature
    if settings.payload > 0.0:
        load = Load(model, int(model.site_bodyid[site]), Mount(model, site))
        load.put(Payload(settings.payload).moments())
    mujoco.mj_setConst(model, mujoco.MjData(model))


class Actuation:
    """Torques on their way to the motors."""

    def __init__(self, delay: float, period: float):
        self._ticks = round(delay / period)
        self._waiting: deque[np.ndarray] = deque()

    @property
    def at_once(self) -> bool:
        """Whether there is no delay."""
        return self._ticks == 0

    def reset(self, torque: np.ndarray) -> None:
        """Begin with a torque that acts already [Nm]."""
        self._waiting = deque([torque.copy()] * self._ticks)

    def through(self, torque: np.ndarray) -> np.ndarray:
        """Send a torque, and return the one that acts now [Nm]."""
        self._waiting.append(torque.copy())
        return self._waiting.popleft()
