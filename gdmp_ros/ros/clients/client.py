"""Base of clients of the nodes: waiting with a timeout, service calls."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.dds import current
from gdmp_ros.ros.middleware import Publisher, reliable, ServiceClient, Subscription

#: Wait before the first call of a service [s]: a reply is lost if the server has not found the
#: client yet, and a client cannot find out whether it has.
DISCOVERY_S = 0.5
#: Largest time for the start of a node [s]; it includes the compilation of the kernels.
START_UP_S = 120.0
#: Longest time between two looks at what is waited for [s].
LOOK_S = 0.02


class Client:
    """
    Takes part, and receives messages while it waits.

    :ivar participant: what it offers and uses goes through it
    :ivar clock: of the client
    """

    def __init__(self, name: str, check: Callable[[], None] | None = None):
        """:param check: called while waiting; may raise an exception"""
        self._check = check or (lambda: None)
        self.participant = current().client(name)
        self.clock = self.participant.clock
        self._services: dict[str, ServiceClient] = {}

    def close(self) -> None:
        """Leave."""
        self.participant.close()

    def publisher(self, kind: Any, topic: str, depth: int = 10) -> Publisher:
        """Publish on a topic, reliably."""
        return self.participant.publisher(kind, topic, reliable(depth))

    def subscribe(self, kind: Any, topic: str, callback: Callable[[Any], None] | None = None,
                  depth: int = 10) -> Subscription:
        """
        Subscribe to a topic.

        :param callback: gets each message; without one, messages are taken from the subscription,
            which is fast enough for 1 kHz
        """
        return self.participant.subscription(kind, topic, reliable(depth), callback)

    def now(self) -> float:
        """Steady time [s]."""
        return self.clock.now() / NS

    def wait(self, what: str, until: Callable[[], bool], timeout: float) -> None:
        """
        Wait until a condition holds.

        :raises GdmpError: after ``timeout`` seconds
        """
        ends = self.now() + timeout
        while not until():
            if self.now() > ends:
                raise GdmpError(f'waited {timeout:g} s for {what}, without success')
            self._check()
            self.participant.spin(LOOK_S)

    def spend(self, seconds: float) -> None:
        """Let time pass while messages are received."""
        ends = self.clock.now() + round(seconds * NS)
        while (left := ends - self.clock.now()) > 0:
            self._check()
            self.participant.spin(min(left / NS, LOOK_S))

    def service(self, kind: Any, name: str) -> ServiceClient:
        """
        A service that is ready to be called.

        :raises GdmpError: if no node offers it in time
        """
        if name not in self._services:
            client = self.participant.client(kind, name)
            self.wait(f'the service {name}', client.service_is_ready, START_UP_S)
            self.spend(DISCOVERY_S)
            self._services[name] = client
        return self._services[name]

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service and return its reply."""
        future = self.service(kind, name).call_async(kind.Request(**fields))
        self.wait(f'the reply of {name}', future.done, 60.0)
        return future.result()

    def request(self, kind: Any, name: str, **fields: Any) -> str:
        """
        Call a service.

        :returns: its message
        :raises GdmpError: if it refuses, with the reason
        """
        reply = self.call(kind, name, **fields)
        if not reply.success:
            raise GdmpError(f'{name}: {reply.message}')
        return str(reply.message)
