"""One arm, simulated or real: its states, its controller, and the motions of its joints."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.control.arm_driver import ArmDriver, ArmStopped
from gdmp_ros.control.arm_states import ArmStates, Request, State
from gdmp_ros.control.controller import ImpedanceController
from gdmp_ros.control.joint_motion import Braking, JointMotion
from gdmp_ros.control.joint_path import JointPath, NO_PATH
from gdmp_ros.control.joint_target import joint_target_size, resting_joints
from gdmp_ros.control.law import compare_with, let_move
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.measurement import Measurement, Tick
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.reference_kinds import MeasuredMotion
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.target import resting_target, whole_target
from gdmp_ros.errors import RefusedError

#: In these the joints are moved; in these nothing keeps the posture of the null space.
_OF_JOINTS = (State.MOVING, State.IDENTIFYING)
_FREE = (*_OF_JOINTS, State.GUIDED, State.COMPLIANT)


class ArmControl:
    """
    The controller of an arm, and what else may move it; one thread uses it.

    :ivar driver: of the arm
    :ivar states: what the arm does
    :ivar joint_motion: motions of the joints, while they are made and after; None if they were
        ended early
    :ivar joint_motion_problem: why they ended early; empty if they did not
    """

    def __init__(self, driver: ArmDriver, settings: ControllerSettings | None = None):
        """
        Prepare; `hold` comes next.

        :raises ParameterError: if the settings do not fit the joints
        """
        self.driver, self.joints = driver, driver.joints
        self.states = ArmStates()
        self.controller = ImpedanceController(driver.joints, driver.friction, driver.chain,
                                              settings, self.states, driver.body)
        self.states.watchers.append(self._entered)
        self.joint_motion: JointMotion | None = None
        self.joint_motion_problem = ''
        self._planned: JointMotion | None = None
        self._braking: Braking | None = None

    def hold(self, measured: Measurement) -> None:
        """Hold the arm where it is, as after the start."""
        self.controller.reset(measured, self.driver.end_pose)

    def warm_up(self, measured: Measurement, dt: float) -> None:
        """
        Compute each kind of tick once, so that no kernel is compiled in a real-time loop; `hold`.
        """
        self.hold(measured)
        guard = self.controller.guard
        self.compute(measured, dt)
        for target in (resting_target(measured.pose),
                       resting_joints(measured.position, np.full(len(measured.position), 100.0))):
            self.follow(target)
            self.compute(measured, dt)
            # Otherwise a stream that begins soon would be taken for the one of this tick.
            guard.offer(target, Origin(guard.settings.frame, mode=StreamMode.ENDED))
            self.compute(measured, dt)
        compare_with(self.controller.numbers, np.tile(self.controller.memory.last, (2, 1)),
                     self.joints.cycle)
        rest = Braking(measured.position, measured.velocity, dt)
        rest.target()
        self.controller.move_joints(measured, rest.path, dt)
        let_move(self.controller.numbers, 1.0)
        self.controller.move_tool(measured.pose, measured.pose, self.driver.end_pose)
        self.controller.surround(self.controller.scene)
        self.compute(measured, dt)
        self.hold(measured)

    def follow(self, target: np.ndarray, mode: StreamMode = StreamMode.STREAMING) -> bool:
        """
        Offer a reference of a motion to the guard; whether it is followed.

        :param target: `gdmp_ros.control.target.TARGET_SIZE` numbers, or ``REQUIRED_SIZE``; or
            those of `gdmp_ros.control.joint_target`
        :param mode: what its stream says of itself
        """
        guard = self.controller.guard
        of_joints = np.shape(target) == (joint_target_size(len(self.joints.torque)),)
        return guard.offer(target.copy() if of_joints else whole_target(target),
                           Origin(guard.settings.frame, mode=mode))

    def must_follow(self, target: np.ndarray) -> None:
        """
        Offer a reference of a motion that is executed by whoever calls this; see `follow`.

        :raises RefusedError: if the guard does not accept it
        """
        if not self.follow(target):
            guard = self.controller.guard
            raise RefusedError(f'the arm does not follow the reference: {guard.last_refusal}')

    def do(self, request: Request, argument: Any = None) -> None:
        """
        Carry out what a user asks for.

        :param argument: a motion of the joints, tool, payload or posture
        :raises GdmpError: if it is refused, or fails
        """
        self.states.check(request)
        match request:
            case Request.ARM:
                self.controller.guard.arm()
            case Request.STOP:
                self.controller.guard.stop('~/stop was called')
            case Request.COMPLY:
                self.states.take(request, '~/comply was called')
            case Request.MOVE | Request.IDENTIFY:
                self.move(argument)
            case Request.RECOVER:
                self.recover()
            case Request.TOOL:
                self.put_tool(argument)
            case Request.PAYLOAD:
                self.carry(argument)
            case Request.REFILL:
                self.controller.refill_tank()
            case Request.POSTURE:
                self.controller.posture.approach(argument)
            case Request.RESET:
                self.hold(self.driver.reset())
            case Request.GUIDE:
                self.states.take(request)
                if self.states.state is State.HOLDING:
                    raise RefusedError(self.states.reason)
            case _:
                self.states.take(request)

    def activate(self) -> None:
        """Begin to control: hold the arm where it is; one that refuses is in a fault."""
        self.states.take(Request.ACTIVATE)
        try:
            self.hold(self.driver.begin())
        except ArmStopped as error:
            self.fail(str(error))

    def wait(self) -> Measurement | None:
        """Wait for the next state; None if the arm does not answer, or has just stopped."""
        try:
            return self.driver.measure()
        except ArmStopped as error:
            self.fail(str(error))
            return None

    def answer(self, measured: Measurement) -> Tick:
        """Compute the torque for a state, and send it; nothing is sent to an arm that stopped."""
        driver = self.driver
        if not driver.controlled:
            if self.states.state not in (State.FAULT, State.INACTIVE):
                self.fail('the robot has ended the control')
            return self.stand(measured, driver.dt)
        if driver.taken is not None:
            compare_with(self.controller.numbers, driver.taken, self.joints.cycle)
        tick = self.compute(measured, driver.dt)
        try:
            driver.command(tick.torque)
        except ArmStopped as error:
            self.fail(str(error))
        return tick

    def end(self) -> None:
        """End the control; the arm then holds its position by itself."""
        try:
            self.driver.end()
        except ArmStopped as error:
            self.fail(str(error))

    def fail(self, reason: str) -> None:
        """Note that the arm is not controlled any more, and why."""
        self.controller.guard.fault(reason)

    def recover(self) -> None:
        """
        End a fault: the arm holds where it is, and follows nothing.

        :raises GdmpError: if the arm does not recover
        """
        if self.driver.controlled:
            self.states.take(Request.RECOVER)
            return
        try:
            self.hold(self.driver.recover())
        except ArmStopped as error:
            self.fail(str(error))
            raise

    def put_tool(self, tool: Any) -> None:
        """
        Control another point of the tool's body; the arm goes on holding with the same wrench.

        :raises ParameterError: while the arm moves
        """
        self.states.take(Request.TOOL)
        self.use_tool(tool)

    def use_tool(self, tool: Any) -> None:
        """`put_tool` in any state."""
        self.controller.move_tool(*self.driver.use_tool(tool), self.driver.end_pose)

    def carry(self, payload: Any) -> None:
        """
        Carry something from now on.

        :raises GdmpError: if that is not possible now
        """
        self.driver.check_payload(self.states.state)
        try:
            measured = self.driver.carry(payload)
        except ArmStopped as error:
            self.fail(str(error))
            raise
        if measured is not None:
            self.hold(measured)

    def move(self, motion: JointMotion) -> None:
        """
        Begin motions of the joints, as soon as the arm rests.

        :raises ParameterError: if the arm does something else
        """
        self.states.check(motion.request)
        self._planned, self.joint_motion, self.joint_motion_problem = motion, None, ''
        self.states.take(motion.request)

    @property
    def moves_joints(self) -> bool:
        """Whether motions of the joints are being made, or will be."""
        return self._planned is not None or self.states.state in _OF_JOINTS

    def stand(self, measured: Measurement, dt: float) -> Tick:
        """What happens in ``dt`` seconds in which something else holds the arm, as its brakes."""
        controller, twist = self.controller, measured.jacobian @ measured.velocity
        controller.guard.measure(dt, MeasuredMotion(measured.pose, twist, measured.position,
                                                 measured.velocity))
        return Tick(measured, twist, np.zeros(6), np.zeros(36), np.zeros(36),
                    np.zeros_like(measured.position), np.zeros(6), self.states.state.mode, 0.0,
                    controller.tank.energy, np.zeros(len(LIMITS)))

    def compute(self, measured: Measurement, dt: float) -> Tick:
        """Compute the torque for the next ``dt`` seconds."""
        if self._planned is not None and self.states.state in _OF_JOINTS:
            self.joint_motion, self._planned = self._planned, None
            self.joint_motion.begin(measured.position)
        motion = self._present_motion
        if motion is None:
            return self.controller.tick(measured, dt)
        result = self.controller.move_joints(measured, motion.path, dt)
        self._look_at(motion)
        return result

    def catch_up(self) -> None:
        """Know what the arm does, and where it is, after ticks that a kernel has made."""
        self.controller.catch_up()
        motion = self._present_motion
        if motion is None:
            self.controller.guard.settle()
        else:
            self._look_at(motion)

    def end_tick(self, event: int) -> Tick:
        """End a tick in which a kernel felt something, or could compute no torque."""
        motion = self._present_motion
        if motion is None:
            self.controller.guard.settle()
        result = self.controller.end_tick(event)
        if motion is not None:
            self._look_at(motion)
        return result

    @property
    def only_goes_on(self) -> bool:
        """Whether no request, setting or motion begins with the next tick; see `path`."""
        begins = self._planned is not None and self.states.state in _OF_JOINTS
        return not begins and self.controller.only_goes_on

    @property
    def path(self) -> JointPath:
        """On which the joints move now."""
        motion = self._present_motion
        return NO_PATH if motion is None else motion.path

    def _look_at(self, motion: JointMotion) -> None:
        """End a motion of the joints that has been made, or cannot go on."""
        if motion is not self._present_motion:
            return  # a collision has ended it
        if motion.failed:
            # What holds the arm would be pushed on by joints that come to rest on their way.
            self.joint_motion_problem = motion.problem(self.controller.blocked)
            self.joint_motion = None
        if motion.failed or motion.done:
            self.states.take(Request.ARRIVED)

    @property
    def _present_motion(self) -> JointMotion | None:
        """Of the joints, now."""
        if self.states.state is State.STOPPING:
            return self._braking
        return self.joint_motion if self.states.state in _OF_JOINTS else None

    def _entered(self, before: State) -> None:
        """The state has changed, or what comes after it."""
        state, then, motion = self.states.state, self.states.then, self.joint_motion
        comes = state if state is not State.STOPPING else then
        if self._planned is not None and comes not in _OF_JOINTS:
            self._planned, self.joint_motion_problem = None, self._why_ended()
        if state is before:
            return
        if before in _OF_JOINTS and motion is not None and not motion.done:
            self.joint_motion, self.joint_motion_problem = None, self._why_ended()
            if state is State.STOPPING:
                self._braking = Braking(*motion.target(),
                                        self.controller.settings.guard.stop_time)
        if state is State.FAULT:
            self.controller.tank.empty()
        if state is State.GUIDED:
            problem = self.controller.begin_guiding()
            if problem:
                self.states.take(Request.STOP, problem)
                return
        if state is State.STOPPING:
            return
        if (before in _FREE or self._braking is not None) and state not in _FREE:
            self.controller.take_posture()
        self._braking = None

    def _why_ended(self) -> str:
        return self.states.reason or _ENDED.get(self.states.state, 'it was ended')


_ENDED = {State.GUIDED: 'the arm is guided by hand', State.COMPLIANT: 'the arm gives way',
          State.INACTIVE: 'the node was deactivated'}
