"""Learning in a process of its own: the stream must not feel it."""
from __future__ import annotations

import json
from pathlib import Path
import subprocess
import tempfile
from typing import Any, TYPE_CHECKING

from gdmp_msgs.srv import LearnSkill
from rclpy.task import Future

from gdmp_ros.dmp.primitive import CONNECTIONS
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util import child_process as child

if TYPE_CHECKING:
    from gdmp_ros.ros.server.node import TrajectoryServer


class LearningProcess:
    """Runs ``gdmp learn`` and looks after it ten times a second."""

    def __init__(self, node: TrajectoryServer):
        self._node = node
        self._process: subprocess.Popen[str] | None = None

    async def learn(self, request: LearnSkill.Request) -> tuple[str, float]:
        """
        Learn from bags.

        :returns: path of the skill file and mean reproduction error / span
        :raises GdmpError: with what ``gdmp learn`` said
        """
        if self._process is not None:
            raise ParameterError('a skill is being learned already')
        output, command = self.command(request)
        try:
            self._process = subprocess.Popen(command, stdout=subprocess.PIPE,
                                             stderr=subprocess.PIPE, text=True)
        except (OSError, ValueError) as error:
            raise ParameterError(f'learning cannot be started: {error}') from None
        done: Future = Future(executor=self._node.executor)

        def look() -> None:
            if self._process is None or self._process.poll() is not None:
                timer.cancel()
                done.set_result(True)

        timer = self._node.wall_timer(0.1, look)
        await done
        self._node.destroy_timer(timer)
        process, self._process = self._process, None
        if process is None:
            raise ParameterError('learning was cancelled')
        out, complaint = process.communicate()
        if process.returncode != 0:
            raise DataError(complaint.strip().splitlines()[-1] if complaint.strip()
                            else f'learning failed with code {process.returncode}')
        report: dict[str, Any] = json.loads(out)
        return output, float(report['mean_relative_error'])

    def command(self, request: LearnSkill.Request) -> tuple[str, list[str]]:
        """
        Path of the skill file and the command that writes it; nothing in it can be an option.

        :raises ParameterError: if the request is not one to learn from
        """
        parameters = self._node.parameters
        if not request.bags:
            raise ParameterError('no bags were named')
        connection = request.connection or parameters.connection
        if connection not in CONNECTIONS:
            raise ParameterError(f'connection is {connection!r}, expected one of '
                                 f'{", ".join(CONNECTIONS)}')
        for name in (*request.bags, request.output):
            if '\0' in name or not name.isprintable():
                raise ParameterError(f'{name!r} is not the name of a file')
        output = request.output or str(Path(tempfile.mkdtemp(prefix='gdmp-')) / 'skill.json')
        return output, child.command(
            'gdmp_ros.cli.main', 'learn', f'--output={output}', '--json',
            f'--stiffness={parameters.learned_stiffness}',
            f'--n-basis={request.n_basis or parameters.n_basis}', f'--connection={connection}',
            '--', *request.bags)

    def cancel(self) -> None:
        """End a learning process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
