"""What touches an arm that takes joint positions: a hard table, and a hand; in lockstep."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.control.admittance import AdmittanceSettings
from gdmp_ros.control.settings import ControllerSettings, TankSettings
from gdmp_ros.control.target import ACCELERATION, POSE, resting_target, STIFFNESS, TWIST
from gdmp_ros.errors import GdmpError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.servo_arm import PositionLoop, ServoArm, ServoSettings
from gdmp_ros.util.profiles import minimum_jerk

CYCLE = 0.002
#: Whole delays, of servo, lag and interpolation, are 8 and 36 ms.
FAST, SLOW = ServoSettings(delay=0.0055, lag=0.002), ServoSettings(delay=0.0335, lag=0.002)
#: Of the table, and how deep below its top the references go [m].
TABLE_STIFFNESS, TABLE_DAMPING, DEPTH = 30_000.0, 20.0, 0.01


def table_force(arm: Arm, top: float) -> tuple[float, np.ndarray]:
    """
    Force of a hard table on a tool, upwards [N], and the velocity of the tool [m/s].

    :param top: height of the table [m]
    """
    jacobian, site = np.zeros((3, arm.model.nv)), arm.data.site('tcp')
    mujoco.mj_jacSite(arm.model, arm.data, jacobian, None, site.id)
    velocity, deep = jacobian @ arm.data.qvel, float(top - site.xpos[2])
    force = TABLE_STIFFNESS * deep - TABLE_DAMPING * float(velocity[2])
    return (max(force, 0.0) if deep > 0.0 else 0.0), velocity


class Trial:
    """
    An arm, its controller, and what touches the tool.

    :ivar table: height of its top [m]; None without one
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
                self.force, _ = table_force(arm, self.table)
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


def resting(pose: np.ndarray, stiffness: float, seconds: float, cycle: float = CYCLE
            ) -> np.ndarray:
    """References at rest; stiffness of the translation [N/m]."""
    references = np.array([resting_target(pose)] * round(seconds / cycle))
    references[:, STIFFNESS:STIFFNESS + 36] = np.diag([stiffness] * 3 + [30.0] * 3).ravel()
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
