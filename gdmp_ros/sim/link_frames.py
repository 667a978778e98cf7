"""Where the links of an arm are, each in its parent, as /tf tells it."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.urdf import links_of


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
        joints: list[tuple[np.ndarray, np.ndarray, int, bool]] = []
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
            joints.append((pose, model.jnt_axis[joint].copy(),
                           int(model.jnt_qposadr[joint]),
                           int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_SLIDE)))
        self._prepare(joints)
        self._objects: list[int] = []
        for joint in range(model.njnt):
            if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_FREE):
                self.moving.append((frame, model.body(int(model.jnt_bodyid[joint])).name))
                self._objects.append(int(model.jnt_qposadr[joint]))
        for s, name in links.sites.items():
            site = model.site(s)
            self.fixed.append((links.bodies[int(model.site_bodyid[s])], name,
                               np.concatenate([site.pos, site.quat])))

    def _prepare(self, joints: list[tuple[np.ndarray, np.ndarray, int, bool]]) -> None:
        """What `at` needs of poses at zero, axes, numbers of the positions, and kinds."""
        poses = np.array([pose for pose, *_ in joints]).reshape(-1, 7)
        self._numbers = [number for _, _, number, _ in joints]
        slides = np.array([slides for *_, slides in joints], dtype=bool)[:, None]
        axes, turned = np.zeros((len(joints), 3)), np.zeros((len(joints), 4))
        for i, (pose, axis, _, _) in enumerate(joints):
            # The axis in the parent, and the quaternion after half a turn around it.
            mujoco.mju_rotVecQuat(axes[i], axis, pose[3:])
            mujoco.mju_mulQuat(turned[i], np.concatenate([[0.0], axes[i]]), pose[3:])
        self._zero, self._turned = poses, turned
        self._slide, self._half_turn = np.where(slides, axes, 0.0), np.where(slides, 0.0, 0.5)

    def at(self, position: np.ndarray) -> np.ndarray:
        """
        Poses of `moving`, shape ``(links, 7)``.

        :param position: of all joints and objects [rad, m]
        """
        joints = position[self._numbers][:, None]
        half, count = self._half_turn * joints, len(self._numbers)
        result = np.empty((len(self.moving), 7))
        result[:count, :3] = self._zero[:, :3] + joints * self._slide
        result[:count, 3:] = np.cos(half) * self._zero[:, 3:] + np.sin(half) * self._turned
        for i, at in enumerate(self._objects, count):
            result[i] = position[at:at + 7]
        return result
