"""Client of a trajectory server: executes its skill, switches the goal, waits."""
from __future__ import annotations

from collections.abc import Callable, Mapping
import sys
from typing import Any, TypeVar

from action_msgs.msg import GoalStatus
from gdmp_msgs.action import ExecuteSequence, ExecuteSkill
from gdmp_msgs.msg import Context, ServerState
from gdmp_msgs.srv import RefineSkill
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_msgs.msg import Float64, Float64MultiArray, String

from gdmp_ros.data.sequences import read_sequence
from gdmp_ros.errors import GdmpError
from gdmp_ros.learning.correction import FollowedMotion
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros import messages
from gdmp_ros.ros.dds import current
from gdmp_ros.ros.middleware import (
    ActionClient,
    latched,
    Publisher,
    reliable,
    ServiceClient,
    Subscription,
)

#: Wait before the first call of a service [s]: a reply is lost if the server has not found the
#: client yet, and a client cannot find out whether it has.
DISCOVERY_S = 0.5
#: Largest time for the start of a node [s]; it includes the compilation of the kernels.
START_UP_S = 120.0
#: Longest time between two looks at what is waited for [s].
LOOK_S = 0.02
#: Name of the node of a `ServerClient`.
CLIENT = 'server_client'
#: Interval at which a wait is reported [s].
REPORT_S = 2.0
#: Client of a service or of an action.
Offer = TypeVar('Offer', ServiceClient, ActionClient)


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
        self._offers: dict[str, Any] = {}

    def close(self) -> None:
        """Leave."""
        self.participant.close()

    def publisher(self, kind: Any, topic: str, depth: int = 10) -> Publisher:
        """Publish on a topic, reliably."""
        return self.participant.publisher(kind, topic, reliable(depth))

    def subscribe(self, kind: Any, topic: str, callback: Callable[[Any], None] | None = None,
                  depth: int = 10, late: bool = False) -> Subscription:
        """
        Subscribe to a topic.

        :param callback: gets each message; without one, messages are taken from the subscription,
            which is fast enough for 1 kHz
        :param late: receive the last messages from before too (transient local)
        """
        return self.participant.subscription(
            kind, topic, latched(depth) if late else reliable(depth), callback)

    def now(self) -> float:
        """Steady time [s]."""
        return self.clock.now() / NS

    def wait(self, what: str, until: Callable[[], bool], timeout: float,
             silent: bool = False, why: Callable[[], str] = str) -> None:
        """
        Wait until a condition holds; say so on standard error every two seconds.

        :param silent: say nothing
        :param why: what is known of the reason
        :raises GdmpError: after ``timeout`` seconds
        """
        began, said = self.now(), 0.0
        while not until():
            waited = self.now() - began
            if waited > timeout:
                raise GdmpError(f'waited {timeout:g} s for {what}, without success{_after(why())}')
            if waited - said >= REPORT_S and not silent:
                said = waited
                print(f'waiting for {what}, {waited:.0f} s{_after(why())}', file=sys.stderr,
                      flush=True)
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
        return self._offer(f'the service {name}', lambda: self.participant.client(kind, name),
                           lambda client: client.service_is_ready())

    def action(self, kind: Any, name: str) -> ActionClient:
        """
        An action that is ready for a goal.

        :raises GdmpError: if no node offers it in time
        """
        return self._offer(f'the action {name}',
                           lambda: self.participant.action_client(kind, name),
                           lambda client: client.server_is_ready())

    def _offer(self, what: str, make: Callable[[], Offer], ready: Callable[[Offer], bool]
               ) -> Offer:
        """What another node offers, made and waited for once."""
        if what not in self._offers:
            client = make()
            self.wait(what, lambda: ready(client), START_UP_S)
            self.spend(DISCOVERY_S)
            self._offers[what] = client
        client = self._offers[what]
        return client

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service and return its reply."""
        future = self.service(kind, name).call_async(kind.Request(**fields))
        self.wait(f'the reply of {name}', future.done, 60.0)
        return future.result()

    def send(self, action: ActionClient, goal: Any, timeout: float,
             feedback: Callable[[Any], None] | None = None) -> SentGoal:
        """
        Send a goal to an action; `SentGoal.accepted` or `SentGoal.result` comes next.

        :param feedback: gets each feedback
        :raises GdmpError: if no node offers the action
        """
        self.wait('the action server', action.server_is_ready, timeout)
        return SentGoal(self, action, goal, feedback)

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


class SentGoal:
    """A goal that was sent to an action, until its result."""

    def __init__(self, client: Client, action: ActionClient, goal: Any,
                 feedback: Callable[[Any], None] | None = None):
        """
        Send.

        :param feedback: gets each feedback
        """
        self._client = client
        self._sent: Any = action.send_goal_async(
            goal, None if feedback is None else lambda message: feedback(message.feedback))
        self._result: Any = None
        self._rejected = False

    def accepted(self, timeout: float) -> None:
        """
        Wait for the answer.

        :raises GdmpError: if it is rejected, or there is no answer
        """
        self._client.wait('the goal to be accepted', self._sent.done, timeout)
        handle = self._sent.result()
        if not handle.accepted:
            self._rejected = True
            raise GdmpError('the server rejected the goal')
        if self._result is None:
            self._result = handle.get_result_async()

    def cancel(self, timeout: float = 5.0) -> bool:
        """
        Cancel it, if it has not ended; the motion stops smoothly.

        An interrupted start is waited for: nothing that was sent goes on.
        """
        if self._rejected or self.done():
            return False
        self.accepted(timeout)
        request = self._sent.result().cancel_goal_async()
        self._client.wait('the motion to be cancelled', request.done, timeout)
        return True

    def done(self) -> bool:
        """Whether it has ended."""
        return self._result is not None and bool(self._result.done())

    def succeeded(self) -> bool:
        """Whether it has ended well."""
        if not self.done():
            return False
        answer = self._result.result()
        return bool(answer.status == GoalStatus.STATUS_SUCCEEDED)

    def result(self, timeout: float) -> Any:
        """
        Wait for its result.

        :raises GdmpError: if it is rejected, or has not ended in time
        """
        self.accepted(timeout)
        self._client.wait('the motion to finish', self.done, timeout)
        return self._result.result().result


class ServerClient(Client):
    """
    Uses the topics and the action of a trajectory server.

    :ivar server: name of its node, with its namespace
    :ivar state: newest state of the server, None before the first
    """

    def __init__(self, server: str = 'trajectory_server', check: Callable[[], None] | None = None):
        """:param check: called while waiting; may raise an exception"""
        super().__init__(CLIENT, check)
        self.server = server
        self.state: ServerState | None = None
        self.subscribe(ServerState, f'{server}/state', self._on_state)
        self._publishers = {
            topic: self.publisher(kind, f'{server}/{topic}')
            for topic, kind in (('goal_pose', PoseStamped), ('goal_stiffness', Float64MultiArray),
                                ('amplitude', Float64), ('frequency', Float64),
                                ('signal', String), ('context', Context))}
        self._action, self._sequences = (
            self.participant.action_client(kind, f'{server}/{name}') for kind, name in (
                (ExecuteSkill, 'execute'), (ExecuteSequence, 'execute_sequence')))
        self._goal: SentGoal | None = None

    def _on_state(self, message: ServerState) -> None:
        self.state = message

    def find_server(self, timeout: float) -> None:
        """
        Wait for the state of the server.

        :raises GdmpError: if there is none in time, or more than one of this name
        """
        topic = f'/{self.server.lstrip("/")}/state'
        self.wait(f'the state of {self.server}', lambda: self.state is not None, timeout,
                  why=self._others)
        self.spend(DISCOVERY_S)
        count = len(self.participant.publishers(topic))
        if count > 1:
            raise GdmpError(f'{count} nodes of the name {self.server} run in this DDS domain '
                            '(ROS_DOMAIN_ID chooses another one): end all but one')

    def _others(self) -> str:
        """What runs instead of the server, for people."""
        names = sorted({name.lstrip('/') for name in self.participant.nodes()})
        found = [name for name in names if not name.rpartition('/')[2].startswith(('_', CLIENT))]
        return (f'no node of this name runs; there are {", ".join(found)}' if found else
                'no other node runs in this DDS domain: start it with gdmp up')

    def wait_status(self, status: str, timeout: float) -> None:
        """Wait until the server reports a status."""
        self.wait(f'the server to be {status}',
                  lambda: self.state is not None and self.state.status == status, timeout)

    def execute(self, goal: ExecuteSkill.Goal | None = None, timeout: float = 10.0) -> None:
        """Start the loaded skill with the action."""
        self._send(self._action, goal or ExecuteSkill.Goal(), timeout)

    def execute_sequence(self, path: str, first_step: int = 0, timeout: float = 10.0) -> None:
        """
        Start a sequence with the action; the server need not have its files.

        :param path: sequence file
        :param first_step: counted from 1; 0: the first one
        :raises DataError: if a file cannot be read
        """
        contents: dict[str, str] = {}
        read_sequence(path, contents)
        self._send(self._sequences, ExecuteSequence.Goal(
            sequence=path, first_step=first_step, files=list(contents),
            contents=list(contents.values())), timeout)

    def _send(self, action: ActionClient, goal: Any, timeout: float) -> None:
        self._goal = self.send(action, goal, timeout)
        self._goal.accepted(timeout)

    def cancel(self, timeout: float = 5.0) -> bool:
        """Cancel the motion that was started, if it has not ended; see `SentGoal.cancel`."""
        return self._goal is not None and self._goal.cancel(timeout)

    def done(self) -> bool:
        """Whether the motion that was started has ended."""
        return self._goal is not None and self._goal.done()

    def succeeded(self) -> bool:
        """Whether the motion or sequence that was started has ended well."""
        return self._goal is not None and self._goal.succeeded()

    def check_failure(self) -> None:
        """:raises GdmpError: if the motion that was started has ended without success"""
        if self.done():
            result = self.result(0.0)
            if result.error_code != result.SUCCESSFUL:
                raise GdmpError(f'the motion ended with {result.error_code}: '
                                f'{result.error_string}')

    def result(self, timeout: float) -> Any:
        """
        Wait for the result of the action.

        :raises GdmpError: if it takes too long, or no motion was started
        """
        if self._goal is None:
            raise GdmpError('no motion was started')
        return self._goal.result(timeout)

    def goal_pose(self, pose: np.ndarray, frame: str) -> None:
        """Switch the pose goal (x, y, z, qw, qx, qy, qz)."""
        self._publish('goal_pose', messages.stamped_pose(pose, frame))

    def goal_stiffness(self, matrix: np.ndarray) -> None:
        """Switch the stiffness goal."""
        self._publish('goal_stiffness',
                      Float64MultiArray(data=np.asarray(matrix).reshape(-1).tolist()))

    def amplitude(self, amplitude: float) -> None:
        """Change the amplitude of a rhythmic motion; 0 ends it at its centre."""
        self._publish('amplitude', Float64(data=amplitude))

    def frequency(self, frequency: float) -> None:
        """Change the frequency of a rhythmic motion [Hz]."""
        self._publish('frequency', Float64(data=frequency))

    def signal(self, name: str) -> None:
        """Tell the present step of a sequence that something has happened."""
        self._publish('signal', String(data=name))

    def context(self, context: Mapping[str, float]) -> None:
        """Use the loaded skill in a context from the next start on."""
        self._publish('context', Context(names=list(context), values=list(context.values())))

    def _publish(self, topic: str, message: Any) -> None:
        publisher = self._publishers[topic]
        self.wait(f'the server to subscribe to {topic}', lambda: publisher.subscribers() > 0, 5.0)
        publisher.publish(message)


def _after(reason: str) -> str:
    return f': {reason}' if reason else ''


def problem_of(state: ServerState | None) -> str:
    """What the server says of a motion that does not go on."""
    flags = [] if state is None else [flag for flag in state.flags if flag in (
        'no_robot', 'blocked', 'lagging', 'not_settled', 'held')]
    return ', '.join(flags)


def followed_motion(reply: RefineSkill.Response) -> FollowedMotion:
    """
    How the arm followed the last motion, in a reply of ``~/refine_skill``.

    :raises GdmpError: if it tells nothing, with its reason
    """
    if not len(reply.progress):
        raise GdmpError(reply.message)
    return FollowedMotion(np.array(reply.progress), *(np.array(
        [messages.pose_numbers(pose) for pose in poses])
        for poses in (reply.references, reply.measured)))
