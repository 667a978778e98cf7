"""What both nodes share: lifecycle with a log line for every failure, autostart, main, QoS."""
from __future__ import annotations

from collections.abc import Callable, Sequence
import os
import signal
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import rclpy
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions

from gdmp_ros import compilation
from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.statistics import Punctuality
from gdmp_ros.util.dds_network import default_environment
from gdmp_ros.util.processes import stop_event

#: Where every message must arrive, histories this long lose none under load (at 10, 14 %).
DEEP = 2000
#: A burst of /clock that is waited for: each message is a tick.
CLOCK_DEPTH = 200


def reliable(depth: int) -> QoSProfile:
    """Reliable, volatile, keep last ``depth``."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth,
                      reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)


OVERRIDABLE = QoSOverridingOptions.with_default_policies


class PolledGroup(CallbackGroup):
    """Subscriptions in this group are left to `take_latest`; the executor never wakes for them."""

    def can_execute(self, entity: Any) -> bool:
        """Never by the executor."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never by the executor."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing to do."""


def take(subscription: Any) -> Any | None:
    """Next message of a polled subscription (bytes if raw), None where there is none."""
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    return None if taken is None else taken[0]


def take_latest(subscription: Any) -> Any | None:
    """Newest message of a polled subscription, None where there is none."""
    latest = None
    while (message := take(subscription)) is not None:
        latest = message
    return latest


class ManagedNode(LifecycleNode):
    """
    A lifecycle node that says why a transition failed.

    Subclasses implement `configure`, `activate`, `deactivate` and `cleanup`, which raise on
    failure.
    """

    def __init__(self, name: str, namespace: str = ''):
        self._held: list[tuple[Callable[[Any], Any], Any]] = []
        super().__init__(name, namespace=namespace or None)

    def configure(self) -> None:
        """Acquire everything; on an exception the node stays unconfigured."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self) -> None:
        """Stop working."""

    def cleanup(self) -> None:
        """Release everything."""

    def add_publisher(self, kind: Any, topic: str, depth: int, latched: bool = False) -> Any:
        """
        Reliable publisher that `release` takes down; its QoS can be overridden.

        :param latched: who comes later gets the last messages too (transient local)
        """
        quality = reliable(depth)
        if latched:
            quality.durability = DurabilityPolicy.TRANSIENT_LOCAL
        made = self.create_publisher(kind, topic, quality, qos_overriding_options=OVERRIDABLE())
        self._held.append((self.destroy_publisher, made))
        return made

    def add_subscription(self, kind: Any, topic: str, callback: Callable[[Any], None] | None,
                         depth: int = 1) -> Any:
        """Reliable subscription; without a callback it is left to `take_latest`."""
        made = self.create_subscription(
            kind, topic, callback or (lambda _: None), reliable(depth),
            callback_group=None if callback else PolledGroup(),
            qos_overriding_options=OVERRIDABLE())
        self._held.append((self.destroy_subscription, made))
        return made

    def publishers(self, topic: str) -> list[str]:
        """Names of the nodes that publish a topic, as far as they have been discovered."""
        found = self.get_publishers_info_by_topic(self.resolve_topic_name(topic))
        return sorted(f'{one.node_namespace.rstrip("/")}/{one.node_name}' for one in found)

    def add_service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any],
                    group: CallbackGroup | None = None) -> None:
        """Service ``~/name``."""
        made = self.create_service(kind, f'~/{name}', callback, callback_group=group)
        self._held.append((self.destroy_service, made))

    def add_client(self, kind: Any, name: str) -> Any:
        """Client of a service that `release` takes down."""
        made = self.create_client(kind, name)
        self._held.append((self.destroy_client, made))
        return made

    def add_report(self, callback: Callable[[], None]) -> None:
        """Call ``callback`` ten times a second."""
        self._held.append((self.destroy_timer, self.wall_timer(0.1, callback)))

    def release(self) -> None:
        """Take down everything that was added."""
        for destroy, entity in self._held:
            destroy(entity)
        self._held.clear()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
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
        self._attempt('deactivate', self.deactivate)
        return self._attempt('cleanup', self.cleanup)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._attempt('deactivate', self.deactivate)
        return self._attempt('cleanup', self.cleanup)

    def _attempt(self, name: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        # rclpy swallows exceptions here without a word.
        try:
            action()
        except GdmpError as error:
            self.get_logger().error(f'{name}: {error}')
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self.get_logger().error(f'{name}: {type(error).__name__}: {error}')
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def expect_compilation(self) -> None:
        """Say what takes long where the kernels have not been compiled yet."""
        if not compilation.compiled_before():
            self.get_logger().info('compiling the kernels for the first time: this takes a minute '
                                   'or two')

    def autostart(self) -> None:
        """Configure and activate; a failure has been logged and leaves the node where it was."""
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def wall_timer(self, period_s: float, callback: Callable[[], None]) -> Any:
        """Timer on the machine's clock: a simulated clock may stand still."""
        return self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def log_scheduler(self, scheduler: str) -> None:
        """Say whether the loop has real-time priority."""
        if scheduler == 'fifo':
            self.get_logger().info('the 1 kHz thread runs with SCHED_FIFO')
        else:
            self.get_logger().warning(
                'the 1 kHz thread has ordinary priority: the system does not grant SCHED_FIFO '
                '(or realtime_priority is 0); expect late ticks under load')


def lateness_diagnostics(node: str, level: bytes, message: str, figures: Punctuality,
                         extra: dict[str, object], stamp: Any) -> DiagnosticArray:
    """Build the /diagnostics message of a node with a loop."""
    values = {'rate [Hz]': f'{figures.rate_hz:.1f}', 'ticks': figures.ticks,
              'missed ticks': figures.missed, 'lateness p50 [us]': f'{figures.p50_us:.0f}',
              'lateness p99 [us]': f'{figures.p99_us:.0f}',
              'lateness max [us]': f'{figures.max_us:.0f}', **extra}
    status = DiagnosticStatus(level=level, name=f'{node}: stream', message=message,
                              hardware_id='gdmp_ros')
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    result = DiagnosticArray(status=[status])
    result.header.stamp = stamp
    return result


def _spin(executor: SingleThreadedExecutor, node: ManagedNode) -> None:
    """Let the executor work for a while; a callback that breaks down does not end the node."""
    try:
        executor.spin_once(timeout_sec=0.2)
    except ExternalShutdownException:
        raise
    except Exception as error:  # rclpy itself breaks down at times, on a negative /clock for one
        node.get_logger().error(f'a callback failed: {type(error).__name__}: {error}',
                                throttle_duration_sec=1.0)


def own_words(arguments: Sequence[str] | None = None) -> list[str]:
    """Words of the command line, or those given, that are not ROS's."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    return words[:words.index('--ros-args')] if '--ros-args' in words else words


def run(makes: Sequence[Callable[[], ManagedNode]],
        arguments: Sequence[str] | None = None) -> int:
    """
    Run nodes until Ctrl-C or SIGTERM, then deactivate them properly.

    Who can reach them: `gdmp_ros.util.dds_network.network`.

    :returns: exit code
    """
    os.environ.update(default_environment())
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    stop = stop_event()
    try:
        nodes = [make() for make in makes]
    except (GdmpError, ValueError) as error:
        print(f'error: {error}', file=sys.stderr)
        rclpy.shutdown()
        return 2
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        for node in nodes:
            if node.get_parameter('autostart').value:
                node.autostart()
        while rclpy.ok() and not stop.is_set():
            _spin(executor, nodes[0])
    except ExternalShutdownException:
        pass
    finally:
        for node in nodes:
            node._attempt('deactivate', node.deactivate)
            node._attempt('cleanup', node.cleanup)
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()
        # Another Ctrl-C while the interpreter ends would be told as a crash.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    return 0
