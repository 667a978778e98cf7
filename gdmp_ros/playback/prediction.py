"""The rest of a motion, computed ahead, and how takes vary around it."""
from __future__ import annotations

import numpy as np

from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.streamed_skill import StreamedSkill

#: A prediction ends after this many durations of the motion.
LONGEST = 5
#: Half-axes of the ellipsoid in which 95 % of positions lie, in standard deviations.
LIKELY = 2.796


def prediction(rollout: Rollout, count: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Points from the present moment to the end of a motion, and their progress.

    :param rollout: is advanced
    :param count: how many there are in one duration of the motion
    :returns: flat points, shape ``(T, point_size)``, and progress, shape ``(T,)``
    """
    rollout.resume()
    step = rollout.duration / count
    points, progress = [rollout.state.point], [rollout.progress]
    # A goal that moves slowly, or a tempo that has to grow first, take longer than that.
    while not rollout.finished and len(points) < LONGEST * count:
        points.append(rollout.advance(step).point)
        progress.append(rollout.progress)
    return np.array(points), np.array(progress)


class Tube:
    """How takes vary around a skill of pose and stiffness whose start and goal are known."""

    def __init__(self, skill: Skill, count: int):
        """
        :param count: of intervals of progress
        :raises DataError: if it was learned from a single take
        """
        self._progress = np.linspace(0.0, 1.0, count + 1)
        if skill.distribution is not None:
            skill = skill.distribution.condition([(0.0, skill.start), (1.0, skill.goal)])
        around = skill.distribution
        if around is None:
            raise DataError('a skill of a single take does not know how takes vary')
        self._covariances = np.array([_pose_covariance(skill, around.mean(s), around.covariance(s))
                                      for s in self._progress])

    def covariances(self, progress: np.ndarray) -> np.ndarray:
        """
        Covariance of position [m] and rotation vector [rad] in the axes of the base.

        :returns: shape ``(len(progress), 6, 6)``
        """
        place = np.clip(progress, 0.0, 1.0) * (len(self._progress) - 1)
        node = np.minimum(place.astype(int), len(self._progress) - 2)
        share = (place - node)[:, None, None]
        return np.asarray((1.0 - share) * self._covariances[node]
                          + share * self._covariances[node + 1])


def likely_path(skill: Skill, first: np.ndarray, last: np.ndarray, count: int
                ) -> tuple[np.ndarray, np.ndarray]:
    """
    Path of a skill of several takes between two poses, and how takes vary around it.

    :param count: of intervals of progress
    :returns: poses, shape ``(count + 1, 7)``; covariances as in `Tube`
    :raises DataError: if the skill is not one of pose and stiffness, or of a single take
    """
    tool, progress = StreamedSkill(skill, PlayerSettings()), np.linspace(0.0, 1.0, count + 1)
    goal = skill.goal.copy()
    goal[:7] = last
    path = Rollout(skill, start=tool.start_at(first), goal=goal, duration=1.0).sample(progress)
    return path.points[:, :7], Tube(skill, count).covariances(progress)


def _pose_covariance(skill: Skill, point: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    manifold = skill.manifold
    frame = manifold.frame(point)
    columns = np.array([manifold.from_frame(frame, item) for item in np.eye(len(covariance))])
    # Tangents on S³ are half the rotation vector.
    scale = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    pose = columns[:, :6] * scale
    return np.asarray(pose.T @ covariance @ pose)
