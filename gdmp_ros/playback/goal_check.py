"""Which goals are accepted: in the workspace, and within reach of the arm or of both arms."""
from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from gdmp_ros.errors import ManifoldError, ParameterError
from gdmp_ros.manifolds.poses import compose, inverse, POSE_SIZE
from gdmp_ros.playback.settings import StreamSettings
from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill


def no_second_arm() -> np.ndarray:
    """:raises ParameterError: always: there is one arm"""
    raise ParameterError('there is no second arm')


class GoalCheck:
    """
    Checks goals.

    :ivar settings: with the limits of the workspace, in the frame of each arm's own base
    """

    def __init__(self, settings: StreamSettings, kinematics: ArmKinematics | None,
                 second_base: Callable[[], np.ndarray] = no_second_arm):
        """
        Prepare to check.

        :param kinematics: of each arm; None if it is not known
        :param second_base: gives the pose of the second arm's base in the frame of the goals, or
            raises a `ParameterError`
        """
        self.settings, self._kinematics, self._second_base = settings, kinematics, second_base

    def place_for(self, skill: StreamedSkill, pose: np.ndarray, near: np.ndarray, side: int = 0
                  ) -> np.ndarray:
        """
        Place of a skill with a tool at a pose; of two tools, the other one follows.

        :param pose: four zeros for its rotation: that of ``near``
        :param near: the place before
        :param side: which of two tools: 0 or 1
        :raises GdmpError: if the pose lies outside the workspace, or there is no such place
        """
        if side and skill.kind is not Kind.TWO_TOOLS:
            raise ManifoldError('the skill is not one of two arms')
        if not pose[3:].any():
            pose = np.concatenate([pose[:3], self._pose_at(skill, near, side)[3:]])
        if skill.kind is Kind.TWO_TOOLS:
            point = skill.changed(skill.changed(skill.skill.goal, near), pose, side=side)
            place = skill.place_of(point)
            self.check_workspace(skill, place)
            return place
        self.settings.check_goal(pose)
        if skill.kind is Kind.TOOL:
            return pose
        return self._known_kinematics().posture(pose, near)

    def _pose_at(self, skill: StreamedSkill, place: np.ndarray, side: int) -> np.ndarray:
        """Pose of a tool at a place of a skill."""
        if skill.kind is Kind.JOINTS:
            return self._known_kinematics().pose_at(place)
        return place[side * POSE_SIZE:(side + 1) * POSE_SIZE]

    def _known_kinematics(self) -> ArmKinematics:
        if self._kinematics is None:
            raise ManifoldError('a pose as goal of a skill of the joints needs reach_model')
        return self._kinematics

    def check(self, skill: StreamedSkill, place: np.ndarray) -> None:
        """:raises GdmpError: if a skill cannot have a place as goal"""
        self.check_workspace(skill, place)
        self.check_reach(skill, place)

    def check_workspace(self, skill: StreamedSkill, place: np.ndarray) -> None:
        """:raises GdmpError: if a place of the tools lies outside the workspace"""
        if skill.kind is not Kind.JOINTS:
            for arm, pose in self._poses(skill, place):
                self.settings.check_goal(pose, arm)

    def check_reach(self, skill: StreamedSkill, place: np.ndarray) -> None:
        """:raises ParameterError: if an arm cannot reach a place"""
        if self._kinematics is None:
            return
        if skill.kind is Kind.JOINTS:
            problems = [self._kinematics.problem_of_joints(place)]
        else:
            problems = [problem and f'{arm}{problem}' for arm, problem in (
                (arm, self._kinematics.problem(pose)) for arm, pose in self._poses(skill, place))]
        for problem in filter(None, problems):
            raise ParameterError(f'the goal cannot be reached: {problem}')

    def _poses(self, skill: StreamedSkill, place: np.ndarray) -> list[tuple[str, np.ndarray]]:
        """Name of each arm for messages, and the pose of its tool in the frame of its base."""
        if skill.kind is not Kind.TWO_TOOLS:
            return [('', place)]
        return [('first arm: ', place[:POSE_SIZE]),
                ('second arm: ', compose(inverse(self._second_base()), place[POSE_SIZE:]))]


class ArmKinematics(Protocol):
    """Kinematics of the arm that follows (`gdmp_ros.sim.path_check`)."""

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
