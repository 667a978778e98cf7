"""Where the tool and the links of an arm are."""
from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gdmp_ros.control.reference_check import QUATERNION_TOLERANCE
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.util.settings import setting

#: Largest coordinate of a tool in the frame of its site [m].
FARTHEST = 2.0


@dataclass(frozen=True)
class ToolTransform:
    """Pose of the tool that is controlled, in the frame of the tool site."""

    position: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), 'position of the tool in the frame of tool_site', 'm', -FARTHEST,
        FARTHEST)
    rotation: tuple[float, float, float, float] = setting(
        (1.0, 0.0, 0.0, 0.0), 'orientation of the tool in the frame of tool_site: w x y z', '',
        -1.001, 1.001)

    def __post_init__(self) -> None:
        """:raises ParameterError: if it is too far away, or the quaternion is none"""
        norm = float(np.linalg.norm(self.rotation))
        if not all(abs(item) <= FARTHEST for item in self.position):
            raise ParameterError(f'tool: position is {self.position} m, expected at most '
                                 f'{FARTHEST:g} in each direction')
        if not abs(norm - 1.0) <= QUATERNION_TOLERANCE:
            raise ParameterError(f'tool: rotation {self.rotation} has norm {norm:.4g}, expected '
                                 '1')


def pose_of(transform: np.ndarray) -> np.ndarray:
    """Pose (x, y, z, qw, qx, qy, qz) of a 4×4 transform."""
    pose = np.empty(7)
    pose[:3] = transform[:3, 3]
    mujoco.mju_mat2Quat(pose[3:], transform[:3, :3].ravel())
    return pose


def tool_at(pose: np.ndarray, tool: ToolTransform) -> np.ndarray:
    """Pose of a tool whose site is at ``pose``."""
    return compose(pose, np.array([*tool.position, *tool.rotation], float))


class Mount:
    """The tool site of a model, as the model has it."""

    def __init__(self, model: mujoco.MjModel, site: int):
        self._site = site
        self.position, self.rotation = model.site_pos[site].copy(), model.site_quat[site].copy()

    @property
    def axes(self) -> np.ndarray:
        """Its axes in the frame of the body, 3×3."""
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, self.rotation)
        return turn.reshape(3, 3)

    def put(self, model: mujoco.MjModel, tool: ToolTransform) -> None:
        """Move the site to the tool."""
        # Otherwise MuJoCo takes the frame of the body for a site that had the same one.
        model.site_sameframe[self._site] = 0
        turn = np.array(tool.rotation) / np.linalg.norm(tool.rotation)
        mujoco.mju_mulPose(model.site_pos[self._site], model.site_quat[self._site],
                           self.position, self.rotation, np.array(tool.position, float), turn)


