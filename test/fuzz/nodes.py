"""Nodes of this process in lockstep, each alone in a network through which anything may come."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.serialization import deserialize_message

from gdmp_ros.ros.clients.testbed import ARM, MODULES, SERVER
from test.lockstep.bed import isolated_context
from test.lockstep.children import LockstepChildren
from test.lockstep.network import MemoryPublisher, Network

MODULE = {**MODULES, 'visualizer': 'gdmp_ros.ros.visualizer.node',
          'adapter': 'gdmp_ros.ros.adapter'}
#: Time for a node to become active, and after each input [s].
START_S, STEP_S = 1.0, 0.002


class FuzzedNode:
    """
    A node.

    :ivar node: the node itself
    """

    def __init__(self, name: str, **parameters: Any):
        self._network, self._problems = Network(isolated_context()), []
        children = LockstepChildren(self._network)
        children.start_node(name, MODULE[name], parameters)
        self._check, self.node = children.check, children.node(name)
        self._outside, self._publishers = self._network.client('outside'), {}
        self.node.participant.executor.problem = self._problems.append
        self.pass_time(START_S)
        for one in list(self.node.participant.made):
            if isinstance(one, MemoryPublisher):  # it makes no message if nobody listens
                self._outside.subscription(one.kind, one.topic, one.quality)

    def pass_time(self, seconds: float = STEP_S) -> None:
        """Let the node work; raises what it should not raise."""
        clock = self._network.clock
        clock.run_until(clock.now() + round(1e9 * seconds))
        self._check()
        if self._problems:
            raise self._problems.pop()

    def stamp(self) -> int:
        """Present time for stamps [ns]."""
        return self._network.clock.wall()

    def send(self, kind: Any, topic: str, data: bytes, takes: bool = True) -> None:
        """
        Bring data to a topic.

        :param takes: whether the node takes serialised messages; otherwise the middleware does
            not hand on what is no message
        """
        if not takes and not _is_message(data, kind):
            return
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._publishers[topic] = self._outside.publisher(
                kind, self.node.resolve_topic_name(topic), _like(self.node, topic))
        publisher.send(data)
        self.pass_time()

    def request(self, kind: Any, name: str, data: bytes) -> None:
        """Bring a serialised request to a service."""
        if _is_message(data, kind.Request):
            client = self._outside.client(kind, self.node.resolve_topic_name(name))
            client.call_async(deserialize_message(data, kind.Request))
            self.pass_time()

    def goal(self, kind: Any, name: str, data: bytes) -> None:
        """Bring a serialised goal to an action."""
        if _is_message(data, kind.Goal):
            client = self._outside.action_client(kind, self.node.resolve_topic_name(name))
            client.send_goal_async(deserialize_message(data, kind.Goal))
            self.pass_time()


def _like(node: Any, topic: str) -> Any:
    """Quality of service of the node's own subscription."""
    name = node.resolve_topic_name(topic)
    return next(one.quality for one in node.participant.made
                if one.topic == name and hasattr(one, 'quality'))


def _is_message(data: bytes, kind: Any) -> bool:
    try:
        deserialize_message(data, kind)
    except Exception:
        return False
    return True


_made: dict[str, FuzzedNode] = {}


def fuzzed(name: str, make: Callable[[], FuzzedNode]) -> FuzzedNode:
    """The node of a name, which is made once."""
    if name not in _made:
        _made[name] = make()
    return _made[name]


def adapter() -> FuzzedNode:
    """The adapter."""
    return fuzzed('adapter', lambda: FuzzedNode('adapter'))


def simulation() -> FuzzedNode:
    """The simulated arm."""
    return fuzzed(ARM, lambda: FuzzedNode(ARM))


def visualizer() -> FuzzedNode:
    """The visualizer."""
    return fuzzed('visualizer', lambda: FuzzedNode('visualizer'))


def server(skill: Callable[[], str], name: str = SERVER, **parameters: Any) -> FuzzedNode:
    """
    A trajectory server that needs no robot.

    :param skill: file of its skill
    """
    return fuzzed(name, lambda: FuzzedNode(SERVER, skill=skill(), start_from='skill',
                                           **parameters))
