"""Learning in a process of its own: the stream must not feel it."""
from __future__ import annotations

import json
from pathlib import Path
import subprocess
import sys
import tempfile
from typing import Any, TYPE_CHECKING

from gdmp_msgs.srv import LearnSkill
from rclpy.task import Future

from gdmp_ros.errors import DataError, ParameterError

if TYPE_CHECKING:
    from gdmp_ros.nodes.trajectory_server import TrajectoryServer


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
        if not request.bags:
            raise ParameterError('no bags were named')
        parameters = self._node.parameters
        output = request.output or str(Path(tempfile.mkdtemp(prefix='gdmp-')) / 'skill.json')
        command = [sys.executable, '-m', 'gdmp_ros.cli.main', 'learn', *request.bags, '-o', output,
                   '--json', '--n-basis', str(request.n_basis or parameters.n_basis),
                   '--connection', request.connection or parameters.connection]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                         text=True)
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

    def cancel(self) -> None:
        """End a learning process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
