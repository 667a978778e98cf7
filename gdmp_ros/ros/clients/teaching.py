"""A teaching session: simulation and take recorder as processes, and a hand."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
import select
import sys
import tempfile

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.teacher import Teacher
from gdmp_ros.ros.clients.testbed import ARM, MODULES, TAKE_RECORDER
from gdmp_ros.util.dds_network import default_environment, Domain
from gdmp_ros.util.processes import ChildProcesses
from gdmp_ros.util.signals import interrupt_on_sigterm
from gdmp_ros.util.terminal import progress

KEYS = 'Enter: start or stop a take; d Enter: discard it; q Enter: end the session'
GRIPPER_KEYS = 'o Enter: open the gripper; c Enter: close it, and hold with 20 N'
#: Commands of these keys: width [m] and force [N].
GRIPPER = {'o': GripperCommand(0.08), 'c': GripperCommand(0.0, 20.0)}


@dataclass(frozen=True)
class TeachingSettings:
    """
    Where and how takes are recorded.

    :ivar folder: for the takes
    :ivar frame: ``frame_id`` of the poses
    :ivar window: whether the simulation has a window
    :ivar gripper: whether the arm has a gripper
    """

    folder: Path
    storage: str
    frame: str
    window: bool
    gripper: bool = False


def teach(settings: TeachingSettings, shown: Sequence[Demonstration]) -> None:
    """
    Teach: a scripted hand guides the arm along each motion; without motions the user does.

    :raises GdmpError: if a process ends early or something does not happen in time
    """
    interrupt_on_sigterm()
    # With the user's own hand the nodes are in the user's domain, for RViz.
    domain = Domain() if shown else None
    environment = domain.environment() if domain else {**os.environ, **default_environment()}
    os.environ.update(environment)
    try:
        with _session(settings, environment) as teacher:
            if shown:
                with progress('teaching', len(shown)) as step:
                    for one in shown:
                        print(teacher.take(one), flush=True)
                        step()
            else:
                _by_hand(teacher, settings.gripper)
    finally:
        if domain:
            domain.release()
    print(f'compare them: gdmp takes {settings.folder}')
    print(f'learn from them: gdmp learn {settings.folder} -o skill.json')


@contextmanager
def _session(settings: TeachingSettings, environment: dict[str, str]) -> Iterator[Teacher]:
    with tempfile.TemporaryDirectory(prefix='gdmp-teach-') as logs, ChildProcesses(
            environment, Path(logs)) as children:
        print('starting the simulation and the recorder', flush=True)
        children.start_node(ARM, MODULES[ARM], {
            'headless': not settings.window, 'frame_id': settings.frame,
            'gripper': settings.gripper})
        children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
            'folder': str(settings.folder), 'storage': settings.storage})
        teacher = Teacher(settings.frame, check=children.check)
        try:
            teacher.ready()
            yield teacher
        finally:
            teacher.close()


def _by_hand(teacher: Teacher, gripper: bool) -> None:
    """Let the user start, stop and discard takes."""
    print(f'the arm can be guided by hand. {KEYS}'
          + (f'; {GRIPPER_KEYS}' if gripper else ''), flush=True)
    word: str | None = ''
    while word not in ('q', None):
        word = _line(teacher)
        try:
            print(_carry_out(teacher, word), flush=True)
        except GdmpError as error:
            print(error, flush=True)


def _carry_out(teacher: Teacher, word: str | None) -> str:
    """Carry out a line of the user; returns the answer."""
    # Asked each time, because a take can also end without the user.
    recording = teacher.recording()
    if word in ('q', None):
        return teacher.keep() if recording else 'done'
    if word == 'd':
        return teacher.discard()
    if word in GRIPPER:
        return teacher.command_gripper(GRIPPER[word])
    if word == '':
        return teacher.keep() if recording else teacher.record()
    return KEYS


def _line(teacher: Teacher) -> str | None:
    """Next line from the terminal, while messages are received; None at the end of input."""
    teacher.wait('a key', lambda: bool(select.select([sys.stdin], [], [], 0.0)[0]), 86400.0)
    line = sys.stdin.readline()
    return line.strip() if line else None
