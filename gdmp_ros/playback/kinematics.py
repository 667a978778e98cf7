"""What a stream has to know of the arm: which postures belong to a pose."""
from __future__ import annotations

from typing import Protocol

import numpy as np


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
