"""What touches an arm that takes joint positions: a hard table, and a hand; in lockstep."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.control.admittance import AdmittanceSettings, DAMPING_SHARE
from gdmp_ros.control.settings import ControllerSettings, TankSettings
from gdmp_ros.control.target import ACCELERATION, POSE, resting_target, STIFFNESS, TWIST
from gdmp_ros.data import lasa
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.states import Status
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.servo_arm import PositionLoop, ServoArm, ServoSettings
from gdmp_ros.util.profiles import minimum_jerk

CYCLE = 0.002
#: Whole delays, of servo, lag and interpolation, are 8 and 36 ms.
FAST, SLOW = ServoSettings(delay=0.0055, lag=0.002), ServoSettings(delay=0.0335, lag=0.002)
#: How far the goal of a letter moves [m], and from which progress on.
SWITCH, SWITCH_AT = np.array([-0.06, 0.08, 0.0]), 0.4
#: Of the table, and how deep below its top the references go [m].
TABLE_STIFFNESS, TABLE_DAMPING, DEPTH = 30_000.0, 20.0, 0.01


def whole_delay(settings: ServoSettings) -> float:
    """Time by which an arm is behind its commands: that of servo, lag and interpolation [s]."""
    # It is measured at the end of a period of the simulation, and half a period is in the lag.
    return settings.delay + settings.lag + settings.cycle - 1.5e-3


def table_force(arm: Arm, top: float, stiffness: float = TABLE_STIFFNESS
                ) -> tuple[float, np.ndarray]:
    """
    Force of a hard table on a tool, upwards [N], and the velocity of the tool [m/s].

    :param top: height of the table [m]
    :param stiffness: of the table [N/m]
    """
    jacobian, site = np.zeros((3, arm.model.nv)), arm.data.site('tcp')
    mujoco.mj_jacSite(arm.model, arm.data, jacobian, None, site.id)
    velocity, deep = jacobian @ arm.data.qvel, float(top - site.xpos[2])
    force = stiffness * deep - TABLE_DAMPING * float(velocity[2])
    return (max(force, 0.0) if deep > 0.0 else 0.0), velocity


class Trial:
    """
    An arm, its controller, and what touches the tool.

    :ivar table: height of its top [m]; None without one
    :ivar table_stiffness: [N/m]
    :ivar hand: force that pushes the tool [N]
    :ivar force: of the table on the tool [N]
    """

    def __init__(self, settings: ServoSettings = FAST, tank: TankSettings | None = None,
                 model: str = 'ur5e', **admittance: float):
        """:param admittance: fields of `AdmittanceSettings`"""
        self.loop = PositionLoop(ServoArm(model, settings),
                                 ControllerSettings(tank=tank or TankSettings()),
                                 AdmittanceSettings(**admittance))  # type: ignore[arg-type]
        self.servo, self.driver = self.loop.servo, self.loop.driver
        self.table: float | None = None
        self.table_stiffness = TABLE_STIFFNESS
        self.hand, self.force = np.zeros(3), 0.0
        self._advance_servo, self.servo.advance = (  # type: ignore[method-assign]
            self.servo.advance, self._advance)

    @property
    def pose(self) -> np.ndarray:
        """Where the tool is (x, y, z, qw, qx, qy, qz)."""
        return self.servo.arm.site_pose('tcp')

    def _advance(self, periods: int = 1) -> None:
        for _ in range(periods):
            arm, wrench = self.servo.arm, np.zeros(6)
            wrench[:3] = self.hand
            if self.table is not None:
                self.force, _ = table_force(arm, self.table, self.table_stiffness)
                wrench[2] += self.force
            arm.push(wrench)
            self._advance_servo()

    def follow(self, references: np.ndarray) -> np.ndarray:
        """
        Follow references, one in each cycle.

        :returns: pose of the tool, force of the table and wrench that was felt, shape (T, 14)
        :raises GdmpError: if the arm stops
        """
        rows = []
        for reference in references:
            self.loop.must_follow(reference)
            self.loop.tick()
            rows.append(np.concatenate([self.pose, [self.force], self.driver.wrench]))
        if not self.driver.controlled:
            raise GdmpError(self.loop.states.reason)
        return np.array(rows)


def soft(stiffness: float) -> np.ndarray:
    """Stiffness of the tool: of the translation as given [N/m], of the rotation 30 Nm/rad."""
    return np.diag([stiffness] * 3 + [30.0] * 3)


def resting(pose: np.ndarray, stiffness: float, seconds: float, cycle: float = CYCLE
            ) -> np.ndarray:
    """References at rest; stiffness of the translation [N/m]."""
    references = np.array([resting_target(pose)] * round(seconds / cycle))
    references[:, STIFFNESS:STIFFNESS + 36] = soft(stiffness).ravel()
    return references


def circle(pose: np.ndarray, stiffness: float, seconds: float = 4.0, radius: float = 0.08,
           cycle: float = CYCLE) -> np.ndarray:
    """References once around, from rest to rest."""
    references = resting(pose, stiffness, seconds, cycle)
    angle = 2.0 * np.pi * minimum_jerk(np.linspace(0.0, 1.0, len(references)))
    rate = np.gradient(angle, cycle)
    references[:, POSE] += radius * (np.cos(angle) - 1.0)
    references[:, POSE + 1] += radius * np.sin(angle)
    references[:, TWIST] = -radius * np.sin(angle) * rate
    references[:, TWIST + 1] = radius * np.cos(angle) * rate
    references[:, ACCELERATION:ACCELERATION + 2] = np.gradient(
        references[:, TWIST:TWIST + 2], cycle, axis=0)
    return references


def played(skill: Skill, home: np.ndarray, stiffness: np.ndarray, cycle: float,
           switch: np.ndarray | None = None) -> np.ndarray:
    """
    References of a skill from ``home`` on.

    :param stiffness: instead of that of the skill, shape ``(6, 6)``
    :param switch: how far its goal moves on the way [m]; None: it stays
    """
    player, rows = Player(skill, PlayerSettings()), []
    player.start(home.copy())
    while player.status is not Status.HOLDING:
        row = np.array(player.tick(cycle))
        row[STIFFNESS:STIFFNESS + 36] = stiffness.ravel()
        rows.append(row)
        if (switch is not None and player.rollout is not None
                and player.rollout.progress > SWITCH_AT):
            player.go_to(np.concatenate([skill.goal[:3] + switch, skill.goal[3:7]]))
            switch = None
    return np.array(rows)


def letter(home: np.ndarray, stiffness: float, cycle: float = CYCLE) -> np.ndarray:
    """References of a handwritten letter whose goal is switched by 0.1 m on the way."""
    return played(Skill.learn(lasa.robot_demonstrations('GShape')[0]), home, soft(stiffness),
                  cycle, SWITCH)


def push(trial: Trial, stiffness: float) -> float:
    """Displacement of the tool by a hand of 20 N after 3 D/K, of that of a spring."""
    home = trial.pose
    trial.follow(resting(home, stiffness, 0.5))
    trial.hand = np.array([0.0, 20.0, 0.0])
    damping = DAMPING_SHARE * TABLE_STIFFNESS * trial.driver.delay
    rows = trial.follow(resting(home, stiffness, 3.0 * damping / stiffness))
    trial.hand = np.zeros(3)
    return float((rows[-1, 1] - home[1]) * stiffness / 20.0)


def given(trial: Trial, rng: np.random.Generator, changes: int = 6) -> float:
    """
    Largest energy that a pressed tool has given to its table beyond what the tank has paid [J].

    The stiffness changes at random; the tank is not refilled.
    """
    tank, home = trial.loop.controller.tank, trial.pose
    trial.table, last, out, before, most = float(home[2] - 0.001), home[2], 0.0, tank.energy, 0.0
    down = resting(home, 300.0, 3.0)
    down[:, POSE + 2] -= np.minimum(0.005 * CYCLE * np.arange(len(down)), DEPTH)
    for part in range(changes):
        references = down if part == 0 else resting(down[-1, :7], rng.uniform(100.0, 1500.0), 0.2)
        for reference in references:
            row = trial.follow(reference[None])[0]
            out += row[7] * (last - row[2])
            last, most = row[2], max(most, out - (before - tank.energy))
    return float(most)


def press(trial: Trial, stiffness: float, speed: float) -> np.ndarray:
    """Approach a table 30 mm below the tool, and press on it; forces of the table [N]."""
    home = trial.pose
    trial.table = float(home[2] - 0.03)
    references = resting(home, stiffness, 0.04 / speed + 1.5)
    heights = home[2] - speed * CYCLE * np.arange(len(references))
    references[:, POSE + 2] = np.maximum(heights, trial.table - DEPTH)
    references[:, TWIST + 2] = np.gradient(references[:, POSE + 2], CYCLE)
    return trial.follow(references)[:, 7]


def lost(forces: np.ndarray) -> int:
    """Cycles without contact, from half a second after the first touch on."""
    later = forces[int(np.argmax(forces > 0.0)) + round(0.5 / CYCLE):]
    return int((later <= 0.0).sum())
