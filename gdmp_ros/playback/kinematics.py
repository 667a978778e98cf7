"""What a stream has to know of the arm: which postures belong to a pose."""
from __future__ import annotations

from typing import Protocol

import numpy as np

from gdmp_ros.errors import ManifoldError, ParameterError
from gdmp_ros.playback.streamed_skill import StreamedSkill


class ArmKinematics(Protocol):
    """Kinematics of the arm that follows (`gdmp_ros.sim.reach`)."""

    def problem(self, pose: np.ndarray) -> str:
        """Why the arm cannot reach a pose; empty if it can."""

    def problem_of_joints(self, position: np.ndarray) -> str:
        """Why positions are not within the limits of the joints; empty if they are."""

    def posture(self, pose: np.ndarray, near: np.ndarray) -> np.ndarray:
        """
        Positions of the joints with which the tool is at a pose, near others.

        :raises ManifoldError: if the arm does not reach it
        """

    def pose_at(self, position: np.ndarray) -> np.ndarray:
        """Pose of the tool at positions of the joints."""


def place_for(kinematics: ArmKinematics | None, skill: StreamedSkill, pose: np.ndarray,
              near: np.ndarray) -> np.ndarray:
    """
    Place of a skill with the tool at a pose.

    :param near: place to stay near to
    :raises ManifoldError: if there is none
    """
    if not skill.of_joints:
        return pose
    if kinematics is None:
        raise ManifoldError('a pose as goal of a skill of the joints needs reach_model')
    return kinematics.posture(pose, near)


def check_reach(kinematics: ArmKinematics | None, skill: StreamedSkill, place: np.ndarray) -> None:
    """:raises ParameterError: if the arm cannot reach a place"""
    if kinematics is None:
        return
    problem = (kinematics.problem_of_joints(place) if skill.of_joints
               else kinematics.problem(place))
    if problem:
        raise ParameterError(f'the goal cannot be reached: {problem}')
