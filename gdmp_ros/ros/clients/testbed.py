"""Arm, server and recorder as processes: in their own DDS domain for tests, or in the user's."""
from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, ExitStack, suppress
from dataclasses import dataclass, field
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self, TypeVar

from gdmp_ros.data import runs
from gdmp_ros.data.runs import REFERENCE_TOPIC, SERVER_STATE_TOPIC
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.arm_choice import (
    ArmChoice,
    FRANKA,
    FRANKA_GRIPPER,
    POSITION,
    SERVO_SIM,
    SIMULATED,
)
from gdmp_ros.ros.clients.server_client import ServerClient, START_UP_S
from gdmp_ros.util.dds_network import default_environment, Domain, locked
from gdmp_ros.util.processes import ChildProcesses, stop_event

#: Interval at which the processes are looked at [s].
LOOK_S = 0.2
ARM, SERVER, RECORDER, TAKE_RECORDER = (SIMULATED, 'trajectory_server', 'recorder',
                                        'take_recorder')
#: Modules of the nodes.
MODULES = {ARM: 'gdmp_ros.ros.arm.simulated_arm', FRANKA: 'gdmp_ros.ros.arm.franka_arm',
           FRANKA_GRIPPER: 'gdmp_ros.ros.arm.franka_gripper',
           POSITION: 'gdmp_ros.ros.arm.position_arm',
           SERVO_SIM: 'gdmp_ros.ros.arm.servo_sim',
           SERVER: 'gdmp_ros.ros.server.node',
           TAKE_RECORDER: 'gdmp_ros.ros.recorder.node'}
#: Opens a testbed: its class, and all arguments of that but ``environment``.
Opener = Callable[..., AbstractContextManager[Any]]


@dataclass(frozen=True)
class Bringup:
    """
    What is started.

    :ivar skill: file that the server loads; None for none
    :ivar takes: folder of the recorder
    :ivar arm: that is started
    :ivar model: of the arm, as for ``panda_sim``
    :ivar window: whether the simulation has a window
    :ivar logs: folder for the output of the nodes; None for a temporary one
    :ivar scene: file of what stands around the arm; None for nothing
    """

    skill: Path | None
    takes: Path
    arm: ArmChoice = field(default_factory=ArmChoice)
    model: str = ''
    gripper: bool = False
    window: bool = False
    logs: Path | None = None
    scene: Path | None = None


def up(settings: Bringup) -> None:
    """
    Start the nodes, and end them with Ctrl-C or SIGTERM.

    :raises GdmpError: if nodes of these names run already, or one of them ends
    """
    ends = stop_event()
    environment = {**os.environ, **default_environment()}
    os.environ.update(environment)
    with ExitStack() as stack:
        logs = settings.logs or Path(stack.enter_context(TemporaryDirectory(prefix='gdmp-up-')))
        # Another one of this machine is known at once, whatever DDS has discovered.
        with suppress(PermissionError):
            claim = locked(f'up-{os.environ.get("ROS_DOMAIN_ID", "0")}')
            if claim is None:
                raise _taken([settings.arm.node, SERVER, TAKE_RECORDER])
            stack.callback(claim.close)
        client = ServerClient()
        stack.callback(client.close)
        client.spend(1.0)  # other nodes are discovered
        names = [settings.arm.node, SERVER, TAKE_RECORDER]
        _refuse_others(client, names, own=0)
        stack.enter_context(settings.arm.robot(logs, settings.gripper))
        children = stack.enter_context(ChildProcesses(environment, logs))
        print('starting the arm, the server and the recorder', flush=True)
        _start(children, settings)

        def is_ready() -> bool:
            children.check()
            _refuse_others(client, names, own=1)  # on a busy machine they are found later
            return ends.is_set() or _is_ready(client)
        client.wait(f'{SERVER} and the pose of the arm (--logs keeps what the nodes say)',
                    is_ready, START_UP_S, why=lambda: (
                        '' if client.state is None else client.state.last_refusal))
        if not ends.is_set():
            print(f'running: {", ".join(names)}; logs: {logs} (Ctrl-C ends them)', flush=True)
        while not ends.is_set():
            children.check()
            client.spend(LOOK_S)
    print('ended')


def _refuse_others(client: ServerClient, names: Sequence[str], own: int) -> None:
    """
    Look for other nodes of these names.

    :param own: how many of each name may run
    :raises GdmpError: if there are more
    """
    running = [name.rpartition('/')[2] for name in client.participant.nodes()]
    taken = [name for name in sorted(names) if running.count(name) > own]
    if taken:
        raise _taken(taken)


def _taken(names: list[str]) -> GdmpError:
    return GdmpError(f'{", ".join(names)} run already in this DDS domain (ROS_DOMAIN_ID chooses '
                     'another one)')


def _is_ready(client: ServerClient) -> bool:
    """Whether the server answers, and knows where the arm is: before, it refuses a start."""
    return client.state is not None and 'no_robot' not in client.state.flags


def _start(children: ChildProcesses, settings: Bringup) -> None:
    arm = settings.arm
    model = {'model': settings.model} if arm.kind == 'sim' else {}
    # The server has it from the arm.
    scene = {} if settings.scene is None else {'scene_file': str(settings.scene.absolute())}
    start_arm(children, arm, settings.gripper, {**model, **scene}, settings.window)
    children.start_node(SERVER, MODULES[SERVER], {
        **arm.server_parameters(), **({'reach_model': settings.model} if model else {}),
        **({} if settings.skill is None else {'skill': str(settings.skill.absolute())})})
    children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
        'folder': str(settings.takes.absolute()),
        'pose_topic': f'/{arm.node}/measured_pose'})


def start_arm(children: ChildProcesses, arm: ArmChoice, gripper: bool,
              parameters: Mapping[str, object], window: bool = False) -> None:
    """
    Start an arm, and its gripper if that is a node of its own.

    :param gripper: whether it has one
    :param parameters: of the arm
    :param window: whether the simulation has a window
    """
    if arm.kind == 'sim':
        parameters = {'headless': not window, 'gripper': gripper, **parameters}
    elif gripper:
        children.start_node(FRANKA_GRIPPER, MODULES[FRANKA_GRIPPER],
                            {'host': arm.parameters()['host']})
    for robot in arm.robots:
        children.start_node(robot, MODULES[robot], {'gripper': gripper}, arm.arguments())
    children.start_node(arm.node, MODULES[arm.node], {**arm.parameters(), **parameters},
                        arm.arguments())


class NodeTestbed:
    """
    Nodes as processes; leaving the context ends them all.

    :ivar children: the processes by name
    :ivar client: client of the server
    :ivar may_end: names of processes that may end
    """

    def __init__(self, folder: Path, environment: Mapping[str, str],
                 arm: ArmChoice | None = None, children: ChildProcesses | None = None):
        """
        Begin without nodes.

        :param folder: for logs and recordings
        :param environment: of a `gdmp_ros.util.dds_network.Domain`
        :param arm: by default the simulated one
        :param children: what runs the nodes; by default processes
        """
        # This process joins the domain too.
        os.environ.update(environment)
        self.folder, self.arm = folder, arm or ArmChoice()
        self.environment = dict(environment)
        self.children = children or ChildProcesses(environment, folder / 'logs')
        # The recorder ends when the disk is full.
        self.may_end = {RECORDER}
        self.client = ServerClient(check=self.check)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.children.stop_all()
        finally:
            self.client.close()

    def check(self) -> None:
        """:raises GdmpError: if a process has ended that must not"""
        self.children.check(self.may_end)

    def start_arm(self, prefix: Sequence[str] = (), extra: Sequence[str] = (),
                  world: Mapping[str, object] | None = None, **parameters: object) -> None:
        """
        Start the arm.

        :param prefix: command that executes the rest of the line, such as ``nsenter``
        :param extra: arguments after ``--ros-args``
        :param world: parameters of what simulates the arm: its model, its scene; a real one has
            its own
        """
        name, simulates = self.arm.node, dict(world or {})
        for robot in self.arm.robots:
            self.children.start_node(robot, MODULES[robot], simulates, self.arm.arguments(),
                                     prefix)
        if self.arm.kind == 'sim':
            parameters = {**simulates, **parameters}
        self.children.start_node(name, MODULES[name], {**self.arm.parameters(), **parameters},
                                 [*self.arm.arguments(), *extra], prefix)

    def start_server(self, name: str = SERVER, extra: Sequence[str] = (),
                     environment: Mapping[str, str] | None = None,
                     prefix: Sequence[str] = (), **parameters: object) -> None:
        """Start a trajectory server that is connected to the arm."""
        connected = {**self.arm.server_parameters(), **parameters}
        self.children.start_node(name, MODULES[SERVER], connected, extra, prefix, environment)

    def record(self, bag: Path | None = None, arguments: Sequence[str] = (),
               prefix: Sequence[str] = ()) -> None:
        """
        Record references and states until `recorded`.

        :param bag: by default ``run`` in the folder
        :param arguments: of `gdmp_ros.ros.recorder.record`
        """
        self.children.start(RECORDER, 'gdmp_ros.ros.recorder.record', [
            str(bag or self.folder / 'run'), f'{REFERENCE_TOPIC}=gdmp_msgs/msg/Reference',
            f'/{self.arm.node}/state=gdmp_msgs/msg/RobotState',
            f'{SERVER_STATE_TOPIC}=gdmp_msgs/msg/ServerState', *arguments], prefix)
        self.wait_log(RECORDER, 'recording\n', START_UP_S)

    def start(self, arm: Mapping[str, Any] | None = None, server: Mapping[str, Any] | None = None,
              record: bool = True, world: Mapping[str, Any] | None = None) -> None:
        """
        Start everything and wait until the server holds the pose of the arm.

        :param arm: parameters of the arm, unless it runs already
        :param server: parameters of the server
        :param world: see `start_arm`
        """
        if self.arm.node not in self.children.processes:
            self.start_arm(world=world, **(arm or {}))
        self.start_server(**(server or {}))
        self.wait_holding()
        if record:
            self.record()

    def end_recording(self) -> None:
        """Close the bag."""
        self.children.stop(RECORDER, timeout=60.0)

    def recorded(self, bag: Path | None = None) -> runs.Run:
        """End the recording and read it."""
        self.end_recording()
        return runs.read(bag or self.folder / 'run')

    @property
    def state(self) -> Any:
        """
        Newest state of the server.

        :raises GdmpError: if there is none
        """
        if self.client.state is None:
            raise GdmpError('no state of the server has been received')
        return self.client.state

    def wait_holding(self) -> None:
        """Wait until a server that has just been started holds the arm."""
        self.spend(0.2)  # discard messages of an earlier server
        self.client.state = None
        self.client.wait_status('holding', START_UP_S)

    def wait_progress(self, value: float) -> None:
        """
        Wait until a motion has reached a progress.

        :raises GdmpError: if it has failed, or after 60 s
        """
        self.client.state = None  # it may be of the motion before

        def reached() -> bool:
            self.client.check_failure()
            state = self.client.state
            return state is not None and state.status == 'moving' and state.progress >= value
        self.client.wait(f'{value:.0%} of the motion', reached, 60.0)

    def wait_log(self, name: str, text: str, timeout: float) -> None:
        """
        Wait until a process has printed a text.

        :raises GdmpError: after the timeout, or if the process reports an error
        """
        def found() -> bool:
            log = self.log(name)
            if 'error:' in log:
                raise GdmpError(f'{name}: {log.strip()}')
            return text in log
        self.client.wait(f'{text.strip()!r} from {name}', found, timeout)

    def wait(self, what: str, until: Any, timeout: float = 15.0) -> None:
        """Wait until a condition holds; see `gdmp_ros.ros.clients.server_client.Client.wait`."""
        self.client.wait(what, until, timeout)

    def spend(self, seconds: float) -> None:
        """Let time pass while the client receives messages."""
        self.client.spend(seconds)

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service and return its reply."""
        return self.client.call(kind, name, **fields)

    def log(self, name: str) -> str:
        """Output of a process so far."""
        return self.children.log(name).read_text(errors='replace')


Bed = TypeVar('Bed', bound=NodeTestbed)


@contextmanager
def process_bed(kind: Callable[..., Bed], *arguments: Any, **options: Any) -> Iterator[Bed]:
    """
    A testbed of processes in a DDS domain of its own.

    The environment of this process is that of the domain meanwhile.

    :param kind: the class; it gets the other arguments, and ``environment``
    """
    before = dict(os.environ)
    try:
        with (Domain() as domain,
              kind(*arguments, environment=domain.environment(), **options) as bed):
            yield bed
    finally:
        os.environ.clear()
        os.environ.update(before)
