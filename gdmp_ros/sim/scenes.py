"""Scenes with the Panda: a watering can and a tray of water, open boxes, a table."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from gdmp_ros.scene import Scene, Volume
from gdmp_ros.sim.arm import Arm, PANDA
from gdmp_ros.sim.model_sources import load
from gdmp_ros.sim.volumes import add_volumes

_BOX, _CYLINDER, _CAPSULE = (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER,
                             mujoco.mjtGeom.mjGEOM_CAPSULE)
#: The arm's geoms collide with these, as with the floor of the model.
_SOLID = {'contype': 2, 'conaffinity': 1}
_GREEN, _WOOD, _WATER = [0.25, 0.55, 0.4, 1.0], [0.72, 0.58, 0.42, 1.0], [0.3, 0.55, 0.85, 0.45]

#: Can: radius [m], half height [m], mass [kg], distance of its centre below the tool [m].
CAN_RADIUS, CAN_HALF, CAN_MASS, CAN_BELOW = 0.055, 0.065, 0.6, 0.11
#: Tray: centre and half size [m], height of its walls and of the water above the floor [m].
TRAY, TRAY_HALF, TRAY_WALL, WATER_LINE = (0.52, 0.0), (0.22, 0.2), 0.19, 0.16
_THIN = 0.006
CUBE_EDGE, CUBE_MASS = 0.04, 0.1
#: Table of foam: stiffness of its top [N/m], and its mass [kg].
TABLE_STIFFNESS, TABLE_MASS = 20_000.0, 1.0
#: Peg: half width, half length, distance of its centre below the tool [m].
PEG_HALF, PEG_HALF_LENGTH, PEG_BELOW = 0.01, 0.03, 0.02
#: Height of the top of the hole above the floor, depth of one that stands anywhere [m].
HOLE_TOP, HOLE_DEPTH = 0.2, 0.06


def watering() -> mujoco.MjSpec:
    """
    Panda with a watering can in its hand, in front of a tray of water.

    Sites: ``tcp``, ``lip`` at the rim that dips first, and ``wrist`` with a force sensor
    ``wrist_force`` between hand and can (in the frame of the site).
    """
    spec = mujoco.MjSpec.from_file(str(PANDA))
    can = spec.body('hand').add_body(name='can', pos=[0.0, 0.0, 0.1034 + CAN_BELOW],
                                     quat=[0.0, 1.0, 0.0, 0.0])
    can.mass, can.explicitinertial, can.ipos = CAN_MASS, True, [0.0, 0.0, 0.0]
    across = CAN_MASS * (CAN_RADIUS ** 2 / 2.0 + CAN_HALF ** 2 / 3.0)
    can.inertia = [across, across, CAN_MASS * CAN_RADIUS ** 2]
    look = {'contype': 1, 'conaffinity': 2, 'rgba': _GREEN}
    can.add_geom(type=_CYLINDER, size=[CAN_RADIUS, CAN_HALF, 0.0], **look)
    can.add_geom(type=_CYLINDER, size=[0.85 * CAN_RADIUS, 0.002, 0.0],
                 pos=[0.0, 0.0, CAN_HALF + 0.001], contype=0, conaffinity=0,
                 rgba=[0.1, 0.2, 0.15, 1.0])
    can.add_geom(type=_CAPSULE, size=[0.009, 0.0, 0.0],
                 fromto=[-CAN_RADIUS, 0.0, -0.03, -0.14, 0.0, 0.075], **look)
    for side in (-1.0, 1.0):
        can.add_geom(type=_CAPSULE, size=[0.006, 0.0, 0.0], contype=0, conaffinity=0,
                     rgba=_GREEN, fromto=[side * 0.045, 0.0, CAN_HALF, 0.0, 0.0, CAN_BELOW])
    can.add_site(name='lip', pos=[CAN_RADIUS, 0.0, CAN_HALF], size=[0.005] * 3,
                 rgba=[0.9, 0.2, 0.1, 1.0])
    can.add_site(name='wrist', pos=[0.0, 0.0, CAN_BELOW], rgba=[0.0] * 4)
    spec.add_sensor(name='wrist_force', type=mujoco.mjtSensor.mjSENS_FORCE,
                    objtype=mujoco.mjtObj.mjOBJ_SITE, objname='wrist')
    _tray(spec)
    return spec


def _tray(spec: mujoco.MjSpec) -> None:
    tray = spec.worldbody.add_body(name='tray', pos=[*TRAY, 0.0])
    width, depth = TRAY_HALF
    tray.add_geom(name='tray_floor', type=_BOX, size=[width, depth, _THIN],
                  pos=[0.0, 0.0, _THIN], rgba=_WOOD, **_SOLID)
    _walls(tray, (width, depth), TRAY_WALL, _WOOD, 'tray')
    tray.add_geom(name='water', type=_BOX, size=[width, depth, 0.5 * WATER_LINE],
                  pos=[0.0, 0.0, 0.5 * WATER_LINE], rgba=_WATER, contype=0, conaffinity=0)


def _walls(body: mujoco.MjsBody, half: tuple[float, float], height: float, colour: list[float],
           name: str, below: float = 0.0) -> None:
    """:param below: where they begin, below the body [m]"""
    for axis in (0, 1):
        for side in (-1.0, 1.0):
            size = [half[0] + _THIN, half[1] + _THIN, 0.5 * height]
            position = [0.0, 0.0, 0.5 * height - below]
            size[axis], position[axis] = _THIN, side * (half[axis] + _THIN)
            body.add_geom(name=f'{name}_wall_{axis}{"-+"[side > 0]}', type=_BOX, size=size,
                          pos=position, rgba=colour, **_SOLID)


@dataclass(frozen=True)
class Box:
    """An open box on the floor: centre, half size of its opening, height [m]."""

    centre: tuple[float, float]
    half: tuple[float, float]
    height: float


def boxes(where: list[Box]) -> mujoco.MjSpec:
    """
    Panda with open boxes in front of it.

    Walls are geoms named ``box1_wall_0-`` and so on, floors ``box1_floor``; both collide with the
    Panda.
    """
    spec = mujoco.MjSpec.from_file(str(PANDA))
    _add_boxes(spec, where)
    return spec


def _add_boxes(spec: mujoco.MjSpec, where: list[Box]) -> None:
    for number, box in enumerate(where, 1):
        _add_box(spec, number, box, np.array([*box.centre, 0.0, 1.0, 0.0, 0.0, 0.0]))


def _add_box(spec: mujoco.MjSpec, number: int, box: Box, where: np.ndarray) -> None:
    body = spec.worldbody.add_body(name=f'box{number}', pos=where[:3], quat=where[3:])
    shade = [0.55 + 0.12 * number, 0.62, 0.75 - 0.1 * number, 0.55]
    body.add_geom(name=f'box{number}_floor', type=_BOX, size=[*box.half, _THIN],
                  pos=[0.0, 0.0, _THIN], rgba=shade, **_SOLID)
    _walls(body, box.half, box.height, shade, f'box{number}')


#: Boxes to pick from and to place in, edge of the cube [m] and its mass [kg].
PICK = Box((0.45, -0.22), (0.09, 0.09), 0.06)
PLACE = Box((0.45, 0.22), (0.09, 0.09), 0.06)


def pick_and_place(spec: mujoco.MjSpec) -> None:
    """Add two open boxes, and a body ``cube`` in the first of them."""
    _add_boxes(spec, [PICK, PLACE])
    _add_cube(spec, np.array([*PICK.centre, 2.0 * _THIN + 0.5 * CUBE_EDGE, 1.0, 0.0, 0.0, 0.0]))


def cube_and_box(spec: mujoco.MjSpec, cube: np.ndarray, box: np.ndarray) -> None:
    """
    Add a body ``cube`` on the floor, and an open box that is turned about the vertical.

    :param cube: pose of its centre
    :param box: pose of the middle of its floor
    """
    _add_box(spec, 1, PLACE, box)
    _add_cube(spec, cube)


def _add_cube(spec: mujoco.MjSpec, where: np.ndarray) -> None:
    half = 0.5 * CUBE_EDGE
    cube = spec.worldbody.add_body(name='cube', pos=where[:3], quat=where[3:])
    cube.add_freejoint(name='cube')
    cube.mass, cube.explicitinertial, cube.ipos = CUBE_MASS, True, [0.0, 0.0, 0.0]
    cube.inertia = [CUBE_MASS * CUBE_EDGE ** 2 / 6.0] * 3
    # It collides with the arm and with what is solid.
    cube.add_geom(name='cube', type=_BOX, size=[half] * 3, rgba=_GREEN,
                  contype=3, conaffinity=3, friction=[1.5, 0.05, 1e-3], condim=4,
                  solref=[0.004, 1.0])


def hard_table(below: float, model: str = 'panda') -> mujoco.MjSpec:
    """
    Arm with a table under its tool, hard and with little damping in contact.

    :param below: distance from the tool in the first keyframe down to the table top [m]
    :param model: of the arm, a built-in one
    """
    spec, half = load(model), 0.2
    tool = Arm(model).measure().pose[:3]
    # Negative numbers give stiffness and damping directly, per unit of mass.
    spec.worldbody.add_geom(name='table', type=_BOX, size=[half] * 3, rgba=_WOOD,
                            pos=[tool[0], tool[1], tool[2] - below - half],
                            solref=[-2e4, -5.0], **_SOLID)
    return spec


def cloth_table(below: float, model: str = 'panda') -> mujoco.MjSpec:
    """Arm with a table under its tool that a cloth covers, to be wiped; see `hard_table`."""
    spec = hard_table(below, model)
    _cover(spec.geom('table'))
    return spec


def _cover(top: mujoco.MjsGeom) -> None:
    """Cover a table with a cloth: without it, sliding over the corners of the fingers chatters."""
    top.solref, top.solimp = [0.02, 1.0], [0.0, 0.95, 0.005, 0.5, 2.0]
    top.priority, top.friction = 1, [0.2, 0.005, 0.0001]


def peg_and_hole(where: tuple[float, float], angle: float, clearance: float,
                 friction: float = 1.0) -> mujoco.MjSpec:
    """
    Panda with a square peg in its hand, and a square hole between four walls.

    The walls are geoms named ``hole_wall_0-`` and so on.

    :param where: centre of the hole [m]
    :param angle: of the hole about the vertical [rad]
    :param clearance: on each side of the peg [m]
    :param friction: between peg and walls
    """
    spec = _with_peg(friction)
    hole = spec.worldbody.add_body(name='hole', pos=[*where, 0.0], quat=[
        np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])
    _walls(hole, (PEG_HALF + clearance,) * 2, HOLE_TOP, _WOOD, 'hole')
    return spec


def _with_peg(friction: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(str(PANDA))
    spec.body('hand').add_geom(
        name='peg', type=_BOX, size=[PEG_HALF, PEG_HALF, PEG_HALF_LENGTH], mass=0.1, rgba=_GREEN,
        pos=[0.0, 0.0, 0.1034 + PEG_BELOW], contype=1, conaffinity=2,
        friction=[friction, 0.005, 0.0001], priority=1)
    return spec


def peg_and_holes(where: Sequence[np.ndarray], clearance: float, friction: float = 0.3
                  ) -> mujoco.MjSpec:
    """
    Panda with a square peg in its hand, and square holes that stand anywhere, turned and tilted.

    :param where: poses of the middle of the top of each hole; it goes down along -z
    :param clearance: on each side of the peg [m]
    """
    spec = _with_peg(friction)
    for number, pose in enumerate(where):
        hole = spec.worldbody.add_body(name=f'hole_{number}', pos=pose[:3], quat=pose[3:])
        _walls(hole, (PEG_HALF + clearance,) * 2, HOLE_DEPTH, _WOOD, f'hole_{number}', HOLE_DEPTH)
    return spec


def contact_count(model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> int:
    """Count contacts of geoms whose name begins with ``prefix``."""
    ids = np.array([i for i in range(model.ngeom) if model.geom(i).name.startswith(prefix)])
    pairs = data.contact.geom[:data.ncon]
    return int(np.isin(pairs, ids).any(axis=1).sum()) if data.ncon else 0


def soft_table(spec: mujoco.MjSpec) -> None:
    """Add a table of foam with its top at height 0, which a cloth covers."""
    half = 0.4
    table = spec.worldbody.add_body(name='table', pos=[0.5, 0.0, -half], gravcomp=1.0)
    table.mass, table.explicitinertial, table.ipos = TABLE_MASS, True, [0.0, 0.0, 0.0]
    table.inertia = [TABLE_MASS * half ** 2] * 3
    # It does not ring.
    table.add_joint(name='table', type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0],
                    stiffness=TABLE_STIFFNESS,
                    damping=2.0 * np.sqrt(TABLE_STIFFNESS * TABLE_MASS))
    _cover(table.add_geom(name='table', type=_BOX, size=[half] * 3, rgba=_WOOD, **_SOLID))


def standing_at(scene: Callable[[mujoco.MjSpec], None], height: float
                ) -> Callable[[mujoco.MjSpec], None]:
    """The same scene on a floor at another height [m]."""
    def add(spec: mujoco.MjSpec) -> None:
        before = {body.name for body in spec.worldbody.bodies}
        scene(spec)
        for body in spec.worldbody.bodies:
            if body.name not in before:
                body.pos[2] += height
    return add


#: Objects between the boxes, in the frame of the base, and the one that is pushed.
CLUTTER, PUSHED = Scene([
    Volume('post', 'capsule', (0.03, 0.3), np.array([0.43, 0.0, 0.18, 1.0, 0.0, 0.0, 0.0])),
    Volume('crate', 'box', (0.12, 0.12, 0.12), np.array([0.62, 0.02, 0.06, 1.0, 0.0, 0.0, 0.0])),
    Volume('bottle', 'capsule', (0.05, 0.3),
           np.array([0.29, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0]))], 0.03), 'post'


def clutter(spec: mujoco.MjSpec) -> None:
    """Add the boxes and the cube, and three objects between them."""
    pick_and_place(spec)
    add_volumes(CLUTTER)(spec)


#: Objects that `gdmp_ros.sim.arm.Arm` may add to the built-in arms.
SCENES = {'pick_and_place': pick_and_place, 'soft_table': soft_table, 'clutter': clutter}
