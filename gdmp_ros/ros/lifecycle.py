"""Base of all nodes: lifecycle with logged failures, autostart, topics of every tick."""
from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
import numpy as np
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.dds import answered_transitions, current, destroy_rest
from gdmp_ros.ros.messages import fill_matrix, fill_pose_stamped, matrix_message, stamp_of
from gdmp_ros.ros.middleware import (
    best_effort,
    latched,
    Participant,
    Publisher,
    reliable,
    ServiceClient,
    Subscription,
)
from gdmp_ros.ros.serialized import SerializedTemplate
from gdmp_ros.util.compile_progress import compilation_reported

#: Time between two reports of a node, and without one the node counts as silent [s].
REPORT_S, SILENT_S = 0.1, 1.0
#: Reports between two diagnostics that say the same.
DIAGNOSTICS_EVERY = 10
#: Ticks between two checks for subscribers.
CHECK_EVERY = 100


class ManagedNode(LifecycleNode):
    """
    A lifecycle node that logs why a transition failed.

    Subclasses implement `configure`, `activate` and `deactivate`, and extend `cleanup`; these
    raise an exception on failure.

    :ivar participant: what the node offers and uses goes through it
    :ivar parameters: see `gdmp_ros.ros.parameters.Parameters`; a subclass makes them
    :ivar clock: of the node, and of everything that it uses
    :ivar shut_down: whether the node has been shut down: it does nothing any more
    """

    shut_down = False
    parameters: Any

    def __init__(self, name: str, namespace: str = ''):
        self._made: list[object] = []
        self._reports: list[Callable[[], None]] = []
        middleware = current()
        self.participant: Participant = middleware.join(self)
        self.clock = self.participant.clock
        super().__init__(name, namespace=namespace or None, **middleware.options())
        answered_transitions(self)

    def configure(self) -> None:
        """Create everything; after an exception the node stays unconfigured."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self) -> None:
        """Stop working."""

    def cleanup(self) -> None:
        """Destroy everything that was added; parameters can be set again."""
        self.release()
        self.parameters.locked = False

    def destroy_node(self) -> None:
        """Destroy what the node has; nothing of it answers any more."""
        super().destroy_node()
        destroy_rest(self)

    def add_publisher(self, kind: Any, topic: str, depth: int, late: bool = False) -> Publisher:
        """
        Reliable publisher; `release` destroys it. Its QoS can be overridden.

        :param late: late subscribers get the last messages too (transient local)
        """
        return self._own(self.participant.publisher(
            kind, topic, latched(depth) if late else reliable(depth)))

    def add_subscription(self, kind: Any, topic: str, callback: Callable[[Any], None] | None,
                         depth: int = 1, late: bool = False) -> Subscription:
        """
        Reliable subscription; without a callback, messages are taken from it.

        :param late: receive the last messages from before too (transient local)
        """
        return self._own(self.participant.subscription(
            kind, topic, latched(depth) if late else reliable(depth), callback))

    def add_sensor(self, kind: Any, topic: str, depth: int = 1) -> Subscription:
        """Subscription to what is measured: the newest, also of best-effort publishers."""
        return self._own(self.participant.subscription(kind, topic, best_effort(depth), None))

    def add_service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any],
                    concurrent: bool = False) -> None:
        """
        Service ``~/name``.

        :param concurrent: others are called while it awaits something
        """
        self._own(self.participant.service(kind, f'~/{name}', callback, concurrent))

    def add_client(self, kind: Any, name: str) -> ServiceClient:
        """Client of a service; `release` destroys it."""
        return self._own(self.participant.client(kind, name))

    def add_action(self, kind: Any, name: str, execute: Callable[[Any], Any],
                   accept: Callable[[Any], bool], cancel: bool) -> None:
        """
        Action; see `Participant.action`.

        :param cancel: whether its goals may be cancelled
        """
        self._own(self.participant.action(kind, name, execute, accept, lambda: cancel))

    def add_report(self, callback: Callable[[], None]) -> None:
        """Call ``callback`` ten times a second (by `gdmp_ros.ros.running`), until `release`."""
        self._reports.append(callback)

    def _own(self, entity: Any) -> Any:
        self._made.append(entity)
        return entity

    def report(self) -> None:
        """Call what `add_report` added."""
        for callback in tuple(self._reports):
            callback()

    def release(self) -> None:
        """Destroy everything that was added."""
        self._reports.clear()
        for result in self._made:
            self.participant.destroy(result)
        self._made.clear()

    def create_subscription(self, msg_type: Any, topic: str, callback: Callable[[Any], None],
                            qos_profile: Any, **options: Any) -> Any:
        """Create a subscription; that of rclpy itself to /clock goes through `participant`."""
        if msg_type is ClockMessage and 'raw' not in options:
            return self.subscribe_clock(topic, callback, qos_profile)
        return super().create_subscription(msg_type, topic, callback, qos_profile, **options)

    def subscribe_clock(self, topic: str, callback: Callable[[Any], None], quality: Any
                        ) -> Subscription:
        """
        Subscribe to simulated time.

        :param callback: sets the time of the node
        """
        return self.participant.subscription(ClockMessage, topic, quality, callback)

    def destroy_subscription(self, subscription: Any) -> bool:
        """Destroy a subscription; rclpy ends that to /clock."""
        if isinstance(subscription, Subscription):
            self.participant.destroy(subscription)
            return True
        return bool(super().destroy_subscription(subscription))

    def get_logger(self) -> Any:
        """Where the node logs."""
        return self.participant.logger or super().get_logger()

    def time_ns(self) -> int:
        """Time of stamps: simulated time if it is used, otherwise wall time [ns]."""
        ros: Any = self.get_clock()
        return int(ros.now().nanoseconds) if ros.ros_time_is_active else self.clock.wall()

    def stamp(self) -> Time:
        """`time_ns` as a message."""
        return stamp_of(self.time_ns())

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        with compilation_reported(self.get_logger().info):
            result = self._attempt('configure', self.configure)
        if result != TransitionCallbackReturn.SUCCESS:
            self._attempt('cleanup', self.cleanup)
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        result = self._attempt('activate', self.activate)
        if result != TransitionCallbackReturn.SUCCESS:
            self._attempt('deactivate', self.deactivate)
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt('deactivate', self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._attempt('cleanup', self.cleanup)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.shut_down = True
        self._attempt('deactivate', self.deactivate)
        return self._attempt('cleanup', self.cleanup)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._attempt('deactivate', self.deactivate)
        return self._attempt('cleanup', self.cleanup)

    def _attempt(self, name: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        # rclpy drops exceptions here silently.
        try:
            action()
        except GdmpError as error:
            self.get_logger().error(f'{name}: {error}')
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self.get_logger().error(f'{name}: {type(error).__name__}: {error}')
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def take_down(self) -> None:
        """Deactivate and clean up, in any state."""
        self._attempt('deactivate', self.deactivate)
        self._attempt('cleanup', self.cleanup)

    def autostart(self) -> bool:
        """Configure and activate; False after a failure, which is logged."""
        success = TransitionCallbackReturn.SUCCESS
        return bool(self.trigger_configure() == success and self.trigger_activate() == success)

    def future(self) -> Future:
        """A future that a callback may await."""
        return self.participant.future()

    async def wait_until(self, condition: Callable[[], bool], period_s: float = 0.1,
                         timeout_s: float = math.inf) -> None:
        """Let other callbacks run until a condition holds, or the time is over."""
        done, clock = self.future(), self.clock
        latest = clock.now() / NS + timeout_s

        def check() -> None:
            if not done.done() and (condition() or clock.now() / NS > latest):
                done.set_result(True)

        timer = self.participant.timer(period_s, check)
        await done
        self.participant.destroy(timer)

    def loop_began(self, scheduler: str) -> None:
        """Let messages have real-time priority if the loop has it, and log whether it has."""
        if scheduler == 'fifo':
            self.participant.precede()
            self.get_logger().info('the 1 kHz thread runs with SCHED_FIFO')
        else:
            self.get_logger().warning(
                'the 1 kHz thread has normal priority: the system does not grant SCHED_FIFO '
                '(or realtime_priority is 0); expect late ticks under load')


class Stream:
    """
    Messages that differ in numbers, stamp and integers only (`SerializedTemplate.bytes`).

    :ivar publisher: of them
    :ivar template: of them
    :ivar has_subscribers: result of the last `check`; without subscribers nothing need be
        published, because the topics are volatile
    """

    def __init__(self, publisher: Publisher, template: SerializedTemplate):
        self.publisher, self.template = publisher, template
        self.has_subscribers = False

    def check(self) -> None:
        """Find out whether there are subscribers."""
        self.has_subscribers = self.publisher.subscribers() > 0

    def publish(self, numbers: np.ndarray, stamp_ns: int = 0, *integers: int) -> None:
        """Publish; only useful if it `has_subscribers`."""
        self.publisher.send(self.template.bytes(numbers, stamp_ns, *integers))


def check_subscribers(*streams: Stream) -> None:
    """`Stream.check` of several streams."""
    for stream in streams:
        stream.check()


def pose_stream(node: ManagedNode, topic: str, frame: str) -> Stream:
    """Stream of poses (x, y, z, qw, qx, qy, qz) as PoseStamped."""
    message = PoseStamped()
    message.header.frame_id = frame
    return Stream(node.add_publisher(PoseStamped, topic, 10),
                  SerializedTemplate(message, 7, fill_pose_stamped))


def joints_stream(node: ManagedNode, topic: str, names: Sequence[str]) -> Stream:
    """Stream of positions, velocities and torques (one after the other) as JointState."""
    fields = ('position', 'velocity', 'effort')

    def fill(message: JointState, numbers: np.ndarray) -> None:
        for field, row in zip(fields, numbers.reshape(len(fields), -1)):
            setattr(message, field, row.tolist())
    return Stream(node.add_publisher(JointState, topic, 10),
                  SerializedTemplate(JointState(name=list(names)), len(fields) * len(names), fill))


def stiffness_stream(node: ManagedNode, topic: str) -> Stream:
    """Stream of 6×6 matrices, row by row."""
    return Stream(node.add_publisher(Float64MultiArray, topic, 10),
                  SerializedTemplate(matrix_message(6), 36, fill_matrix))
