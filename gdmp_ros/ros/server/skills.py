"""Skills of a server: loaded and checked with its arm, learned, corrected by pushes."""
from __future__ import annotations

from collections.abc import Mapping
import json
from pathlib import Path
import shutil
import subprocess
import tempfile
from typing import Any
import warnings

from gdmp_msgs.msg import Context
from gdmp_msgs.srv import LearnSkill, LoadSkill, RefineSkill
import numpy as np

from gdmp_ros.dmp.changes import joints_in_order
from gdmp_ros.dmp.primitive import check_connection
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.learning.correction import Correction, correction, FollowedMotion
from gdmp_ros.playback.streamed_skill import is_of_two_arms
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import pose_message
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.sim.path_check import check_skill, PathChecker
from gdmp_ros.util import child_process

#: Poses of a path that are checked: fewer than ``gdmp check`` does, because a stream goes on.
CHECKED_POSES = 40
#: Poses of a path in the reply.
PREVIEW_POSES = 101


class SkillLoader:
    """Puts skills into the streamer, and warns of those that the arm cannot follow."""

    def __init__(self, streamer: Streamer, checker: PathChecker | None, logger: Any):
        """:param checker: of the arm; None without a model"""
        self._streamer, self._checker, self._logger = streamer, checker, logger
        self._loaded: tuple[Skill, str] | None = None

    def use(self, skill: Skill, name: str) -> str:
        """
        Use a skill for the next start.

        :returns: why the arm cannot follow it to its own goal, with what is around it now; empty
            if it can. Another goal may be reached: nothing is refused
        :raises DataError: if it is neither one of a pose nor of joints, or the joints are not
            those of the arm; the present skill stays
        """
        if self._checker is not None:
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter('always')
                skill = joints_in_order(skill, self._checker.joint_names)
            for item in told:
                self._logger.warning(f'{name}: {item.message}')
        self._streamer.use(skill, name)
        self._loaded = skill, name
        return self._check(skill, name)

    def loaded(self) -> tuple[Skill, str]:
        """
        The skill that was loaded, and its name.

        :raises ParameterError: if there is none
        """
        if self._loaded is None:
            raise ParameterError('no skill is loaded')
        return self._loaded

    def use_context(self, message: Context) -> None:
        """Use the loaded skill in another context from the next start on, or refuse that."""
        try:
            if len(message.names) != len(message.values):
                raise ParameterError(f'{len(message.names)} names and {len(message.values)} '
                                     'values, expected one for each')
            self._in_context(dict(zip(message.names, message.values)))
        except GdmpError as error:
            self._streamer.refusals.add(f'context: {error}')

    def _in_context(self, context: Mapping[str, float]) -> None:
        skill, name = self.loaded()
        with warnings.catch_warnings(record=True) as outside:
            warnings.simplefilter('always')
            skill = skill.in_context(context)
        for item in outside:
            self._logger.warning(f'{name}: {item.message}')
        self._streamer.use(skill, name, context)
        self._check(skill, name)

    def _check(self, skill: Skill, name: str) -> str:
        # Of two arms only goals are checked, when a motion starts.
        if self._checker is None or is_of_two_arms(skill):
            return ''
        around = self._streamer.surroundings
        try:
            self._checker.surround(around.scene)
            skill = around.led(skill, None, None).motion
            problems = check_skill(skill, self._checker, CHECKED_POSES)[0].problems()
        except DataError as error:
            problems = [str(error)]
        if not problems:
            return ''
        warning = f'the arm cannot follow {name}: {"; ".join(problems)}'
        self._logger.warning(f'{warning} (gdmp check draws where)')
        return warning

    def use_that_of(self, parameters: Parameters) -> None:
        """
        Use the skill that the parameters name, if there is one.

        :raises DataError: if it cannot be loaded or learned
        """
        result = skill_from_parameters(parameters, self._logger)
        if result is not None:
            self.use(*result)

    def load(self, path: str, name: str = '', contents: str = '') -> str:
        """
        Use a skill file; returns as `use`.

        :param name: for reports; by default the path
        :param contents: of the file, if it is on another machine
        :raises DataError: if it cannot be loaded; the present skill stays
        """
        skill = Skill.parse(contents, path) if contents else Skill.load(path)
        warning = self.use(skill, name or path)
        self._logger.info(f'loaded {name or path}')
        return warning

    def answer(self, request: LoadSkill.Request, reply: LoadSkill.Response) -> LoadSkill.Response:
        """Answer ``~/load_skill``."""
        try:
            reply.message, reply.success = self.load(
                request.path, contents=request.contents), True
        except GdmpError as error:
            reply.success, reply.message = False, str(error)
            self._logger.warning(str(error))
        return reply


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
    from gdmp_ros.data.skills import LearningSettings, skill_from_bags
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


class Refinement:
    """Answers ``~/refine_skill``; nothing changes the skill but a correction that is kept."""

    def __init__(self, streamer: Streamer, skills: SkillLoader, logger: Any):
        self._streamer, self._skills, self._logger = streamer, skills, logger
        self._proposed: tuple[Skill, Correction] | None = None
        self._earlier: list[tuple[Skill, str, Skill]] = []

    def answer(self, request: RefineSkill.Request, reply: RefineSkill.Response
               ) -> RefineSkill.Response:
        """Answer the service."""
        actions = {request.PROPOSE: self._propose, request.KEEP: self._keep,
                   request.DISCARD: self._discard, request.UNDO: self._undo}
        try:
            if request.action not in actions:
                raise ParameterError(f'action is {request.action}, expected 0 to '
                                     f'{len(actions) - 1}')
            reply.message = actions[request.action](request, reply)
            reply.success = True
        except GdmpError as error:
            reply.success, reply.message = False, str(error)
            self._logger.warning(str(error))
        return reply

    def _propose(self, request: RefineSkill.Request, reply: RefineSkill.Response) -> str:
        self._proposed = None
        skill, name = self._skills.loaded()
        record = self._streamer.record
        if self._streamer.context:
            raise ParameterError('a skill in a context is not corrected: correct the skill '
                                 'itself, or show another take')
        if record.skill is not skill:
            raise ParameterError(f'{name} has not been executed since it was loaded')
        progress, references, measured = record.arrays()
        reply.progress = progress.tolist()
        reply.references.extend(pose_message(row) for row in references)
        reply.measured.extend(pose_message(row) for row in measured)
        result = correction(skill, FollowedMotion(progress, references, measured))
        self._proposed = skill, result
        reply.pushed_at = [push.at for push in result.pushes]
        reply.moved = [push.largest if push.quantity == 'position' else 0.0
                       for push in result.pushes]
        for path, into in ((result.before, reply.before), (result.after, reply.after)):
            rows = np.linspace(0, len(path) - 1, PREVIEW_POSES).astype(int)
            into.extend(pose_message(row[:7]) for row in path[rows])
        return (f'{len(result.pushes)} pushes; the path is moved by at most '
                f'{1e3 * max(reply.moved):.0f} mm')

    def _keep(self, request: RefineSkill.Request, reply: RefineSkill.Response) -> str:
        skill, name = self._skills.loaded()
        if self._proposed is None or self._proposed[0] is not skill:
            raise ParameterError('no correction of this skill was proposed')
        corrected = self._proposed[1].primitive
        if request.output:
            corrected.save(Path(request.output))
        warning = self._skills.use(corrected, name)
        self._earlier.append((skill, name, corrected))
        self._proposed = None
        self._logger.info(f'{name} is corrected')
        return warning

    def _discard(self, request: RefineSkill.Request, reply: RefineSkill.Response) -> str:
        self._proposed = None
        return ''

    def _undo(self, request: RefineSkill.Request, reply: RefineSkill.Response) -> str:
        skill, name = self._skills.loaded()
        if not self._earlier or self._earlier[-1][2] is not skill:
            raise ParameterError(f'{name} was not corrected since it was loaded')
        before = self._earlier.pop()[0]
        self._proposed = None
        self._logger.info(f'the last correction of {name} is undone')
        return self._skills.use(before, name)
