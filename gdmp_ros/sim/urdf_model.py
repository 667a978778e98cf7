"""
Make a model of an arm from its URDF: for the simulation, and for `position_arm`.

What a URDF does not say is assumed, and told: inertia of links without one, that of the rotors,
and a capsule along each link without a simple shape, with which the arm keeps clear of itself.
"""
from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
import xml.etree.ElementTree as ET

import mujoco
import numpy as np

from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.sim.model_sources import make_torque_controlled
from gdmp_ros.sim.tip import add_inertia, read_urdf

#: Of a link without an inertia: mass [kg] and inertia [kg m²]; inertia of a rotor [kg m²] and
#: viscous friction of a joint [Nm s/rad]; radius of a capsule along a link, and the shortest one.
MASS, INERTIA, ROTOR, FRICTION, RADIUS, SHORTEST = 0.1, 1e-4, 0.1, 1.0, 0.05, 0.08
#: Name of the site of the tool.
TOOL = 'tcp'


class ArmModel(NamedTuple):
    """
    A model.

    :ivar spec: with a torque motor for each joint, the home posture, and the site of the tool
    :ivar root: first link: frame of the base
    :ivar assumed: what the URDF does not say
    """

    spec: mujoco.MjSpec
    root: str
    assumed: list[str]


def model_of(path: Path, tip: str, home: np.ndarray) -> ArmModel:
    """
    Make a model of a URDF.

    :param tip: link that carries the tool, which is at its origin
    :param home: posture at the beginning, where the null space rests [rad]
    :raises DataError: if it is no URDF, has no such link, or says too little
    :raises ParameterError: if the home posture does not fit the joints
    """
    robot, root = read_urdf(path)
    assumed: list[str] = []
    _simplify(robot, assumed)
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(robot, encoding='unicode'))
    except ValueError as error:
        raise DataError(f'{path}: {error}') from None
    body = spec.body(tip)
    if body is None:
        raise DataError(f'{path}: there is no link {tip!r}; there are '
                        f'{", ".join(one.name for one in spec.bodies[1:])}')
    speeds = _speeds(robot)
    body.add_site(name=TOOL)
    try:
        make_torque_controlled(spec, TOOL)
    except DataError as error:
        raise DataError(f'{path}: {error}; a URDF has it as effort="…" of the limit') from None
    joints = spec.joints
    for joint in joints:
        joint.armature = ROTOR
        if not np.any(joint.damping):
            joint.damping = [FRICTION, 0.0, 0.0]
    assumed.append(f'rotors of {ROTOR:g} kg m², and friction of {FRICTION:g} Nm s/rad in joints '
                   'without friction')
    _cover(spec, assumed)
    unknown = [joint.name for joint in joints if not speeds.get(joint.name, 0.0) > 0.0]
    if unknown:
        raise DataError(f'{path}: no velocity="…" in the limit of {", ".join(unknown)}')
    spec.add_numeric(name='joint_speed', size=len(joints),
                     data=[speeds[joint.name] for joint in joints])
    _check(home, joints)
    spec.add_key(name='home', qpos=home)
    return ArmModel(spec, root, assumed)


def _simplify(robot: ET.Element, assumed: list[str]) -> None:
    """Remove visual shapes and meshes, and give each link an inertia."""
    without = []
    for link in robot.iter('link'):
        for part in link.findall('visual'):
            link.remove(part)
        for part in link.findall('collision'):
            if part.find('geometry/mesh') is not None:
                link.remove(part)
        if link.find('inertial') is None:
            without.append(link.get('name', ''))
            add_inertia(link, MASS, INERTIA)
    if without:
        assumed.append(f'a mass of {MASS:g} kg for {", ".join(without)}')


def _speeds(robot: ET.Element) -> dict[str, float]:
    """Largest speed of each joint that has one [rad/s]."""
    limits = ((joint.get('name', ''), joint.find('limit')) for joint in robot.iter('joint'))
    return {name: float(limit.get('velocity', 0.0)) for name, limit in limits if limit is not None}


def _cover(spec: mujoco.MjSpec, assumed: list[str]) -> None:
    """Put a capsule along each link without a shape; it touches nothing in the simulation."""
    spec.compiler.discardvisual = False
    covered = []
    for body in spec.bodies[1:]:
        if body.geoms:
            continue
        for child in body.bodies:
            if np.linalg.norm(child.pos) >= SHORTEST:
                body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[RADIUS, 0.0, 0.0],
                              fromto=[0.0, 0.0, 0.0, *child.pos], contype=0, conaffinity=0,
                              mass=0.0)
                covered.append(body.name)
    if covered:
        assumed.append(f'a capsule with a radius of {RADIUS:g} m along {", ".join(covered)}')


def _check(home: np.ndarray, joints: list[mujoco.MjsJoint]) -> None:
    """:raises ParameterError: if the posture has another number of joints, or is out of range"""
    if len(home) != len(joints):
        raise ParameterError(f'the home posture has {len(home)} numbers, expected {len(joints)}: '
                             f'{", ".join(joint.name for joint in joints)}')
    for value, joint in zip(home.tolist(), joints):
        low, high = joint.range
        if high > low and not low <= value <= high:
            raise ParameterError(f'home: {joint.name} is {value:g} rad, expected {low:.4g} to '
                                 f'{high:.4g}')
