"""Shapes of an arm for visualization, its description as URDF, and where its links are."""
from __future__ import annotations

from typing import NamedTuple
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.sim.arm import Arm

_GEOM = mujoco.mjtGeom
_KINDS = {int(_GEOM.mjGEOM_SPHERE): 'sphere', int(_GEOM.mjGEOM_BOX): 'box',
          int(_GEOM.mjGEOM_CYLINDER): 'cylinder', int(_GEOM.mjGEOM_CAPSULE): 'capsule'}
#: MuJoCo's viewer shows the geom groups below this number by default.
_SHOWN_GROUPS = 3
#: Speed limit of a finger of a gripper [m/s].
FINGER_SPEED = 0.2


class Shape(NamedTuple):
    """
    A simple shape.

    :ivar kind: ``sphere``, ``box`` or ``cylinder`` (along its z)
    :ivar size: extents along its axes [m], shape ``(3,)``
    :ivar body: id of the body that it is fixed to
    :ivar pose: in the body's frame, (x, y, z, qw, qx, qy, qz)
    :ivar colour: red, green, blue, opacity, 0 to 1
    """

    kind: str
    size: np.ndarray
    body: int
    pose: np.ndarray
    colour: np.ndarray


def shapes(arm: Arm) -> list[Shape]:
    """
    Shapes of all bodies; a capsule becomes three shapes, a mesh its bounding box.

    Hidden geoms are used only for a body whose geoms are all hidden.
    """
    model, result = arm.model, []
    visible = {int(model.geom_bodyid[i]) for i in range(model.ngeom)
               if model.geom_group[i] < _SHOWN_GROUPS}
    for i in range(model.ngeom):
        body = int(model.geom_bodyid[i])
        kind = _KINDS.get(int(model.geom_type[i]), '')
        mesh = int(model.geom_type[i]) == int(_GEOM.mjGEOM_MESH)
        hidden = model.geom_group[i] >= _SHOWN_GROUPS and body in visible
        if body == 0 or hidden or not (kind or mesh):
            continue
        material = int(model.geom_matid[i])
        colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[i]
        colour = colour.astype(float).round(4)
        size, position, rotation = model.geom_size[i], model.geom_pos[i], model.geom_quat[i]
        if mesh:
            kind, size = 'box', model.geom_aabb[i, 3:]
            position = position + _rotation(rotation).apply(model.geom_aabb[i, :3])

        def add(kind: str, extents: list[float], along: float = 0.0,
                rotation: np.ndarray = rotation, position: np.ndarray = position,
                body: int = body, colour: np.ndarray = colour) -> None:
            centre = position + along * _rotation(rotation).as_matrix()[:, 2]
            result.append(Shape(kind, np.array(extents), body, np.concatenate([centre, rotation]),
                                colour))

        wide = 2.0 * size[0]
        if kind == 'box':
            add('box', list(2.0 * size))
        elif kind == 'sphere':
            add('sphere', [wide] * 3)
        else:
            add('cylinder', [wide, wide, 2.0 * size[1]])
            if kind == 'capsule':
                for end in (-size[1], size[1]):
                    add('sphere', [wide] * 3, end)
    return result


def shape_pose(arm: Arm, shape: Shape) -> np.ndarray:
    """Pose of a shape in the base frame, in the present posture."""
    return compose(np.concatenate([arm.data.xpos[shape.body], arm.data.xquat[shape.body]]),
                    shape.pose)


def urdf(arm: Arm, frame: str = 'panda_link0', joint_speed: float = np.inf) -> str:
    """
    Describe an arm as URDF.

    Links are the model's bodies and sites; joints have the names of ``joint_states``. Frames,
    inertial parameters, limits and simple shapes are those of the model.

    :param frame: name of the link at the model's origin, the frame of poses. Its prefix before the
        name of the first body, such as ``left_`` before ``link0``, is used for all links and
        joints, instead of that of the model
    :param joint_speed: largest speed of any joint, besides the limits of the arm [rad/s]
    :raises DataError: for joints that URDF cannot describe, or if the frame is not at the origin
    """
    model, drawn = arm.model, shapes(arm)
    links = links_of(arm, frame)
    robot = ET.Element('robot', name=links.prefix.strip('_') or 'arm')
    for i, name in links.bodies.items():
        element = ET.SubElement(robot, 'link', name=name)
        if i == 0:
            continue
        _inertial(element, model, i)
        for shape in (s for s in drawn if s.body == i):
            _visual(element, shape)
    for i, name in links.bodies.items():
        parent = links.bodies.get(int(model.body_parentid[i]))
        if i == 0 or parent is None:
            continue
        joints = [j for j in range(model.njnt) if model.jnt_bodyid[j] == i]
        pose = np.concatenate([model.body_pos[i], model.body_quat[i]])
        if joints:
            _joint(robot, arm, joints, parent, name, pose, links, joint_speed)
        else:
            _fixed(robot, parent, name, pose)
    for s, name in links.sites.items():
        site = model.site(s)
        ET.SubElement(robot, 'link', name=name)
        _fixed(robot, links.bodies[int(model.site_bodyid[s])], name,
               np.concatenate([site.pos, site.quat]))
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding='unicode') + '\n'


class Links(NamedTuple):
    """
    Names of the links by id of their body (0: the world, if it is a link) or site.

    :ivar prefix: of all names, instead of ``own``, that of the model
    """

    prefix: str
    own: str
    bodies: dict[int, str]
    sites: dict[int, str]

    def named(self, name: str) -> str:
        """Name of something of the model."""
        return f'{self.prefix}{name.removeprefix(self.own)}'


def joint_names(arm: Arm, frame: str) -> list[str]:
    """
    Names of the joints of an arm, as `urdf` has them.

    :raises DataError: if the frame is not at the origin
    """
    links = links_of(arm, frame)
    return [links.named(name) for name in arm.names]


def link_names(arm: Arm, frame: str) -> dict[str, str]:
    """Names of the links in the description of an arm, and of their bodies in its model."""
    return {name: arm.model.body(body).name
            for body, name in links_of(arm, frame).bodies.items()}


def links_of(arm: Arm, frame: str) -> Links:
    """
    Names of the links of an arm.

    :raises DataError: if the frame is not at the origin
    """
    model = arm.model
    root = int(model.body_rootid[arm.tool_body])
    bodies = [i for i in range(1, model.nbody) if model.body_rootid[i] == root]
    first = model.body(root).name
    stem = first.rpartition('_')[2]
    prefix = own = ''
    if stem and frame.endswith(stem):
        prefix, own = frame.removesuffix(stem), first.removesuffix(stem)
    names = Links(prefix, own, {}, {})
    # A body that is fixed at the origin is the frame itself.
    base = next((i for i in bodies if names.named(model.body(i).name) == frame), 0)
    if base and not _at_origin(model, base):
        raise DataError(f'the body {model.body(base).name!r} is not at the origin of the model: '
                        f'{frame!r} cannot be the frame of its poses')
    taken: set[str] = set()

    def unique(name: str) -> str:
        while name in taken:
            name += '_'
        taken.add(name)
        return name

    named = {} if base == root else {0: unique('world' if base else frame)}
    named |= {i: unique(names.named(model.body(i).name or f'body{i}')) for i in bodies}
    return Links(prefix, own, named, {
        s: unique(names.named(model.site(s).name)) for s in range(model.nsite)
        if int(model.site_bodyid[s]) in bodies and model.site(s).name})


def _at_origin(model: mujoco.MjModel, body: int) -> bool:
    """Whether a body is at the model's origin for all joint positions."""
    while body != 0:
        if (model.body_jntnum[body] or np.abs(model.body_pos[body]).max() > 1e-9
                or abs(model.body_quat[body, 0]) < 1.0 - 1e-12):
            return False
        body = int(model.body_parentid[body])
    return True


def _joint(robot: ET.Element, arm: Arm, joints: list[int], parent: str, child: str,
           pose: np.ndarray, links: Links, speed: float) -> None:
    model, j = arm.model, joints[0]
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): 'revolute',
             int(mujoco.mjtJoint.mjJNT_SLIDE): 'prismatic'}
    kind = kinds.get(int(model.jnt_type[j]))
    if len(joints) > 1 or kind is None or np.abs(model.jnt_pos[j]).max() > 1e-9:
        raise DataError(f'{child}: URDF describes one hinge or slide at the origin of a body, the '
                        f'model has {[model.joint(k).name for k in joints]}')
    limited = bool(model.jnt_limited[j])
    element = ET.SubElement(robot, 'joint', name=links.named(model.joint(j).name),
                            type=kind if limited or kind == 'prismatic' else 'continuous')
    ET.SubElement(element, 'parent', link=parent)
    ET.SubElement(element, 'child', link=child)
    _origin(element, pose)
    ET.SubElement(element, 'axis', xyz=_words(model.jnt_axis[j]))
    dof = int(model.jnt_dofadr[j])
    torque, fastest = arm.limits.torque, arm.limits.fastest(speed)
    own = dof < len(torque)  # otherwise a finger, with the limits of its motor
    limit = {'effort': f'{torque[dof] if own else model.actuator_ctrlrange[dof, 1]:.6g}',
             'velocity': f'{fastest[dof] if own else FINGER_SPEED:.6g}'}
    if limited:
        limit |= {'lower': repr(float(model.jnt_range[j, 0])),
                  'upper': repr(float(model.jnt_range[j, 1]))}
    ET.SubElement(element, 'limit', limit)
    ET.SubElement(element, 'dynamics', damping=repr(float(model.dof_damping[dof])))


def _fixed(robot: ET.Element, parent: str, child: str, pose: np.ndarray) -> None:
    element = ET.SubElement(robot, 'joint', name=f'{child}_fixed', type='fixed')
    ET.SubElement(element, 'parent', link=parent)
    ET.SubElement(element, 'child', link=child)
    _origin(element, pose)


def _inertial(element: ET.Element, model: mujoco.MjModel, i: int) -> None:
    if model.body_mass[i] <= 0.0:
        return
    inertial = ET.SubElement(element, 'inertial')
    _origin(inertial, np.concatenate([model.body_ipos[i], model.body_iquat[i]]))
    ET.SubElement(inertial, 'mass', value=repr(float(model.body_mass[i])))
    moments = {key: repr(float(value)) for key, value in zip(('ixx', 'iyy', 'izz'),
                                                             model.body_inertia[i])}
    ET.SubElement(inertial, 'inertia', moments | {'ixy': '0', 'ixz': '0', 'iyz': '0'})


def _visual(element: ET.Element, shape: Shape) -> None:
    visual = ET.SubElement(element, 'visual')
    _origin(visual, shape.pose)
    geometry = ET.SubElement(visual, 'geometry')
    if shape.kind == 'box':
        ET.SubElement(geometry, 'box', size=_words(shape.size))
    elif shape.kind == 'sphere':
        ET.SubElement(geometry, 'sphere', radius=repr(float(shape.size[0] / 2.0)))
    else:
        ET.SubElement(geometry, 'cylinder', radius=repr(float(shape.size[0] / 2.0)),
                      length=repr(float(shape.size[2])))
    material = ET.SubElement(visual, 'material', name='rgba ' + _words(shape.colour))
    ET.SubElement(material, 'color', rgba=_words(shape.colour))


def _origin(element: ET.Element, pose: np.ndarray) -> None:
    # At a pitch of 90° roll and yaw are not unique: SciPy warns, and sets one to 0.
    angles = _rotation(pose[3:]).as_euler('xyz', suppress_warnings=True)
    ET.SubElement(element, 'origin', xyz=_words(pose[:3]), rpy=_words(angles))


def _words(numbers: np.ndarray) -> str:
    return ' '.join(repr(float(value)) for value in numbers)


def _rotation(quaternion: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.roll(quaternion, -1))


class LinkFrames:
    """
    Frames of the links that `urdf` describes, each in its parent; and of objects, in the base.

    :ivar fixed: parent, child and pose (x, y, z, qw, qx, qy, qz) of links that cannot move
    :ivar moving: parent and child of the others
    """

    def __init__(self, arm: Arm, frame: str):
        """Describe an arm as URDF."""
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
