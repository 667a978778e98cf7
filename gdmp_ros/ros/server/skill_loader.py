"""Skills that a trajectory server uses, checked with its arm when they are loaded."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any
import warnings

from gdmp_msgs.msg import Context
from gdmp_msgs.srv import LoadSkill

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.playback.pair_skill import is_of_two_arms
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.parameters import Parameters
from gdmp_ros.ros.server.learning import skill_from_parameters
from gdmp_ros.sim.path_check import PathChecker
from gdmp_ros.sim.skill_check import check_skill

#: Poses of a path that are checked: fewer than ``gdmp check`` does, because a stream goes on.
POSES = 40


class SkillLoader:
    """Puts skills into the streamer, and warns of those that the arm cannot follow."""

    def __init__(self, streamer: Streamer, checker: PathChecker | None, logger: Any):
        """:param checker: of the arm; None without a model"""
        self._streamer, self._checker, self._logger = streamer, checker, logger
        self._loaded: tuple[Skill, str] | None = None

    def use(self, skill: Skill, name: str) -> str:
        """
        Use a skill for the next start.

        :returns: why the arm cannot follow it to its own goal; empty if it can. Another goal may
            be reached: nothing is refused
        :raises DataError: if it is neither one of a pose nor of joints; the present skill stays
        """
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
        for one in outside:
            self._logger.warning(f'{name}: {one.message}')
        self._streamer.use(skill, name, context)
        self._check(skill, name)

    def _check(self, skill: Skill, name: str) -> str:
        # Of two arms only goals are checked, when a motion starts.
        if self._checker is None or is_of_two_arms(skill):
            return ''
        try:
            problems = check_skill(skill, self._checker, POSES)[0].problems()
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
        found = skill_from_parameters(parameters, self._logger)
        if found is not None:
            self.use(*found)

    def load(self, path: str, name: str = '') -> str:
        """
        Use a skill file; returns as `use`.

        :param name: for reports; by default the path
        :raises DataError: if it cannot be loaded; the present skill stays
        """
        warning = self.use(Skill.load(path), name or path)
        self._logger.info(f'loaded {name or path}')
        return warning

    def answer(self, request: LoadSkill.Request, reply: LoadSkill.Response) -> LoadSkill.Response:
        """Answer ``~/load_skill``."""
        try:
            reply.message, reply.success = self.load(request.path), True
        except GdmpError as error:
            reply.success, reply.message = False, str(error)
            self._logger.warning(str(error))
        return reply
