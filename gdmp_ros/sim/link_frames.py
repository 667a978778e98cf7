"""Where the links of an arm are, each in its parent, as /tf tells it."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.urdf import compose, links_of


class LinkFrames:
    """
    Frames of the links that `urdf` describes, each in its parent; and of objects, in the base.

    :ivar fixed: parent, child and pose (x, y, z, qw, qx, qy, qz) of links that cannot move
    :ivar moving: parent and child of the others
    """

    def __init__(self, arm: Arm, frame: str):
        """See `urdf`."""
        model, links = arm.model, links_of(arm, frame)
        self.fixed: list[tuple[str, str, np.ndarray]] = []
        self.moving: list[tuple[str, str]] = []
        self._joints: list[tuple[np.ndarray, np.ndarray, int, bool]] = []
        for i, name in links.bodies.items():
            parent = links.bodies.get(int(model.body_parentid[i]))
            if i == 0 or parent is None:
                continue
            pose = np.concatenate([model.body_pos[i], model.body_quat[i]])
            if model.body_jntnum[i] == 0:
                self.fixed.append((parent, name, pose))
                continue
            joint = int(model.body_jntadr[i])
            self.moving.append((parent, name))
            self._joints.append((pose, model.jnt_axis[joint].copy(),
                                 int(model.jnt_qposadr[joint]),
                                 int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_SLIDE)))
        self._objects: list[int] = []
        for joint in range(model.njnt):
            if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_FREE):
                self.moving.append((frame, model.body(int(model.jnt_bodyid[joint])).name))
                self._objects.append(int(model.jnt_qposadr[joint]))
        for s, name in links.sites.items():
            site = model.site(s)
            self.fixed.append((links.bodies[int(model.site_bodyid[s])], name,
                               np.concatenate([site.pos, site.quat])))

    def at(self, position: np.ndarray) -> list[np.ndarray]:
        """Poses of `moving` at positions of all joints and objects [rad, m]."""
        result = []
        for pose, axis, number, slides in self._joints:
            step = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
            if slides:
                step[:3] = position[number] * axis
            else:
                mujoco.mju_axisAngle2Quat(step[3:], axis, position[number])
            result.append(compose(pose, step))
        return result + [position[at:at + 7].copy() for at in self._objects]
