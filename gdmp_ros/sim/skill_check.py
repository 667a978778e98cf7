"""Whether an arm can follow the motion of a skill."""
from __future__ import annotations

import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.streamed import streamed
from gdmp_ros.playback.streamed_skill import Kind
from gdmp_ros.sim.path_check import PathCheck, PathChecker

#: A motion is checked, and shown, for this many of its durations: a changed goal is reached after
#: the first one.
DURATIONS = 1.2
#: Poses of a motion that are checked.
POSES = 200


def check_skill(skill: Skill, checker: PathChecker, poses: int = POSES
                ) -> tuple[PathCheck, np.ndarray]:
    """
    Check the motion of a skill between its own ends.

    :returns: what was found, and the positions of the tool [m], shape ``(poses, 3)``
    :raises DataError: if it is neither a skill of a pose nor of as many joints as the arm has
    """
    tool = streamed(skill, PlayerSettings())
    if tool.kind is Kind.TWO_TOOLS:
        raise DataError('the skill is one of two arms: check the skill of each, in the frame of '
                        'its own base')
    times = np.linspace(0.0, DURATIONS * skill.duration, poses)
    points = skill.rollout().sample(times).points.reshape(len(times), -1)
    if tool.kind is Kind.TOOL:
        return checker.check(times, points[:, :7]), points[:, :3]
    found = checker.check_postures(times, points)
    return found, np.array([checker.position(posture) for posture in points])
