"""
What stands around the arm: rows that keep its links away from volumes, and a barrier.

A row limits the speed at which a link of the reference approaches a volume, as `limit_rows` does
for other limits; it adds the speed at which the volume comes. The barrier pushes the measured arm
back, but only as far as the arm itself has come nearer: what a volume that moves towards it adds
does not act, so nothing moves by itself.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.kinematics import Chain
from gdmp_ros.control.limit_rows import approach, LAST_S
from gdmp_ros.control.own_body import Body, closing, DOUBLED, place_capsules
from gdmp_ros.kernels import kernel, local_matrix, local_numbers, noinline
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.scene.distance import is_allowed, point_distance, segment_distance
from gdmp_ros.scene.volume import HALF, MARGIN, POSE, RADIUS, THERE, TWIST

#: Most rows of volumes at a time; those with the smallest bounds stay.
MOST_ROWS = 32
#: Stiffness of the barrier [N/m], and its largest force on a link [N].
BARRIER, MOST_FORCE = 5000.0, 150.0
#: A volume that was last seen this long ago does not go on moving [s].
LAST_SEEN_S = 0.3
#: An arm stands still before a volume reaches it that comes: it is slowed down from this time
#: before the contact on [s]; at the end a share of the margin is left.
SLOWED_S, LEFT_SHARE = 0.6, 1.0
#: The reference keeps this much more than the margin, and there the barrier begins: the arm is not
#: quite where its reference is [m].
SLACK = 0.01
#: Motions of the joints may bring links this much nearer to what they are too near to [m].
NEARER_M = 0.001
#: Volumes that are further away than this are not near [m].
SEEN_FROM = 0.5
#: Ends of a link have a row of their own if they are this far along it from its nearest point, so
#: that a link that is parallel to a face does not turn into it.
_ENDS = 0.1


@kernel
def move_volumes(volumes, seen, dt):
    """
    Let volumes go on as they move; those that were not seen again stand where they were.

    :param seen: how long ago they were seen [s]
    """
    turn = local_numbers(3)
    for v in range(volumes.shape[0]):
        moves = 0.0
        for i in range(6):
            moves += abs(volumes[v, TWIST + i])
        if volumes[v, THERE] == 0.0 or moves == 0.0:
            continue
        if seen > LAST_SEEN_S:
            for i in range(6):
                volumes[v, TWIST + i] = 0.0
            continue
        for i in range(3):
            volumes[v, POSE + i] += dt * volumes[v, TWIST + i]
            turn[i] = dt * volumes[v, TWIST + 3 + i]
        rotate_by_vector(volumes[v, POSE + 3:POSE + 7], turn, volumes[v, POSE + 3:POSE + 7])


@kernel
def _is_far(volume, capsule, first, second, distance):
    """Whether a capsule is certainly further from a volume than a distance, by their spheres."""
    between = length = size = 0.0
    for i in range(3):
        between += (0.5 * (first[i] + second[i]) - volume[POSE + i]) ** 2
        length += (first[i] - second[i]) ** 2
        size += volume[HALF + i] ** 2
    least = (distance + capsule[7] + 0.5 * math.sqrt(length) + volume[RADIUS] + math.sqrt(size))
    return between > least * least


@kernel
def _coming(volume, point, way):
    """Speed at which a volume comes nearer to a point [m/s]; 0 if it does not."""
    lever, turn = local_numbers(3), volume[TWIST + 3:TWIST + 6]
    for i in range(3):
        lever[i] = point[i] - volume[POSE + i]
    speed = (way[0] * (volume[TWIST] + turn[1] * lever[2] - turn[2] * lever[1])
             + way[1] * (volume[TWIST + 1] + turn[2] * lever[0] - turn[0] * lever[2])
             + way[2] * (volume[TWIST + 2] + turn[0] * lever[1] - turn[1] * lever[0]))
    return max(speed, 0.0)


@kernel
def _share_beside(away, margin, coming):
    """Share of the speed that is left at a distance from what comes nearer [m, m/s]."""
    if coming == 0.0:
        return 1.0
    return min(max((away - LEFT_SHARE * margin) / (SLOWED_S * coming), 0.0), 1.0)


@kernel
def _place_for(bounds, first, count, bound):
    """Return where a row comes: behind the others, or in the place of the loosest one; or -1."""
    if count - first < MOST_ROWS:
        return count
    loosest = first
    for k in range(first, count):
        if bounds[k] > bounds[loosest]:
            loosest = k
    return loosest if bound < bounds[loosest] else -1


@kernel
def surroundings_rows(frames, axes, position, capsules, volumes, slack, deceleration, fastest,
                      retreat, first_id, rows, bounds, ids, first):
    """
    Write the rows of links and volumes that may bind, behind others.

    :param frames: of the joints (`gdmp_ros.control.kinematics.Chain`), as ``axes``
    :param position: of the joints of the reference [rad], shape (n,)
    :param capsules: of the arm (`gdmp_ros.control.own_body.Body`)
    :param volumes: packed (`gdmp_ros.scene.volume`), in the frame of the base
    :param slack: an approach ends so far outside of the margin [m]
    :param deceleration: with which an approach ends [m/s²]
    :param fastest: a row does not bind that allows this speed [m/s]
    :param retreat: speed at which the arm goes away from what comes [m/s]
    :param first_id: of the first volume and capsule
    :param rows: written, as by `gdmp_ros.control.limit_rows.limit_rows`
    :param first: rows that are there
    :returns: number of rows; share of the speed that is left beside what comes; the least
        distance, at most `SEEN_FROM` [m], and the number of its volume and capsule, or -1
    """
    noinline()
    n, m, count, share = position.size, capsules.shape[0], first, 1.0
    clearance, nearest = SEEN_FROM, -1
    links, turns, ends = (local_matrix(n + 1, 7), local_matrix(n, 3), local_matrix(2 * m, 3))
    way, point = local_numbers(3), local_numbers(3)
    placed = False
    reach = max(0.5 * fastest ** 2 / deceleration, fastest * LAST_S)
    for v in range(volumes.shape[0]):
        volume = volumes[v]
        if volume[THERE] == 0.0:
            continue
        if not placed:
            place_capsules(frames, axes, position, capsules, links, turns, ends)
            placed = True
        speed = math.sqrt(volume[TWIST] ** 2 + volume[TWIST + 1] ** 2 + volume[TWIST + 2] ** 2)
        furthest = volume[MARGIN] + SLACK + reach + SLOWED_S * speed
        for c in range(m):
            capsule = capsules[c]
            if capsule[0] == 0.0 or is_allowed(volume, capsule[8]) or _is_far(
                    volume, capsule, ends[2 * c], ends[2 * c + 1], max(furthest, clearance)):
                continue
            distance, t = segment_distance(volume, ends[2 * c], ends[2 * c + 1], way)
            if distance - capsule[7] < clearance:
                clearance, nearest = distance - capsule[7], v * m + c
            for place in range(3):
                # The nearest point, and the ends of the link.
                along = t if place == 0 else place - 1.0
                if place > 0:
                    if abs(along - t) < _ENDS:
                        continue
                    distance = point_distance(volume, ends[2 * c + place - 1], way)
                away = distance - capsule[7]
                for i in range(3):
                    point[i] = ends[2 * c, i] + along * (ends[2 * c + 1, i] - ends[2 * c, i])
                coming = _coming(volume, point, way)
                if retreat == 0.0:
                    share = min(share, _share_beside(away, volume[MARGIN], coming))
                bound = max(approach(away - volume[MARGIN] - slack, deceleration) - coming,
                            -retreat)
                at = _place_for(bounds, first, count, bound)
                if bound < fastest and at >= 0:
                    closing(links, turns, (0, int(capsule[0])), point, way, 1.0, rows[at])
                    bounds[at], ids[at] = bound, first_id + v * m + c
                    count = max(count, at + 1)
    return count, share, clearance, nearest


@kernel
def push_away(frames, axes, position, velocity, capsules, volumes, dt, relief, torque):
    """
    Add the torque that pushes links away from volumes that are too near: a potential of the depth.

    Returns the share of the speed that is left beside what comes.

    :param position: of the joints, measured [rad]
    :param velocity: of the joints, measured [rad/s]
    :param relief: depth of each volume and link inside the margin that does not act [m], shape
        (volumes, capsules); changed
    """
    noinline()
    n, m, placed, share = position.size, capsules.shape[0], False, 1.0
    links, turns, ends = (local_matrix(n + 1, 7), local_matrix(n, 3), local_matrix(2 * m, 3))
    way, point, row = local_numbers(3), local_numbers(3), local_numbers(n)
    for v in range(volumes.shape[0]):
        volume = volumes[v]
        if volume[THERE] == 0.0:
            continue
        if not placed:
            place_capsules(frames, axes, position, capsules, links, turns, ends)
            placed = True
        speed = math.sqrt(volume[TWIST] ** 2 + volume[TWIST + 1] ** 2 + volume[TWIST + 2] ** 2)
        furthest = volume[MARGIN] + SLACK + SLOWED_S * speed
        for c in range(m):
            capsule = capsules[c]
            if capsule[0] == 0.0 or is_allowed(volume, capsule[8]) or _is_far(
                    volume, capsule, ends[2 * c], ends[2 * c + 1], furthest):
                relief[v, c] = 0.0
                continue
            distance, t = segment_distance(volume, ends[2 * c], ends[2 * c + 1], way)
            deep = max(volume[MARGIN] + SLACK - distance + capsule[7], 0.0)
            for i in range(3):
                point[i] = ends[2 * c, i] + t * (ends[2 * c + 1, i] - ends[2 * c, i])
            coming = _coming(volume, point, way)
            share = min(share, _share_beside(distance - capsule[7], volume[MARGIN], coming))
            relief[v, c] = min(relief[v, c] + dt * coming, deep)
            if deep <= relief[v, c]:
                continue
            closing(links, turns, (0, int(capsule[0])), point, way, 1.0, row)
            nearing = 0.0
            for i in range(n):
                nearing += row[i] * velocity[i]
            force = min(BARRIER * (deep - relief[v, c]) * (1.0 + max(nearing, 0.0) / DOUBLED),
                        MOST_FORCE)
            for i in range(n):
                torque[i] -= force * row[i]
    return share


def depths(chain: Chain, body: Body, position: np.ndarray, volumes: np.ndarray) -> np.ndarray:
    """
    How deep each link is inside the margin of each volume [m], shape (volumes, capsules).

    :param position: of the joints [rad]
    :param volumes: packed
    """
    result = np.zeros((len(volumes), len(body.capsules)))
    _depths(*chain, np.ascontiguousarray(position, dtype=float), body.capsules,
            np.ascontiguousarray(volumes), result)
    return result


@kernel
def _depths(frames, axes, position, capsules, volumes, result):
    n, m = position.size, capsules.shape[0]
    links, turns, ends = (local_matrix(n + 1, 7), local_matrix(n, 3), local_matrix(2 * m, 3))
    way = local_numbers(3)
    place_capsules(frames, axes, position, capsules, links, turns, ends)
    for v in range(volumes.shape[0]):
        for c in range(m):
            if (volumes[v, THERE] == 0.0 or capsules[c, 0] == 0.0
                    or is_allowed(volumes[v], capsules[c, 8])):
                result[v, c] = -math.inf
                continue
            distance, _ = segment_distance(volumes[v], ends[2 * c], ends[2 * c + 1], way)
            result[v, c] = volumes[v, MARGIN] - distance + capsules[c, 7]
