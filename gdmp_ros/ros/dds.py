"""The middleware of ROS: rclpy over DDS. What leans on the inside of rclpy is here."""
from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
import os
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock as RosClock
from rclpy.clock import ClockType
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    SingleThreadedExecutor,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from gdmp_ros.realtime.loop import Clock, Loop, RunningLoop, SystemClock
from gdmp_ros.ros.middleware import (
    ANOTHER_NODE,
    ClientParticipant,
    Middleware,
    Participant,
    Publisher,
    Received,
    ServiceClient,
    Subscription,
)
from gdmp_ros.util.processes import held_interrupts, thread_names

#: Longest wait for a message before a loop looks whether it is to end [ns].
WAIT_NS = 50_000_000
#: Name of a node that is not discovered yet, as rclpy reports it.
_NAMELESS = '_NODE_NAME_UNKNOWN_'
#: How the names of the threads of Fast DDS begin.
_THREADS = 'dds.'
#: SCHED_FIFO priority of the threads that receive and send messages: below that of the loops.
MESSAGE_PRIORITY = 35
_CLOCK = SystemClock()


class _PolledGroup(CallbackGroup):
    """
    Callback group for subscriptions that the executor ignores.

    With polling a flood of messages costs little; an executor would wake up for each of them.
    """

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


class _Publisher(Publisher):
    def __init__(self, inner: Any):
        super().__init__(inner.msg_type, inner.topic_name)
        self.made = inner

    def in_use(self) -> AbstractContextManager[int]:
        return _in_use(self.made)

    def send(self, data: bytes) -> None:
        # `Publisher.publish` looks for the type of the message first: that takes a microsecond.
        self.made.handle.publish_raw(data)

    def subscribers(self) -> int:
        return int(self.made.get_subscription_count())


class _Subscription(Subscription):
    def __init__(self, clock: Clock, node: Node, callback: Callable[[Any], None] | None,
                 kind: Any, topic: str, quality: QoSProfile):
        super().__init__(clock, kind, node.resolve_topic_name(topic), lambda why: (
            node.get_logger().warning(why, throttle_duration_sec=1.0)))
        self._callback = callback
        self.made = node.create_subscription(
            kind, topic, self._call, quality, raw=True,
            callback_group=None if callback else _PolledGroup(),
            qos_overriding_options=QoSOverridingOptions.with_default_policies())

    def _call(self, data: bytes) -> None:
        message = self.message_of(data)
        if self._callback is not None and message is not None:
            self._callback(message)

    def in_use(self) -> AbstractContextManager[int]:
        return _in_use(self.made)

    def take(self) -> Received | None:
        handle = self.made.handle
        with handle:
            taken = handle.take_message(self.kind, True)
        if taken is None:
            return None
        data, about = taken
        return Received(data, about['source_timestamp'], about['received_timestamp'])


@contextmanager
def _in_use(made: Any) -> Iterator[int]:
    """Keep what rclpy has made, and give its address; 0 if this version does not tell it."""
    handle = made.handle
    with handle:
        yield int(getattr(handle, 'pointer', 0))


class DdsParticipant:
    """A node of rclpy; see `Participant`."""

    logger = None

    def __init__(self, node: Node, clock: Clock = _CLOCK):
        self.clock, self._node = clock, node

    def publisher(self, kind: Any, topic: str, quality: QoSProfile) -> Publisher:
        return _Publisher(self._node.create_publisher(
            kind, topic, quality,
            qos_overriding_options=QoSOverridingOptions.with_default_policies()))

    def subscription(self, kind: Any, topic: str, quality: QoSProfile,
                     callback: Callable[[Any], None] | None = None) -> Subscription:
        return _Subscription(self.clock, self._node, callback, kind, topic, quality)

    def follow(self, subscription: Subscription, step: Callable[[Any], None], priority: int
               ) -> RunningLoop:
        subscription.discard()
        return self.clock.start(self._following(subscription, step), priority)

    def _following(self, subscription: Any, step: Callable[[Any], None]) -> Loop:
        waiting = rclpy_implementation.WaitSet(1, 0, 0, 0, 0, 0, self._node.context.handle)
        while True:
            waiting.clear_entities()
            waiting.add_subscription(subscription.made.handle)
            waiting.wait(WAIT_NS)
            while (message := subscription.take_message()) is not None:
                step(message)
                yield 0
            yield 0

    def service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any],
                concurrent: bool = False) -> object:
        return self._node.create_service(
            kind, name, callback,
            callback_group=ReentrantCallbackGroup() if concurrent else None)

    def client(self, kind: Any, name: str) -> ServiceClient:
        result: ServiceClient = self._node.create_client(kind, name)
        return result

    def action(self, kind: Any, name: str, execute: Callable[[Any], Any],
               accept: Callable[[Any], bool], cancel: Callable[[], bool]) -> object:
        return ActionServer(
            self._node, kind, name, execute,
            goal_callback=lambda goal: (GoalResponse.ACCEPT if accept(goal)
                                        else GoalResponse.REJECT),
            cancel_callback=lambda _: (CancelResponse.ACCEPT if cancel()
                                       else CancelResponse.REJECT))

    def action_client(self, kind: Any, name: str) -> Any:
        return ActionClient(self._node, kind, name)

    def timer(self, period_s: float, callback: Callable[[], None]) -> object:
        # On the steady clock: simulated time may stand still.
        return self._node.create_timer(period_s, callback,
                                       clock=RosClock(clock_type=ClockType.STEADY_TIME))

    def future(self) -> Future:
        result: Future = Future(executor=self._node.executor)
        # The executor resumes coroutines when it wakes up; only a future with a callback wakes it.
        result.add_done_callback(lambda _: None)
        return result

    def destroy(self, entity: Any) -> None:
        if isinstance(entity, (ActionServer, ActionClient)):
            entity.destroy()
            return
        node, result = self._node, getattr(entity, 'made', entity)
        for destroy in (node.destroy_publisher, node.destroy_subscription, node.destroy_service,
                        node.destroy_client, node.destroy_timer):
            if destroy(result):
                return

    def precede(self) -> None:
        # Fast DDS names its threads; the system grants what it has granted to the loop.
        for number, name in thread_names().items():
            if name.startswith(_THREADS):
                with suppress(OSError):
                    os.sched_setscheduler(number, os.SCHED_FIFO, os.sched_param(MESSAGE_PRIORITY))

    def publishers(self, topic: str) -> list[str]:
        found = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))
        return sorted(ANOTHER_NODE if each.node_name == _NAMELESS
                      else f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in found)

    def nodes(self) -> list[str]:
        return [f'{space.rstrip("/")}/{name}'
                for name, space in self._node.get_node_names_and_namespaces()]


class DdsClient(DdsParticipant):
    """A participant with a context and an executor of its own; see `ClientParticipant`."""

    def __init__(self, name: str):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node(name, context=self._context)
        super().__init__(self.node)
        self.name = self.node.get_fully_qualified_name()
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        with held_interrupts():
            self._executor.spin_once(timeout_sec=seconds)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        destroy_rest(self.node)
        rclpy.shutdown(context=self._context)


class Dds:
    """The middleware of ROS; see `Middleware`."""

    clock: Clock = _CLOCK

    def options(self) -> Mapping[str, Any]:
        return {}

    def join(self, node: Any) -> Participant:
        return DdsParticipant(node)

    def client(self, name: str) -> ClientParticipant:
        return DdsClient(name)


_used: list[Middleware] = [Dds()]


def current() -> Middleware:
    """The middleware that nodes and clients join: DDS, unless another one is used instead."""
    return _used[-1]


@contextmanager
def using(middleware: Middleware) -> Iterator[None]:
    """Let nodes and clients that are made meanwhile join another middleware."""
    _used.append(middleware)
    try:
        yield
    finally:
        _used.pop()


def answered_transitions(node: Any) -> None:
    """Let ``~/change_state`` answer a transition that is not possible; rclpy raises instead."""
    service = node._service_change_state  # noqa: SLF001  rclpy has no public name for it

    def change(inner: Callable[[Any, Any], Any], request: Any, reply: Any) -> Any:
        try:
            return inner(request, reply)
        except RuntimeError as error:  # of rcl
            known = request.transition.label or request.transition.id
            node.get_logger().warning(f'transition {known}: not possible in this state: {error}')
            reply.success = False
            return reply
    service.callback = partial(change, service.callback)


def destroy_rest(node: Any) -> None:
    """Destroy what `Node.destroy_node` leaves, which would keep the participant."""
    for waitable in list(node.waitables):
        if isinstance(waitable, (ActionServer, ActionClient)):
            waitable.destroy()
    if isinstance(node, LifecycleNode):
        node._state_machine.destroy_when_not_in_use()  # noqa: SLF001  of the lifecycle's services


class CallbackExecutor:
    """Runs the callbacks of nodes, one after the other."""

    #: Raised by `run_next` when it is to end.
    ENDED = (ConditionReachedException, ExternalShutdownException)

    def __init__(self, nodes: Sequence[Node]):
        self._executor = SingleThreadedExecutor()
        for node in nodes:
            self._executor.add_node(node)

    def next(self, ending: Callable[[], bool]) -> Callable[[], None]:
        """
        Wait for a callback, and return a call that runs it.

        :param ending: whether to end instead
        """
        task, _, _ = self._executor.wait_for_ready_callbacks(None, None, ending)

        def call() -> None:
            task()
            error = task.exception()
            if error is not None:
                raise error
        return call

    def wake(self) -> None:
        """Let `next` look whether it is to end."""
        self._executor.wake()

    def close(self) -> None:
        """Shut down; nobody waits in `next`."""
        self._executor.shutdown()
