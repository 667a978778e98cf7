"""Impedance controller: guard, impedance law, energy tank and torque limits."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.arm_states import ArmStates, Request, State
from gdmp_ros.control.contact import Contact
from gdmp_ros.control.friction import friction_of, without_friction
from gdmp_ros.control.guard import ReferenceGuard
from gdmp_ros.control.identification import joint_torque
from gdmp_ros.control.impedance import external_wrench
from gdmp_ros.control.laws import ImpedanceLaw, JointImpedance, stiffness_at_tool, ToolImpedance
from gdmp_ros.control.limits import ENERGY, LimitCounters, LIMITS, TORQUE, WRENCH_LIMIT
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.posture import Posture
from gdmp_ros.control.reference_kinds import MeasuredMotion
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.tank import EnergyTank
from gdmp_ros.control.target import STIFFNESS, TARGET_SIZE, TWIST
from gdmp_ros.control.tick import Tick
from gdmp_ros.control.torque_limits import TorqueLimiter
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.linalg import is_finite

#: Joint damping of an arm that a hand moves [Nm s/rad]: it comes to rest when the hand lets go.
FREE_DAMPING = {State.COMPLIANT: 5.0, State.GUIDED: 2.0}


class ImpedanceController:
    """Impedance control of an arm that follows references; without ROS and simulator."""

    guard: ReferenceGuard
    tank: EnergyTank
    _limiter: TorqueLimiter

    def __init__(self, joints: JointLimits, friction: np.ndarray,
                 settings: ControllerSettings | None = None, states: ArmStates | None = None):
        """
        Prepare to control.

        :param friction: viscous friction of the model's joints [Nm s/rad], shape (n,)
        :param states: of the arm
        :raises ParameterError: if the settings do not fit the joints
        """
        self.states = states or ArmStates()
        self.counters, self.posture = LimitCounters(), Posture(joints)
        self.contact = Contact((settings or ControllerSettings()).contact)
        self._tool_law = ToolImpedance(self.posture, self.contact)
        self._joint_law = JointImpedance()
        self._law: ImpedanceLaw = self._tool_law
        self._joints, self._model_friction = joints, friction
        self._next: ControllerSettings | None = None
        self._refills = False
        self.check(settings or ControllerSettings())
        self._use(settings or ControllerSettings())

    def configure(self, settings: ControllerSettings) -> None:
        """
        Use other settings from the next tick on; torque, stiffness and energy carry over.

        :raises ParameterError: if they do not fit the joints
        """
        self.check(settings)
        self._next = settings

    def check(self, settings: ControllerSettings) -> None:
        """:raises ParameterError: if the settings do not fit the joints"""
        dry = friction_of(settings.friction, self._model_friction)[0][1]
        if (dry > self._joints.torque).any():
            at = int(np.argmax(dry - self._joints.torque))
            raise ParameterError(f'friction, dry: {dry[at]:g} Nm at joint {at + 1}, expected at '
                                 f'most {self._joints.torque[at]:g}, what its motor can do')
        self.posture.check(settings.posture)

    def take_posture(self) -> None:
        """Approach the posture of the settings again, if there is one."""
        self.posture.use(self.settings.posture)

    def refill_tank(self) -> None:
        """Fill the energy tank as at the start, with the next tick."""
        self._refills = True

    def reset(self, measured: Measurement) -> None:
        """Hold the measured pose, with the tank as at the start."""
        settings = self.settings
        self.posture.hold(measured.position)
        self.posture.use(settings.posture)
        self._limiter = TorqueLimiter(self._joints, settings.limits)
        self._limiter.reset(measured.bias)
        if not hasattr(self, 'guard'):
            self.guard = ReferenceGuard(settings.guard, measured.pose, settings.damping_ratio,
                                        len(measured.position), self.states)
        self.guard.restart(MeasuredMotion(
            measured.pose.copy(), np.zeros(6), measured.position.copy(),
            np.zeros_like(measured.velocity)))
        self.tank = EnergyTank(settings.tank, self._credit)
        self._last_pose = measured.pose.copy()
        self.contact.reset()
        self._hold(measured)

    def tick(self, measured: Measurement, dt: float) -> Tick:
        """Compute the torque for the next ``dt`` seconds."""
        damping = FREE_DAMPING.get(self.states.state)
        if damping is not None:
            free = measured.bias - damping * measured.velocity
            return self._without_reference(measured, free, np.zeros(6), dt)
        self._take_settings()
        violation = np.zeros(len(LIMITS))
        self.tank.measure(measured, self._law.stored(measured), dt)
        twist = measured.jacobian @ measured.velocity
        known = is_finite(measured.pose) and is_finite(twist)
        robot = MeasuredMotion(measured.pose, twist, measured.position, measured.velocity)
        target = self.guard.target(dt, robot if known else None).copy()
        law = self._chosen_law(measured)
        requested = (np.zeros(36) if self.guard.in_joints
                     else target[STIFFNESS:STIFFNESS + 36].copy())
        drawn, spring = law.move(measured, target, self.tank.spendable(dt), dt, violation)
        self.tank.draw(drawn)
        torque, wrench, commanded = law.respond(measured, self._external(measured), dt, violation)
        if is_finite(torque):
            self._feel(wrench, self._law.motion(measured), dt)
            torque, spring = self._settle(measured, torque, twist, spring, dt, violation)
        else:
            torque, spring = self._limited(measured, self._recover(measured), dt, violation), 0.0
            violation[TORQUE] = np.inf
        self._sent(measured, torque, spring, dt, violation)
        if known:
            self._last_pose = measured.pose.copy()
        return Tick(measured, twist, wrench, stiffness_at_tool(self._law), requested, torque,
                    commanded, self.guard.mode, spring, self.tank.energy, violation,
                    self._joint_law.reference if self.guard.in_joints else None)

    def _chosen_law(self, measured: Measurement) -> ImpedanceLaw:
        """The law of the target; another one than before begins with springs at rest."""
        law: ImpedanceLaw = self._joint_law if self.guard.in_joints else self._tool_law
        if law is not self._law:
            law.hold(measured)
            self.posture.hold(measured.position)
            self._law = law
        return law

    def _feel(self, wrench: np.ndarray, motion: np.ndarray, dt: float) -> None:
        """React to a collision with what the arm does because of a request."""
        collision = self.contact.update(wrench, motion, dt)
        if collision and self.states.state.moves:
            comply = self.settings.contact.collision_reaction == 'comply'
            self.states.take(Request.COMPLY if comply else Request.COLLISION, collision)

    @property
    def reference(self) -> np.ndarray:
        """The governed reference, of the tool or of the joints."""
        return self._law.reference.copy()

    def move_joints(self, measured: Measurement, position: np.ndarray, velocity: np.ndarray,
                    dt: float) -> Tick:
        """
        Compute the torque for the next ``dt`` seconds of an arm that follows joint positions.

        For slow motions; all limits and the reaction to collisions stay in force. From the next
        `tick` on the arm is held where it is.
        """
        torque, gains = joint_torque(measured, position, velocity), self.settings.gains
        pushed = external_wrench(measured, torque - measured.bias, gains.singularity)
        share = min(1.0, *(largest / max(float(np.linalg.norm(part)), 1e-9) for largest, part in
                           zip(gains.wrench_max, (pushed[:3], pushed[3:]))))
        return self._without_reference(
            measured, measured.bias + share * (torque - measured.bias),
            measured.jacobian @ velocity, dt, 1.0 - share)

    def move_tool(self, before: np.ndarray, after: np.ndarray) -> None:
        """
        Go on holding with the same wrench, after another point became the tool.

        :param before: pose of the last tool (x, y, z, qw, qx, qy, qz)
        :param after: pose of the new one
        """
        pose = self._tool_law.follow_tool(before, after, self.tank.energy)
        self.guard.hold(pose)

    def _without_reference(self, measured: Measurement, target: np.ndarray, wanted: np.ndarray,
                           dt: float, reduced: float = 0.0) -> Tick:
        """
        Send a torque; gravity is compensated, and there is no stiffness.

        :param wanted: twist of the tool that is wanted [m/s, rad/s]
        :param reduced: fraction by which the wrench was reduced
        """
        self._take_settings()
        twist = measured.jacobian @ measured.velocity
        violation = np.zeros(len(LIMITS))
        violation[WRENCH_LIMIT] = reduced
        self.tank.measure(measured, 0.0, dt)
        self.posture.hold(measured.position)
        self.guard.measure(dt, MeasuredMotion(measured.pose, twist, measured.position,
                                           measured.velocity))
        self.guard.hold(measured.pose)
        self._hold(measured)
        torque = self._limited(measured, target, dt, violation)
        self._sent(measured, torque, 0.0, dt, violation)
        wrench = external_wrench(measured, self._external(measured),
                                 self.settings.gains.singularity)
        mode, motion = self.states.state.mode, np.zeros(TARGET_SIZE)
        motion[TWIST:TWIST + 6] = wanted
        self._feel(wrench, motion, dt)
        return Tick(measured, twist, wrench, np.zeros(36), np.zeros(36), torque, np.zeros(6),
                    mode, 0.0, self.tank.energy, violation)

    def _use(self, settings: ControllerSettings) -> None:
        self.settings = settings
        self._friction, self._credit = friction_of(settings.friction, self._model_friction)
        self._dry = self._friction[1] if self._friction[1].any() else None
        for law in (self._tool_law, self._joint_law):
            law.use(settings, self._friction, self._joints)

    def _take_settings(self) -> None:
        settings, self._next = self._next, None
        if self._refills:
            self._refills = False
            self.tank.fill()
        if settings is None:
            return
        if settings.posture != self.settings.posture:
            self.posture.use(settings.posture)
        self._use(settings)
        last = self._limiter.last
        self._limiter = TorqueLimiter(self._joints, settings.limits)
        self._limiter.sent(last)  # a smaller limit is no step of the torque
        self.guard.configure(settings.guard, settings.damping_ratio)
        self.tank.configure(settings.tank)
        self.contact.settings = settings.contact
        self.tank.credit = self._credit

    def _hold(self, measured: Measurement) -> None:
        """Hold the tool where it is, with the stiffness before the first reference."""
        self._law = self._tool_law
        self._tool_law.hold(measured)

    def _settle(self, measured: Measurement, target: np.ndarray, twist: np.ndarray, spring: float,
                dt: float, violation: np.ndarray) -> tuple[np.ndarray, float]:
        """
        Limit a torque; with too little energy for it shed wrench, then stiffness.

        :returns: torque to be sent [Nm], energy in the spring [J]
        """
        torque, tank = self._limited(measured, target, dt, violation), self.tank
        power = self._law.power(measured, twist, spring, dt)
        missing = tank.missing(measured, torque, power, dt)
        if missing <= 0.0:
            return torque, spring
        violation[ENERGY] += missing
        velocity, bias = measured.velocity, measured.bias
        driving = dt * float(velocity @ (torque - bias))
        if driving > 0.0:
            target = bias + max(1.0 - missing / driving, 0.0) * (target - bias)
            torque = self._limited(measured, target, dt, violation)
            missing = tank.missing(measured, torque, power, dt)
        if missing > 0.0:
            released = self._law.release(measured, missing)
            tank.draw(-released)
            spring -= released
        return torque, spring

    def _limited(self, measured: Measurement, torque: np.ndarray, dt: float,
                 violation: np.ndarray) -> np.ndarray:
        return self._limiter.limited(measured.position, measured.velocity, measured.bias, torque,
                                     dt, violation)

    def _sent(self, measured: Measurement, torque: np.ndarray, spring: float, dt: float,
              violation: np.ndarray) -> None:
        """Remember the torque that is sent, and count the violations."""
        self._limiter.sent(torque)
        self.tank.remember(measured, torque, spring, dt)
        self.counters.add(violation)

    def _recover(self, measured: Measurement) -> np.ndarray:
        """No torque could be computed: hold the measured pose, and compensate gravity."""
        pose = np.where(np.isfinite(measured.pose), measured.pose, self._last_pose)
        self._law = self._tool_law
        self._tool_law.hold_pose(pose)
        self.guard.measure(0.0, MeasuredMotion(pose, np.zeros(6)))
        self.guard.fault('a measurement or a torque was not finite')
        self.tank.empty()
        return measured.bias.copy() if is_finite(measured.bias) else self._limiter.last

    def _external(self, measured: Measurement) -> np.ndarray:
        return without_friction(measured, self._dry, self.settings.gains.friction_smoothing)
