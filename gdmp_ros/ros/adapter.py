"""Node ``adapter``: converts references to the topics and parameters of other controllers."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from gdmp_msgs.msg import JointReference, Reference
from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.guard import ARMED_S, ReferenceGuard
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.reference_kinds import MeasuredMotion
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.stiffness import bound_stiffness, diagonal_bounds
from gdmp_ros.data.bags import joint_positions, joint_target, ns_of, reference_target
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.realtime.loop import NS, periodic, RunningLoop
from gdmp_ros.ros import messages
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.middleware import deserialized
from gdmp_ros.ros.parameters import Parameters, Spec
from gdmp_ros.ros.running import run
from gdmp_ros.ros.serialized import PoseReader

SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('reference_topic', '/trajectory_server/reference', 'gdmp_msgs/Reference to convert'),
    Spec('reference_frame', 'panda_link0', 'frame of the references; others are refused'),
    Spec('measured_pose_topic', 'measured_pose', 'geometry_msgs/PoseStamped of the tool: a motion '
         'is converted if it begins near the robot, or after ~/arm'),
    Spec('pose_topic', 'target_pose', 'geometry_msgs/PoseStamped of the controller; empty: none'),
    Spec('pose_rate_hz', 1000, 'largest rate of the poses', 'Hz', 1, 1000),
    Spec('frame_id', '', 'name of that frame in the controller, if it is another one; '
         'empty: the same'),
    Spec('stiffness', 'six', 'interface of the controller for the stiffness: none, six numbers '
         '(x y z rx ry rz) or a row-major 6x6 matrix in a Float64MultiArray, a WrenchStamped, or '
         'six parameters', choices=('none', 'six', 'matrix', 'wrench', 'parameters')),
    Spec('stiffness_topic', 'target_stiffness', 'topic of the stiffness'),
    Spec('stiffness_rate_hz', 1000, 'largest rate of the stiffness', 'Hz', 1, 1000),
    Spec('stiffness_frame', 'base', 'axes of the six numbers: those of the base or of the tool',
         choices=('base', 'tool')),
    Spec('stiffness_node', '', 'node with the six parameters'),
    Spec('stiffness_parameters', [''], 'names of the six parameters, x y z rx ry rz'),
    Spec('stiffness_min', [1.0, 0.1], 'smallest stiffness of the controller, translational and '
         'rotational', 'N/m, Nm/rad', 1e-3, 1e5),
    Spec('stiffness_max', [2000.0, 200.0], 'largest stiffness of the controller', 'N/m, Nm/rad',
         1e-3, 1e5),
    Spec('joint_names', [''], 'joints of a controller of joint trajectories, in the order of the '
         'references; empty: references of the joints are refused'),
    Spec('joint_trajectory_topic', 'joint_trajectory_controller/joint_trajectory',
         'trajectory_msgs/JointTrajectory of that controller'),
    Spec('joint_rate_hz', 100, 'largest rate of the trajectories', 'Hz', 1, 1000),
    Spec('joint_horizon', 0.03, 'a trajectory leads to where the joints will be after this time: '
         'longer than the period of joint_rate_hz', 's', 0.001, 1.0),
    Spec('measured_joints_topic', 'joint_states', 'sensor_msgs/JointState of the robot: a motion '
         'of the joints is converted if it begins near the robot, or after ~/arm'),
    Spec('realtime_priority', -1, 'SCHED_FIFO priority of the loop; -1: 40 if the system grants '
         'it; 0: never', low=-1, high=99),
)
PERIOD_NS = 1_000_000
#: The measured pose is read once in this many ticks.
READ_EVERY = 10
#: A measured pose, or positions of the joints, older than this are not those of the robot [s].
MEASURED_S = 0.5
#: Pose of the robot before it is known.
ANYWHERE = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
#: Reply timeout [s].
REPLY_TIMEOUT_S = 1.0
#: Relative change of an entry after which a stiffness is set by parameters again.
CHANGED = 0.01


class Output:
    """One output of the adapter, with a largest rate."""

    def __init__(self, rate_hz: float, send: Callable[[Any], None]):
        self.send = send
        self._period = 1.0 / rate_hz
        self._next = 0.0

    def due(self, now: float) -> bool:
        """Whether to send again at a time of the monotonic clock [s]."""
        # Half a tick of tolerance, because references arrive a little early or late.
        if now < self._next - 0.5e-3:
            return False
        self._next = max(self._next + self._period, now)
        return True


class Command(NamedTuple):
    """
    A reference for other controllers.

    :ivar pose: (x, y, z, qw, qx, qy, qz)
    :ivar stiffness: 6×6 [N/m, Nm/rad]
    :ivar stamp_ns: of the reference
    """

    pose: np.ndarray
    stiffness: np.ndarray
    stamp_ns: int


def along_axes(stiffness: np.ndarray, quaternion: np.ndarray | None) -> np.ndarray:
    """
    Diagonal of a stiffness in the axes of the base or of the tool.

    :param stiffness: 6×6, base frame
    :param quaternion: of the tool (wxyz); None for the axes of the base
    """
    if quaternion is None:
        return np.diag(stiffness).copy()
    rotation = Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()
    return np.concatenate([np.diag(rotation.T @ stiffness[:3, :3] @ rotation),
                           np.diag(rotation.T @ stiffness[3:, 3:] @ rotation)])


class JointTrajectoryOutput:
    """
    Sends each reference as a trajectory of one point, which replaces the one before.

    The controller interpolates from where it is; the stamp 0 lets the trajectory begin at once.
    """

    def __init__(self, publisher: Any, names: Sequence[str], horizon: float):
        """:param horizon: time until the joints are to be at the point [s]"""
        self._publisher, self._names, self._horizon = publisher, list(names), horizon

    def send(self, joints: JointReference) -> None:
        """Send where the joints will be after the horizon."""
        point = JointTrajectoryPoint(
            positions=[position + self._horizon * velocity
                       for position, velocity in zip(joints.position, joints.velocity)],
            velocities=list(joints.velocity))
        ns = round(self._horizon * NS)
        point.time_from_start.sec, point.time_from_start.nanosec = ns // NS, ns % NS
        self._publisher.publish(JointTrajectory(joint_names=self._names, points=[point]))


class Adapter(ManagedNode):
    """The managed node ``adapter``."""

    def __init__(self) -> None:
        super().__init__('adapter')
        self.parameters = Parameters(self, SPECS)
        self._loop: RunningLoop | None = None

    def configure(self) -> None:
        p = self.parameters
        p.check = self._check
        self._check(p)
        self._reference = self.add_subscription(Reference, p.reference_topic, None)
        self._measured = self.add_sensor(PoseStamped, p.measured_pose_topic)
        self._poses, self._arms = PoseReader(p.reference_frame), False
        self._pose_seen = self._joints_seen = 0
        self._ticks, self._streamed = 0, False
        self._names = [name for name in p.joint_names if name]
        self._posture = np.empty(0)
        self._pose_of_robot = ANYWHERE
        self.guard = ReferenceGuard(GuardSettings(p.reference_frame), ANYWHERE, 0.7,
                                    len(self._names))
        if self._names:
            self._joint_states = self.add_sensor(JointState, p.measured_joints_topic)
            self._trajectory = JointTrajectoryOutput(
                self.add_publisher(JointTrajectory, p.joint_trajectory_topic, 1), self._names,
                p.joint_horizon)
            self._joint_output = Output(p.joint_rate_hz, self._trajectory.send)
        self.add_service(Trigger, 'arm', self._on_arm)
        self._pending: tuple[Any, float] | None = None
        self._last: np.ndarray | None = None
        self._frame = p.frame_id or p.reference_frame
        self._bounds = diagonal_bounds(p.stiffness_min, p.stiffness_max)
        self._outputs: list[Output] = []
        if p.pose_topic:
            self._pose = self.add_publisher(PoseStamped, p.pose_topic, 1)
            self._outputs.append(Output(p.pose_rate_hz, self._send_pose))
        if p.stiffness != 'none':
            self._outputs.append(Output(p.stiffness_rate_hz, self._stiffness_output()))
        self.add_report(self._report)
        p.locked = True

    def activate(self) -> None:
        self._loop = self.clock.start(periodic(self._tick, PERIOD_NS, self.clock),
                                      self.parameters.realtime_priority)
        self.get_logger().info(f'converting {self.parameters.reference_topic} to '
                               f'{self.parameters.pose_topic or self.parameters.stiffness}')

    def deactivate(self) -> None:
        if self._loop is not None:
            self._loop.end()
            self._loop = None

    def _check(self, p: Any) -> None:
        for word, low, high in zip(('translational', 'rotational'), p.stiffness_min,
                                   p.stiffness_max):
            if low > high:
                raise ParameterError(f'stiffness_min is {low:g} ({word}), expected at most '
                                     f'stiffness_max, {high:g}')
        if p.stiffness == 'parameters' and (not p.stiffness_node
                                            or len(p.stiffness_parameters) != 6):
            raise ParameterError('stiffness by parameters needs stiffness_node and six '
                                 f'stiffness_parameters, got node {p.stiffness_node!r} and '
                                 f'{len(p.stiffness_parameters)} names')

    def _tick(self, deadline_ns: int, now_ns: int) -> None:
        self._ticks += 1
        if self._ticks % READ_EVERY == 0:
            self._read_pose()
        if self._arms and self.guard.states.refusal(Request.ARM) is None:
            self._arms = False
            self.guard.arm()
        self.guard.target(1e-9 * PERIOD_NS)
        received = self._reference.newest()
        if received is not None:
            if not self._streamed:
                self._streamed = True
                self.get_logger().info('references arrive')
            self.convert(received.data)

    def _read_pose(self) -> None:
        try:
            received = self._measured.newest()
            if received is not None:
                self._pose_of_robot = self._poses.read(received.data)
                if not self._pose_seen:
                    self.get_logger().info('the pose of the robot is known')
                self._pose_seen = self.clock.now()
            state = self._joint_states.newest_message() if self._names else None
            if state is not None:
                known = len(self._posture) > 0
                self._posture = joint_positions(state, self._names)
                self._joints_seen = self.clock.now()
                if not known:
                    self.get_logger().info('the joints of the robot are known')
            if received is not None or state is not None:
                self.guard.measure(0.0, MeasuredMotion(self._pose_of_robot, np.zeros(6),
                                                    self._posture, np.zeros(len(self._posture))))
        except GdmpError as error:
            self.get_logger().warning(f'measurement refused: {error}', throttle_duration_sec=1.0)

    def _on_arm(self, request: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self._arms = True
        reply.success = True
        reply.message = (f'the motion that is streamed, or begins within {ARMED_S:g} s, is '
                         'converted from wherever it is')
        return reply

    def convert(self, data: bytes) -> None:
        """
        Send a serialised reference to the outputs, or refuse it.

        Other controllers do not check it.
        """
        guard, count = self.guard, self.guard.refused
        try:
            self._convert(deserialized(data, Reference))
        except DataError as error:
            guard.refuse(str(error))
        if guard.refused > count:
            self.get_logger().warning(f'reference refused: {guard.last_refusal}',
                                      throttle_duration_sec=1.0)

    def _convert(self, message: Reference) -> None:
        guard = self.guard
        if message.joints:
            self._convert_joints(message)
        elif not (self._knows(self._pose_seen) or guard.armed):
            guard.refuse(f'no pose of the robot on {self.parameters.measured_pose_topic}, in '
                         f'{self.parameters.reference_frame}: see the parameter '
                         'measured_pose_topic, or call ~/arm')
        elif guard.offer(reference_target(message),
                         messages.origin_of(message, self._age(message))):
            self._send(message)

    def _age(self, message: Reference) -> float:
        """Present time minus the stamp of a reference [s]."""
        return (self.time_ns() - ns_of(message.header.stamp)) / NS

    def _knows(self, seen: int) -> bool:
        """
        Whether a motion may be followed by what was measured: what is followed goes on anyway.

        :param seen: when it was measured, 0 if never [ns]
        """
        fresh = bool(seen) and self.clock.now() - seen < MEASURED_S * NS
        return fresh or self.guard.following

    def _convert_joints(self, message: Reference) -> None:
        guard = self.guard
        if not self._names:
            guard.refuse('references of the joints: see the parameter joint_names')
        elif not (self._knows(self._joints_seen) or guard.armed):
            guard.refuse('no positions of the joints on '
                         f'{self.parameters.measured_joints_topic}: see the parameter '
                         'measured_joints_topic, or call ~/arm')
        elif (guard.offer(joint_target(message), messages.origin_of(message, self._age(message)))
              and self._joint_output.due(self.clock.now() / NS)):
            self._joint_output.send(message.joints[0])

    def _send(self, message: Reference) -> None:
        now = self.clock.now() / NS
        due = [output for output in self._outputs if output.due(now)]
        if not due:
            return
        command = Command(messages.pose_numbers(message.pose),
                          np.asarray(message.stiffness).reshape(6, 6),
                          ns_of(message.header.stamp))
        for output in due:
            output.send(command)

    def _report(self) -> None:
        if self._loop is not None and self._loop.failure is not None:
            self.get_logger().error(f'converting failed: {self._loop.failure!r}',
                                    throttle_duration_sec=5.0)

    # Outputs

    def _send_pose(self, command: Command) -> None:
        self._pose.publish(messages.stamped_pose(command.pose, self._frame,
                                                 messages.stamp_of(command.stamp_ns)))

    def _stiffness_output(self) -> Callable[[Command], None]:
        p = self.parameters
        if p.stiffness == 'parameters':
            self._client = self.add_client(
                SetParametersAtomically, f'{p.stiffness_node}/set_parameters_atomically')
            return self._set_parameters
        kind = WrenchStamped if p.stiffness == 'wrench' else Float64MultiArray
        self._stiffness = self.add_publisher(kind, p.stiffness_topic, 1)
        return {'six': self._send_six, 'matrix': self._send_matrix,
                'wrench': self._send_wrench}[p.stiffness]

    def _six(self, command: Command) -> np.ndarray:
        p = self.parameters
        numbers = along_axes(command.stiffness,
                             command.pose[3:] if p.stiffness_frame == 'tool' else None)
        return np.clip(numbers, np.repeat(p.stiffness_min, 3), np.repeat(p.stiffness_max, 3))

    def _send_six(self, command: Command) -> None:
        self._stiffness.publish(Float64MultiArray(data=self._six(command).tolist()))

    def _send_matrix(self, command: Command) -> None:
        message = messages.matrix_message(6)
        bounded = command.stiffness.reshape(-1).copy()
        bound_stiffness(bounded, self._bounds[0], self._bounds[1], np.zeros(len(LIMITS)))
        message.data = bounded.tolist()
        self._stiffness.publish(message)

    def _send_wrench(self, command: Command) -> None:
        message, numbers = WrenchStamped(), self._six(command)
        message.header.frame_id = self._frame
        message.header.stamp = messages.stamp_of(command.stamp_ns)
        messages.set_vectors(message.wrench.force, message.wrench.torque, numbers)
        self._stiffness.publish(message)

    def _set_parameters(self, command: Command) -> None:
        """Set a stiffness that has changed, one request at a time."""
        if self._pending is not None:
            future, since = self._pending
            if not future.done() and self.clock.now() / NS - since < REPLY_TIMEOUT_S:
                return
            if not future.done():
                self._client.remove_pending_request(future)
                self._last = None
            self._pending = None
        numbers = self._six(command)
        if not self._client.service_is_ready():
            self._last = None  # a restarted node does not know it
            self.get_logger().warning('the stiffness cannot be set: the service of '
                                      f'{self.parameters.stiffness_node} is not available',
                                      throttle_duration_sec=5.0)
            return
        if self._last is not None and np.all(
                np.abs(numbers - self._last) <= CHANGED * np.maximum(self._last, 1.0)):
            return
        changes = [Parameter(name, value=float(number)).to_parameter_msg()
                   for name, number in zip(self.parameters.stiffness_parameters, numbers)]
        self._last = numbers
        future = self._client.call_async(SetParametersAtomically.Request(parameters=changes))
        self._pending = (future, self.clock.now() / NS)
        future.add_done_callback(self._on_set)

    def _on_set(self, future: Any) -> None:
        result = future.result().result
        if not result.successful:
            self._last = None
            self.get_logger().warning(f'{self.parameters.stiffness_node} refused the stiffness: '
                                      f'{result.reason}', throttle_duration_sec=1.0)


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``adapter``."""
    return run([Adapter], arguments)


if __name__ == '__main__':
    raise SystemExit(main())
