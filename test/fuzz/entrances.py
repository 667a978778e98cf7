"""
Every entrance through which something from outside comes in, and seeds of what is valid there.

An entrance takes bytes. Whatever they are, only a `GdmpError` may come out, and the nodes' next
tick must work.
"""
from __future__ import annotations

import atexit
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
import random
import shutil
import struct
import tempfile
import time
from typing import Any

import numpy as np

from gdmp_ros.data import bags, lasa, recordings
from gdmp_ros.data.context_table import read_contexts
from gdmp_ros.data.sequences import read_sequence
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.sequence_rollout import SequenceRollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.learning.context_fit import Contexts
from gdmp_ros.manifolds.product import Product
from gdmp_ros.util.dds_network import Domain

TOOL = lasa.TOOL
POSE = Product(*TOOL.factors[:2], names=TOOL.names[:2])
FRAME = 'panda_link0'
#: Files are written to memory, thousands of times a second.
MEMORY = '/dev/shm' if os.access('/dev/shm', os.W_OK) else None


@dataclass
class Entrance:
    """
    One entrance.

    :ivar feed: takes bytes; raises only what it should not
    :ivar seeds: valid inputs
    """

    feed: Callable[[bytes], None]
    seeds: list[bytes] = field(default_factory=list)


def demonstration(count: int = 12) -> Demonstration:
    times = np.linspace(0.0, 1.0, count)
    angle = 0.3 * times
    points = np.zeros((count, 16))
    points[:, 0] = 0.3 + 0.1 * times ** 2
    points[:, 2] = 0.5 - 0.05 * times
    points[:, 3], points[:, 4] = np.sin(angle), np.cos(angle)
    points[:, [7, 11, 15]] = 300.0 + 100.0 * times[:, None]
    return Demonstration(times, points, TOOL)


def short_skill() -> Skill:
    return Skill.learn(demonstration(), n_basis=4)


def _folder() -> Path:
    made = Path(tempfile.mkdtemp(prefix='gdmp-fuzz-', dir=MEMORY))
    atexit.register(shutil.rmtree, made, True)
    return made


def skill_file() -> Entrance:
    """Bytes of a skill file; what loads must also move."""
    folder = _folder()
    path, made = folder / 'skill.json', folder / 'made.json'
    short_skill().save(made)

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(GdmpError):
            skill = Skill.load(path)
            skill.reproduce(skill.duration / 5.0)
    return Entrance(feed, [made.read_bytes()])


_VALUES: tuple[Any, ...] = (None, True, False, 0, -1, 1, 2 ** 63, -2 ** 70, 1e308, -1e-308, 0.5,
                            '', 'x', 'parallel', [], [[]], [1.0], [[1.0, 2.0]], {}, {'a': 1},
                            'spd', float('nan'), float('inf'))


def edited(document: Any, choose: random.Random, depth: int = 0) -> Any:
    """The same document with one value somewhere replaced, taken out or doubled."""
    keys = (list(document) if isinstance(document, dict)
            else list(range(len(document))) if isinstance(document, list) else [])
    if not keys or (depth and choose.random() < 0.2):
        return choose.choice(_VALUES)
    copy, key = document.copy(), choose.choice(keys)
    deed = choose.random()
    if deed < 0.1:
        del copy[key]
    elif deed < 0.15 and isinstance(copy, list):
        copy.insert(key, copy[key])
    else:
        copy[key] = edited(copy[key], choose, depth + 1)
    return copy


def skill_fields() -> Entrance:
    """A valid skill file with a few fields changed: the bytes are the seed of the changes."""
    inner = skill_file()
    document = json.loads(inner.seeds[0])

    def feed(data: bytes) -> None:
        choose, changed = random.Random(data), document
        for _ in range(choose.randint(1, 3)):
            changed = edited(changed, choose)
        inner.feed(json.dumps(changed).encode())
    return Entrance(feed, [bytes([i]) for i in range(8)])


def _bag(storage: str) -> Entrance:
    folder = _folder()
    bag = folder / 'bag'
    # Poses alone, and few of them: what is read again and again should be short.
    shown = demonstration(6)
    recordings.write(bag, Demonstration(shown.times, shown.points[:, :7], POSE), FRAME, 10 ** 18,
                     storage)
    data = next(path for path in bag.iterdir() if path.suffix in ('.mcap', '.db3'))

    def feed(content: bytes) -> None:
        data.write_bytes(content)
        with suppress(GdmpError):
            recordings.read(bag)
    return Entrance(feed, [data.read_bytes()])


def bag_mcap() -> Entrance:
    """Bytes of an MCAP file in a bag."""
    return _bag('mcap')


def bag_sqlite3() -> Entrance:
    """Bytes of an sqlite3 file in a bag."""
    return _bag('sqlite3')


def bag_metadata() -> Entrance:
    """Bytes of a bag's metadata."""
    folder = _folder()
    bag = folder / 'bag'
    recordings.write(bag, demonstration(), FRAME, 10 ** 18)
    metadata = bag / 'metadata.yaml'
    made = metadata.read_bytes()

    def feed(content: bytes) -> None:
        metadata.write_bytes(content)
        with suppress(GdmpError):
            bags.topics(bag)
    return Entrance(feed, [made])


_nodes: dict[str, Any] = {}


def node(name: str) -> Any:
    """A node of this process, active, whose ticks are taken by hand."""
    if name in _nodes:
        return _nodes[name]
    import rclpy

    from gdmp_ros.ros.adapter.node import Adapter
    from gdmp_ros.ros.arm.panda_sim import PandaSim
    from gdmp_ros.ros.server.node import TrajectoryServer
    from gdmp_ros.ros.visualizer.node import Visualizer
    if not rclpy.ok():
        # A domain of one's own, kept to the end of the process.
        _nodes['domain'] = domain = Domain()
        rclpy.init(args=[], domain_id=domain.id)
    made: Any = {'server': TrajectoryServer, 'sim': PandaSim, 'adapter': Adapter,
                 'visualizer': Visualizer}[name]()
    if name == 'server':
        path = _folder() / 'skill.json'
        short_skill().save(path)
        made.set_parameters([_parameter('skill', str(path)), _parameter('start_from', 'skill')])
    made.configure()
    _listen(made)
    if name == 'server':
        made.streamer.active = True
    made._active = True
    made.get_logger().set_level(50)
    _nodes[name] = made
    return made


def _listen(made: Any) -> None:
    """Listen to what a node streams: it makes no message otherwise."""
    from gdmp_ros.ros.polling import PolledGroup
    from gdmp_ros.ros.streams import Stream
    holder = getattr(made, '_references', made)
    for publisher in [one._publisher for one in vars(holder).values() if isinstance(one, Stream)]:
        made.create_subscription(publisher.msg_type, publisher.topic, lambda _: None, 10,
                                 callback_group=PolledGroup())
        ends = time.monotonic() + 10.0
        while publisher.get_subscription_count() == 0:
            if time.monotonic() > ends:
                raise RuntimeError(f'nobody hears {publisher.topic}')
            time.sleep(0.01)


def _parameter(name: str, value: Any) -> Any:
    from rclpy.parameter import Parameter
    return Parameter(name, value=value)


def tick(name: str) -> None:
    """One tick and, now and then, a report: whatever came in, these must work."""
    made = node(name)
    _ticks[name] = _ticks.get(name, 0) + 1
    if name == 'server':
        made._tick(_ticks[name] * 1_000_000, 0.05, time.time_ns())
    elif name == 'sim':
        made._advance(time.time_ns(), time.time_ns())
    elif name == 'visualizer':
        made._update_handles()
        made._all_markers()
        return
    else:
        made._tick(time.time_ns(), time.time_ns())
        return
    if _ticks[name] % 50 == 0:
        (made._publish_report if name == 'server' else made._report)()


_ticks: dict[str, int] = {}


def _message(kind: Any, valid: list[Any], name: str, use: Callable[[Any, Any], None]) -> Entrance:
    """Raw bytes as CDR, decoded as the middleware does, given to what handles the message."""
    from rclpy.serialization import deserialize_message, serialize_message
    made = node(name)

    def feed(data: bytes) -> None:
        try:
            message = deserialize_message(data, kind)
        except Exception:
            return  # the middleware never hands it on
        with suppress(GdmpError):
            use(made, message)
        tick(name)
    return Entrance(feed, [serialize_message(message) for message in valid])


def _serialised(valid: list[Any], use: Callable[[Any, bytes], None]) -> Entrance:
    """Raw bytes, as the server takes them from a topic."""
    from rclpy.serialization import serialize_message
    server = node('server')

    def feed(data: bytes) -> None:
        use(server, data)
        tick('server')
    return Entrance(feed, [serialize_message(message) for message in valid])


def _pose(frame: str = FRAME) -> Any:
    from geometry_msgs.msg import PoseStamped
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.z = 0.4, 0.4
    message.pose.orientation.w, message.pose.orientation.x = 0.0, 1.0
    return message


def _array(values: Any) -> Any:
    from std_msgs.msg import Float64MultiArray
    return Float64MultiArray(data=[float(v) for v in np.ravel(values)])


def _moving(server: Any) -> None:
    rollout = server.streamer.player.rollout
    if rollout is None or rollout.finished:
        server.streamer.begin()


def topic_goal_pose() -> Entrance:
    """``~/goal_pose`` while a skill is executed."""
    def use(server: Any, data: bytes) -> None:
        _moving(server)
        server.goals.take('goal_pose', data)
    return _serialised([_pose(), _pose('world')], use)


def topic_moving_goal() -> Entrance:
    """``~/moving_goal`` while a skill is executed."""
    from gdmp_msgs.msg import MovingGoal

    def use(server: Any, data: bytes) -> None:
        _moving(server)
        server.goals.take('moving_goal', data)
    message = MovingGoal(header=_pose().header, pose=_pose().pose)
    message.twist.linear.y = 0.1
    return _serialised([message], use)


def topic_goal_stiffness() -> Entrance:
    """``~/goal_stiffness`` while a skill is executed."""
    def use(server: Any, data: bytes) -> None:
        _moving(server)
        server.goals.take('goal_stiffness', data)
    return _serialised([_array(300.0 * np.eye(3)), _array(300.0 * np.eye(6))], use)


def short_cycle() -> Skill:
    """A rhythmic skill near the start of `short_skill`."""
    times = np.linspace(0.0, 3.0, 60)
    points = np.tile(np.array(demonstration().points[0]), (60, 1))
    points[:, 0] += 0.02 * np.sin(2.0 * np.pi * times)
    points[:, 1] += 0.02 * np.cos(2.0 * np.pi * times)
    return Skill.learn_rhythmic(Demonstration(times, points, TOOL), n_basis=8)


def topic_amplitude() -> Entrance:
    """``~/amplitude`` and ``~/frequency`` while a rhythmic skill, or another, is executed."""
    from std_msgs.msg import Float64
    skills = [short_cycle(), short_skill()]

    def use(server: Any, data: bytes) -> None:
        streamer = server.streamer
        rhythmic = skills[len(data) % 2]
        streamer.use(rhythmic, 'fuzzed')
        streamer.begin()
        tick('server')
        server.goals.take('amplitude', data)
        server.goals.take('frequency', data)
        tick('server')
        streamer.use(skills[1], 'fuzzed')
        streamer.begin()
    return _serialised([Float64(data=0.5), Float64(data=float('nan'))], use)


def sequence_file() -> Entrance:
    """Bytes of a sequence file with skills beside it; what loads must also move."""
    folder = _folder()
    path = folder / 'sequence.yaml'
    short_skill().save(folder / 'a.json')
    short_cycle().save(folder / 'b.json')

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(GdmpError):
            rollout = SequenceRollout(read_sequence(path))
            for _ in range(3):
                rollout.advance(0.4)
    return Entrance(feed, [
        b'steps: [{skill: a.json, blend: 0.1, goal: [0.4, 0, 0.4]}, {skill: b.json, cycles: 2}]',
        b'steps:\n- gripper: {width: 0.02, force: 20}\n- hold:\n  until: go\n'
        b'- {skill: b.json, until: x, frequency: 2, amplitude: 0.5, name: y}\n'])


def context_skill() -> Skill:
    """A skill that depends on a context."""
    first = demonstration()
    takes = []
    for height in np.linspace(0.0, 0.1, 5):
        points = np.array(first.points)
        points[:, 2] += height * np.linspace(0.0, 1.0, len(points)) ** 2
        takes.append(Demonstration(first.times, points, TOOL))
    return Skill.learn(takes, n_basis=4, contexts={'height': np.linspace(0.0, 0.1, 5)})


def topic_context() -> Entrance:
    """``~/context``; what is accepted must also move."""
    from gdmp_msgs.msg import Context
    skill = context_skill()

    def use(server: Any, message: Any) -> None:
        server._skills.use(skill, 'fuzzed')
        server._skills.use_context(message)
        _moving(server)
    return _message(Context, [Context(names=['height'], values=[0.05]), Context(),
                              Context(names=['height'], values=[1e300])], 'server', use)


def context_table() -> Entrance:
    """Bytes of a table of contexts."""
    path = _folder() / 'contexts.csv'

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(GdmpError):
            Contexts.of(read_contexts(path, ['a', 'b', 'c', 'd']), 4)
    return Entrance(feed, [b'take,height\na,1\nb,2\nc,3\nd,5\n',
                           b'height,"take"\r\n1e3,a\r\n2,b\r\n-3,c\r\n.5,d'])


def service_refine() -> Entrance:
    """``~/refine_skill``."""
    from gdmp_msgs.srv import RefineSkill

    def use(server: Any, request: Any) -> None:
        request.output = ''
        server._refinement.answer(request, RefineSkill.Response())
        _moving(server)
    return _message(RefineSkill.Request, [RefineSkill.Request(action=n) for n in range(5)],
                    'server', use)


def topic_measured_pose() -> Entrance:
    """``~/measured_pose``, and a start from it."""
    def use(server: Any, data: bytes) -> None:
        pose = server.inputs.read_pose(data)
        if pose is not None and server.streamer.player is not None:
            server.streamer.player.observe(pose)
    return _serialised([_pose()], use)


def topic_clock() -> Entrance:
    """``/clock`` of a server on simulated time."""
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    def use(server: Any, message: Any) -> None:
        server._clock_input = None, server._time_source.clock_callback
        server._clock_tick(message)
    valid = [Clock(clock=Time(sec=100, nanosec=i * 10 ** 6)) for i in range(3)]
    return _message(Clock, valid, 'server', use)


def topic_hand_pose() -> Entrance:
    """Hand that guides the simulated arm."""
    from geometry_msgs.msg import PoseStamped

    def use(sim: Any, message: Any) -> None:
        sim.simulation.loop.hand_guided = True
        sim.simulation.take_hand(message)
        try:
            for _ in range(2):
                tick('sim')
        finally:
            sim.simulation.loop.hand_guided = False
            sim.simulation._release()
    return _message(PoseStamped, [_pose()], 'sim', use)


def topic_reference() -> Entrance:
    """Reference of the simulated arm."""
    from rclpy.serialization import serialize_message

    def use(sim: Any, message: Any) -> None:
        # In every other input the clock says what the stamp says: it would refuse nearly all.
        stamp = message.header.stamp
        now = time.time_ns()
        if message.sequence % 2 == 0:
            now = stamp.sec * 10 ** 9 + stamp.nanosec
            sim.simulation.loop.controller.guard._sequence = 0
        sim.simulation.take_reference(serialize_message(message), now)
    return _reference('sim', use)


def topic_converted() -> Entrance:
    """Reference that the adapter converts for other controllers."""
    return _reference('adapter', lambda adapter, message: adapter.convert(message))


def topic_shown() -> Entrance:
    """State of an arm that the visualizer shows."""
    from gdmp_msgs.msg import RobotState
    valid = RobotState()
    valid.header.frame_id, valid.pose.orientation.w = FRAME, 1.0
    valid.stiffness = np.diag([400.0] * 3 + [30.0] * 3).ravel()
    valid.position = [0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.8]
    return _message(RobotState, [valid], 'visualizer',
                    lambda node, message: node.take_robot(message))


def topic_handle() -> Entrance:
    """What a user does to the handles of the visualizer."""
    from gdmp_msgs.msg import ServerState
    from visualization_msgs.msg import InteractiveMarkerFeedback
    made = node('visualizer')
    state = ServerState(goal=[_pose().pose])
    state.header.frame_id = FRAME
    made.take_server(state)
    tick('visualizer')
    valid = [InteractiveMarkerFeedback(marker_name='goal', event_type=kind, menu_entry_id=1)
             for kind in (1, 2, 4, 5)]
    for message in valid:
        message.header.frame_id, message.pose = FRAME, _pose().pose
    return _message(InteractiveMarkerFeedback, valid, 'visualizer',
                    lambda made, message: made.handles.take_feedback(message))


def _reference(name: str, use: Callable[[Any, Any], None]) -> Entrance:
    from gdmp_msgs.msg import Reference

    from gdmp_ros.control.target import HOLD_STIFFNESS
    from gdmp_ros.ros import messages
    numbers = np.zeros(56)
    numbers[:7], numbers[19:55] = (0.31, 0, 0.48, 0, 1, 0, 0), HOLD_STIFFNESS.ravel()
    numbers[55] = 0.7
    valid = Reference()
    valid.header.frame_id = FRAME
    messages.fill_reference(valid, numbers)
    return _message(Reference, [valid], name, use)


def service_set_speed() -> Entrance:
    """``~/set_speed``."""
    from gdmp_msgs.srv import SetSpeed
    return _message(SetSpeed.Request, [SetSpeed.Request(scale=0.5)], 'server',
                    lambda server, request: server._set_speed(request.scale))


def service_pause() -> Entrance:
    """``~/pause``, ``~/start`` and ``~/stop``, one after the other."""
    from std_srvs.srv import SetBool

    def use(server: Any, request: Any) -> None:
        _moving(server)
        server.streamer.player.pause(request.data)
        if not request.data:
            server.streamer.player.stop()
            server.streamer.begin()
    return _message(SetBool.Request, [SetBool.Request(data=True), SetBool.Request()], 'server',
                    use)


def service_load_skill() -> Entrance:
    """``~/load_skill``: names of files."""
    from gdmp_msgs.srv import LoadSkill
    path = _folder() / 'skill.json'
    short_skill().save(path)
    valid = [LoadSkill.Request(path=str(p)) for p in (path, '/dev/zero', '/', '..', '/dev/stdin')]
    return _message(LoadSkill.Request, valid, 'server',
                    lambda server, request: server._skills.load(request.path))


def service_learn_skill() -> Entrance:
    """``~/learn_skill``: the command it makes has no option that it was not to have."""
    from gdmp_msgs.srv import LearnSkill
    valid = [LearnSkill.Request(bags=['demo'], n_basis=30, connection='parallel', output='x.json'),
             LearnSkill.Request(bags=['--each', '-o', '/etc/x'], connection='published')]

    def use(server: Any, request: Any) -> None:
        request.output = request.output or 'skill.json'
        _, command = server._learning.command(request)
        after = command[command.index('--') + 1:]
        if after != list(request.bags) or sum(w.startswith('-') for w in
                                              command[:command.index('--')]) != 6:
            raise AssertionError(f'an option came in: {command}')
    return _message(LearnSkill.Request, valid, 'server', use)


def action_execute() -> Entrance:
    """Goals of ``~/execute``."""
    from gdmp_msgs.action import ExecuteSkill
    whole = ExecuteSkill.Goal(use_goal_pose=True, goal_pose=_pose(), duration=2.0,
                              goal_stiffness=list((300.0 * np.eye(3)).ravel()),
                              position_tolerance=0.01, rotation_tolerance=0.01)
    return _message(ExecuteSkill.Goal, [ExecuteSkill.Goal(), whole], 'server',
                    lambda server, goal: server._action._begin(goal, server._base.pose(
                        goal.goal_pose) if goal.use_goal_pose else None))


def services_of_the_simulation() -> Entrance:
    """``~/set_pause``, ``~/teach``, ``~/reset_world``, ``~/step_simulation`` and the rest."""
    from gdmp_msgs.srv import StepSimulation
    from std_srvs.srv import SetBool, Trigger

    def use(sim: Any, request: Any) -> None:
        reply = StepSimulation.Response()
        # Refused before it awaits anything, as the simulation is not paused.
        with suppress(StopIteration):
            sim.arm_services.on_step(request, reply).send(None)
            raise AssertionError('waits for steps though not paused')
        if reply.success:
            raise AssertionError('stepped though not paused')
        for paused in (True, False):
            sim.arm_services.on_pause(SetBool.Request(data=paused), SetBool.Response())
            tick('sim')
            sim.arm_services.on_teach(SetBool.Request(data=paused), SetBool.Response())
            tick('sim')
            sim.arm_services.on_refill(Trigger.Request(), Trigger.Response())
            with suppress(StopIteration):
                sim.arm_services.on_identify(SetBool.Request(data=paused),
                                             SetBool.Response()).send(None)
            tick('sim')
        if request.steps % 3 == 0:
            sim.arm_services.on_reset(Trigger.Request(), Trigger.Response())
            sim.simulation.request_reset()
    return _message(StepSimulation.Request, [StepSimulation.Request(steps=n) for n in (0, 5, 9)],
                    'sim', use)


def service_set_tool() -> Entrance:
    """``~/set_tool`` of the arm."""
    from gdmp_msgs.srv import SetTool
    from geometry_msgs.msg import Point, Pose, Quaternion
    valid = [SetTool.Request(), SetTool.Request(pose=Pose(
        position=Point(x=0.05, z=0.1), orientation=Quaternion(x=0.6, w=0.8)))]

    def use(sim: Any, request: Any) -> None:
        answering = sim.arm_services.on_tool(request, SetTool.Response())
        with suppress(StopIteration):
            answering.send(None)
        tick('sim')
        answering.close()
    return _message(SetTool.Request, valid, 'sim', use)


def service_set_payload() -> Entrance:
    """``~/set_payload`` of the arm."""
    from gdmp_msgs.srv import SetPayload
    valid = [SetPayload.Request(), SetPayload.Request(mass=0.5, center=[0.0, 0.0, 0.05]),
             SetPayload.Request(mass=1.0, inertia=[0.01, 0.01, 0.01, 0.0, 0.0, 0.0])]

    def use(sim: Any, request: Any) -> None:
        sim.arm_services.on_payload(request, SetPayload.Response())
        tick('sim')
    return _message(SetPayload.Request, valid, 'sim', use)


def _parameters(name: str, of_node: str) -> Entrance:
    from gdmp_ros.ros.parameter_tables import NODES
    specs = NODES[of_node][1]
    names = [spec.name for spec in specs]

    def value(choose: random.Random) -> Any:
        number = choose.choice([0.0, -0.0, 1e308, -1e308, float('nan'), float('inf'),
                                choose.gauss(0, 1), choose.gauss(0, 1e3)])
        count = choose.randint(0, 8)
        return choose.choice([
            number, int(choose.gauss(0, 100)), choose.random() < 0.5, 2 ** 63 - 1,
            ''.join(chr(choose.choice([0, 10, 32, 65, 233, 0x4E2D, 0x1F600]))
                    for _ in range(count)),
            [number] * count, [True] * count, ['x'] * count, [1] * count,
            bytes(range(count))])

    def feed(data: bytes) -> None:
        choose, made = random.Random(data), node(name)
        made.parameters.locked = choose.random() < 0.5
        for _ in range(3):
            which = choose.choice(names)
            before = getattr(made.parameters, which)
            try:
                changes = [_parameter(which, value(choose))]
            except (TypeError, ValueError, AttributeError):
                continue  # rclpy has no such parameter value
            result = made.set_parameters(changes)[0]
            after = getattr(made.parameters, which)
            if not result.successful and after != before and after == after:
                raise AssertionError(f'{which}: refused, and changed to {after!r}')
            if result.successful:
                problem = {s.name: s for s in specs}[which].problem(after)
                if problem:
                    raise AssertionError(f'accepted: {problem}')
                tick(name)
                made.set_parameters([_parameter(which, before)])
        tick(name)
    return Entrance(feed, [struct.pack('<I', i) for i in range(8)])


def parameters_of_the_server() -> Entrance:
    """Parameters of ``trajectory_server``."""
    return _parameters('server', 'trajectory_server')


def parameters_of_the_simulation() -> Entrance:
    """Parameters of ``panda_sim``."""
    return _parameters('sim', 'panda_sim')


ENTRANCES: dict[str, Callable[[], Entrance]] = {
    made.__name__: made for made in (
        skill_file, skill_fields, bag_mcap, bag_sqlite3, bag_metadata, topic_goal_pose,
        topic_moving_goal, topic_goal_stiffness, topic_amplitude, sequence_file,
        topic_context, context_table, service_refine,
        topic_measured_pose, topic_clock, topic_hand_pose,
        topic_reference, topic_converted, topic_shown, topic_handle,
        service_set_speed, service_pause, service_load_skill, service_learn_skill,
        action_execute, services_of_the_simulation, service_set_payload, service_set_tool,
        parameters_of_the_server, parameters_of_the_simulation)}
