"""What an arm does in each tick: follow references, give way to a hand, identify its friction."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.controller import ImpedanceController
from gdmp_ros.control.joint_motion import JointMotion
from gdmp_ros.control.joint_target import joint_target_size, resting_joints
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.reference_kinds import MeasuredMotion
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.target import resting_target, whole_target
from gdmp_ros.control.tick import Tick
from gdmp_ros.errors import DataError, ParameterError, RefusedError


class ArmControl:
    """
    The controller of an arm, simulated or real, and what else may move the arm.

    :ivar hand_guided: whether the arm only compensates gravity, to be guided by hand
    :ivar joint_motion: motions of the joints, while they are made and after
    :ivar joint_motion_problem: why they ended early; empty if they did not
    """

    def __init__(self, joints: JointLimits, friction: np.ndarray,
                 settings: ControllerSettings | None = None):
        """
        Prepare; see `ImpedanceController`.

        :raises ParameterError: if the settings do not fit the joints
        """
        self.joints = joints
        self.controller = ImpedanceController(joints, friction, settings)
        self.hand_guided = False
        self.joint_motion: JointMotion | None = None
        self.joint_motion_problem = ''

    def hold(self, measured: Measurement) -> None:
        """Hold the arm where it is, as after the start."""
        self.joint_motion = None
        self.controller.reset(measured)

    def warm_up(self, measured: Measurement, dt: float) -> None:
        """
        Compute each kind of tick once, so that no kernel is compiled in a real-time loop; `hold`.
        """
        guard = self.controller.guard
        self.compute(measured, dt)
        for target in (resting_target(measured.pose),
                       resting_joints(measured.position, np.full(len(measured.position), 100.0))):
            self.follow(target)
            self.compute(measured, dt)
            # Otherwise a stream that begins soon would be taken for the one of this tick.
            guard.offer(target, Origin(guard.settings.frame, mode=StreamMode.ENDED))
            self.compute(measured, dt)
        self.controller.hand_guide(measured, dt)
        self.controller.move_joints(measured, measured.position, measured.velocity, dt,
                                    ArmMode.MOVE)
        self.controller.move_tool(measured.pose, measured.pose)
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

    @property
    def moves_joints(self) -> bool:
        """Whether motions of the joints are being made."""
        return self.joint_motion is not None and not self.joint_motion.done

    def end_joint_motion(self, reason: str) -> None:
        """End the motions of the joints, if there are any; the arm holds where it is."""
        if self.moves_joints:
            self.joint_motion, self.joint_motion_problem = None, reason

    def check_tool(self) -> None:
        """:raises ParameterError: while the tool cannot change"""
        if self.controller.guard.following:
            raise ParameterError('the arm follows references: stop their publisher, or call '
                                 '~/stop, first')

    def stand(self, measured: Measurement, dt: float) -> Tick:
        """What happens in ``dt`` seconds in which something else holds the arm, as its brakes."""
        controller, twist = self.controller, measured.jacobian @ measured.velocity
        controller.guard.measure(dt, MeasuredMotion(measured.pose, twist, measured.position,
                                                 measured.velocity))
        return Tick(measured, twist, np.zeros(6), np.zeros(36), np.zeros(36),
                    np.zeros_like(measured.position), np.zeros(6), controller.guard.mode, 0.0,
                    controller.tank.energy, np.zeros(len(LIMITS)))

    def compute(self, measured: Measurement, dt: float) -> Tick:
        """Compute the torque for the next ``dt`` seconds."""
        motion = self.joint_motion
        if motion is not None and not motion.done:
            result = self.controller.move_joints(measured, *motion.target(), dt, motion.mode)
            try:
                motion.add(measured, result.torque, dt)
            except DataError as error:
                self.end_joint_motion(str(error))
            return result
        if self.hand_guided:
            return self.controller.hand_guide(measured, dt)
        return self.controller.tick(measured, dt)
