"""Where the tool of an arm is, computed from few numbers: for a loop without a simulation."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.control.kinematics import chain_pose
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import tool_at, ToolTransform


class Chain:
    """The revolute joints between the base of an arm and its tool."""

    def __init__(self, arm: Arm):
        """:raises ParameterError: if other joints are between, or joints are elsewhere"""
        known = arm.known
        model, body = known.model, int(known.model.site_bodyid[known.site])
        end = np.concatenate([model.site_pos[known.site], model.site_quat[known.site]])
        frames: list[np.ndarray] = []
        axes: list[np.ndarray] = []
        while body > 0:
            frame = np.concatenate([model.body_pos[body], model.body_quat[body]])
            joint = int(model.body_jntadr[body])
            if joint < 0:
                # What is fixed moves with the next joint towards the tool.
                if frames:
                    frames[0] = compose(frame, frames[0])
                else:
                    end = compose(frame, end)
            else:
                if (model.body_jntnum[body] != 1 or model.jnt_pos[joint].any()
                        or int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE)):
                    raise ParameterError(f'body {model.body(body).name!r} of the model has other '
                                         'joints than one revolute joint at its origin')
                frames.insert(0, frame)
                axes.insert(0, model.jnt_axis[joint].copy())
            body = int(model.body_parentid[body])
        self._frames, self._axes, self._end = np.array(frames), np.array(axes), end

    def end_of(self, *tools: ToolTransform) -> np.ndarray:
        """Where a tool is (each in the frame of the one before), for `pose_at`."""
        end = self._end
        for tool in tools:
            end = tool_at(end, tool)
        return end

    def pose_at(self, position: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Pose (x, y, z, qw, qx, qy, qz) of what `end_of` gave, at joint positions [rad]."""
        pose = np.empty(7)
        chain_pose(self._frames, self._axes, position, end, pose)
        return pose
