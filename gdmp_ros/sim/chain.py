"""The chain of joints between the base of an arm and its tool, and its shape, from a model."""
from __future__ import annotations

import itertools

import mujoco
import numpy as np

from gdmp_ros.control.kinematics import Chain
from gdmp_ros.control.own_body import Body, CAPSULE_SIZE, KEEP, nearest_points
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import compose

_STILL = np.array([1.0, 0.0, 0.0, 0.0])


def chain_of(model: mujoco.MjModel, body: int) -> tuple[Chain, np.ndarray]:
    """
    Return the joints between the base and a body, and where the body is in the frame of the last.

    :raises ParameterError: if other joints are between than one revolute joint at a body, or the
        model has joints elsewhere
    """
    end = np.array([0.0, 0.0, 0.0, *_STILL])
    frames: list[np.ndarray] = []
    axes: list[np.ndarray] = []
    at = body
    while at > 0:
        frame = np.concatenate([model.body_pos[at], model.body_quat[at]])
        joint, count = int(model.body_jntadr[at]), int(model.body_jntnum[at])
        if count > 1 or (count == 1 and int(model.jnt_type[joint])
                         != int(mujoco.mjtJoint.mjJNT_HINGE)):
            raise ParameterError(f'body {model.body(at).name!r} of the model has other joints '
                                 'than one revolute joint')
        # The joint turns everything of its body about a point of it.
        place = np.concatenate([model.jnt_pos[joint], _STILL]) if count else None
        if place is not None:
            back = np.concatenate([-model.jnt_pos[joint], _STILL])
            if frames:
                frames[0] = compose(back, frames[0])
            else:
                end = compose(back, end)
            frames.insert(0, compose(frame, place))
            axes.insert(0, model.jnt_axis[joint].copy())
        elif frames:
            frames[0] = compose(frame, frames[0])
        else:
            end = compose(frame, end)
        at = int(model.body_parentid[at])
    if len(frames) != model.nv:
        raise ParameterError(f'{len(frames)} of the {model.nv} joints of the model are between '
                             f'its base and {model.body(body).name!r}, expected all')
    return Chain(np.array(frames), np.array(axes)), end


#: Links with at most this many joints between them are neighbours: nothing keeps them apart.
NEIGHBOURS = 2
_GEOM = mujoco.mjtGeom
_ROUND = {int(_GEOM.mjGEOM_SPHERE), int(_GEOM.mjGEOM_CAPSULE), int(_GEOM.mjGEOM_CYLINDER)}
_ENDLESS = {int(_GEOM.mjGEOM_PLANE), int(_GEOM.mjGEOM_HFIELD)}


def joints_before(model: mujoco.MjModel) -> list[int]:
    """Number of joints between the base and each body."""
    result = [0] * model.nbody
    for body in range(1, model.nbody):
        result[body] = result[model.body_parentid[body]] + int(model.body_jntnum[body])
    return result


def body_of(model: mujoco.MjModel, body: int, posture: np.ndarray) -> Body:
    """
    Shape of the arm that carries a body: a capsule around each geom that collides.

    A link without one counts with all its geoms. Pairs of neighbours may touch, and pairs that
    are closer than `KEEP` in a posture that is known to be right.

    :param posture: such a posture [rad]
    """
    data = mujoco.MjData(model)
    data.qpos[:] = posture
    mujoco.mj_kinematics(model, data)
    order, root = joints_before(model), model.body_rootid[body]
    moved_by = {order[other]: other for other in range(model.nbody) if model.body_jntnum[other]}
    capsules, places, names = [], [], []
    for geom in _solid_geoms(model, root):
        owner = int(model.geom_bodyid[geom])
        first, second, radius = _around(model, data, geom)
        places.append((first, second, radius))
        names.append(model.body(owner).name)
        if order[owner]:
            # The frame of a joint is at the joint, and turns with its body.
            link = moved_by[order[owner]]
            turn, at = data.xmat[link].reshape(3, 3), data.xanchor[model.body_jntadr[link]]
            first, second = (first - at) @ turn, (second - at) @ turn
        # Beyond 52 links a float does not hold the bit.
        bit = 2.0 ** min(len(dict.fromkeys(names)) - 1, 51)
        capsules.append([order[owner], *first, *second, radius, bit])
    near, far = np.empty((2, 3))
    pairs, found = [], []
    for a in range(len(capsules)):
        for b in range(len(capsules)):
            if capsules[b][0] - capsules[a][0] <= NEIGHBOURS:
                continue
            nearest_points(*places[a][:2], *places[b][:2], near, far)
            if np.linalg.norm(far - near) - places[a][2] - places[b][2] > KEEP:
                pairs.append((a, b))
                found.append(f'{names[b]} and {names[a]}')
    return Body(np.array(capsules).reshape(-1, CAPSULE_SIZE),
                np.array(pairs, dtype=float).reshape(-1, 2), tuple(found), tuple(names))


def _solid_geoms(model: mujoco.MjModel, root: int) -> list[int]:
    """Geoms of a tree of bodies that collide; all of a body where none does."""
    found = list[int]()
    for body in range(1, model.nbody):
        if model.body_rootid[body] != root:
            continue
        begin = int(model.body_geomadr[body])
        own = [geom for geom in range(begin, begin + int(model.body_geomnum[body]))
               if int(model.geom_type[geom]) not in _ENDLESS]
        found += [geom for geom in own
                  if model.geom_contype[geom] or model.geom_conaffinity[geom]] or own
    return found


def _around(model: mujoco.MjModel, data: mujoco.MjData, geom: int
            ) -> tuple[np.ndarray, np.ndarray, float]:
    """Capsule around a geom: both ends of its axis, in the frame of the base, and its radius."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    at, turn = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    if kind in _ROUND:
        half = 0.0 if kind == int(_GEOM.mjGEOM_SPHERE) else size[1]
        return at - half * turn[:, 2], at + half * turn[:, 2], float(size[0])
    centre, sides = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    points = sides * np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    if kind == int(_GEOM.mjGEOM_MESH):
        mesh = model.geom_dataid[geom]
        begin = model.mesh_vertadr[mesh]
        points = model.mesh_vert[begin:begin + model.mesh_vertnum[mesh]] - centre
    axis = int(np.argmax(sides))
    across = np.linalg.norm(np.delete(points, axis, axis=1), axis=1)
    radius = float(across.max())
    half = max(float((np.abs(points[:, axis]) - np.sqrt(radius ** 2 - across ** 2)).max()), 0.0)
    middle, way = at + turn @ centre, half * turn[:, axis]
    return middle - way, middle + way, radius
