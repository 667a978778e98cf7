"""Control of a Franka, one cycle at a time."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.kinematics import add_lever, constant_velocity_acceleration
from gdmp_ros.control.measurement import Measurement
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.tick import Tick
from gdmp_ros.errors import ParameterError
from gdmp_ros.franka.robot import FrankaRobot, Reading, RobotStopped
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.chain import Chain
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.payload import Payload

#: Time between two commands; the robot compares each with the one before, lost cycles or not [s].
CYCLE_S = 0.001
#: Longest cycle that counts, on wall time [s].
LONGEST_S = 0.02
#: Cycles in which the torque decreases to zero at the end.
END_CYCLES = 50
_END_EFFECTOR = ToolTransform()


class FrankaLoop(ArmControl):
    """
    A Franka and its impedance controller; one thread uses it.

    Jacobian and dynamics are those of the robot's own model, with the end effector and the load
    that the robot knows. Gravity is not in it: the robot compensates that itself. Poses are
    computed from the joints: a server of the protocol reports those of the last link.

    :ivar robot: access to the robot
    :ivar measured: the last measurement
    :ivar lost: cycles without a state of the robot, since the start
    """

    def __init__(self, robot: FrankaRobot, rotor_inertia: float,
                 settings: ControllerSettings | None = None, wall_time: bool = False):
        """
        Prepare, and compile the control law; the robot does not move.

        :param robot: connected
        :param rotor_inertia: of each joint, added to the robot's model [kg m²]
        :param wall_time: whether a cycle lasts until the next state arrives, instead of as long as
            the robot says: for a server of the protocol
        """
        self._wall_time, self._arrived = wall_time, 0
        flange = Arm('fr3', 'flange', hand=False)
        self._chain = Chain(flange)
        joints = replace(flange.limits, cycle=CYCLE_S)
        super().__init__(joints, np.zeros(len(joints.torque)), settings)
        self.robot = robot
        self.lost = 0
        self._rotors = rotor_inertia * np.eye(len(joints.torque))
        self._dt = CYCLE_S
        self._sent = np.zeros_like(joints.torque)
        self._reading = robot.read()
        self._end_effector = robot.end_effector
        self._end = self._chain.end_of(self._end_effector)
        self._tool_end: np.ndarray | None = None
        self.measured = self._measurement()
        self.hold(self.measured)
        add_lever(self.measured.jacobian, np.zeros(3))
        self.warm_up(self.measured, CYCLE_S)

    @property
    def misplaced(self) -> float:
        """Distance between the tool that the robot reports and that of the model [m]."""
        own = self._chain.pose_at(self._reading.position, self._end)
        return float(np.linalg.norm(own[:3] - self.robot.position))

    def activate(self) -> None:
        """Begin to control; a robot that refuses is in a fault."""
        self.states.take(Request.ACTIVATE)
        try:
            self.begin()
        except RobotStopped as error:
            self.stop(str(error))

    def begin(self) -> None:
        """
        Begin to control: hold the robot where it is, without a torque at first.

        :raises RobotStopped: if the robot refuses
        """
        self.robot.begin()
        measured = self.wait()
        if measured is None:
            raise RobotStopped(self.states.reason, False)
        self.hold(measured)
        self.answer(measured)

    def wait(self) -> Measurement | None:
        """Wait for the next state; None if the robot does not answer, or has just stopped."""
        if not self.robot.connected:
            return None
        try:
            self._reading = self.robot.read()
        except RobotStopped as error:
            self.stop(str(error))
            return None
        elapsed = self._reading.elapsed if self._reading.elapsed > 0.0 else CYCLE_S
        self.lost += max(round(elapsed / CYCLE_S) - 1, 0)
        self._dt = self._between_arrivals() if self._wall_time else elapsed
        self.measured = self._measurement()
        return self.measured

    def _between_arrivals(self) -> float:
        """Time since the last state arrived [s]."""
        last, self._arrived = self._arrived, self.robot.arrived
        return min(1e-9 * (self._arrived - last), LONGEST_S) if last else CYCLE_S

    def answer(self, measured: Measurement) -> Tick:
        """Compute the torque for a state, and send it; nothing is sent to a robot that stopped."""
        if not self.robot.controlled:
            if self.states.state not in (State.FAULT, State.INACTIVE):
                self.stop('the robot has ended the control')
            return self.stand(measured, self._dt)
        tick = self.compute(measured, self._dt)
        try:
            self.robot.write(tick.torque)
            self._sent = tick.torque
        except RobotStopped as error:
            self.stop(str(error))
        return tick

    def end(self) -> None:
        """End the control within `END_CYCLES`; the robot then holds its position by itself."""
        if not self.robot.controlled:
            return
        try:
            for left in range(END_CYCLES - 1, -1, -1):
                self.robot.read()
                self.robot.write(left / END_CYCLES * self._sent, last=left == 0)
        except RobotStopped as error:
            self.stop(str(error))

    def recover(self) -> None:
        """
        End a fault: the robot is held where it is, and follows nothing.

        :raises RobotStopped: if the robot does not recover
        """
        if self.robot.controlled:
            super().recover()
            return
        try:
            self.robot.recover()
            self.begin()
        except RobotStopped as error:
            self.stop(str(error))
            raise

    def use_tool(self, tool: ToolTransform) -> None:
        before = self.measured.pose
        self._tool_end = (None if tool == _END_EFFECTOR
                          else self._chain.end_of(self._end_effector, tool))
        self.measured = self._measurement()
        self.controller.move_tool(before, self.measured.pose)

    def check_payload(self) -> None:
        """:raises ParameterError: while the robot cannot be told what it carries"""
        state = self.states.state
        if state.moves or state is State.GUIDED:
            raise ParameterError('the robot can only be told what it carries while it rests: '
                                 'call ~/stop first')

    def carry(self, payload: Payload) -> None:
        """
        Tell the robot what it carries; the robot holds by itself meanwhile.

        :raises GdmpError: if the robot moves, or does not answer
        """
        self.check_payload()
        controlled = self.robot.controlled
        try:
            self.end()
            self.robot.carry(payload)
            if controlled:
                self.begin()
        except RobotStopped as error:
            self.stop(str(error))
            raise

    def _measurement(self) -> Measurement:
        reading: Reading = self._reading
        jacobian = np.ascontiguousarray(reading.jacobian)
        pose = self._chain.pose_at(reading.position, self._end)
        acceleration = np.empty(6)
        if self._tool_end is not None:
            at, pose = pose, self._chain.pose_at(reading.position, self._tool_end)
            add_lever(jacobian, pose[:3] - at[:3])
        constant_velocity_acceleration(jacobian, reading.velocity, acceleration)
        return Measurement(reading.position, reading.velocity, pose, jacobian,
                           reading.inertia + self._rotors, reading.coriolis, reading.external,
                           acceleration, 0.0)

    def stop(self, reason: str) -> None:
        """Note that the robot is not controlled any more, and why."""
        self.controller.guard.fault(reason)
