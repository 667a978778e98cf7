"""Corrections of the loaded skill by pushes during its last motion: proposed, kept, undone."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from gdmp_msgs.srv import RefineSkill
from geometry_msgs.msg import Pose
import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.learning.correction import Correction, correction, FollowedMotion
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.ros.messages import set_pose
from gdmp_ros.ros.server.skill_loader import SkillLoader

#: Poses of a path in the reply.
POSES = 101


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
        reply.references.extend(_pose(row) for row in references)
        reply.measured.extend(_pose(row) for row in measured)
        found = correction(skill, FollowedMotion(progress, references, measured))
        self._proposed = skill, found
        reply.pushed_at = [one.at for one in found.pushes]
        reply.moved = [one.largest if one.quantity == 'position' else 0.0 for one in found.pushes]
        for path, into in ((found.before, reply.before), (found.after, reply.after)):
            rows = np.linspace(0, len(path) - 1, POSES).astype(int)
            into.extend(_pose(row[:7]) for row in path[rows])
        return (f'{len(found.pushes)} pushes; the path is moved by at most '
                f'{1e3 * max(reply.moved):.0f} mm')

    def _keep(self, request: RefineSkill.Request, reply: RefineSkill.Response) -> str:
        skill, name = self._skills.loaded()
        if self._proposed is None or self._proposed[0] is not skill:
            raise ParameterError('no correction of this skill was proposed')
        corrected = Skill.of(self._proposed[1].primitive)
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


def _pose(numbers: np.ndarray) -> Pose:
    pose = Pose()
    set_pose(pose, numbers)
    return pose
