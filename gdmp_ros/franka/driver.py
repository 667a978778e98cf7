"""A Franka as an arm that is controlled, one cycle at a time."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.control.arm_states import State
from gdmp_ros.control.kinematics import add_lever, constant_velocity_acceleration
from gdmp_ros.control.measurement import Measurement
from gdmp_ros.errors import ParameterError
from gdmp_ros.franka.robot import FrankaRobot, Reading
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import tool_at, ToolTransform
from gdmp_ros.sim.payload import Payload

#: Time between two commands; the robot compares each with the one before, lost cycles or not [s].
CYCLE_S = 0.001
#: Longest cycle that counts, on wall time [s].
LONGEST_S = 0.02
#: Cycles in which the torque decreases to zero at the end.
END_CYCLES = 50


class FrankaDriver:
    """
    A Franka; see `gdmp_ros.control.arm_driver.ArmDriver`.

    Jacobian and dynamics are those of the robot's own model, with the end effector and the load
    that the robot knows. Gravity is not in it: the robot compensates that itself. Poses are
    computed from the joints: a server of the protocol reports those of the last link.

    :ivar robot: access to the robot
    :ivar measured: the last measurement
    :ivar dt: time for which the next torque acts [s]
    :ivar lost: cycles without a state of the robot, since the start
    """

    def __init__(self, robot: FrankaRobot, rotor_inertia: float, wall_time: bool = False):
        """
        Read the first state; the robot does not move.

        :param robot: connected
        :param rotor_inertia: of each joint, added to the robot's model [kg m²]
        :param wall_time: whether a cycle lasts until the next state arrives, instead of as long as
            the robot says: for a server of the protocol
        """
        self.robot, self._wall_time, self._arrived = robot, wall_time, 0
        flange = Arm('fr3', 'flange', hand=False)
        self.chain, self.body = flange.chain, flange.shape
        self.joints = replace(flange.limits, cycle=CYCLE_S)
        self.friction = np.zeros(len(self.joints.torque))
        self.dt, self.lost = CYCLE_S, 0
        self._rotors = rotor_inertia * np.eye(len(self.joints.torque))
        self._sent = np.zeros_like(self.joints.torque)
        self._reading = robot.read()
        self._end_effector = tool_at(flange.end_pose, robot.end_effector)
        self.end_pose = self._end_effector
        self.measured = self._measurement()
        add_lever(self.measured.jacobian, np.zeros(3))  # compiled before it is needed

    @property
    def controlled(self) -> bool:
        return self.robot.controlled

    @property
    def misplaced(self) -> float:
        """Distance between the tool that the robot reports and that of the model [m]."""
        own = self.chain.pose_at(self._reading.position, self._end_effector)
        return float(np.linalg.norm(own[:3] - self.robot.position))

    def begin(self) -> Measurement:
        self.robot.begin()
        measured = self.measure()
        if measured is None:
            raise ArmStopped('the robot does not answer', False)
        self.command(np.zeros_like(self._sent))
        return measured

    def measure(self) -> Measurement | None:
        if not self.robot.connected:
            return None
        self._reading = self.robot.read()
        elapsed = self._reading.elapsed if self._reading.elapsed > 0.0 else CYCLE_S
        self.lost += max(round(elapsed / CYCLE_S) - 1, 0)
        self.dt = self._between_arrivals() if self._wall_time else elapsed
        self.measured = self._measurement()
        return self.measured

    def _between_arrivals(self) -> float:
        """Time since the last state arrived [s]."""
        last, self._arrived = self._arrived, self.robot.arrived
        return min(1e-9 * (self._arrived - last), LONGEST_S) if last else CYCLE_S

    def command(self, torque: np.ndarray) -> None:
        self.robot.write(torque)
        self._sent = torque

    def end(self) -> None:
        """End the control within `END_CYCLES`."""
        if self.robot.controlled:
            for left in range(END_CYCLES - 1, -1, -1):
                self.robot.read()
                self.robot.write(left / END_CYCLES * self._sent, last=left == 0)

    def recover(self) -> Measurement:
        self.robot.recover()
        return self.begin()

    def reset(self) -> Measurement:
        raise ParameterError('a robot cannot be reset')

    def use_tool(self, tool: ToolTransform) -> tuple[np.ndarray, np.ndarray]:
        before = self.measured.pose
        self.end_pose = tool_at(self._end_effector, tool)
        self.measured = self._measurement()
        return before, self.measured.pose

    def check_payload(self, state: State) -> None:
        if state.moves or state is State.GUIDED:
            raise ParameterError('the robot can only be told what it carries while it rests: '
                                 'call ~/stop first')

    def carry(self, payload: Payload) -> Measurement | None:
        controlled = self.controlled
        self.end()
        self.robot.carry(payload)
        return self.begin() if controlled else None

    def _measurement(self) -> Measurement:
        reading: Reading = self._reading
        jacobian = np.ascontiguousarray(reading.jacobian)
        pose = self.chain.pose_at(reading.position, self.end_pose)
        acceleration = np.empty(6)
        if self.end_pose is not self._end_effector:
            at = self.chain.pose_at(reading.position, self._end_effector)
            add_lever(jacobian, pose[:3] - at[:3])
        constant_velocity_acceleration(jacobian, reading.velocity, acceleration)
        return Measurement(reading.position, reading.velocity, pose, jacobian,
                           reading.inertia + self._rotors, reading.coriolis, reading.external,
                           acceleration, 0.0)
