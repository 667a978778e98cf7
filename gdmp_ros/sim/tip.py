"""Where the tool of an arm is at positions of its joints: of a URDF file, or of a model."""
from __future__ import annotations

from pathlib import Path
import xml.etree.ElementTree as ET

import mujoco
import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.poses import compose, inverse
from gdmp_ros.sim import model_sources
from gdmp_ros.util.files import read_text

#: Parts of a URDF that kinematics does not need; their files may be elsewhere.
_NOT_NEEDED = ('visual', 'collision', 'inertial')
#: Larger files are refused [bytes].
_LARGEST = 50_000_000
_KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): True, int(mujoco.mjtJoint.mjJNT_SLIDE): False}


class TipKinematics:
    """
    The joints between the base of an arm and a tip (`gdmp_ros.data.arm_joints.ArmKinematics`).

    :ivar names: of the joints, from the base on
    :ivar limits: shape ``(n, 2)`` [rad, m]; infinite where there are none
    :ivar turns: whether each is revolute, shape ``(n,)``
    :ivar base: name of the link that the poses are in
    """

    def __init__(self, model: mujoco.MjModel, tip: str, root: str, base: str = ''):
        """
        Find the joints.

        :param tip: name of a site, or of a body
        :param root: name of what is fixed to the world
        :param base: name of a body between it and the tip; empty: ``root``
        :raises DataError: if there is no such tip or base, or the arm has other joints
        """
        self.base = base or root
        self._model, self._data = model, mujoco.MjData(model)
        self._site, body = self._found(tip)
        self._end = body
        self._base = 0 if self.base == root else self._body(self.base)
        joints, of_base = self._joints_before(body), self._joints_before(self._base)
        if joints[:len(of_base)] != of_base:
            raise DataError(f'{self.base!r} moves on another branch than {tip!r}')
        joints = joints[len(of_base):]
        kinds = [int(model.jnt_type[joint]) for joint in joints]
        if not joints or not all(kind in _KINDS for kind in kinds):
            raise DataError(f'there are {len(joints)} joints between {self.base!r} and {tip!r}, '
                            'expected joints that turn or slide')
        self.names = tuple(model.joint(joint).name for joint in joints)
        self.turns = np.array([_KINDS[kind] for kind in kinds])
        self.limits = np.array([model.jnt_range[joint] if model.jnt_limited[joint]
                                else (-np.inf, np.inf) for joint in joints])
        self._at = model.jnt_qposadr[joints]

    def _joints_before(self, body: int) -> list[int]:
        """Joints between the world and a body, in their order."""
        joints: list[int] = []
        while body:
            first = int(self._model.body_jntadr[body])
            joints = [*range(first, first + int(self._model.body_jntnum[body])), *joints]
            body = int(self._model.body_parentid[body])
        return joints

    def _found(self, tip: str) -> tuple[int, int]:
        """Site of the tip, -1 for a body; and its body."""
        site = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_SITE, tip)
        if site >= 0:
            return site, int(self._model.site_bodyid[site])
        return -1, self._body(tip)

    def _body(self, name: str) -> int:
        body = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_BODY, name)
        if body <= 0:
            have = ', '.join(self._model.body(i).name for i in range(1, self._model.nbody))
            raise DataError(f'there is no link {name!r}; there are {have}')
        return int(body)

    def poses(self, positions: np.ndarray) -> np.ndarray:
        """
        Poses of the tip in the base.

        :param positions: of the joints, shape ``(T, n)`` [rad, m]
        :returns: shape ``(T, 7)``
        """
        data, result = self._data, np.empty((len(positions), 7))
        data.qpos[:] = self._model.qpos0
        quaternion = np.empty(4)
        for row, position in zip(result, positions):
            data.qpos[self._at] = position
            mujoco.mj_kinematics(self._model, data)
            if self._site >= 0:
                mujoco.mju_mat2Quat(quaternion, data.site_xmat[self._site])
                row[:3], row[3:] = data.site_xpos[self._site], quaternion
            else:
                row[:3], row[3:] = data.xpos[self._end], data.xquat[self._end]
            if self._base:
                base = np.concatenate([data.xpos[self._base], data.xquat[self._base]])
                row[:] = compose(inverse(base), row)
        return result


def read_urdf(path: Path) -> tuple[ET.Element, str]:
    """
    Read a URDF file, for MuJoCo: links without joints stay links.

    :returns: the robot, and the name of its first link
    :raises DataError: if it is no URDF
    """
    text = read_text(path, 'URDF', _LARGEST)
    try:
        robot = ET.fromstring(text)
    except ET.ParseError as error:
        raise DataError(f'{path}: it is not XML: {error}') from None
    if '<xacro:' in text:
        raise DataError(f'{path}: it is a xacro file; make a URDF of it: xacro {path} > '
                        'robot.urdf')
    if robot.tag != 'robot':
        raise DataError(f'{path}: it begins with <{robot.tag}>, expected <robot>')
    children = {child.get('link') for child in robot.iter('child')}
    roots = [link.get('name', '') for link in robot.iter('link')
             if link.get('name') not in children]
    if len(roots) != 1:
        raise DataError(f'{path}: the links {", ".join(roots) or "none"} have no parent, expected '
                        'one')
    for part in robot.findall('mujoco'):
        robot.remove(part)
    # Links without joints would be joined to their parents, and have no names any more.
    ET.SubElement(ET.SubElement(robot, 'mujoco'), 'compiler', fusestatic='false')
    return robot, roots[0]


def add_inertia(link: ET.Element, mass: float, inertia: float) -> None:
    """Give a link a mass [kg], and the same inertia about all axes [kg m²]."""
    inertial = ET.SubElement(link, 'inertial')
    ET.SubElement(inertial, 'mass', value=str(mass))
    about = str(inertia)
    ET.SubElement(inertial, 'inertia', ixx=about, iyy=about, izz=about, ixy='0', ixz='0', iyz='0')


def from_urdf(path: Path, tip: str, base: str = '') -> TipKinematics:
    """
    Kinematics of a URDF file; its meshes are not needed.

    :param tip: name of a link
    :param base: name of the link that the poses are in; empty: the first one
    :raises DataError: if it is no URDF, or has no such links
    """
    robot, root = read_urdf(path)
    for link in robot.iter('link'):
        for name in _NOT_NEEDED:
            for part in link.findall(name):
                link.remove(part)
        add_inertia(link, 1.0, 1.0)
    try:
        model = mujoco.MjModel.from_xml_string(ET.tostring(robot, encoding='unicode'))
    except ValueError as error:
        raise DataError(f'{path}: {error}') from None
    try:
        return TipKinematics(model, tip, root, base)
    except DataError as error:
        raise DataError(f'{path}: {error}') from None


def from_model(name: str, tip: str = '', base: str = '') -> TipKinematics:
    """
    Kinematics of a model.

    :param name: as `gdmp_ros.sim.model_sources.load`
    :param tip: name of a site or body; empty: the site ``tcp``
    :param base: name of the body that the poses are in; empty: the first one
    :raises DataError: if there is no such model, tip or base
    """
    spec = model_sources.load(name)
    try:
        model = spec.compile()
    except ValueError as error:
        raise DataError(f'{name}: {error}') from None
    first = next((model.body(i).name for i in range(1, model.nbody)
                  if model.body_parentid[i] == 0 and model.body_jntnum[i] == 0), '')
    try:
        return TipKinematics(model, tip or 'tcp', first or 'world', base)
    except DataError as error:
        raise DataError(f'{name}: {error}') from None
