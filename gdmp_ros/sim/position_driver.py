"""An arm that takes joint positions, controlled like one with torques (`control.admittance`)."""
from __future__ import annotations

import copy

import mujoco
import numpy as np

from gdmp_ros.control import memory
from gdmp_ros.control.admittance import AdmittanceSettings
from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.control.arm_states import State
from gdmp_ros.control.measurement import Measurement, Tick
from gdmp_ros.control.servo import (
    answer,
    check,
    feel,
    pay,
    PositionLink,
    problem_of,
    rest,
    SCALARS,
    servo_of,
    ServoState,
    take_state,
    write_measured,
)
from gdmp_ros.control.weight import GRAVITY
from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels import records_at
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import tool_at, ToolTransform
from gdmp_ros.sim.known_model import KnownModel
from gdmp_ros.sim.payload import Payload

#: Time in which an arm comes to rest that has to stop [s].
STOP_S = 0.15
#: A smaller force on an arm that nothing touches is noise [N], and how much, in parts of the
#: weight, one may differ that explains it.
LEAST_FORCE, WEIGHT_SHARE = 3.0, 0.3


class PositionDriver:
    """
    An arm that takes joint positions; see `gdmp_ros.control.arm_driver.ArmDriver`.

    Its torques act on a virtual arm. Where that is, the arm is told to be.

    :ivar link: to the arm
    :ivar servo: what is known of it
    :ivar scalars: those of `servo`
    :ivar known: model of the virtual arm
    :ivar numbers: memory of the controller
    """

    taken = None

    def __init__(self, arm: Arm, link: PositionLink, settings: AdmittanceSettings,
                 sensor: np.ndarray):
        """
        Prepare; nothing is sent.

        :param arm: its model, which is not moved
        :param sensor: pose of the frame of the measured wrench in the frame of the last joint
        """
        self.link = link
        self.joints, self.chain, self.body = arm.limits, arm.chain, arm.shape
        self.friction = np.zeros(len(self.joints.torque))
        self.known = _virtual(arm, settings.virtual_mass)
        self.servo = servo_of(arm.chain, arm.limits, settings, link.cycle)
        self.scalars = records_at(self.servo.numbers, 0, 1, SCALARS)[0]
        self.servo.ends[:] = sensor, arm.end_pose, arm.end_pose
        # Without a controller there is no motion, and no tank.
        self.numbers = memory.blank(len(self.joints.torque))
        self._problem = 'it was not begun'
        write_measured(self.servo, ServoState(arm.home, np.zeros_like(self.friction)))
        self._hold()
        # Kernels are compiled, or loaded, before a robot waits for them.
        take_state(self.servo)
        pay(self.servo, self.numbers)
        answer(self.servo, self.numbers, self.friction)
        self._hold()

    def use_memory(self, numbers: np.ndarray) -> None:
        """Know the memory of the controller: how its reference moves, and the energy tank."""
        self.numbers = numbers

    @property
    def controlled(self) -> bool:
        return not self._problem

    @property
    def dt(self) -> float:
        return float(self.scalars.dt)

    @dt.setter
    def dt(self, dt: float) -> None:
        self.scalars.dt = dt

    @property
    def end_pose(self) -> np.ndarray:
        return np.asarray(self.servo.ends[1])

    @property
    def delay(self) -> float:
        """Time by which the arm is behind its commands [s]."""
        return float(self.scalars.delay)

    @property
    def wrench(self) -> np.ndarray:
        """External, at the tool, in the frame of the base [N, Nm]."""
        return self.servo.wrench

    def weight_doubt(self) -> str:
        """What is probably wrong with the weight at the sensor, of an arm that nothing touches."""
        force, weight = self.wrench[:3], float(self.scalars.mass) * GRAVITY
        if not self.scalars.senses or float(np.linalg.norm(force)) < LEAST_FORCE:
            return ''
        felt = f'{np.linalg.norm(force):.3g} N are felt beside the weight of the payload'
        for share, why in (
                (1.0, 'does the driver of the robot subtract this weight, too? Then set '
                 'payload_mass to 0'),
                (2.0, 'is the sign of the wrench wrong? It must be what acts on the sensor from '
                 'the side of the tool')):
            if np.linalg.norm(force - [0.0, 0.0, share * weight]) < WEIGHT_SHARE * weight:
                return f'{felt}: {why}'
        return (f'{felt}: does something touch the arm, or is the payload another one (gdmp arm '
                'tool)? The arm gives way to this force')

    def begin(self) -> Measurement:
        state = self.link.read()
        if state is None:
            raise ArmStopped('the arm does not answer', False)
        write_measured(self.servo, state)
        problem = problem_of(self.servo, check(self.servo))
        if problem:
            raise ArmStopped(problem, True)
        self._hold()
        self._problem = ''
        self._send()
        return self._measure()

    def _hold(self) -> None:
        """Put the virtual arm to rest where the arm was measured."""
        rest(self.servo)
        feel(self.servo)
        self._stopping = np.zeros_like(self.friction), 0.0

    def measure(self) -> Measurement | None:
        state = self.link.read()
        if state is None:
            return None
        if self._problem:
            self._stand(state)
            return self._measure()
        write_measured(self.servo, state)
        code = take_state(self.servo)
        if code:
            raise self.stopped(code)
        pay(self.servo, self.numbers)
        return self._measure()

    def stopped(self, code: int) -> ArmStopped:
        """Stop the arm, because `take_state` cannot use what was measured; returns why."""
        self._problem = problem_of(self.servo, code)
        # What was sent last goes on, and slows down: the virtual arm is where it will be later.
        self._stopping = self.servo.command[1].copy(), STOP_S
        return ArmStopped(self._problem, True)

    def reported(self, tick: Tick) -> Tick:
        """What happened in a tick, with the arm itself instead of the virtual one."""
        position, velocity = self.servo.measured.copy()
        return tick._replace(
            twist=tick.measurement.jacobian @ velocity,
            measurement=tick.measurement._replace(position=position, velocity=velocity,
                                                  pose=self.servo.pose.copy()))

    def command(self, torque: np.ndarray) -> None:
        answer(self.servo, self.numbers, torque)
        self._send()

    def _send(self) -> None:
        self.link.send(self.servo.command[0].copy(), self.servo.virtual[1].copy())

    def _stand(self, state: ServoState) -> None:
        """Come to rest after a stop; then nothing is sent, and the arm is where it is."""
        servo, (velocity, left) = self.servo, self._stopping
        write_measured(servo, state)
        if left == 0.0:
            if not check(servo):
                self._hold()
            return
        left = max(left - self.dt, 0.0)
        self._stopping = velocity, left
        servo.virtual[1] = servo.command[1] = velocity * left / STOP_S
        for moved in servo.virtual, servo.command:
            moved[0] += self.dt * servo.virtual[1]
        self._send()

    def end(self) -> None:
        if not self._problem:
            self._problem = 'it was ended'
            self.servo.virtual[1] = self.servo.command[1] = 0.0
            self._send()

    def recover(self) -> Measurement:
        return self.begin()

    def reset(self) -> Measurement:
        raise ParameterError('a robot cannot be reset')

    def use_tool(self, tool: ToolTransform) -> tuple[np.ndarray, np.ndarray]:
        before = self._measure().pose
        self.servo.ends[1] = tool_at(self.servo.ends[2], tool)
        self.known.put_tool(tool)
        return before, self._measure().pose

    def check_payload(self, state: State) -> None:
        if state.moves:
            raise ParameterError('what the arm carries can only change while it rests: call '
                                 '~/stop first')

    def carry(self, payload: Payload) -> None:
        """Know what hangs at the sensor: its weight is not measured as a force."""
        self.scalars.mass, self.servo.center[:] = payload.mass, payload.center

    def _measure(self) -> Measurement:
        """State of the virtual arm."""
        position, velocity = self.servo.virtual.copy()
        self.known.look(position, velocity, self.dt)
        free = self.known.measurement(position, velocity, np.zeros_like(position))
        return free._replace(external=free.jacobian.T @ self.wrench)


def _virtual(arm: Arm, mass: float) -> KnownModel:
    """
    Model without weight and friction, scaled so that the tool has a mass at the home posture.

    :param mass: mean of the directions [kg]
    """
    model = copy.deepcopy(arm.known.model)
    model.opt.gravity[:] = model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    # What it touches, the sensor tells.
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    known = KnownModel(model, mujoco.MjData(model), arm.known.site, False)
    home = arm.home
    known.look(home, np.zeros_like(home), 0.0)
    free = known.measurement(home, np.zeros_like(home), np.zeros_like(home))
    jacobian = free.jacobian[:3]
    felt = 1.0 / np.diag(jacobian @ np.linalg.solve(free.inertia, jacobian.T))
    for part in (model.body_mass, model.body_inertia, model.dof_armature):
        part *= mass / felt.mean()
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return known
