"""Skills that a trajectory server learns: at start-up, and on request in another process."""
from __future__ import annotations

import json
from pathlib import Path
import shutil
import subprocess
import tempfile
from typing import Any

from gdmp_msgs.srv import LearnSkill

from gdmp_ros.dmp.primitive import check_connection
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.util import child_process


def skill_from_parameters(parameters: Parameters, logger: Any) -> tuple[Skill, str] | None:
    """
    Load or learn the skill that the parameters name.

    :returns: the skill and its name; None if there is none yet
    :raises DataError: if it cannot be loaded or learned
    """
    if parameters.skill:
        return Skill.load(parameters.skill), parameters.skill
    bags = [bag for bag in parameters.demonstrations if bag]
    if not bags:
        logger.info('no skill yet: waiting for ~/load_skill or ~/learn_skill')
        return None
    logger.info(f'learning from {len(bags)} demonstrations')
    # Slow to import, and a server that loads its skill does not need it.
    from gdmp_ros.data.skill_from_bags import LearningSettings, skill_from_bags
    settings = LearningSettings(
        n_basis=parameters.n_basis or 'auto', connection=parameters.connection,
        stiffness=parameters.learned_stiffness, frame=parameters.frame_id)
    learned = skill_from_bags(bags, settings)
    logger.info(f'learned; stiffness: {learned.stiffness}')
    return learned.skill, ', '.join(bags)


class LearningProcess:
    """Runs ``gdmp learn`` in its own process, so that the stream is not disturbed."""

    def __init__(self, node: ManagedNode, parameters: Parameters):
        self._node, self._parameters = node, parameters
        self._process: subprocess.Popen[str] | None = None

    async def learn(self, request: LearnSkill.Request) -> tuple[str, float]:
        """
        Learn from bags.

        :returns: path of the skill file and mean reproduction error / span
        :raises GdmpError: with the message of ``gdmp learn``
        """
        if self._process is not None:
            raise ParameterError('another skill is being learned')
        output, command = self.command(request)
        try:
            return output, await self._run(command)
        except BaseException:
            if not request.output:
                shutil.rmtree(Path(output).parent, ignore_errors=True)
            raise

    async def _run(self, command: list[str]) -> float:
        """Run ``gdmp learn``; its mean reproduction error / span."""
        # Into files: the process would wait as soon as a pipe is full.
        with (tempfile.TemporaryFile('w+') as out, tempfile.TemporaryFile('w+') as errors):
            try:
                self._process = subprocess.Popen(command, stdout=out, stderr=errors, text=True)
            except (OSError, ValueError) as error:
                raise ParameterError(f'learning cannot be started: {error}') from None
            await self._node.wait_until(self._has_ended)
            process, self._process = self._process, None
            if process is None:
                raise ParameterError('learning was cancelled')
            for stream in (out, errors):
                stream.seek(0)
            if process.returncode != 0:
                lines = errors.read().strip().splitlines()
                raise DataError(lines[-1] if lines
                                else f'learning failed with code {process.returncode}')
            report: dict[str, Any] = json.load(out)
        return float(report['mean_relative_error'])

    def _has_ended(self) -> bool:
        return self._process is None or self._process.poll() is not None

    def command(self, request: LearnSkill.Request) -> tuple[str, list[str]]:
        """
        Path of the skill file, and the command that writes it; no name can become an option.

        :raises ParameterError: if the request is invalid
        """
        parameters = self._parameters
        if not request.bags:
            raise ParameterError('no bags were named')
        connection = request.connection or parameters.connection
        check_connection(connection)
        for name in (*request.bags, request.output):
            if '\0' in name or not name.isprintable():
                raise ParameterError(f'{name!r} is not the name of a file')
        output = request.output or str(Path(tempfile.mkdtemp(prefix='gdmp-')) / 'skill.json')
        return output, child_process.command(
            'gdmp_ros.cli.start', 'learn', f'--output={output}', '--json',
            f'--stiffness={parameters.learned_stiffness}',
            f'--n-basis={request.n_basis or parameters.n_basis or "auto"}',
            f'--connection={connection}', *(['--rhythmic'] if request.rhythmic else []),
            '--', *request.bags)

    def cancel(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
