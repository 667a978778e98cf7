"""What connects a node with others: topics, services, actions, timers."""
from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any, NamedTuple, Protocol

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future

from gdmp_ros.errors import DataError
from gdmp_ros.realtime.loop import Clock, NS, RunningLoop

#: History for topics of which every message must arrive. Under load a history of 10 loses 14 %.
DEEP = 2000
#: History of /clock: each message is a tick.
CLOCK_DEPTH = 200
#: A node that publishes, and whose name is not discovered yet.
ANOTHER_NODE = 'another node'


def reliable(depth: int) -> QoSProfile:
    """Reliable, volatile, keep last ``depth``."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth,
                      reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)


def best_effort(depth: int) -> QoSProfile:
    """As `reliable`, without repetition: publishers of either kind are heard."""
    quality = reliable(depth)
    quality.reliability = ReliabilityPolicy.BEST_EFFORT
    return quality


def latched(depth: int) -> QoSProfile:
    """As `reliable`; late subscribers get the last messages too (transient local)."""
    quality = reliable(depth)
    quality.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return quality


def end_goal(handle: Any, success: bool) -> None:
    """Tell the client of an action how its goal ended."""
    if success:
        handle.succeed()
    elif handle.is_cancel_requested:
        handle.canceled()
    else:
        handle.abort()


def deserialized(data: bytes, kind: Any) -> Any:
    """
    Read a serialised message.

    :raises DataError: if it is not one of this type
    """
    try:
        return deserialize_message(data, kind)
    except (RuntimeError, MemoryError) as error:
        raise DataError(f'not a {kind.__name__}: {error}') from None


class Received(NamedTuple):
    """
    A message that has come.

    :ivar published: when it was published, wall time [ns]
    :ivar arrived: when it arrived, wall time [ns]; 0 if that is not known
    """

    data: bytes
    published: int
    arrived: int


class Publisher(ABC):
    """Sends the messages of a topic."""

    def __init__(self, kind: Any, topic: str):
        """
        Prepare.

        :param kind: class of the messages
        :param topic: its full name
        """
        self.kind, self.topic = kind, topic

    def in_use(self) -> AbstractContextManager[int]:
        """The address of the publisher of rcl, which exists meanwhile; 0 without rcl."""
        return nullcontext(0)

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Send a serialised message."""

    @abstractmethod
    def subscribers(self) -> int:
        """Number of subscriptions to the topic."""

    def publish(self, message: Any) -> None:
        """Serialise a message and send it."""
        self.send(serialize_message(message))


class Subscription(ABC):
    """Receives the messages of a topic; with a callback they are not taken here."""

    def __init__(self, clock: Clock, kind: Any, topic: str, refused: Callable[[str], None]):
        """
        Prepare; see `Publisher`.

        :param refused: gets why a message is dropped that is not one of the type
        """
        self.kind, self.topic = kind, topic
        self._clock, self._refused = clock, refused

    def in_use(self) -> AbstractContextManager[int]:
        """The address of the subscription of rcl, which exists meanwhile; 0 without rcl."""
        return nullcontext(0)

    @abstractmethod
    def take(self) -> Received | None:
        """The next message; None if there is none."""

    def newest(self) -> Received | None:
        """The newest message, the others are dropped; None if there is none."""
        newest = None
        while (received := self.take()) is not None:
            newest = received
        return newest

    def discard(self) -> None:
        """Drop the messages that have come."""
        self.newest()

    def take_message(self) -> Any | None:
        """As `take`, deserialised; what is not a message of the type is dropped."""
        while (received := self.take()) is not None:
            message = self.message_of(received.data)
            if message is not None:
                return message
        return None

    def newest_message(self) -> Any | None:
        """As `newest`, deserialised; None if it is not a message of the type."""
        received = self.newest()
        return None if received is None else self.message_of(received.data)

    def message_of(self, data: bytes) -> Any | None:
        """Deserialise a message; None, and reported, if it is not one of the type."""
        try:
            return deserialized(data, self.kind)
        except DataError as error:
            self._refused(f'{self.topic}: {error}')
            return None

    def age(self, received: Received) -> float:
        """Time since a message arrived [s]; 0 if that is not known."""
        return max(0.0, (self._clock.wall() - received.arrived) / NS) if received.arrived else 0.0


class ServiceClient(Protocol):
    """Calls a service; the client of rclpy, or one with these methods."""

    srv_type: Any
    srv_name: str

    def service_is_ready(self) -> bool:
        """Whether a node offers the service."""

    def call_async(self, request: Any) -> Future:
        """Call it; the future gets the reply."""

    def remove_pending_request(self, future: Future) -> None:
        """Do not wait for a reply any more."""


class ActionClient(Protocol):
    """Sends goals to an action; the client of rclpy, or one with these methods."""

    def server_is_ready(self) -> bool:
        """Whether a node offers the action."""

    def send_goal_async(self, goal: Any, feedback_callback: Callable[[Any], None] | None = None
                        ) -> Future:
        """Send a goal; the future gets its handle, which knows whether it was accepted."""


class Participant(Protocol):
    """
    A node among others.

    Names are relative to the node; ``~/x`` is below its own name.

    :ivar clock: of the node, and of what it uses
    :ivar logger: where the node logs, instead of the logger of rclpy; None for that
    """

    clock: Clock
    logger: Any

    def publisher(self, kind: Any, topic: str, quality: QoSProfile) -> Publisher:
        """Publish on a topic."""

    def subscription(self, kind: Any, topic: str, quality: QoSProfile,
                     callback: Callable[[Any], None] | None = None) -> Subscription:
        """
        Subscribe to a topic.

        :param callback: gets each message as it comes; without one, messages are taken
        """

    def follow(self, subscription: Subscription, step: Callable[[Any], None], priority: int
               ) -> RunningLoop:
        """
        Call ``step`` with each message of a subscription without a callback, in a loop of its own.

        Messages from before are dropped.
        """

    def service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any],
                concurrent: bool = False) -> object:
        """
        Offer a service.

        :param callback: gets request and reply, and returns the reply; it may be asynchronous
        :param concurrent: others are called while it awaits something
        """

    def client(self, kind: Any, name: str) -> ServiceClient:
        """Use a service."""

    def action(self, kind: Any, name: str, execute: Callable[[Any], Any],
               accept: Callable[[Any], bool], cancel: Callable[[], bool]) -> object:
        """
        Offer an action.

        :param execute: asynchronous; gets the handle of a goal, and returns its result
        :param accept: whether a goal is accepted
        :param cancel: whether a goal may be cancelled
        """

    def action_client(self, kind: Any, name: str) -> ActionClient:
        """Use an action."""

    def timer(self, period_s: float, callback: Callable[[], None]) -> object:
        """Call something periodically, on the steady clock."""

    def future(self) -> Future:
        """A future that a callback may await."""

    def destroy(self, entity: object) -> None:
        """Destroy what was made here."""

    def precede(self) -> None:
        """Let messages arrive in time although other processes keep the cores busy."""

    def publishers(self, topic: str) -> list[str]:
        """Names of the known nodes that publish a topic, or `ANOTHER_NODE`; sorted."""

    def nodes(self) -> list[str]:
        """Names of the known nodes, with their namespaces; each as often as there are nodes."""


class ClientParticipant(Participant, Protocol):
    """
    A participant that is no managed node, and whose callbacks run in `spin`.

    :ivar name: of its node, with the namespace
    """

    name: str

    def spin(self, seconds: float) -> None:
        """Run what is to be done, or let at most this time pass."""

    def close(self) -> None:
        """Leave, with everything that was made here."""


class Middleware(Protocol):
    """
    What nodes and clients join.

    :ivar clock: of all of them
    """

    clock: Clock

    def options(self) -> Mapping[str, Any]:
        """Arguments for the constructor of a node of rclpy."""

    def join(self, node: Any) -> Participant:
        """Let a node of rclpy take part; called before its constructor."""

    def client(self, name: str) -> ClientParticipant:
        """Let a client take part."""


