"""Base of all nodes: lifecycle with logged failures, autostart, QoS."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
import time
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.task import Future

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.polling import PolledGroup
from gdmp_ros.util.compile_progress import compilation_reported

#: History for topics of which every message must arrive. Under load a history of 10 loses 14 %.
DEEP = 2000
#: History of /clock: each message is a tick.
CLOCK_DEPTH = 200
#: A node that publishes, and whose name is not discovered yet.
ANOTHER_NODE, _NAMELESS = 'another node', '_NODE_NAME_UNKNOWN_'
#: Time between two reports of a node, and without one the node counts as silent [s].
REPORT_S, SILENT_S = 0.1, 1.0


def reliable(depth: int) -> QoSProfile:
    """Reliable, volatile, keep last ``depth``."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth,
                      reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)


OVERRIDABLE = QoSOverridingOptions.with_default_policies


def publishers_of(node: Node, topic: str) -> list[str]:
    """Names of the discovered nodes that publish a topic, or `ANOTHER_NODE`."""
    return sorted(ANOTHER_NODE if one.node_name == _NAMELESS
                  else f'{one.node_namespace.rstrip("/")}/{one.node_name}'
                  for one in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)))


class ManagedNode(LifecycleNode):
    """
    A lifecycle node that logs why a transition failed.

    Subclasses implement `configure`, `activate`, `deactivate` and `cleanup`, which raise an
    exception on failure.
    """

    def __init__(self, name: str, namespace: str = ''):
        self._owned: list[tuple[Callable[[Any], Any], Any]] = []
        self._reports: list[Callable[[], None]] = []
        super().__init__(name, namespace=namespace or None)
        change = self._service_change_state
        change.callback = partial(self._change_state, change.callback)

    def _change_state(self, change: Callable[[Any, Any], Any], request: Any, reply: Any) -> Any:
        """Change the state; rclpy does not answer a transition that is not possible now."""
        try:
            return change(request, reply)
        except RuntimeError as error:  # of rcl
            known = request.transition.label or request.transition.id
            self.get_logger().warning(f'transition {known}: not possible in this state: {error}')
            reply.success = False
            return reply

    def configure(self) -> None:
        """Create everything; after an exception the node stays unconfigured."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self) -> None:
        """Stop working."""

    def cleanup(self) -> None:
        """Destroy everything."""

    def add_publisher(self, kind: Any, topic: str, depth: int, latched: bool = False) -> Any:
        """
        Reliable publisher; `release` destroys it. Its QoS can be overridden.

        :param latched: late subscribers get the last messages too (transient local)
        """
        quality = reliable(depth)
        if latched:
            quality.durability = DurabilityPolicy.TRANSIENT_LOCAL
        made = self.create_publisher(kind, topic, quality, qos_overriding_options=OVERRIDABLE())
        self._owned.append((self.destroy_publisher, made))
        return made

    def add_subscription(self, kind: Any, topic: str, callback: Callable[[Any], None] | None,
                         depth: int = 1, raw: bool = False, latched: bool = False) -> Any:
        """
        Reliable subscription; without a callback it is polled (`gdmp_ros.ros.polling`).

        :param raw: receive serialised messages
        :param latched: receive the last messages from before too (transient local)
        """
        quality = reliable(depth)
        if latched:
            quality.durability = DurabilityPolicy.TRANSIENT_LOCAL
        made = self.create_subscription(
            kind, topic, callback or (lambda _: None), quality,
            callback_group=None if callback else PolledGroup(),
            qos_overriding_options=OVERRIDABLE(), raw=raw)
        self._owned.append((self.destroy_subscription, made))
        return made

    def add_service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any],
                    group: CallbackGroup | None = None) -> None:
        """Service ``~/name``."""
        made = self.create_service(kind, f'~/{name}', callback, callback_group=group)
        self._owned.append((self.destroy_service, made))

    def add_client(self, kind: Any, name: str) -> Any:
        """Client of a service; `release` destroys it."""
        made = self.create_client(kind, name)
        self._owned.append((self.destroy_client, made))
        return made

    def add_report(self, callback: Callable[[], None]) -> None:
        """Call ``callback`` ten times a second (by `gdmp_ros.ros.running`), until `release`."""
        self._reports.append(callback)

    def report(self) -> None:
        """Call what `add_report` added."""
        for callback in tuple(self._reports):
            callback()

    def release(self) -> None:
        """Destroy everything that was added."""
        self._reports.clear()
        for destroy, entity in self._owned:
            destroy(entity)
        self._owned.clear()

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

    def autostart(self) -> None:
        """Configure and activate; after a failure, which is logged, the node keeps its state."""
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def wall_timer(self, period_s: float, callback: Callable[[], None]) -> Any:
        """Timer on the steady clock: simulated time may stand still."""
        return self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def future(self) -> Future:
        """A future that a callback may await."""
        made: Future = Future(executor=self.executor)
        # The executor resumes coroutines when it wakes up; only a future with a callback wakes it.
        made.add_done_callback(lambda _: None)
        return made

    async def wait_until(self, condition: Callable[[], bool], period_s: float = 0.1,
                         timeout_s: float = math.inf) -> None:
        """Let the executor work until a condition holds, or the time is over."""
        done = self.future()
        latest = time.monotonic() + timeout_s

        def check() -> None:
            if condition() or time.monotonic() > latest:
                timer.cancel()
                done.set_result(True)

        timer = self.wall_timer(period_s, check)
        await done
        self.destroy_timer(timer)

    def log_scheduler(self, scheduler: str) -> None:
        """Log whether the loop has real-time priority."""
        if scheduler == 'fifo':
            self.get_logger().info('the 1 kHz thread runs with SCHED_FIFO')
        else:
            self.get_logger().warning(
                'the 1 kHz thread has normal priority: the system does not grant SCHED_FIFO '
                '(or realtime_priority is 0); expect late ticks under load')
