"""A Franka as an arm that is controlled, one cycle at a time."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.control.arm_states import State
from gdmp_ros.control.measurement import Measurement
from gdmp_ros.errors import ParameterError
from gdmp_ros.franka.channel import CYCLE_S
from gdmp_ros.franka.robot import FrankaRobot
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import tool_at, ToolTransform
from gdmp_ros.sim.known_model import KnownModel
from gdmp_ros.sim.payload import Load, Payload

#: Largest difference of the inertia from that of the robot, relative, and of the Jacobian [m].
LARGEST_INERTIA, LARGEST_JACOBIAN = 0.2, 0.02
#: Cycles in which the torque decreases to zero at the end.
END_CYCLES = 50


class FrankaDriver:
    """
    A Franka; see `gdmp_ros.control.arm_driver.ArmDriver`.

    Kinematics and dynamics are those of the model of this package, with the end effector that the
    robot knows and the load that it was told; they are compared with the robot's own at the begin
    of each control. Gravity is not in them: the robot compensates that itself.

    :ivar robot: access to the robot
    :ivar known: its model
    :ivar measured: the last measurement
    :ivar dt: time for which the next torque acts [s]
    :ivar differences: of the model from that of the robot at the last begin: of the inertia,
        relative, and the largest one of a column of the Jacobian [m, rad]
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
        self.robot, self.wall_time = robot, wall_time
        flange = Arm('fr3', 'flange', hand=False)
        self.chain = flange.chain
        # Whatever hangs there may be a hand: it is kept away from obstacles, and is no obstacle.
        whole = Arm('fr3').shape
        self.body = flange.shape._replace(capsules=whole.capsules, links=whole.links)
        self.joints = replace(flange.limits, cycle=CYCLE_S)
        self.friction = np.zeros(len(self.joints.torque))
        self.dt, self.lost = CYCLE_S, 0
        self.known = KnownModel.weightless(flange.known.model, flange.known.site, rotor_inertia)
        self._load = Load(self.known.model, self.known.body, self.known.mount)
        self._flange = flange.end_pose
        self._sent, self.differences = np.zeros_like(self.joints.torque), (0.0, 0.0)
        self._tool, self._payload = ToolTransform(), Payload()
        self._reading = robot.read()
        self._put(self._tool)

    @property
    def controlled(self) -> bool:
        return self.robot.controlled

    @property
    def taken(self) -> np.ndarray | None:
        return self._reading.taken if self.robot.controlled else None

    @property
    def misplaced(self) -> float:
        """Distance between the tool that the robot reports and that of the model [m]."""
        own = self.chain.pose_at(self._reading.position, tool_at(self._flange, self._end_effector))
        return float(np.linalg.norm(own[:3] - self.robot.position))

    def begin(self) -> Measurement:
        self._check_model()
        self.robot.begin()
        measured = self.measure()
        if measured is None:
            raise ArmStopped('the robot does not answer', False)
        self.command(np.zeros_like(self._sent))
        return measured

    def _check_model(self) -> None:
        """:raises ArmStopped: if the model of this package is not that of the robot"""
        own = self.robot.own_model()
        # At the end effector, which may be another one than before.
        self._put(ToolTransform())
        used = self._at(own.position, *np.zeros((2, len(own.position))))
        self._put(self._tool)
        rotors = np.diag(self.known.model.dof_armature)
        inertia = float(np.linalg.norm(used.inertia - rotors - own.inertia)
                        / np.linalg.norm(own.inertia))
        away = float(np.linalg.norm(used.jacobian - own.jacobian, axis=0).max())
        self.differences = inertia, away
        if inertia > LARGEST_INERTIA or away > LARGEST_JACOBIAN:
            raise ArmStopped(
                f'the model is not that of the robot: its inertia differs by {100 * inertia:.0f} '
                f'%, expected at most {100 * LARGEST_INERTIA:g}, and its Jacobian by {away:.3f} '
                f'm, expected at most {LARGEST_JACOBIAN:g}: is it a Franka Research 3?', True)

    def measure(self) -> Measurement | None:
        if not self.robot.connected:
            return None
        self._reading = self.robot.read()
        elapsed = self._reading.elapsed if self._reading.elapsed > 0.0 else CYCLE_S
        self.lost += max(round(elapsed / CYCLE_S) - 1, 0)
        self.dt = self.robot.channel.between_arrivals if self.wall_time else elapsed
        self.measured = self._measurement()
        return self.measured

    def catch_up(self, torque: np.ndarray) -> None:
        """
        Know the last state, after kernels have answered some.

        :param torque: that was sent last [Nm]
        """
        self._reading, self._sent = self.robot.last(), torque.copy()
        self.measured = self._measurement()

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
        before, self._tool = self.measured.pose, tool
        self._put(tool)
        return before, self.measured.pose

    def _put(self, tool: ToolTransform) -> None:
        """Put end effector, a tool in its frame, and load to the model, and look at it."""
        self._end_effector = self.robot.end_effector
        x, y, z, w, i, j, k = tool_at(np.array(
            [*self._end_effector.position, *self._end_effector.rotation]), tool).tolist()
        whole = ToolTransform((x, y, z), (w, i, j, k))
        self.end_pose = tool_at(self._flange, whole)
        self.known.put_tool(whole)
        self._load.put(self.robot.tool_moments
                       + self._payload.seen_from(self._end_effector).moments())
        self.measured = self._measurement()

    def check_payload(self, state: State) -> None:
        if state.moves or state is State.GUIDED:
            raise ParameterError('the robot can only be told what it carries while it rests: '
                                 'call ~/stop first')

    def carry(self, payload: Payload) -> Measurement | None:
        controlled = self.controlled
        self.end()
        self.robot.carry(payload)
        self._payload = payload
        self._put(self._tool)
        return self.begin() if controlled else None

    def _measurement(self) -> Measurement:
        return self._at(*self._reading[:3])

    def _at(self, position: np.ndarray, velocity: np.ndarray, external: np.ndarray) -> Measurement:
        """What the model says in a state."""
        self.known.look(position, velocity, 0.0)
        return self.known.measurement(position, velocity, external)
