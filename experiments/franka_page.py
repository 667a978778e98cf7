"""
What a user of a Franka does on the first day, over the protocol: the commands of the page.

The commands of `docs/franka_first_skill.md` are run one after the other, with a server of the
protocol in place of the robot, and a scripted hand in place of a person.
"""
from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from typing import Any

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.util.dds_network import Domain

PAGE = Path(__file__).parent.parent / 'docs' / 'franka_first_skill.md'
#: Address of the robot on the page.
ADDRESS = '172.16.0.2'
#: Longest time for a command, and for the end of one in the background [s].
LONGEST_S, END_S = 600.0, 30.0
#: Lines of output that are kept of each command.
KEPT = 8


def blocks(text: str) -> list[str]:
    """Commands of a page: the content of its fences of bash."""
    return [found.strip() for found in re.findall(r'^```bash[^\n]*\n(.*?)^```', text, re.S | re.M)]


def over_protocol(command: str) -> str:
    """A command with the server of the protocol as its robot."""
    return command.replace(f'--host {ADDRESS}', '--protocol-server').replace(ADDRESS, '127.0.0.1')


def run_page(folder: Path) -> list[dict[str, Any]]:
    """
    Run all commands; those after one that failed, too.

    :returns: of each: ``command``, ``exit_code``, ``seconds``, ``said``, the end of its output
    """
    folder.mkdir(parents=True, exist_ok=True)
    with Domain() as domain, ExitStack() as stack:
        environment = {**os.environ, **domain.environment(), 'PATH': os.pathsep.join(
            [str(Path(sys.executable).parent), os.environ['PATH']])}
        done = []
        for block in blocks(PAGE.read_text()):
            command = over_protocol(block)
            print(command, flush=True)
            if command.startswith('gdmp up'):  # runs until the last command has ended
                stack.enter_context(_background(command, folder, environment))
                continue
            if 'doctor' in command:  # the others start the server themselves
                with ArmChoice('franka', protocol_server=True).robot(folder):
                    done.append(_run(command, folder, environment))
            else:
                done.append(_run(command, folder, environment))
    return done


def _run(command: str, folder: Path, environment: dict[str, str]) -> dict[str, Any]:
    begun = time.monotonic()
    done = subprocess.run(['bash', '-ec', command], cwd=folder, env=environment, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=LONGEST_S,
                          stdin=subprocess.DEVNULL, check=False)
    return {'command': command, 'exit_code': done.returncode,
            'seconds': round(time.monotonic() - begun, 1),
            'said': done.stdout.splitlines()[-KEPT:]}


@contextmanager
def _background(command: str, folder: Path, environment: dict[str, str]) -> Iterator[None]:
    """
    Run a command meanwhile; it ends as with Ctrl-C.

    :raises GdmpError: if it has ended by itself, or does not end
    """
    process = subprocess.Popen(['bash', '-ec', f'exec {command}'], cwd=folder, env=environment,
                               stdin=subprocess.DEVNULL)
    try:
        yield
    finally:
        ended = process.poll()
        process.send_signal(signal.SIGINT)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise GdmpError(f'{command}: does not end with Ctrl-C') from None
    if ended is not None:
        raise GdmpError(f'{command}: has ended with code {ended}')
