"""A stiffness profile that adds energy in a stiff contact."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.reliability.stability import growth_margin
from experiments.reliability.trial import FaultTrial
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.control.impedance import damping_design
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.settings import (
    ControllerSettings,
    LimitSettings,
    TankSettings,
)
from gdmp_ros.control.target import resting_target, STIFFNESS
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.scenes import hard_table
from gdmp_ros.view import plots

#: Smallest and largest stiffness normal to the table [N/m].
LOW, HIGH = 150.0, 3000.0
DAMPING, TANK_J, SECONDS = 0.1, 1.0, 6.0
#: Distance of the table, and of the reference above it, below the initial tool position [m].
TABLE_BELOW, REFERENCE_BELOW = 0.05, 0.045
_PERIOD = 1e-3


@dataclass(frozen=True)
class History:
    """Energies [J], height [m], stiffness [N/m] and contact at every tick."""

    times: np.ndarray
    kinetic: np.ndarray
    spring: np.ndarray
    tank: np.ndarray
    height: np.ndarray
    stiffness: np.ndarray
    requested: np.ndarray
    contact: np.ndarray

    @property
    def robot(self) -> np.ndarray:
        """Kinetic energy and energy in the spring."""
        return np.asarray(self.kinetic + self.spring)


def adversary(last: Tick | None, target: np.ndarray) -> float:
    """Stiffness that adds energy: large on the way to the reference, small away from it [N/m]."""
    if last is None:
        return LOW
    away = last.measurement.pose[2] - target[2]
    return HIGH if away * last.twist[2] < 0.0 else LOW


def simulate(passive: bool, seconds: float = SECONDS) -> History:
    """Follow a reference just above the table with the adversarial stiffness."""
    arm = Arm(hard_table(TABLE_BELOW))
    loop = ClosedLoop(arm, ControllerSettings(
        limits=LimitSettings(stiffness_rate=200.0),
        tank=TankSettings(TANK_J, TANK_J, 0.0, passive=passive)))
    start = arm.measure().pose.copy()
    target = resting_target(start, damping_ratio=DAMPING)
    target[2] -= REFERENCE_BELOW
    loop.controller.guard.arm()
    rows, last = [], None
    for k in range(round(seconds / _PERIOD)):
        wanted = adversary(last, target)
        target[STIFFNESS:STIFFNESS + 36] = np.diag([400.0, 400.0, wanted, 30.0, 30.0, 30.0]
                                                   ).reshape(-1)
        loop.must_follow(target)
        contact = arm.data.ncon > 0
        last = loop.tick()
        measured = last.measurement
        kinetic = 0.5 * measured.velocity @ measured.inertia @ measured.velocity
        last = last._replace(measurement=measured._replace(pose=measured.pose.copy()))
        rows.append((k * _PERIOD, kinetic, last.spring, last.tank, measured.pose[2] - start[2],
                     last.stiffness[14], wanted, contact))
    return History(*np.array(rows, dtype=float).T)


def margin(history: History) -> float:
    """
    `growth_margin` of the profile along the normal of the table.

    If it is positive the profile is not known to be stable.
    """
    arm = Arm().measure()
    inverse = (arm.jacobian @ np.linalg.solve(arm.inertia, arm.jacobian.T))[2:3, 2:3]
    stiffness = history.stiffness.reshape(-1, 1, 1)
    damping = np.array([damping_design(k, inverse, DAMPING)[0] for k in stiffness])
    return growth_margin(history.times, stiffness, damping, np.linalg.inv(inverse))[1]


def adversarial_stiffness(trial: FaultTrial, quick: bool) -> TrialResult:
    """A stiffness profile that adds energy in a stiff contact"""
    outcome = TrialResult()
    plain, ours = simulate(False), simulate(True)
    total = ours.robot + ours.tank
    last = plain.times > SECONDS - 2.0
    outcome.need('without the tank: largest energy of arm and spring [J]',
                 float(plain.robot.max()), lambda v: v > 5.0)
    outcome.need('without the tank: amplitude in the last 2 s [m]',
                 float(np.ptp(plain.height[last])), lambda v: v > 0.05)
    outcome.need('with the tank: largest energy of arm and spring [J]', float(ours.robot.max()),
                 lambda v: v < total[0])
    outcome.need('with the tank: smallest energy in the tank [J]', float(ours.tank.min()),
                 lambda v: v > -0.01)
    outcome.need('with the tank: growth of the total energy [J]', float(total.max() - total[0]),
                 lambda v: v < 0.01)
    outcome.need('with the tank: energy in the last 2 s [J]', float(ours.robot[last].max()),
                 lambda v: v < 0.3)
    outcome.need('growth margin of the profile [N/m/s]', margin(plain),
                 lambda v: v > 0.0)
    draw(plain, ours, trial.folder.parent / 'adversarial-stiffness.png')
    return outcome


def draw(plain: History, ours: History, path: Path) -> None:
    """Energies, heights and stiffness, without and with the tank."""
    figure, axes = plots.panels(3, 2, (5.4, 2.5))
    for column, (history, title) in enumerate(((plain, 'without the energy tank'),
                                               (ours, 'with the energy tank'))):
        energy, height, stiffness = axes[:, column]
        energy.plot(history.times, history.robot, color=plots.INK[0], label='arm and spring')
        energy.plot(history.times, history.tank, color=plots.INK[1], ls='--', label='tank')
        energy.plot(history.times, history.robot + history.tank, color=plots.INK[4], ls=':',
                    label='sum')
        energy.set(title=title, ylabel='energy [J]')
        energy.legend(fontsize=7)
        height.plot(history.times, 1e3 * history.height, color=plots.INK[0], lw=0.8)
        height.axhline(-1e3 * REFERENCE_BELOW, color='0.5', ls='--', lw=0.8)
        height.set(ylabel='tool, from the start [mm]')
        stiffness.plot(history.times, history.requested, color='0.75', lw=0.6, label='requested')
        stiffness.plot(history.times, history.stiffness, color=plots.INK[0], lw=0.8,
                       label='applied')
        stiffness.set(ylabel='stiffness [N/m]', xlabel='time [s]')
        stiffness.legend(fontsize=7, loc='upper right')
    lowest = min(axes[1, 0].get_ylim()[0], axes[1, 1].get_ylim()[0])
    highest = max(axes[1, 0].get_ylim()[1], axes[1, 1].get_ylim()[1])
    for axis in axes[1]:
        axis.set_ylim(lowest, highest)
    plots.save(figure, path)
