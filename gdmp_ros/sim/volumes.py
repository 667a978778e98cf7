"""Volumes of a scene as bodies of a simulation: they are where they are put, and touch the arm."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

from gdmp_ros.scene.scene import Scene
from gdmp_ros.scene.volume import ENDLESS, Volume
from gdmp_ros.sim.arm import Arm

_KINDS = {'sphere': mujoco.mjtGeom.mjGEOM_SPHERE, 'box': mujoco.mjtGeom.mjGEOM_BOX,
          'capsule': mujoco.mjtGeom.mjGEOM_CAPSULE, 'plane': mujoco.mjtGeom.mjGEOM_BOX}
_COLOUR = [0.85, 0.45, 0.2, 0.8]
#: Distances beyond this one are not measured [m].
FAR = 1.0


def add_volumes(scene: Scene, free: bool = False) -> Callable[[mujoco.MjSpec], None]:
    """
    What adds the volumes of a scene to a simulated robot (`Arm`), as bodies of their names.

    :param free: they have joints of their names, and fall; otherwise they are where they are put
    """
    def add(spec: mujoco.MjSpec) -> None:
        for volume in scene.around:
            pose = volume.centre
            body = spec.worldbody.add_body(name=volume.name, mocap=not free, pos=pose[:3],
                                           quat=pose[3:])
            if free:
                body.add_freejoint(name=volume.name)
                body.mass, body.explicitinertial = 1.0, True
                body.ipos, body.inertia = [0.0, 0.0, 0.0], [0.01] * 3
            size = np.zeros(3)
            if volume.kind == 'capsule':
                size[:2] = volume.radius, volume.half[2]
            elif volume.kind == 'sphere':
                size[0] = volume.radius
            else:
                size[:] = volume.half
            body.add_geom(name=volume.name, type=_KINDS[volume.kind], size=size, rgba=_COLOUR,
                          contype=2, conaffinity=1,
                          group=3 if volume.half.max() >= ENDLESS else 0)
    return add


def follow_scene(arm: Arm, scene: Scene) -> None:
    """Put bodies of a simulation where the volumes of their names are; others stay."""
    for body in range(arm.model.nbody):
        mocap, name = int(arm.model.body_mocapid[body]), arm.model.body(body).name
        if mocap >= 0 and name in scene:
            arm.data.mocap_pos[mocap] = scene[name].centre[:3]
            arm.data.mocap_quat[mocap] = scene[name].centre[3:]


class Contact(NamedTuple):
    """
    A volume that touches a link.

    :ivar volume: its name
    :ivar link: the same
    :ivar speed: of the point of the link [m/s]
    """

    volume: str
    link: str
    speed: float


class VolumeBodies:
    """The bodies of a scene's volumes in the simulation of an arm."""

    def __init__(self, arm: Arm, scene: Scene):
        """:param scene: that was added to the arm, `add_volumes`"""
        self._arm, model = arm, arm.model
        self._geoms = {model.geom(volume.name).id: volume.name for volume in scene.around}
        root = model.body_rootid[arm.tool_body]
        self._links = [geom for geom in range(model.ngeom)
                       if model.body_rootid[model.geom_bodyid[geom]] == root
                       and (model.geom_contype[geom] or model.geom_conaffinity[geom])]

    def put(self, volume: Volume) -> None:
        """Put a volume where it is now."""
        follow_scene(self._arm, Scene([volume]))

    def least(self) -> float:
        """Least distance of a link from a volume [m], at most `FAR`."""
        model, data = self._arm.model, self._arm.data
        return float(min(mujoco.mj_geomDistance(model, data, geom, link, FAR, None)
                         for geom in self._geoms for link in self._links))

    def contacts(self, velocity: np.ndarray | None = None) -> list[Contact]:
        """
        What touches at present.

        :param velocity: of all that moves, with which the speeds are computed, as before a contact
            has changed it; the present one by default
        """
        velocity = self._arm.data.qvel if velocity is None else velocity
        model, data, found = self._arm.model, self._arm.data, []
        jacobian = np.empty((3, model.nv))
        for k in range(data.ncon):
            pair = [int(geom) for geom in data.contact.geom[k]]
            for geom, link in (pair, pair[::-1]):
                if geom in self._geoms and link in self._links:
                    body = int(model.geom_bodyid[link])
                    mujoco.mj_jac(model, data, jacobian, None, data.contact.pos[k], body)
                    found.append(Contact(self._geoms[geom], model.body(body).name,
                                         float(np.linalg.norm(jacobian @ velocity))))
        return found
