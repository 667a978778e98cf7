"""A session of teaching: simulation and recorder as processes, with somebody who leads the arm."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
import select
import sys
import tempfile

from gdmp_ros.dmp import Demonstration
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.teacher import RECORDER, SIM, Teacher
from gdmp_ros.util.dds_network import default_environment, Domain
from gdmp_ros.util.processes import ChildProcesses, interrupt_on_sigterm
from gdmp_ros.util.terminal import progress

KEYS = ('Enter begins a take and ends it; d and Enter drops it; q and Enter ends the session')


@dataclass(frozen=True)
class Setting:
    """
    Where takes go, and how.

    :ivar folder: for the takes
    :ivar frame: of the poses
    :ivar window: whether the simulation shows one
    """

    folder: Path
    storage: str
    frame: str
    window: bool


def run(setting: Setting, shown: Sequence[Demonstration]) -> None:
    """
    Teach: a scripted hand leads along each motion, or with none shown somebody at the terminal.

    :raises GdmpError: if a process ends early or something does not happen in time
    """
    interrupt_on_sigterm()
    # Somebody who looks on, or leads by a marker, is on the user's own domain.
    domain = Domain() if shown else None
    environment = domain.environment() if domain else {**os.environ, **default_environment()}
    os.environ.update(environment)
    try:
        with _session(setting, environment) as teacher:
            if shown:
                with progress('teaching', len(shown)) as step:
                    for one in shown:
                        print(teacher.take(one), flush=True)
                        step()
            else:
                _by_hand(teacher)
    finally:
        if domain:
            domain.release()
    print(f'compare them: gdmp takes {setting.folder}')
    print(f'learn from them: gdmp learn {setting.folder} -o skill.json')


@contextmanager
def _session(setting: Setting, environment: dict[str, str]) -> Iterator[Teacher]:
    with tempfile.TemporaryDirectory(prefix='gdmp-teach-') as logs, ChildProcesses(
            environment, Path(logs)) as children:
        print('starting the simulation and the recorder', flush=True)
        children.start_node(SIM, 'gdmp_ros.ros.arm.node', {
            'headless': not setting.window, 'frame_id': setting.frame})
        children.start_node(RECORDER, 'gdmp_ros.ros.recorder.node', {
            'folder': str(setting.folder), 'storage': setting.storage})
        teacher = Teacher(setting.frame, check=children.check)
        try:
            teacher.ready()
            yield teacher
        finally:
            teacher.close()


def _by_hand(teacher: Teacher) -> None:
    """Let somebody at the terminal begin, end and drop takes."""
    print(f'the arm is weightless. {KEYS}', flush=True)
    word: str | None = ''
    while word not in ('q', None):
        word = _line(teacher)
        try:
            print(_obey(teacher, word), flush=True)
        except GdmpError as error:
            print(error, flush=True)


def _obey(teacher: Teacher, word: str | None) -> str:
    """Do what a line says; what to say about it. Takes end by themselves as well."""
    recording = teacher.recording()
    if word in ('q', None):
        return teacher.keep() if recording else 'done'
    if word == 'd':
        return teacher.discard()
    if word == '':
        return teacher.keep() if recording else teacher.record()
    return KEYS


def _line(teacher: Teacher) -> str | None:
    """Next line from the terminal while the nodes are listened to; None at its end."""
    teacher.wait('a key', lambda: bool(select.select([sys.stdin], [], [], 0.0)[0]), 86400.0)
    line = sys.stdin.readline()
    return line.strip() if line else None
