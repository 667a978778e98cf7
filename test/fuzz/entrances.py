"""
Every entrance through which something from outside comes in, and seeds of what is valid there.

An entrance takes bytes. Whatever they are, only a `GdmpError` may come out, and the node goes on
working.
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
from typing import Any

from builtin_interfaces.msg import Time
from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import Context, MovingGoal, Reference, RobotState, ServerState
from gdmp_msgs.srv import (
    LearnSkill,
    LoadSkill,
    RefineSkill,
    SetPayload,
    SetSpeed,
    SetTool,
    StepSimulation,
)
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
import numpy as np
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import InteractiveMarkerFeedback

from gdmp_ros.control.target import HOLD_STIFFNESS
from gdmp_ros.data import bags, lasa, recordings
from gdmp_ros.data.arm_joints import ArmJoints, radians
from gdmp_ros.data.objects import read_poses
from gdmp_ros.data.sequences import read_sequence
from gdmp_ros.data.takes import read_numbers
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.frames import checked_frames
from gdmp_ros.dmp.sequence import SequenceRollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.learning.variation_fit import Contexts
from gdmp_ros.manifolds.product import Product
from gdmp_ros.ros.messages import fill_reference, stamp_of
from gdmp_ros.ros.parameter_tables import NODES
from gdmp_ros.sim.tip import from_model, from_urdf
from test import urdf
from test.fuzz import nodes

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


def server() -> nodes.FuzzedNode:
    """The trajectory server, with a short skill."""
    return nodes.server(_saved)


def _saved() -> str:
    path = _folder() / 'skill.json'
    short_skill().save(path)
    return str(path)


def _moving(made: nodes.FuzzedNode) -> None:
    """Let the server execute a skill."""
    streamer = made.node.streamer
    rollout = streamer.player.rollout
    if rollout is None or rollout.finished:
        streamer.begin()


def _topic(made: nodes.FuzzedNode, kind: Any, topic: str, valid: list[Any], takes: bool = True,
           before: Callable[[nodes.FuzzedNode], None] = lambda made: None) -> Entrance:
    """Raw bytes as CDR on a topic."""
    def feed(data: bytes) -> None:
        before(made)
        made.send(kind, topic, data, takes)
    return Entrance(feed, [serialize_message(message) for message in valid])


def _service(made: nodes.FuzzedNode, kind: Any, name: str, valid: list[Any],
             before: Callable[[nodes.FuzzedNode], None] = lambda made: None) -> Entrance:
    """Raw bytes as CDR to a service."""
    def feed(data: bytes) -> None:
        before(made)
        made.request(kind, name, data)
    return Entrance(feed, [serialize_message(request) for request in valid])


def _pose(frame: str = FRAME) -> Any:
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.z = 0.4, 0.4
    message.pose.orientation.w, message.pose.orientation.x = 0.0, 1.0
    return message


def _array(values: Any) -> Any:
    return Float64MultiArray(data=[float(v) for v in np.ravel(values)])


def topic_goal_pose() -> Entrance:
    """``~/goal_pose`` while a skill is executed."""
    return _topic(server(), PoseStamped, '~/goal_pose', [_pose(), _pose('world')], before=_moving)


def topic_moving_goal() -> Entrance:
    """``~/moving_goal`` while a skill is executed."""
    message = MovingGoal(header=_pose().header, pose=_pose().pose)
    message.twist.linear.y = 0.1
    return _topic(server(), MovingGoal, '~/moving_goal', [message], before=_moving)


def topic_goal_stiffness() -> Entrance:
    """``~/goal_stiffness`` while a skill is executed."""
    return _topic(server(), Float64MultiArray, '~/goal_stiffness',
                  [_array(300.0 * np.eye(3)), _array(300.0 * np.eye(6))], before=_moving)


def short_cycle() -> Skill:
    """A rhythmic skill near the start of `short_skill`."""
    times = np.linspace(0.0, 3.0, 60)
    points = np.tile(np.array(demonstration().points[0]), (60, 1))
    points[:, 0] += 0.02 * np.sin(2.0 * np.pi * times)
    points[:, 1] += 0.02 * np.cos(2.0 * np.pi * times)
    return Skill.learn_rhythmic(Demonstration(times, points, TOOL), n_basis=8)


def topic_amplitude() -> Entrance:
    """``~/amplitude`` and ``~/frequency`` while a rhythmic skill, or another, is executed."""
    skills = [short_cycle(), short_skill()]
    made = server()

    def feed(data: bytes) -> None:
        streamer = made.node.streamer
        streamer.use(skills[len(data) % 2], 'fuzzed')
        streamer.begin()
        made.pass_time()
        made.send(Float64, '~/amplitude', data)
        made.send(Float64, '~/frequency', data)
        streamer.use(skills[1], 'fuzzed')
        streamer.begin()
        made.pass_time()
    return Entrance(feed, [serialize_message(Float64(data=one)) for one in (0.5, float('nan'))])


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
    skill = context_skill()

    def before(made: nodes.FuzzedNode) -> None:
        made.node._skills.use(skill, 'fuzzed')
        _moving(made)
    return _topic(server(), Context, '~/context', [
        Context(names=['height'], values=[0.05]), Context(),
        Context(names=['height'], values=[1e300])], takes=False, before=before)


def context_table() -> Entrance:
    """Bytes of a table of contexts."""
    path = _folder() / 'contexts.csv'

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(GdmpError):
            Contexts.of(read_numbers(path, ['a', 'b', 'c', 'd']), 4)
    return Entrance(feed, [b'take,height\na,1\nb,2\nc,3\nd,5\n',
                           b'height,"take"\r\n1e3,a\r\n2,b\r\n-3,c\r\n.5,d'])


def object_table() -> Entrance:
    """Bytes of a table of poses of objects."""
    path = _folder() / 'objects.csv'

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(GdmpError):
            for poses in read_poses(path, ['a', 'b']):
                checked_frames(poses, TOOL, 3)
    return Entrance(feed, [b'take,box.x,box.y,box.z,box.qw,box.qx,box.qy,box.qz\n'
                           b'a,0,0,0,1,0,0,0\nb,1,2,3,0,1e0,0,0\n'])


def urdf_file() -> Entrance:
    """Bytes of a URDF; what is accepted has poses."""
    path = _folder() / 'robot.urdf'

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(GdmpError):
            arm = from_urdf(path, 'tool0')
            arm.poses(np.zeros((2, len(arm.names))))
    return Entrance(feed, [urdf.ur5e().encode(), urdf.ur5e(urdf.JOINTS[:1]).encode()])


def motor_calibration() -> Entrance:
    """Bytes of a calibration of motors."""
    path, arm = _folder() / 'motors.json', from_model('panda')
    rows = np.full((2, len(arm.names)), 50.0)

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        with suppress(GdmpError):
            radians('fuzzed', ArmJoints(arm, path), rows, 'percent', True)
    return Entrance(feed, [json.dumps({name: {'range_min': 100, 'range_max': 4000, 'drive_mode': 1}
                                       for name in arm.names}).encode()])


def service_refine() -> Entrance:
    """``~/refine_skill``."""
    made = server()

    def feed(data: bytes) -> None:
        with suppress(Exception):  # what is no request is not handed on
            request = deserialize_message(data, RefineSkill.Request)
            request.output = ''
            data = serialize_message(request)
        _moving(made)
        made.request(RefineSkill, '~/refine_skill', data)
    return Entrance(feed, [serialize_message(RefineSkill.Request(action=n)) for n in range(5)])


def topic_measured_pose() -> Entrance:
    """Measured pose of the robot, and a start from it."""
    made = nodes.server(_saved, 'watching', phase_stopping=50.0)
    return _topic(made, PoseStamped, made.node.parameters.measured_pose_topic, [_pose()],
                  before=_moving)


def topic_clock() -> Entrance:
    """``/clock`` of a server on simulated time."""
    made = nodes.server(_saved, 'simulated_time', use_sim_time=True)
    valid = [Clock(clock=Time(sec=100, nanosec=i * 10 ** 6)) for i in range(3)]
    return _topic(made, Clock, '/clock', valid)


def topic_hand_pose() -> Entrance:
    """Hand that guides the simulated arm."""
    def before(made: nodes.FuzzedNode) -> None:
        made.request(SetBool, '~/teach', serialize_message(SetBool.Request(data=True)))
    return _topic(nodes.simulation(), PoseStamped, '~/hand_pose', [_pose()], before=before)


def topic_reference() -> Entrance:
    """Reference of the simulated arm."""
    made = nodes.simulation()

    def feed(data: bytes) -> None:
        with suppress(Exception):  # what is no message stays as it is
            message = deserialize_message(data, Reference)
            # In every other input the stamp is that of the clock: it would refuse nearly all.
            if message.sequence % 2 == 0:
                message.header.stamp = stamp_of(made.stamp())
                made.node.commands.control.controller.guard._stream.sequence = 0.0
                data = serialize_message(message)
        made.send(Reference, made.node.parameters.reference_topic, data)
    return Entrance(feed, [serialize_message(_reference())])


def topic_converted() -> Entrance:
    """Reference that the adapter converts for other controllers."""
    made = nodes.adapter()
    return _topic(made, Reference, made.node.parameters.reference_topic, [_reference()])


def topic_shown() -> Entrance:
    """State of an arm that the visualizer shows."""
    valid = RobotState()
    valid.header.frame_id, valid.pose.orientation.w = FRAME, 1.0
    valid.stiffness = np.diag([400.0] * 3 + [30.0] * 3).ravel()
    valid.position = [0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.8]
    made = nodes.visualizer()
    return _shown(_topic(made, RobotState, f'{made.node.parameters.arm}/state', [valid]), made)


def topic_handle() -> Entrance:
    """What a user does to the handles of the visualizer."""
    made = nodes.visualizer()
    state = ServerState(goal=[_pose().pose])
    state.header.frame_id = FRAME
    made.send(ServerState, f'{made.node.parameters.server}/state', serialize_message(state))
    valid = [InteractiveMarkerFeedback(marker_name='goal', event_type=kind, menu_entry_id=1)
             for kind in (1, 2, 4, 5)]
    for message in valid:
        message.header.frame_id, message.pose = FRAME, _pose().pose
    return _shown(_topic(made, InteractiveMarkerFeedback, '~/feedback', valid, takes=False), made)


def _shown(entrance: Entrance, made: nodes.FuzzedNode) -> Entrance:
    """After each input the visualizer draws everything, as it does a few times a second."""
    def feed(data: bytes) -> None:
        entrance.feed(data)
        made.node._update_handles()
        made.node._all_markers()
    return Entrance(feed, entrance.seeds)


def _reference() -> Any:
    numbers = np.zeros(56)
    numbers[:7], numbers[19:55] = (0.31, 0, 0.48, 0, 1, 0, 0), HOLD_STIFFNESS.ravel()
    numbers[55] = 0.7
    valid = Reference()
    valid.header.frame_id = FRAME
    fill_reference(valid, numbers)
    return valid


def service_set_speed() -> Entrance:
    """``~/set_speed``."""
    return _service(server(), SetSpeed, '~/set_speed', [SetSpeed.Request(scale=0.5)])


def service_pause() -> Entrance:
    """``~/pause``, ``~/start`` and ``~/stop``, one after the other."""
    made = server()
    call = serialize_message(Trigger.Request())

    def feed(data: bytes) -> None:
        _moving(made)
        made.request(SetBool, '~/pause', data)
        made.request(Trigger, '~/stop', call)
        made.request(Trigger, '~/start', call)
    return Entrance(feed, [serialize_message(SetBool.Request(data=one)) for one in (True, False)])


def service_load_skill() -> Entrance:
    """``~/load_skill``: names of files, and what they contain."""
    valid = [LoadSkill.Request(path=str(p))
             for p in (_saved(), '/dev/zero', '/', '..', '/dev/stdin')]
    valid.append(LoadSkill.Request(path='sent', contents=Path(_saved()).read_text()))
    return _service(server(), LoadSkill, '~/load_skill', valid)


def service_learn_skill() -> Entrance:
    """``~/learn_skill``: the command it makes has no option that it was not to have."""
    made = server()

    def feed(data: bytes) -> None:
        try:
            request = deserialize_message(data, LearnSkill.Request)
        except Exception:
            return  # the middleware never hands it on
        request.output = request.output or 'skill.json'
        with suppress(GdmpError):
            _, command = made.node._learning.command(request)
            ends = command.index('--')
            options = {word.partition('=')[0] for word in command[:ends] if word[0] == '-'}
            if command[ends + 1:] != list(request.bags) or not options <= {
                    '-m', '--output', '--json', '--stiffness', '--n-basis', '--connection',
                    '--rhythmic'}:
                raise AssertionError(f'an option came in: {command}')
    return Entrance(feed, [serialize_message(one) for one in (
        LearnSkill.Request(bags=['demo'], n_basis=30, connection='parallel', output='x.json'),
        LearnSkill.Request(bags=['--each', '-o', '/etc/x'], connection='published'))])


def action_execute() -> Entrance:
    """Goals of ``~/execute``."""
    whole = ExecuteSkill.Goal(use_goal_pose=True, goal_pose=_pose(), duration=2.0,
                              goal_stiffness=list((300.0 * np.eye(3)).ravel()),
                              position_tolerance=0.01, rotation_tolerance=0.01)
    made = server()
    return Entrance(lambda data: made.goal(ExecuteSkill, '~/execute', data),
                    [serialize_message(one) for one in (ExecuteSkill.Goal(), whole)])


def services_of_the_simulation() -> Entrance:
    """``~/step_simulation``, and ``~/set_pause``, ``~/teach``, ``~/reset_world`` and the rest."""
    made = nodes.simulation()
    call = serialize_message(Trigger.Request())

    def feed(data: bytes) -> None:
        made.request(StepSimulation, '~/step_simulation', data)
        for paused in (True, False):
            request = serialize_message(SetBool.Request(data=paused))
            for name in ('set_pause', 'teach', 'identify'):
                made.request(SetBool, f'~/{name}', request)
            made.request(StepSimulation, '~/step_simulation', data[:12])
            made.request(Trigger, '~/refill_tank', call)
        if len(data) % 3 == 0:
            made.request(Trigger, '~/reset_world', call)
    return Entrance(feed, [serialize_message(StepSimulation.Request(steps=n)) for n in (0, 5, 9)])


def service_set_tool() -> Entrance:
    """``~/set_tool`` of the arm."""
    valid = [SetTool.Request(), SetTool.Request(pose=Pose(
        position=Point(x=0.05, z=0.1), orientation=Quaternion(x=0.6, w=0.8)))]
    return _service(nodes.simulation(), SetTool, '~/set_tool', valid)


def service_set_payload() -> Entrance:
    """``~/set_payload`` of the arm."""
    valid = [SetPayload.Request(), SetPayload.Request(mass=0.5, center=[0.0, 0.0, 0.05]),
             SetPayload.Request(mass=1.0, inertia=[0.01, 0.01, 0.01, 0.0, 0.0, 0.0])]
    return _service(nodes.simulation(), SetPayload, '~/set_payload', valid)


def _parameters(fuzzed: nodes.FuzzedNode, of_node: str) -> Entrance:
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
        choose, made = random.Random(data), fuzzed.node
        made.parameters.locked = choose.random() < 0.5
        for _ in range(3):
            which = choose.choice(names)
            before = getattr(made.parameters, which)
            try:
                changes = [Parameter(which, value=value(choose))]
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
                fuzzed.pass_time()
                made.set_parameters([Parameter(which, value=before)])
        fuzzed.pass_time()
    return Entrance(feed, [struct.pack('<I', i) for i in range(8)])


def parameters_of_the_server() -> Entrance:
    """Parameters of ``trajectory_server``."""
    return _parameters(server(), 'trajectory_server')


def parameters_of_the_simulation() -> Entrance:
    """Parameters of ``panda_sim``."""
    return _parameters(nodes.simulation(), 'panda_sim')


ENTRANCES: dict[str, Callable[[], Entrance]] = {
    made.__name__: made for made in (
        skill_file, skill_fields, bag_mcap, bag_sqlite3, bag_metadata, topic_goal_pose,
        topic_moving_goal, topic_goal_stiffness, topic_amplitude, sequence_file,
        topic_context, context_table, object_table, urdf_file, motor_calibration,
        service_refine,
        topic_measured_pose, topic_clock, topic_hand_pose,
        topic_reference, topic_converted, topic_shown, topic_handle,
        service_set_speed, service_pause, service_load_skill, service_learn_skill,
        action_execute, services_of_the_simulation, service_set_payload, service_set_tool,
        parameters_of_the_server, parameters_of_the_simulation)}
