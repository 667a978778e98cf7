"""
An admittance with fixed diagonal gains, as the admittance_controller of ros2_controllers.

Written after its documentation and ``admittance_rule_impl.hpp`` (2024): the joints of a
reference are moved by an offset; ``M ẍ + D ẋ + K x = F`` gives its acceleration, with x from the
reference to the measured pose, and a damping of the joints besides. K and D are diagonal in the
frame of the tool, and are parameters.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.admittance import external_wrench
from gdmp_ros.control.kinematics import chain_state
from gdmp_ros.control.weight import GRAVITY
from gdmp_ros.manifolds.quaternion import rotate, rotation_between
from gdmp_ros.sim.servo_arm import ServoArm

#: Its default damping of the joints [1/s].
JOINT_DAMPING = 5.0


class DiagonalAdmittance:
    """
    The controller of a simulated arm, in lockstep.

    :ivar servo: the arm
    :ivar wrench: external, at the tool, in the frame of the base [N, Nm]
    """

    def __init__(self, servo: ServoArm, stiffness: np.ndarray, damping: np.ndarray,
                 mass: np.ndarray):
        """
        Hold the arm where it is.

        :param stiffness: along and about the axes of the tool, shape (6,), as ``damping`` and
            ``mass``
        """
        self.servo, self.wrench = servo, np.zeros(6)
        self._gains = stiffness, damping, mass
        arm, self._hand, self._sensor = servo.arm, servo.hand, servo.sensor
        self._chain, self._end = arm.chain, arm.end_pose
        self._reference = servo.read().position
        self._offset, self._rate = np.zeros((2, len(self._reference)))

    def tick(self, pose: np.ndarray) -> None:
        """
        Let one cycle pass.

        :param pose: of the reference (x, y, z, qw, qx, qy, qz)
        """
        state, dt = self.servo.read(), self.servo.cycle
        self._reference = self._chain.near(pose, self._reference, self._end)
        now, jacobian = np.empty(7), np.empty((6, len(self._reference)))
        chain_state(*self._chain, self._end, state.position, now, jacobian)
        sensor = self._chain.pose_at(state.position, self._sensor)
        weight = np.array([0.0, 0.0, -self._hand.mass * GRAVITY])
        external_wrench(state.wrench, sensor, now, now, np.array(self._hand.center), weight,
                        self.wrench)
        stiffness, damping, mass = self._gains
        axes = np.empty((3, 3))
        for axis, unit in zip(axes, np.eye(3)):
            rotate(now[3:], unit, axis)
        turn = np.kron(np.eye(2), axes.T)
        away = np.empty(6)
        away[:3] = now[:3] - pose[:3]
        rotation_between(pose[3:], now[3:], away[3:])
        force = self.wrench - turn @ (damping * (turn.T @ (jacobian @ self._rate))
                                      + stiffness * (turn.T @ away))
        acceleration = np.linalg.lstsq(jacobian, force / mass, rcond=None)[0]
        self._rate += dt * (acceleration - JOINT_DAMPING * self._rate)
        self._offset += dt * self._rate
        self.servo.send(self._reference + self._offset, self._rate)
        self.servo.advance(round(dt / self.servo.arm.period))
