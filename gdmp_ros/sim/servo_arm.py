"""A simulated arm that takes joint positions, with a sensor for the wrench at its wrist."""
from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from gdmp_ros.control.admittance import AdmittanceSettings
from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.servo import ServoState
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.manifolds.poses import compose, IDENTITY, inverse
from gdmp_ros.sim.arm import Arm, Extra
from gdmp_ros.sim.gripper import add_gripper, SimulatedGripper
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.position_driver import PositionDriver
from gdmp_ros.util.settings import setting

#: Body that hangs at the sensor, and names of the sensor.
HAND, SITE, FORCE, TORQUE = 'hand', 'wrist_sensor', 'wrist_force', 'wrist_torque'
#: Bandwidth of the position servos [rad/s].
BANDWIDTH = 400.0


@dataclass(frozen=True)
class ServoSettings:
    """An arm with position servos, and its sensor."""

    delay: float = setting(0.006, 'time until a command acts', 's', 0.0, 0.2)
    lag: float = setting(0.002, 'time constant with which it acts then', 's', 0.0005, 0.1)
    cycle: float = setting(0.002, 'time between two commands', 's', 0.001, 0.02)
    force_noise: float = setting(0.3, 'standard deviation of a measured force', 'N', 0.0, 10.0)
    torque_noise: float = setting(0.01, 'the same of a torque', 'Nm', 0.0, 1.0)


def add_wrist_sensor(spec: mujoco.MjSpec) -> None:
    """Let a sensor measure the wrench between the hand and the arm, in the frame of the hand."""
    spec.body(HAND).add_site(name=SITE)
    for name, kind in ((FORCE, mujoco.mjtSensor.mjSENS_FORCE),
                       (TORQUE, mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=SITE)


class ServoArm:
    """
    The arm; see `gdmp_ros.control.servo.PositionLink`.

    :ivar arm: in the simulation
    :ivar gripper: of it; None if its fingers do not move
    :ivar cycle: time between two commands [s]
    """

    def __init__(self, model: str = 'ur5e', settings: ServoSettings | None = None,
                 gripper: bool = False, extras: Sequence[Extra] = ()):
        """
        Hold the home posture.

        :param gripper: whether its fingers move
        :param extras: what else is in the simulation (`gdmp_ros.sim.arm.Arm`)
        """
        self.settings = settings or ServoSettings()
        self.arm = Arm(model, extras=[add_wrist_sensor, *([add_gripper] if gripper else []),
                                      *extras])
        self.gripper = SimulatedGripper(self.arm.model, self.arm.data) if gripper else None
        self.cycle, self._left = self.settings.cycle, 0
        self._random = np.random.default_rng(0)
        self._commands = deque([self.arm.home] * round(self.settings.delay / self.arm.period))
        self._acts = self._now = self._wanted = self.arm.home

    @property
    def hand(self) -> Payload:
        """What hangs at the sensor, in the frame of the tool site."""
        model, data = self.arm.model, mujoco.MjData(self.arm.model)
        mujoco.mj_forward(model, data)
        body, site = model.body(HAND).id, data.site('tcp')
        mass = float(model.body_subtreemass[body])
        x, y, z = (site.xmat.reshape(3, 3).T @ (data.subtree_com[body] - site.xpos)).tolist()
        return Payload(mass, (x, y, z))

    @property
    def sensor(self) -> np.ndarray:
        """Pose of the sensor in the frame of the last joint."""
        last = self.arm.chain.pose_at(self.read().position, IDENTITY)
        return compose(inverse(last), self.arm.site_pose(SITE))

    def read(self) -> ServoState:
        data, noise = self.arm.data, self._random.standard_normal(6)
        # MuJoCo's sensors measure what the arm exerts on the hand.
        wrench = -np.concatenate([data.sensor(FORCE).data, data.sensor(TORQUE).data])
        wrench += noise * np.repeat([self.settings.force_noise, self.settings.torque_noise], 3)
        count = len(self.arm.names)
        return ServoState(data.qpos[:count].copy(), data.qvel[:count].copy(), wrench)

    def send(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._wanted, self._left = position.copy(), round(self.cycle / self.arm.period)

    def advance(self) -> None:
        """Let one period of the simulation pass."""
        arm, last = self.arm, self._acts
        # As robots do, it goes to a command until the next one is due.
        step = (self._wanted - self._now) / max(self._left, 1)
        self._now, self._left = self._now + step, self._left - 1
        self._commands.append(self._now)
        wanted = self._commands.popleft()
        self._acts = last + (1.0 - np.exp(-arm.period / self.settings.lag)) * (wanted - last)
        rate = (self._acts - last) / arm.period
        data, joints = arm.data, slice(len(arm.names))
        inertia = np.empty((arm.model.nv, arm.model.nv))
        mujoco.mj_fullM(arm.model, data, inertia)
        wish = (BANDWIDTH ** 2 * (self._acts - data.qpos[joints])
                + 2.0 * BANDWIDTH * (rate - data.qvel[joints]))
        torque = (inertia[joints, joints] @ wish + data.qfrc_bias[joints]
                  - data.qfrc_passive[joints])
        if self.gripper is not None:
            self.gripper.advance(arm.period)
        arm.step(np.clip(torque, -arm.limits.torque, arm.limits.torque))


class PositionLoop(ArmControl):
    """
    A simulated arm that takes joint positions, and its controller; in lockstep.

    :ivar servo: the arm
    """

    driver: PositionDriver

    def __init__(self, servo: ServoArm, settings: ControllerSettings | None = None,
                 admittance: AdmittanceSettings | None = None):
        """Hold the arm where it is."""
        self.servo = servo
        driver = PositionDriver(servo.arm, servo, admittance or AdmittanceSettings(),
                                servo.sensor)
        driver.carry(servo.hand)
        super().__init__(driver, settings)
        driver.use_memory(self.controller.numbers)
        self.hold(driver.begin())

    def tick(self) -> Tick | None:
        """Let one cycle pass; None if the arm has just stopped."""
        measured = self.wait()
        tick = None if measured is None else self.answer(measured)
        for _ in range(round(self.servo.cycle / self.servo.arm.period)):
            self.servo.advance()
        return tick
