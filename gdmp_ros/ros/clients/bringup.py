"""Arm, server and recorder of takes as processes in the user's own DDS domain."""
from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import dataclass
import os
from pathlib import Path
from tempfile import TemporaryDirectory

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.client import START_UP_S
from gdmp_ros.ros.clients.server_client import ServerClient
from gdmp_ros.ros.clients.testbed import ARM, MODULES, SERVER, TAKE_RECORDER
from gdmp_ros.util.dds_network import default_environment, locked
from gdmp_ros.util.processes import ChildProcesses
from gdmp_ros.util.signals import stop_event

#: Interval at which the processes are looked at [s].
LOOK_S = 0.2


@dataclass(frozen=True)
class Bringup:
    """
    What is started.

    :ivar skill: file that the server loads; None for none
    :ivar takes: folder of the recorder
    :ivar model: of the arm, as for ``panda_sim``
    :ivar window: whether the simulation has a window
    :ivar logs: folder for the output of the nodes; None for a temporary one
    """

    skill: Path | None
    takes: Path
    model: str = ''
    gripper: bool = False
    window: bool = False
    logs: Path | None = None


def up(wanted: Bringup) -> None:
    """
    Start the nodes, and end them with Ctrl-C or SIGTERM.

    :raises GdmpError: if nodes of these names run already, or one of them ends
    """
    ends = stop_event()
    environment = {**os.environ, **default_environment()}
    os.environ.update(environment)
    with ExitStack() as stack:
        logs = wanted.logs or Path(stack.enter_context(TemporaryDirectory(prefix='gdmp-up-')))
        # Another one of this machine is known at once, whatever DDS has discovered.
        with suppress(PermissionError):
            claim = locked(f'up-{os.environ.get("ROS_DOMAIN_ID", "0")}')
            if claim is None:
                raise _taken([ARM, SERVER, TAKE_RECORDER])
            stack.callback(claim.close)
        client = ServerClient()
        stack.callback(client.close)
        client.spend(1.0)  # other nodes are discovered
        _refuse_others(client, own=0)
        children = stack.enter_context(ChildProcesses(environment, logs))
        print('starting the simulated arm, the server and the recorder', flush=True)
        _start(children, wanted)
        waited = 0.0
        while not ends.is_set() and not _is_ready(client):
            children.check()
            client.spend(LOOK_S)
            _refuse_others(client, own=1)  # on a busy machine they are found later
            waited += LOOK_S
            if waited > START_UP_S:
                raise GdmpError(f'waited {START_UP_S:g} s for {SERVER} and the pose of the arm, '
                                'without success (--logs keeps what the nodes say)')
        if not ends.is_set():
            print(f'running: {ARM}, {SERVER}, {TAKE_RECORDER}; logs: {logs} (Ctrl-C ends them)',
                  flush=True)
        while not ends.is_set():
            children.check()
            client.spend(LOOK_S)
    print('ended')


def _refuse_others(client: ServerClient, own: int) -> None:
    """
    Look for other nodes of these names.

    :param own: how many of each name may run
    :raises GdmpError: if there are more
    """
    running = [name.rpartition('/')[2] for name in client.participant.nodes()]
    taken = [name for name in sorted((ARM, SERVER, TAKE_RECORDER)) if running.count(name) > own]
    if taken:
        raise _taken(taken)


def _taken(names: list[str]) -> GdmpError:
    return GdmpError(f'{", ".join(names)} run already in this DDS domain (ROS_DOMAIN_ID chooses '
                     'another one)')


def _is_ready(client: ServerClient) -> bool:
    """Whether the server answers, and knows where the arm is: before, it refuses a start."""
    return client.state is not None and 'no_robot' not in client.state.flags


def _start(children: ChildProcesses, wanted: Bringup) -> None:
    children.start_node(ARM, MODULES[ARM], {
        'headless': not wanted.window, 'gripper': wanted.gripper, 'model': wanted.model})
    children.start_node(SERVER, MODULES[SERVER], {
        'measured_pose_topic': f'/{ARM}/measured_pose', 'reach_model': wanted.model,
        **({} if wanted.skill is None else {'skill': str(wanted.skill.absolute())})})
    children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
        'folder': str(wanted.takes.absolute()),
        'pose_topic': f'/{ARM}/measured_pose'})
