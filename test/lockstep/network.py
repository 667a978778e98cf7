"""
The middleware of tests: exact and immediate, in memory, on a stepped clock.

Messages, requests, goals and their answers are serialised, as they would be on a network.
"""
from collections import deque
from contextlib import contextmanager
from functools import partial
import inspect
import logging
import math
from types import SimpleNamespace

from action_msgs.msg import GoalStatus
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future

from gdmp_ros.ros.middleware import DEEP, Publisher, Received, Subscription
from test.lockstep.clock import NodeClock, SteppedClock

LATE, BEST_EFFORT = DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.BEST_EFFORT


def sent(message):
    """A message as the other side gets it."""
    return deserialize_message(serialize_message(message), type(message))


class Network:
    """
    See `gdmp_ros.ros.middleware.Middleware`.

    :ivar disturbances: by topic: what becomes of a message
    """

    def __init__(self, context):
        """:param context: of rclpy, for the nodes"""
        self.clock = SteppedClock()
        self.participants, self.disturbances = [], {}
        self.version = 0  # of what participants have
        self._context, self._arguments = context, ()
        self._logs = None

    def options(self):
        return {'context': self._context, 'cli_args': list(self._arguments),
                'use_global_arguments': False}

    @contextmanager
    def arguments(self, words, log):
        """Nodes that are made meanwhile have these ROS arguments, and log to a list."""
        before = self._arguments, self._logs
        self._arguments, self._logs = words, log
        try:
            yield
        finally:
            self._arguments, self._logs = before

    def join(self, node):
        log = [] if self._logs is None else self._logs
        made = Participant(self, Executor(self.clock), node, Logger(log, self.clock))
        self.participants.append(made)
        return made

    def client(self, name):
        made = ClientParticipant(self, name)
        self.participants.append(made)
        return made

    @contextmanager
    def disturbed(self, topic, rule):
        """
        Disturb a topic.

        :param rule: gets the data of a message, and returns what arrives instead: pairs of a delay
            [s] and data
        """
        self.disturbances[topic] = rule
        try:
            yield
        finally:
            del self.disturbances[topic]

    def deliver(self, publisher, data, subscriptions):
        """Bring a message to subscriptions, now or later, whole or not."""
        rule = self.disturbances.get(publisher.topic)
        for delay, arrives in ((0.0, data),) if rule is None else rule(data):
            published = self.clock.wall()

            def arrive(arrives=arrives, published=published):
                for one in subscriptions:
                    one.receive(Received(arrives, published, self.clock.wall()))
            if delay:
                self.clock.at(self.clock.now() + round(1e9 * delay), arrive)
            else:
                arrive()

    def all(self, what, name):
        """Everything of a kind and full name that participants have."""
        return [one for participant in self.participants for one in participant.made
                if isinstance(one, what) and one.topic == name]

    def service(self, name):
        """A service: its participant, type and callback; None if there is none."""
        for participant in self.participants:
            for one in participant.made:
                if isinstance(one, Service) and one.topic == name:
                    return participant, one.kind, one.callback
            for one in participant.own_services():
                if participant.resolve(one.srv_name) == name:
                    return participant, one.srv_type, one.callback
        return None


class Logger:
    """Keeps the lines of a node; they are not throttled."""

    def __init__(self, lines, clock):
        self._lines, self._clock = lines, clock

    def _add(self, level, text):
        self._lines.append(f'[{level}] [{1e-9 * self._clock.now():.3f}] {text}')
        logging.getLogger('nodes').log(getattr(logging, level), text)

    def debug(self, text, **_):
        self._add('DEBUG', text)

    def info(self, text, **_):
        self._add('INFO', text)

    def warning(self, text, **_):
        self._add('WARNING', text)

    def error(self, text, **_):
        self._add('ERROR', text)

    def set_level(self, level):
        pass


class Executor:
    """
    Runs the callbacks of a node one after the other, and resumes those that await something.

    A callback that sleeps keeps it busy: others wait.
    """

    def __init__(self, clock):
        self._clock, self._waiting, self._tasks = clock, deque(), []
        self._busy = False
        self.problem = lambda error: None

    def call(self, callback):
        """Run a callback at the present time."""
        self._waiting.append(callback)
        self._clock.soon(self.run)

    def wake(self):
        """Look whether something that is awaited has happened."""
        self._clock.soon(self.run)

    def task(self, coroutine, done):
        """Run a coroutine; ``done`` gets its result."""
        self._tasks.append((coroutine, done))
        self.wake()

    def run(self):
        if self._busy:
            return  # it goes on afterwards
        self._busy = True
        try:
            while self._waiting:
                self._attempt(self._waiting.popleft())
                self._resume()
            self._resume()
        finally:
            self._busy = False

    def _resume(self):
        for task in list(self._tasks):
            coroutine, done = task
            try:
                coroutine.send(None)
            except StopIteration as ended:
                self._tasks.remove(task)
                self._attempt(partial(done, ended.value))
            except Exception as error:
                self._tasks.remove(task)
                self.problem(error)

    def _attempt(self, callback):
        try:
            callback()
        except Exception as error:
            self.problem(error)


class SpunExecutor:
    """Runs callbacks when it is spun, one at a time."""

    def __init__(self, clock):
        self._clock, self._waiting = clock, deque()

    def call(self, callback):
        self._waiting.append(callback)

    def wake(self):
        pass

    def spin(self, seconds):
        if not self._waiting:
            self._clock.run_until(self._clock.now() + math.ceil(1e9 * seconds),
                                  stop=lambda: bool(self._waiting))
        if self._waiting:
            self._waiting.popleft()()

    def drain(self):
        """Run what waits; no time passes."""
        while self._waiting:
            self._waiting.popleft()()


class MemoryPublisher(Publisher):
    def __init__(self, network, kind, topic, quality):
        super().__init__(kind, topic)
        self._network, self.quality = network, quality
        self.last = deque(maxlen=quality.depth)  # that late subscribers get
        self._matched, self._version = [], -1

    def matched(self):
        if self._version != self._network.version:
            self._version = self._network.version
            self._matched = [one for one in self._network.all(MemorySubscription, self.topic)
                             if one.matches(self)]
        return self._matched

    def send(self, data):
        if self.quality.durability == LATE:
            self.last.append(data)
        self._network.deliver(self, bytes(data), self.matched())

    def subscribers(self):
        return len(self.matched())


class MemorySubscription(Subscription):
    def __init__(self, participant, kind, topic, quality, callback):
        super().__init__(participant.clock, kind, topic, participant.refused)
        self.quality, self._callback = quality, callback
        self._executor, self._network = participant.executor, participant.network
        # A deep history is one that loses nothing.
        self._received = deque(maxlen=quality.depth if quality.depth < DEEP else None)
        self.follower = None
        if quality.durability == LATE:
            for publisher in self._network.all(MemoryPublisher, topic):
                if self.matches(publisher):
                    for data in publisher.last:
                        self._network.deliver(publisher, data, [self])

    def matches(self, publisher):
        """Whether DDS would connect the two."""
        mine, theirs = self.quality, publisher.quality
        return (publisher.kind is self.kind
                and (mine.reliability == BEST_EFFORT or theirs.reliability != BEST_EFFORT)
                and (mine.durability != LATE or theirs.durability == LATE))

    def receive(self, received):
        self._received.append(received)
        if self.follower is not None:
            self.follower()
        elif self._callback is not None:
            self._executor.call(self._call)

    def _call(self):
        # A short history may have dropped older ones.
        message = self.take_message()
        if message is not None:
            self._callback(message)

    def take(self):
        return self._received.popleft() if self._received else None


class Following:
    """A loop that makes a step for each message; see `Participant.follow`."""

    scheduler, failure = 'other', None

    def __init__(self, subscription, clock, step):
        self._subscription, self._step = subscription, step
        subscription.discard()
        subscription.follower = lambda: clock.soon(self._run)

    def _run(self):
        while self._subscription.follower is not None and (
                message := self._subscription.take_message()) is not None:
            try:
                self._step(message)
            except Exception as error:
                self.failure = error
                self.end()

    def end(self):
        self._subscription.follower = None

    kill = end


class Service:
    def __init__(self, kind, topic, callback, concurrent):
        self.kind, self.topic, self._callback = kind, topic, callback
        self._concurrent = concurrent

    def callback(self, request, reply):
        made = self._callback(request, reply)
        if inspect.iscoroutine(made) and not self._concurrent:
            raise RuntimeError(f'{self.topic} awaits something, and lets all others wait')
        return made


class Client:
    def __init__(self, participant, kind, name):
        self.srv_type, self.srv_name, self.topic = kind, name, name
        self._participant = participant
        self._forgotten = set()

    def service_is_ready(self):
        return self._participant.network.service(self.srv_name) is not None

    def call_async(self, request):
        future, data = Future(), serialize_message(request)
        found = self._participant.network.service(self.srv_name)
        if found is not None:
            server, kind, callback = found

            def carry_out():
                made = callback(deserialize_message(data, kind.Request), kind.Response())
                if inspect.iscoroutine(made):
                    server.executor.task(made, answer)
                else:
                    answer(made)

            def answer(reply):
                arrived = sent(reply)
                self._participant.executor.call(lambda: self._finish(future, arrived))
            server.executor.call(carry_out)
        return future

    def remove_pending_request(self, future):
        self._forgotten.add(id(future))

    def _finish(self, future, reply):
        if id(future) not in self._forgotten:
            future.set_result(reply)


class Action:
    def __init__(self, participant, kind, topic, execute, accept, cancel):
        self.participant, self.kind, self.topic = participant, kind, topic
        self.execute, self.accept, self.cancel = execute, accept, cancel


class GoalHandle:
    """What an action knows of a goal."""

    def __init__(self, action, request, feedback):
        self.request, self.is_cancel_requested = request, False
        self.status = GoalStatus.STATUS_EXECUTING
        self._action, self._feedback = action, feedback

    @property
    def is_active(self):
        return self.status == GoalStatus.STATUS_EXECUTING

    def publish_feedback(self, feedback):
        self._feedback(sent(feedback))

    def succeed(self):
        self.status = GoalStatus.STATUS_SUCCEEDED

    def abort(self):
        self.status = GoalStatus.STATUS_ABORTED

    def canceled(self):
        if not self.is_cancel_requested:
            raise RuntimeError('a goal that nobody cancelled cannot be cancelled')
        self.status = GoalStatus.STATUS_CANCELED


class SentGoal:
    """What a client knows of a goal."""

    def __init__(self, participant, accepted):
        self.accepted, self._participant = accepted, participant
        self.handle, self.result = None, Future()

    def get_result_async(self):
        return self.result

    def cancel_goal_async(self):
        future, handle, participant = Future(), self.handle, self._participant

        def ask():
            if handle.is_active and handle._action.cancel():
                handle.is_cancel_requested = True
            participant.executor.call(lambda: future.set_result(SimpleNamespace(
                goals_canceling=[handle] if handle.is_cancel_requested else [])))
        handle._action.participant.executor.call(ask)
        return future


class ActionClient:
    def __init__(self, participant, kind, name):
        self.topic, self._kind, self._participant = name, kind, participant

    def _action(self):
        found = self._participant.network.all(Action, self.topic)
        return found[0] if found else None

    def server_is_ready(self):
        return self._action() is not None

    def send_goal_async(self, goal, feedback_callback=None):
        future, action, me = Future(), self._action(), self._participant
        if action is None:
            return future
        request = sent(goal)

        def feedback(message):
            if feedback_callback is not None:
                me.executor.call(lambda: feedback_callback(SimpleNamespace(feedback=message)))

        def ask():
            answer = SentGoal(me, bool(action.accept(request)))
            me.executor.call(lambda: future.set_result(answer))
            if answer.accepted:
                handle = answer.handle = GoalHandle(action, request, feedback)
                action.participant.executor.task(action.execute(handle), lambda result: end(
                    answer, handle, sent(result)))

        def end(answer, handle, result):
            if handle.is_active:
                handle.abort()  # as rclpy does with a goal that its callback forgot
            me.executor.call(lambda: answer.result.set_result(SimpleNamespace(
                status=handle.status, result=result)))
        action.participant.executor.call(ask)
        return future

    def destroy(self):
        pass


class Timer:
    topic = ''

    def __init__(self, participant, period_s, callback):
        self._waits, self.ended = False, False

        def run():
            self._waits = False
            if not self.ended:
                callback()

        def fire():
            if not self._waits and not self.ended:
                self._waits = True
                participant.executor.call(run)
            return self.ended
        participant.network.clock.every(round(1e9 * period_s), fire)


class Participant:
    """See `gdmp_ros.ros.middleware.Participant`."""

    def __init__(self, network, executor, node=None, logger=None):
        self.network, self.executor = network, executor
        self.clock = NodeClock(network.clock)
        self.node, self.logger, self.made = node, logger, []
        if logger is not None:
            executor.problem = lambda error: logger.error(
                f'a callback failed: {type(error).__name__}: {error}')

    def refused(self, why):
        """A message was dropped."""
        if self.logger is not None:
            self.logger.warning(why)

    def own_services(self):
        """Services that rclpy offers: parameters, lifecycle."""
        return self.node.services if self.node is not None else ()

    def resolve(self, name):
        return self.node.resolve_topic_name(name)

    def _own(self, made):
        self.made.append(made)
        self.network.version += 1
        return made

    def publisher(self, kind, topic, quality):
        return self._own(MemoryPublisher(self.network, kind, self.resolve(topic), quality))

    def subscription(self, kind, topic, quality, callback=None):
        return self._own(MemorySubscription(self, kind, self.resolve(topic), quality, callback))

    def follow(self, subscription, step, priority):
        made = Following(subscription, self.network.clock, step)
        self.clock.loops.append(made)
        return made

    def service(self, kind, name, callback, concurrent=False):
        return self._own(Service(kind, self.resolve(name), callback, concurrent))

    def client(self, kind, name):
        return self._own(Client(self, kind, self.resolve(name)))

    def action(self, kind, name, execute, accept, cancel):
        return self._own(Action(self, kind, self.resolve(name), execute, accept, cancel))

    def action_client(self, kind, name):
        return self._own(ActionClient(self, kind, self.resolve(name)))

    def timer(self, period_s, callback):
        return self._own(Timer(self, period_s, callback))

    def future(self):
        made = Future()
        made.add_done_callback(lambda _: self.executor.wake())
        return made

    def destroy(self, entity):
        if isinstance(entity, Timer):
            entity.ended = True
        self.made.remove(entity)
        self.network.version += 1

    def leave(self):
        """Vanish, with everything that was made."""
        for one in self.made:
            if isinstance(one, Timer):
                one.ended = True
        self.made.clear()
        self.network.version += 1
        self.network.participants.remove(self)

    @property
    def name(self):
        return self.node.get_fully_qualified_name()

    def precede(self):
        """There are no threads."""

    def publishers(self, topic):
        name = self.resolve(topic)
        return sorted(one.name for one in self.network.participants for made in one.made
                      if isinstance(made, MemoryPublisher) and made.topic == name)

    def nodes(self):
        return [one.name for one in self.network.participants]


class ClientParticipant(Participant):
    """See `gdmp_ros.ros.middleware.ClientParticipant`."""

    name = ''

    def __init__(self, network, name):
        super().__init__(network, SpunExecutor(network.clock))
        self.name = f'/{name}'

    def resolve(self, name):
        return name if name.startswith('/') else f'/{name}'

    def spin(self, seconds):
        self.executor.spin(seconds)

    def close(self):
        self.leave()
