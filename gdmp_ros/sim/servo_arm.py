"""A simulated arm that takes joint positions, with a sensor for the wrench at its wrist."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

import mujoco
import numpy as np

from gdmp_ros.control.admittance import AdmittanceSettings
from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.servo import ServoState
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.errors import DataError
from gdmp_ros.kernels import kernel, local_matrix, local_numbers
from gdmp_ros.manifolds.poses import compose, IDENTITY, inverse
from gdmp_ros.sim.arm import Arm, Extra
from gdmp_ros.sim.gripper import add_gripper, advance_gripper, NO_GRIPPER, SimulatedGripper
from gdmp_ros.sim.native import full_inertia, ModelView, step, view_of
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.position_driver import PositionDriver
from gdmp_ros.util.settings import setting

#: Names of the sensor; the body with the site of the tool hangs at it.
TOOL, SITE, FORCE, TORQUE = 'tcp', 'wrist_sensor', 'wrist_force', 'wrist_torque'
#: Bandwidth of the position servos [rad/s].
BANDWIDTH = 400.0


@dataclass(frozen=True)
class ServoSettings:
    """An arm with position servos, and its sensor."""

    delay: float = setting(0.002, 'time until a command acts', 's', 0.0, 0.2)
    lag: float = setting(0.006, 'time constant with which it acts then: robots smooth', 's',
                         0.0005, 0.1)
    cycle: float = setting(0.002, 'time between two commands', 's', 0.001, 0.02)
    force_noise: float = setting(0.3, 'standard deviation of a measured force', 'N', 0.0, 10.0)
    torque_noise: float = setting(0.01, 'the same of a torque', 'Nm', 0.0, 1.0)


def add_wrist_sensor(spec: mujoco.MjSpec) -> None:
    """
    Let a sensor measure the wrench between tool and arm, in the frame of the body of the tool.

    :raises DataError: if the model has no tool
    """
    tool = spec.site(TOOL)
    if tool is None:
        raise DataError(f'the model has no site {TOOL!r}')
    tool.parent.add_site(name=SITE)
    for name, kind in ((FORCE, mujoco.mjtSensor.mjSENS_FORCE),
                       (TORQUE, mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=SITE)


class ServoView(NamedTuple):
    """
    The arm, for kernels; n is the number of its joints.

    :ivar known: addresses and state of the simulation
    :ivar passive: joint torques of it
    :ivar control: torques of its motors
    :ivar settings: time constant of the lag, period [s]
    :ivar counts: index of the oldest command that does not act yet, periods that are left until
        the next command is due
    :ivar commands: that do not act yet, shape (k, n)
    :ivar joints: the newest command, where it leads now, where the servos hold the joints, and
        their largest torques, shape (4, n)
    """

    known: ModelView
    passive: np.ndarray
    control: np.ndarray
    settings: np.ndarray
    counts: np.ndarray
    commands: np.ndarray
    joints: np.ndarray


@kernel
def advance_servos(view, gripper, count):
    """Let periods of the simulation pass."""
    known, joints, dt = view.known, view.joints, view.settings[1]
    n, size, lag = joints.shape[1], known.velocity.size, view.settings[0]
    inertia, wish = local_matrix(size, size), local_numbers(n)
    for _ in range(count):
        # As robots do, it goes to a command until the next one is due.
        left = max(view.counts[1], 1)
        view.counts[1] -= 1
        at = view.counts[0]
        full_inertia(known, inertia)
        for i in range(n):
            joints[1, i] += (joints[0, i] - joints[1, i]) / left
            wanted = joints[1, i]
            if len(view.commands) > 0:
                wanted, view.commands[at, i] = view.commands[at, i], wanted
            moved = (1.0 - math.exp(-dt / lag)) * (wanted - joints[2, i])
            joints[2, i] += moved
            wish[i] = (BANDWIDTH ** 2 * (joints[2, i] - known.position[i])
                       + 2.0 * BANDWIDTH * (moved / dt - known.velocity[i]))
        if len(view.commands) > 0:
            view.counts[0] = (at + 1) % len(view.commands)
        for i in range(n):
            torque = known.bias[i] - view.passive[i]
            for j in range(n):
                torque += inertia[i, j] * wish[j]
            view.control[i] = min(max(torque, -joints[3, i]), joints[3, i])
        advance_gripper(gripper, known.position, known.velocity, view.control, dt)
        step(known.functions, known.places[0], known.places[1])


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
        arm = self.arm = Arm(model, extras=[add_wrist_sensor, *([add_gripper] if gripper else []),
                                            *extras])
        self.gripper = SimulatedGripper(arm.model, arm.data) if gripper else None
        self.cycle, self._count = self.settings.cycle, len(arm.names)
        self._random = np.random.default_rng(0)
        waiting, data = round(self.settings.delay / arm.period), arm.data
        self._view = ServoView(
            view_of(arm.model, data, arm.known.site, arm.tool_body), data.qfrc_passive, data.ctrl,
            np.array([self.settings.lag, arm.period]), np.zeros(2, dtype=np.int64),
            np.tile(arm.home, (waiting, 1)), np.array([*[arm.home] * 3, arm.limits.torque]))
        self._sensors = [data.sensor(name).data for name in (FORCE, TORQUE)]

    @property
    def hand(self) -> Payload:
        """What hangs at the sensor, in the frame of the tool site."""
        model, data = self.arm.model, mujoco.MjData(self.arm.model)
        mujoco.mj_forward(model, data)
        body, site = self.arm.tool_body, data.site(TOOL)
        mass = float(model.body_subtreemass[body])
        x, y, z = (site.xmat.reshape(3, 3).T @ (data.subtree_com[body] - site.xpos)).tolist()
        return Payload(mass, (x, y, z))

    @property
    def sensor(self) -> np.ndarray:
        """Pose of the sensor in the frame of the last joint."""
        last = self.arm.chain.pose_at(self.read().position, IDENTITY)
        return compose(inverse(last), self.arm.site_pose(SITE))

    def read(self) -> ServoState:
        data, noise, count = self.arm.data, self._random.standard_normal(6), self._count
        # MuJoCo's sensors measure what the arm exerts on the hand.
        wrench = -np.concatenate(self._sensors)
        wrench += noise * np.repeat([self.settings.force_noise, self.settings.torque_noise], 3)
        return ServoState(data.qpos[:count].copy(), data.qvel[:count].copy(), wrench)

    def send(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._view.joints[0] = position
        self._view.counts[1] = round(self.cycle / self.arm.period)

    def advance(self, periods: int = 1) -> None:
        """
        Let periods of the simulation pass.

        :raises DataError: if it is unstable
        """
        gripper = self.gripper
        if gripper is not None:
            gripper.begin_next()
        advance_servos(self._view, NO_GRIPPER if gripper is None else gripper.view, periods)
        self.arm.check()


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
        self.servo.advance(round(self.servo.cycle / self.servo.arm.period))
        return tick
