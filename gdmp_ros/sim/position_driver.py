"""An arm that takes joint positions, controlled like one with torques (`control.admittance`)."""
from __future__ import annotations

import copy
import math

import mujoco
import numpy as np

from gdmp_ros.control.admittance import (
    AdmittanceSettings,
    advance,
    DAMPING_SHARE,
    external_wrench,
    LEVER_M,
    PositionLink,
    ServoDelay,
    ServoState,
)
from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.control.arm_states import State
from gdmp_ros.control.measurement import Measurement, Tick
from gdmp_ros.control.memory import ArmMemory
from gdmp_ros.errors import ParameterError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import tool_at, ToolTransform
from gdmp_ros.sim.known_model import KnownModel
from gdmp_ros.sim.payload import Payload

#: Time in which an arm comes to rest that has to stop [s].
STOP_S = 0.15
GRAVITY = np.array([0.0, 0.0, -9.81])


class PositionDriver:
    """
    An arm that takes joint positions; see `gdmp_ros.control.arm_driver.ArmDriver`.

    Its torques act on a virtual arm. Where that is, the arm is told to be.

    :ivar link: to the arm
    :ivar settings: how it gives way
    :ivar dt: time between two commands [s]
    :ivar delay: by which it is behind its commands
    :ivar wrench: external, at the tool, in the frame of the base [N, Nm]
    """

    taken = None

    def __init__(self, arm: Arm, link: PositionLink, settings: AdmittanceSettings,
                 sensor: np.ndarray):
        """
        Prepare; nothing is sent.

        :param arm: its model, which is not moved
        :param sensor: pose of the frame of the measured wrench in the frame of the last joint
        """
        self.link, self.settings, self.dt = link, settings, link.cycle
        self.joints, self.chain, self.body = arm.limits, arm.chain, arm.shape
        self.friction = np.zeros(len(self.joints.torque))
        self.known = _virtual(arm, settings.virtual_mass)
        self.delay = ServoDelay(settings.servo_delay, settings.servo_delay_max, link.cycle)
        self.wrench = np.zeros(6)
        self._site, self._sensor = arm.end_pose, sensor
        self.end_pose, self._payload = self._site, Payload()
        self._memory: ArmMemory | None = None
        self._problem = 'it was not begun'
        self._hold(ServoState(arm.home, np.zeros_like(self.friction)))
        self._state: ServoState | None = None
        self._measured: Measurement | None = None

    def use_memory(self, memory: ArmMemory) -> None:
        """Know the memory of the controller: how its reference moves, and the energy tank."""
        self._memory = memory

    @property
    def controlled(self) -> bool:
        return not self._problem

    def begin(self) -> Measurement:
        state = self.link.read()
        if state is None:
            raise ArmStopped('the arm does not answer', False)
        problem = self._invalid(state)
        if problem:
            raise ArmStopped(problem, True)
        self._hold(state)
        self._problem = ''
        self.wrench = self._external(state)
        self.link.send(self._position, self._velocity)
        return self._measure()

    def _hold(self, state: ServoState) -> None:
        """Put the virtual arm to rest where the arm is."""
        self._position, self._velocity = state.position.copy(), np.zeros_like(state.position)
        self._sent, self._rate = self._position.copy(), self._velocity.copy()
        # Twists of the reference, until the arm has them.
        self._twists = [np.zeros(6)]
        self._stopping = np.zeros_like(self._velocity), 0.0
        self.delay.begin(state.position)

    def measure(self) -> Measurement | None:
        state = self._state = self.link.read()
        if state is None:
            return None
        if self._problem:
            self._stand(state)
            return self._measure()
        problem = self._invalid(state)
        if not problem:
            problem = self._astray(self.delay.behind(state.position,
                                                     self._sent + self.dt * self._rate))
        if problem:
            self._problem, self._stopping = problem, (self._velocity.copy(), STOP_S)
            raise ArmStopped(problem, True)
        self.wrench = self._external(state)
        self._pay(state)
        return self._measure()

    def _invalid(self, state: ServoState) -> str:
        """Why a state cannot be used; empty if it can."""
        limits = self.settings
        if not state.runs:
            return 'the arm does not take commands: its own program does not run'
        # A sum is finite only if all of its parts are.
        if not math.isfinite(state.position.sum() + state.velocity.sum()):
            return 'the measured joints are not finite'
        if state.age > limits.measured_timeout:
            return (f'no measured joints for {state.age:.2g} s, expected within '
                    f'{limits.measured_timeout:g} s (measured_timeout)')
        if state.wrench is None:
            return ''
        if not math.isfinite(state.wrench.sum()):
            return 'the measured wrench is not finite'
        if state.wrench_age > limits.measured_timeout:
            return (f'no measured wrench for {state.wrench_age:.2g} s, expected within '
                    f'{limits.measured_timeout:g} s (measured_timeout)')
        sizes = [abs(part) for part in state.wrench.tolist()]
        for part, most, what in ((sizes[:3], limits.sensor_max[0], 'N'),
                                 (sizes[3:], limits.sensor_max[1], 'Nm')):
            largest = max(part)
            if largest >= most:
                return (f'the sensor is saturated: {largest:.3g} {what}, its range is '
                        f'{most:g} {what} (sensor_max)')
        return ''

    def _astray(self, behind: np.ndarray) -> str:
        """Why an arm does not follow as it should; empty if it does."""
        delay, limits = self.delay.value, self.settings
        if delay > limits.servo_delay_max:
            return (f'the arm is {1e3 * delay:.0f} ms behind its commands, expected at most '
                    f'{1e3 * limits.servo_delay_max:g} ms (servo_delay_max)')
        error = np.abs(behind)
        joint = int(np.argmax(error))
        if error[joint] > limits.following_error:
            return (f'joint {joint + 1} is {error[joint]:.2g} rad from where its command leads, '
                    f'expected at most {limits.following_error:g} rad (following_error)')
        return ''

    def _external(self, state: ServoState) -> np.ndarray:
        """Wrench of the environment at the tool, without what hangs at the sensor."""
        if state.wrench is None:
            return np.zeros(6)
        # The tool is where its reference was a delay ago.
        twists, mass = self._twists, self._payload.mass
        carried = mass * GRAVITY
        if mass and len(twists) > 1:
            carried -= mass / self.dt * (twists[1] - twists[0])[:3]
        result = np.empty(6)
        sensor, tool, site = (self.chain.pose_at(state.position, end)
                              for end in (self._sensor, self.end_pose, self._site))
        external_wrench(state.wrench - self.settings.sensor_bias, sensor, tool, site,
                        np.array(self._payload.center), carried, result)
        return result

    def _pay(self, state: ServoState) -> None:
        """
        Let the tank pay what the arm gives to the world beyond what the virtual one gives.

        The books of the law are those of the virtual arm; the real one is behind it.
        """
        if self._memory is not None and self._measured is not None:
            ahead = self._measured.jacobian @ (self._velocity - state.velocity)
            scalars, tank = self._memory.scalars, self._memory.tank
            scalars.energy = min(scalars.energy - self.dt * float(self.wrench @ ahead),
                                 tank.capacity)

    def reported(self, tick: Tick) -> Tick:
        """What happened in a tick, with the arm itself instead of the virtual one."""
        state = self._state
        if state is None:
            return tick
        position, velocity = state.position, state.velocity
        pose = self.chain.pose_at(position, self.end_pose)
        return tick._replace(
            twist=tick.measurement.jacobian @ velocity,
            measurement=tick.measurement._replace(position=position, velocity=velocity,
                                                  pose=pose))

    def command(self, torque: np.ndarray) -> None:
        measured = self._measured
        if measured is None:
            raise RuntimeError('the arm was not measured')
        delay, dt = self.delay.value, self.dt
        rates = np.zeros_like(torque) if self._memory is None else self._memory.rates
        twist = measured.jacobian @ rates
        self._twists = [*self._twists, twist][-(max(round(delay / dt), 1) + 1):]
        linear = DAMPING_SHARE * self.settings.contact_stiffness * delay
        advance(self._position, self._velocity, measured.inertia, measured.jacobian,
                torque - measured.bias, self.wrench, twist,
                np.array([linear, LEVER_M ** 2 * linear]), dt)
        # What is known of the motion is sent earlier.
        self._send(np.clip(self._position + delay * rates, self.joints.lower, self.joints.upper))

    def _send(self, position: np.ndarray) -> None:
        self._rate, self._sent = (position - self._sent) / self.dt, position
        self.link.send(position, self._velocity)

    def _stand(self, state: ServoState) -> None:
        """Come to rest after a stop; then nothing is sent, and the arm is where it is."""
        velocity, left = self._stopping
        if left == 0.0:
            if not self._invalid(state):
                self._hold(state)
            return
        left = max(left - self.dt, 0.0)
        self._stopping = velocity, left
        self._velocity = velocity * left / STOP_S
        self._position = self._position + self.dt * self._velocity
        self._send(self._sent + self.dt * self._velocity)

    def end(self) -> None:
        if not self._problem:
            self._problem = 'it was ended'
            self._velocity = np.zeros_like(self._velocity)
            self._send(self._sent)

    def recover(self) -> Measurement:
        return self.begin()

    def reset(self) -> Measurement:
        raise ParameterError('a robot cannot be reset')

    def use_tool(self, tool: ToolTransform) -> tuple[np.ndarray, np.ndarray]:
        before = self._measure().pose
        self.end_pose = tool_at(self._site, tool)
        self.known.put_tool(tool)
        return before, self._measure().pose

    def check_payload(self, state: State) -> None:
        if state.moves:
            raise ParameterError('what the arm carries can only change while it rests: call '
                                 '~/stop first')

    def carry(self, payload: Payload) -> None:
        """Know what hangs at the sensor: its weight is not measured as a force."""
        self._payload = payload

    def _measure(self) -> Measurement:
        """State of the virtual arm."""
        position, velocity = self._position.copy(), self._velocity.copy()
        self.known.look(position, velocity, self.dt)
        free = self.known.measurement(position, velocity, np.zeros_like(position))
        self._measured = free._replace(external=free.jacobian.T @ self.wrench)
        return self._measured


def _virtual(arm: Arm, mass: float) -> KnownModel:
    """
    Model without weight and friction, scaled so that the tool has a mass at the home posture.

    :param mass: mean of the directions [kg]
    """
    model = copy.deepcopy(arm.known.model)
    model.opt.gravity[:] = model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
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
