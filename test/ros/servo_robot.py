"""An arm that takes joint positions, with the topics of ros2_control, in lockstep."""
from geometry_msgs.msg import WrenchStamped
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from gdmp_ros.ros import messages
from gdmp_ros.ros.middleware import best_effort, reliable
from gdmp_ros.sim.servo_arm import ServoArm

PERIOD_NS = 1_000_000
PREFIX = 'left_'


class ServoRobot:
    """
    Takes commands, and says where it is; names of its joints come in another order.

    :ivar silent: no states are sent
    :ivar deaf: no wrench is sent
    """

    def __init__(self, running, settings=None, trajectory=False):
        """:param trajectory: behind a ``joint_trajectory_controller``"""
        self.servo, self.silent, self.deaf = ServoArm('ur5e', settings), False, False
        self.names, self.commands = self.servo.arm.names, []
        self.push = np.zeros(6)
        self._clock, made = running.client.clock, running.participant
        self._states = made.publisher(JointState, '/joint_states', best_effort(1))
        self._wrench = made.publisher(WrenchStamped, '/force_torque_sensor_broadcaster/wrench',
                                      best_effort(1))
        self._taken = made.subscription(
            *((JointTrajectory, '/joint_trajectory_controller/joint_trajectory') if trajectory
              else (Float64MultiArray, '/forward_position_controller/commands')), reliable(10),
            None)
        running._made += [self._states, self._wrench, self._taken]
        self.running = self._clock.start(self._run())

    def _run(self):
        tick = 0
        while True:
            yield self._clock.now() + PERIOD_NS
            tick += 1
            message = self._taken.newest_message()
            if message is not None:
                self.commands.append(message)
                self.servo.send(self._position(message), np.zeros(6))
            self.servo.arm.push(self.push)
            self.servo.advance()
            if tick % 2 == 0:
                self._say()

    def _position(self, message):
        if isinstance(message, Float64MultiArray):
            return np.array(message.data)
        assert message.header.stamp.sec == 0 and message.joint_names == self.names
        (point,) = message.points
        ahead = point.time_from_start.nanosec * 1e-9
        # As the controller does at once, along its spline.
        return np.array(point.positions) - ahead * np.array(point.velocities)

    def _say(self):
        state = self.servo.read()
        stamp = messages.stamp_of(self._clock.wall())
        if not self.silent:
            message = JointState(name=[PREFIX + name for name in self.names[::-1]],
                                 position=state.position[::-1].tolist(),
                                 velocity=state.velocity[::-1].tolist())
            message.header.stamp = stamp
            self._states.publish(message)
        if not self.deaf:
            felt = WrenchStamped()
            felt.header.stamp, felt.header.frame_id = stamp, 'tool0'
            for vector, numbers in ((felt.wrench.force, state.wrench[:3]),
                                    (felt.wrench.torque, state.wrench[3:])):
                vector.x, vector.y, vector.z = numbers.tolist()
            self._wrench.publish(felt)
