"""Shows an arm and things beside it as they were, for distances and films."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from gdmp_ros.sim.arm import Arm


class Replay:
    """Puts an arm, and things that have joints, where they were."""

    def __init__(self, arm: Arm):
        """:param arm: with things that have joints of their names (`gdmp_ros.sim.volumes`)"""
        self.arm = arm

    def show(self, joints: np.ndarray, places: Mapping[str, np.ndarray | float]) -> np.ndarray:
        """
        Put everything somewhere; all positions.

        :param joints: of the arm [rad]
        :param places: positions of joints by their names [m, rad]; poses of free things; those
            that the model does not have are left out
        """
        data = self.arm.data
        data.qpos[:len(joints)] = joints
        for name, place in places.items():
            if mujoco.mj_name2id(self.arm.model, mujoco.mjtObj.mjOBJ_JOINT, name) >= 0:
                data.joint(name).qpos[:] = place
        mujoco.mj_forward(self.arm.model, data)
        return np.array(data.qpos)

    def save(self, path: Path) -> None:
        """Write the model (.mjb), for `gdmp_ros.view.films.render_to`."""
        mujoco.mj_saveModel(self.arm.model, str(path))
