"""Base of clients of the nodes: waiting with a timeout, service calls."""
from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from gdmp_ros.errors import GdmpError

#: Wait before the first call of a service [s]: a reply is lost if the server has not found the
#: client yet, and a client cannot find out whether it has.
DISCOVERY_S = 0.5
#: Largest time for the start of a node [s]; it includes the compilation of the kernels.
START_UP_S = 120.0


class Client:
    """A node with its own context that receives messages while it waits."""

    def __init__(self, name: str, check: Callable[[], None] | None = None):
        """:param check: called while waiting; may raise an exception"""
        self._check = check or (lambda: None)
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = Node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._services: dict[str, Any] = {}

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait(self, what: str, until: Callable[[], bool], timeout: float) -> None:
        """
        Wait until a condition holds.

        :raises GdmpError: after ``timeout`` seconds
        """
        ends = time.monotonic() + timeout
        while not until():
            if time.monotonic() > ends:
                raise GdmpError(f'waited {timeout:g} s for {what}, without success')
            self._check()
            self._executor.spin_once(timeout_sec=0.02)

    def spend(self, seconds: float) -> None:
        """Let time pass while messages are received."""
        ends = time.monotonic() + seconds
        while (left := ends - time.monotonic()) > 0.0:
            self._check()
            self._executor.spin_once(timeout_sec=min(left, 0.02))

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service and return its reply."""
        if name not in self._services:
            client = self.node.create_client(kind, name)
            self.wait(f'the service {name}', client.service_is_ready, START_UP_S)
            self.spend(DISCOVERY_S)
            self._services[name] = client
        future = self._services[name].call_async(kind.Request(**fields))
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
