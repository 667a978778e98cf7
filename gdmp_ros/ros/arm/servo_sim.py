"""
Node ``servo_sim``: a simulated arm that takes joint positions, in place of a robot.

It has the topics of ros2_control: it takes the commands of a forward_position_controller or a
joint_trajectory_controller, and says where its joints are and what the sensor at its wrist feels.
It describes itself for RViz, and has the topics of a gripper.
"""
from __future__ import annotations

from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.realtime.loop import NS, periodic, RunningLoop
from gdmp_ros.ros.arm.tf_publisher import TfPublisher
from gdmp_ros.ros.gripper import GripperInterface
from gdmp_ros.ros.lifecycle import check_subscribers, joints_stream, ManagedNode, Stream
from gdmp_ros.ros.messages import fill_wrench
from gdmp_ros.ros.parameters import Parameters, settings_from, Spec, specs_of
from gdmp_ros.ros.running import run
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.sim.scenes import SCENES, standing_at
from gdmp_ros.sim.servo_arm import ServoArm, ServoSettings
from gdmp_ros.sim.urdf import LinkFrames, urdf
from gdmp_ros.util.names import indices_of

SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('model', 'ur5e', 'model of the arm, as for position_arm'),
    Spec('frame_id', 'base_link', 'frame of its base'),
    Spec('gripper', False, 'the fingers of the built-in hand move: gripper/command, '
         'gripper/state, gripper/move'),
    Spec('scene', '', 'objects around the arm, with a gripper; pick_and_place: two boxes and a '
         'cube; clutter: three objects between them; soft_table: gives way with 20 kN/m',
         choices=('', *SCENES)),
    Spec('scene_height', 0.0, 'of the floor under these objects', 'm', -1.0, 2.0),
    Spec('joint_prefix', '', 'before the names of the joints'),
    Spec('output', 'forward_position_controller', 'controller that it is behind',
         choices=('forward_position_controller', 'joint_trajectory_controller')),
    Spec('realtime_priority', -1, 'SCHED_FIFO priority of the loop; -1: 40 if the system grants '
         'it; 0: never', low=-1, high=99),
    *specs_of(ServoSettings, 'configure'),
)
#: Periods of the simulation in a tick, and that are made up in one.
PERIODS, MOST_LATE = 2, 20
#: Ticks between two looks for subscribers, and between two messages about links and objects.
LOOK_EVERY, SHOW_EVERY = 100, 10


class ServoSim(ManagedNode):
    """
    The managed node ``servo_sim``.

    :ivar servo: the arm
    :ivar push: what pushes its tool, in the frame of the base [N, Nm]
    :ivar mute: what it does not say any more: ``joints``, ``wrench``
    :ivar commands: how many it has taken
    """

    servo: ServoArm

    def __init__(self) -> None:
        super().__init__('servo_sim')
        self.parameters = Parameters(self, SPECS)
        self.push, self.mute, self.commands = np.zeros(6), set[str](), 0
        self._loop: RunningLoop | None = None

    def configure(self) -> None:
        p = self.parameters
        self.servo = ServoArm(p.model, settings_from(p, ServoSettings),
                              p.gripper or bool(p.scene),
                              [standing_at(SCENES[p.scene], p.scene_height)] if p.scene else ())
        self._names = [f'{p.joint_prefix}{name}' for name in self.servo.arm.names]
        self._states = joints_stream(self, 'joint_states', self._names)
        felt = WrenchStamped()
        felt.header.frame_id = 'tool0'
        self._wrenches = Stream(
            self.add_publisher(WrenchStamped, 'force_torque_sensor_broadcaster/wrench', 10),
            SerializedTemplate(felt, 6, fill_wrench))
        kind, topic = ((JointTrajectory, 'joint_trajectory')
                       if p.output == 'joint_trajectory_controller'
                       else (Float64MultiArray, 'commands'))
        self._taken = self.add_subscription(kind, f'{p.output}/{topic}', None, 10)
        self._links = TfPublisher(self)
        self._links.describe(LinkFrames(self.servo.arm, p.frame_id))
        self.add_publisher(String, 'robot_description', 1, late=True).publish(
            String(data=urdf(self.servo.arm, p.frame_id)))
        if self.servo.gripper is not None:
            GripperInterface(self, self.servo.gripper)
        self.add_report(self._report)
        self._ticks, self._last, self._problem = 0, 0, ''
        self._effort = np.zeros(len(self._names))
        p.locked = True

    def activate(self) -> None:
        priority = self.parameters.realtime_priority
        self._period = round(self.servo.arm.period * NS)
        self._loop = self.clock.start(periodic(self._tick, PERIODS * self._period, self.clock),
                                      priority)
        self.get_logger().info(f'waiting for commands on {self._taken.topic}')

    def deactivate(self) -> None:
        if self._loop is not None:
            self._loop.end()
            self._loop = None

    def _tick(self, deadline_ns: int, now_ns: int) -> None:
        message = self._taken.newest_message()
        if message is not None:
            try:
                self.servo.send(self._position(message), np.zeros(0))
                self.commands += 1
            except GdmpError as error:
                self._problem = str(error)
        # After an overrun: simulated time keeps up with wall time.
        periods = (deadline_ns - self._last) // self._period if self._last else 1
        self._last = deadline_ns
        self.servo.arm.push(self.push)
        self.servo.advance(min(periods, MOST_LATE))
        if self._ticks % LOOK_EVERY == 0:
            check_subscribers(self._states, self._wrenches)
            self._links.check()
        if self._links.has_subscribers and self._ticks % SHOW_EVERY == 0:
            self._links.publish(self.servo.arm.data.qpos.copy(), self.clock.wall())
        self._ticks += 1
        self._say()

    def _position(self, message: Any) -> np.ndarray:
        """:raises DataError: unless it is a command for these joints"""
        if isinstance(message, Float64MultiArray):
            position = np.array(message.data)
        else:
            names = message.joint_names
            if len(message.points) != 1 or any(len(part) != len(names) for part in (
                    message.points[0].positions, message.points[0].velocities)):
                raise DataError(f'{self._taken.topic}: expected one point with a position and a '
                                'velocity for each joint')
            point, order = message.points[0], indices_of(self._names, names, 'joint')
            ahead = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
            # Where the spline of the controller is now, which goes on with this velocity.
            position = (np.array(point.positions) - ahead * np.array(point.velocities))[order]
        if len(position) != len(self._names) or not np.isfinite(position).all():
            raise DataError(f'{self._taken.topic}: {len(position)} positions, expected '
                            f'{len(self._names)} finite ones')
        return position

    def _say(self) -> None:
        state, stamp = self.servo.read(), self.clock.wall()
        if self._states.has_subscribers and 'joints' not in self.mute:
            self._states.publish(np.concatenate([state.position, state.velocity, self._effort]),
                                 stamp)
        if (self._wrenches.has_subscribers and 'wrench' not in self.mute
                and state.wrench is not None):
            self._wrenches.publish(state.wrench, stamp)

    def _report(self) -> None:
        if self._problem:
            self.get_logger().warning(self._problem, throttle_duration_sec=1.0)
            self._problem = ''
        if self._loop is not None and self._loop.failure is not None:
            self.get_logger().error(f'the loop failed: {self._loop.failure!r}')
            self.trigger_deactivate()


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``servo_sim``."""
    return run([ServoSim], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
