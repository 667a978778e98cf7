"""How a simulated robot differs from the model with which it is controlled."""
from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from gdmp_ros.kernels import kernel
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


#: Ticks after which the noise of the encoders comes again.
NOISE_TICKS = 10_000

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


class Channel(NamedTuple):
    """
    Between a robot with n joints and its controller, for kernels.

    :ivar noise: of measured positions and velocities, one row for each tick, shape (k, 2, n);
        empty without noise
    :ivar waiting: torques that do not act yet, shape (k, n); empty without a delay
    :ivar next: which row of each comes next
    """

    noise: np.ndarray
    waiting: np.ndarray
    next: np.ndarray


def channel_of(settings: PlantSettings, joints: int, period: float) -> Channel:
    """What lies between a robot and its controller; `reset_channel` follows."""
    deviations = np.array([[settings.position_noise], [settings.velocity_noise]])
    shape = (NOISE_TICKS if deviations.any() else 0, 2, joints)
    return Channel(deviations * np.random.default_rng(0).standard_normal(shape),
                   np.zeros((round(settings.delay / period), joints)),
                   np.zeros(2, dtype=np.int64))


def reset_channel(between: Channel, torque: np.ndarray) -> None:
    """Begin again, with a torque that acts already [Nm]."""
    between.waiting[:] = torque
    between.next[:] = 0


@kernel
def disturb(between, position, velocity):
    """Add the noise of the encoders to what is measured."""
    if len(between.noise) == 0:
        return
    k = between.next[0]
    between.next[0] = (k + 1) % len(between.noise)
    for i in range(position.size):
        position[i] += between.noise[k, 0, i]
        velocity[i] += between.noise[k, 1, i]


@kernel
def act(between, torque, control):
    """
    Send a torque [Nm].

    :param control: written: the one that acts now
    """
    if len(between.waiting) == 0:
        for i in range(torque.size):
            control[i] = torque[i]
        return
    k = between.next[1]
    between.next[1] = (k + 1) % len(between.waiting)
    for i in range(torque.size):
        control[i] = between.waiting[k, i]
        between.waiting[k, i] = torque[i]
