"""
The arm's own body: capsules on its links, and what keeps pairs of them apart.

A row limits the speed at which two capsules of the reference approach each other, as `limit_rows`
does for other limits. Those of the measured arm are pushed apart. Pairs that touch by
design are not among them (`gdmp_ros.sim.chain.body_of`).
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.kinematics import Chain, place_links
from gdmp_ros.control.limit_rows import approach, LAST_S
from gdmp_ros.kernels import kernel, local_matrix, local_numbers, noinline
from gdmp_ros.manifolds.linalg import norm
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.scene.volume import CARRIED

#: Numbers of a capsule, and how many there are for what the arm carries.
CAPSULE_SIZE, LOAD = 9, 8
#: Distance that the parts of an arm keep from each other [m].
KEEP = 0.02
#: Force between parts that touch [N], and the speed of an approach at which it is doubled [m/s].
PUSH, DOUBLED = 100.0, 0.2


class Body(NamedTuple):
    """
    Shape of an arm.

    :ivar capsules: how many joints move it, both ends of its axis in the frame of the last of
        these joints [m], its radius [m], the bit of its link; shape ``(m, CAPSULE_SIZE)``
    :ivar pairs: capsules that must not touch; the first is moved by fewer joints; shape ``(k, 2)``
    :ivar names: of the parts of each pair
    :ivar links: names of the links of the capsules
    """

    capsules: np.ndarray
    pairs: np.ndarray
    names: tuple[str, ...]
    links: tuple[str, ...] = ()

    @property
    def bits(self) -> dict[str, int]:
        """The bit of each link."""
        return {name: int(row[8]) for name, row in zip(self.links, self.capsules)}

    def with_load(self) -> Body:
        """
        Return it with `LOAD` capsules for what the arm carries, which hold nothing yet.

        They are kept away from what is around the arm, not from its own links.
        """
        rows = np.zeros((LOAD, CAPSULE_SIZE))
        rows[:, 8] = 2.0 ** min(len(self.bits), 51)
        return self._replace(capsules=np.vstack([self.capsules, rows]),
                             links=(*self.links, *(CARRIED,) * LOAD))


#: An arm without a shape.
NO_BODY = Body(np.zeros((0, CAPSULE_SIZE)), np.zeros((0, 2)), ())


def carried_capsules(carried: np.ndarray, end: np.ndarray, joints: int,
                     capsules: np.ndarray) -> None:
    """
    Write the last `LOAD` capsules of a body that has them (`Body.with_load`).

    :param carried: `gdmp_ros.scene.scene.Scene.carried`
    :param end: pose of the tool in the frame of the last joint
    :param joints: of the arm
    """
    rows = capsules[-LOAD:]
    rows[:, :8] = 0.0
    for row, given in zip(rows, carried):
        row[0], row[7] = joints, given[6]
        for first in (0, 3):
            rotate(end[3:], given[first:first + 3], row[1 + first:4 + first])
            row[1 + first:4 + first] += end[:3]


@kernel
def _between(value, low, high):
    return min(max(value, low), high)


@kernel
def nearest_points(a, b, c, d, first, second):
    """
    Write the points of the segments ab and cd that are nearest to each other.

    Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.9.
    """
    u, v, w = local_numbers(3), local_numbers(3), local_numbers(3)
    uu = vv = uv = uw = vw = 0.0
    for i in range(3):
        u[i], v[i], w[i] = b[i] - a[i], d[i] - c[i], a[i] - c[i]
        uu += u[i] * u[i]
        vv += v[i] * v[i]
        uv += u[i] * v[i]
        uw += u[i] * w[i]
        vw += v[i] * w[i]
    s = t = 0.0
    if vv > 0.0:
        square = uu * vv - uv * uv
        # Of parallel segments any point of the first will do.
        if square > 1e-12 * uu * vv:
            s = _between((uv * vw - uw * vv) / square, 0.0, 1.0)
        t = (uv * s + vw) / vv
    if t < 0.0 or t > 1.0 or vv == 0.0:
        t = _between(t, 0.0, 1.0)
        s = _between((uv * t - uw) / uu, 0.0, 1.0) if uu > 0.0 else 0.0
    for i in range(3):
        first[i], second[i] = a[i] + s * u[i], c[i] + t * v[i]


@kernel
def place_capsules(frames, axes, position, capsules, links, turns, ends):
    """
    Write where links, axes of joints and ends of capsules are.

    :param links: written, shape (n + 1, 7), as by `place_links`
    :param turns: written, shape (n, 3)
    :param ends: written, shape (2 m, 3)
    """
    moved = local_numbers(3)
    place_links(frames, axes, position, links, turns)
    for k in range(capsules.shape[0]):
        link = links[int(capsules[k, 0])]
        for end in range(2):
            rotate(link[3:], capsules[k, 1 + 3 * end:4 + 3 * end], moved)
            for i in range(3):
                ends[2 * k + end, i] = link[i] + moved[i]


@kernel
def _is_far(capsules, ends, a, b, distance):
    """Whether two capsules are certainly further apart than a distance: spheres around them."""
    between = first = second = 0.0
    for i in range(3):
        between += (ends[2 * a, i] + ends[2 * a + 1, i] - ends[2 * b, i] - ends[2 * b + 1, i]) ** 2
        first += (ends[2 * a, i] - ends[2 * a + 1, i]) ** 2
        second += (ends[2 * b, i] - ends[2 * b + 1, i]) ** 2
    least = (2.0 * (distance + capsules[a, 7] + capsules[b, 7]) + math.sqrt(first)
             + math.sqrt(second))
    return between > least * least


@kernel
def _distance(capsules, ends, a, b, way, far):
    """Write from where to where two capsules are nearest; the distance of their axes [m]."""
    near = local_numbers(3)
    nearest_points(ends[2 * a], ends[2 * a + 1], ends[2 * b], ends[2 * b + 1], near, far)
    for i in range(3):
        way[i] = far[i] - near[i]
    return norm(3, way)


@kernel
def closing(links, turns, joints, point, way, length, row):
    """
    Write by how much each joint brings a point nearer to another one [m/rad].

    :param links: and ``turns``: see `place_capsules`
    :param joints: the first one that moves the point, and the one behind the last
    :param way: from the point to the other one, of a length
    """
    for k in range(row.size):
        row[k] = 0.0
    lever = local_numbers(3)
    for k in range(joints[0], joints[1]):
        x, y, z = turns[k, 0], turns[k, 1], turns[k, 2]
        for i in range(3):
            lever[i] = point[i] - links[k + 1, i]
        row[k] = -(way[0] * (y * lever[2] - z * lever[1]) + way[1] * (z * lever[0] - x * lever[2])
                   + way[2] * (x * lever[1] - y * lever[0])) / length


@kernel
def _between_them(capsules, a, b):
    """Joints between two links: those that move both leave their distance as it is."""
    return int(capsules[a, 0]), int(capsules[b, 0])


@kernel
def body_rows(frames, axes, position, capsules, pairs, deceleration, fastest, first_id, rows,
              bounds, ids, count):
    """
    Write the rows of pairs that may bind, behind others.

    :param frames: of the joints (`gdmp_ros.control.kinematics.Chain`), as ``axes``
    :param position: of the joints of the reference [rad], shape (n,)
    :param capsules: see `Body`, as ``pairs``
    :param deceleration: with which an approach ends [m/s²]
    :param fastest: a row does not bind that allows this speed [m/s]
    :param first_id: of the first pair
    :param rows: written, as by `gdmp_ros.control.limit_rows.limit_rows`
    :param count: rows that are there
    :returns: number of rows
    """
    noinline()
    n = position.size
    if pairs.shape[0] == 0:
        return count
    links, turns, ends = (local_matrix(n + 1, 7), local_matrix(n, 3),
                          local_matrix(2 * capsules.shape[0], 3))
    way, far = local_numbers(3), local_numbers(3)
    place_capsules(frames, axes, position, capsules, links, turns, ends)
    # Beyond this distance no row binds (`approach`).
    furthest = KEEP + max(0.5 * fastest ** 2 / deceleration, fastest * LAST_S)
    for p in range(pairs.shape[0]):
        a, b = int(pairs[p, 0]), int(pairs[p, 1])
        if _is_far(capsules, ends, a, b, furthest):
            continue
        length = _distance(capsules, ends, a, b, way, far)
        bound = approach(length - capsules[a, 7] - capsules[b, 7] - KEEP, deceleration)
        if bound < fastest and length > 1e-9:
            closing(links, turns, _between_them(capsules, a, b), far, way, length,
                    rows[count])
            bounds[count], ids[count] = bound, first_id + p
            count += 1
    return count


@kernel
def push_apart(frames, axes, position, velocity, capsules, pairs, relief, torque):
    """
    Add the torque that pushes pairs apart that are too near: a potential of their distance.

    :param position: of the joints, measured [rad]
    :param velocity: of the joints, measured [rad/s]
    :param relief: depth of each pair, inside the distance `KEEP`, that does not act yet [m];
        changed
    """
    noinline()
    n = position.size
    if pairs.shape[0] == 0:
        return
    links, turns, ends = (local_matrix(n + 1, 7), local_matrix(n, 3),
                          local_matrix(2 * capsules.shape[0], 3))
    way, far, row = local_numbers(3), local_numbers(3), local_numbers(n)
    place_capsules(frames, axes, position, capsules, links, turns, ends)
    for p in range(pairs.shape[0]):
        a, b = int(pairs[p, 0]), int(pairs[p, 1])
        if _is_far(capsules, ends, a, b, KEEP):
            relief[p] = 0.0
            continue
        length = _distance(capsules, ends, a, b, way, far)
        deep = max(KEEP - length + capsules[a, 7] + capsules[b, 7], 0.0)
        relief[p] = min(relief[p], deep)
        if deep <= relief[p] or length < 1e-9:
            continue
        closing(links, turns, _between_them(capsules, a, b), far, way, length, row)
        nearing = 0.0
        for i in range(n):
            nearing += row[i] * velocity[i]
        # It begins at zero, and grows so slowly that the motors keep up with it.
        force = PUSH / KEEP * (deep - relief[p]) * (1.0 + max(nearing, 0.0) / DOUBLED)
        for i in range(n):
            torque[i] -= force * row[i]


def placed(chain: Chain, body: Body, position: np.ndarray) -> np.ndarray:
    """
    Capsules in the frame of the base: ends of the axis and radius [m], shape (m, 7).

    :param position: of the joints [rad]
    """
    n, m = len(position), len(body.capsules)
    ends = np.empty((2 * m, 3))
    place_capsules(*chain, position, body.capsules, np.empty((n + 1, 7)), np.empty((n, 3)), ends)
    return np.hstack([ends.reshape(m, 6), body.capsules[:, 7:8]])


def clearances(chain: Chain, body: Body, position: np.ndarray) -> np.ndarray:
    """
    Distance of each pair [m], shape (k,).

    :param position: of the joints [rad]
    """
    ends = np.ascontiguousarray(placed(chain, body, position)[:, :6]).reshape(-1, 3)
    way, far = np.empty(3), np.empty(3)
    return np.array([_distance(body.capsules, ends, a, b, way, far) - body.capsules[a, 7]
                     - body.capsules[b, 7] for a, b in body.pairs.astype(int)])
