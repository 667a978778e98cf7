"""
Volumes: spheres, boxes, capsules and half-spaces.

Each is a box whose corners and edges may be rounded: a sphere is rounded alone, a capsule has a
length in one direction, a half-space is a very large box below its plane. So there is one formula
for the distance (`gdmp_ros.scene.distance`). Meshes and clouds of points count as boxes around
them (`gdmp_ros.scene.points`).
"""
from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.util.numeric import numbers

#: Numbers of a kind's size [m]: radius; lengths of the edges; radius and length of the axis (along
#: z); nothing: solid below z = 0.
KINDS = {'sphere': 1, 'box': 3, 'capsule': 2, 'plane': 0}
#: Half of the size of a half-space [m].
ENDLESS = 50.0
#: Larger numbers are refused [m].
LARGEST = 1e3
#: Layout of a packed volume: half edges, radius, pose, twist, margin, links that may touch it (a
#: bit each), and whether the row is used: 1 or 0.
HALF, RADIUS, POSE, TWIST, MARGIN, ALLOWED, THERE = 0, 3, 4, 11, 17, 18, 19
VOLUME_SIZE = 20
#: Most volumes at a time.
CAPACITY = 64
#: In `Volume.allowed`: what the arm carries.
CARRIED = 'carried'
#: Most capsules around one volume that is carried.
STRIPS = 4
#: Margin of a scene, if nothing else is said [m].
DEFAULT_MARGIN = 0.02


def _still() -> np.ndarray:
    return np.zeros(6)


@dataclass(frozen=True)
class Volume:
    """
    Something that is in the way.

    :ivar name: unique in a scene
    :ivar kind: one of `KINDS`
    :ivar size: see `KINDS` [m]
    :ivar pose: of its centre (x, y, z, qw, qx, qy, qz), of a plane: of a point of it; in the base
    :ivar twist: how it moves, linear and angular, in the frame of the pose [m/s, rad/s]
    :ivar margin: distance to keep [m]; None: that of the scene
    :ivar allowed: links of the arm that may touch it, and `CARRIED`
    :ivar carried: whether the arm carries it: its pose is in the frame of the tool, and it is kept
        away from other volumes as the links are
    """

    name: str
    kind: str
    size: tuple[float, ...]
    pose: np.ndarray
    twist: np.ndarray = field(default_factory=_still)
    margin: float | None = None
    allowed: tuple[str, ...] = ()
    carried: bool = False

    def __post_init__(self) -> None:
        where = f'volume {self.name!r}'
        if not self.name or not self.name.isprintable():
            raise DataError(f'{where}: expected a name')
        if self.kind not in KINDS:
            raise DataError(f'{where}: kind is {self.kind!r}, expected {", ".join(KINDS)}')
        size = tuple(float(value) for value in self.size)
        if len(size) != KINDS[self.kind]:
            raise DataError(f'{where}: size has {len(size)} numbers, a {self.kind} has '
                            f'{KINDS[self.kind]}')
        if not all(0.0 < value <= LARGEST for value in size):
            raise DataError(f'{where}: size is {list(size)} m, expected above 0 and at most '
                            f'{LARGEST:g}')
        pose, twist = numbers('pose', self.pose), numbers('twist', self.twist)
        if pose.shape != (7,) or not (np.abs(pose[:3]) <= LARGEST).all():
            raise DataError(f'{where}: pose is {pose.tolist()}, expected x, y, z within '
                            f'{LARGEST:g} m, and qw, qx, qy, qz')
        length = float(np.linalg.norm(pose[3:]))
        if not 0.99 < length < 1.01:
            raise DataError(f'{where}: the quaternion has length {length:.3g}, expected 1')
        if twist.shape != (6,) or not (np.abs(twist) <= LARGEST).all():
            raise DataError(f'{where}: twist is {twist.tolist()}, expected 6 finite numbers')
        if self.margin is not None and not 0.0 <= self.margin <= LARGEST:
            raise DataError(f'{where}: margin is {self.margin} m, expected 0 to {LARGEST:g}')
        if self.carried and self.kind == 'plane':
            raise DataError(f'{where}: an arm carries no plane')
        pose = np.concatenate([pose[:3], pose[3:] / length])
        for name, value in (('size', size), ('pose', pose), ('twist', np.array(twist))):
            object.__setattr__(self, name, value)

    @property
    def half(self) -> np.ndarray:
        """Half edges of the box that is rounded, shape (3,) [m]."""
        if self.kind == 'box':
            return 0.5 * np.array(self.size)
        if self.kind == 'capsule':
            return np.array([0.0, 0.0, 0.5 * self.size[1]])
        return np.full(3, ENDLESS) if self.kind == 'plane' else np.zeros(3)

    @property
    def radius(self) -> float:
        """How far the box is rounded [m]."""
        return self.size[0] if self.kind in ('sphere', 'capsule') else 0.0

    @property
    def centre(self) -> np.ndarray:
        """Pose of the box that is rounded."""
        below = np.array([0.0, 0.0, -ENDLESS, 1.0, 0.0, 0.0, 0.0])
        return compose(self.pose, below) if self.kind == 'plane' else self.pose

    def at(self, pose: np.ndarray, twist: np.ndarray | None = None, carried: bool = False
           ) -> Volume:
        """Return it elsewhere."""
        return replace(self, pose=pose, twist=np.zeros(6) if twist is None else twist,
                       carried=carried)

    @property
    def capsules(self) -> np.ndarray:
        """
        Capsules that hold the volume, in the frame of its pose: ends of the axis, radius.

        A flat box is held by several beside each other. Shape (m, 7) [m].
        """
        half, radius = self.half, self.radius
        thin, wide, long = np.argsort(half, kind='stable')
        strips = int(np.clip(np.ceil(half[wide] / max(half[thin], 1e-6)), 1, STRIPS)
                     if half[wide] > 0.0 else 1)
        rows = np.zeros((strips, 7))
        rows[:, wide] = rows[:, 3 + wide] = half[wide] * (
            (2.0 * np.arange(strips) + 1.0) / strips - 1.0)
        across = float(np.hypot(half[thin], half[wide] / strips))
        # Short ones are a sphere around the corners.
        ball = half[long] < 1.5 * across
        if not ball:
            rows[:, long], rows[:, 3 + long] = -half[long], half[long]
        rows[:, 6] = radius + (float(np.hypot(across, half[long])) if ball else across)
        for row in rows:
            for end in (row[:3], row[3:6]):
                rotate(self.pose[3:], end, end)
                end += self.pose[:3]
        return rows

    def packed(self, margin: float, links: dict[str, int]) -> np.ndarray:
        """
        Numbers for kernels, shape (`VOLUME_SIZE`,).

        :param margin: of the scene [m]
        :param links: the bits of the links of the arm
        :raises DataError: if it allows a link that the arm does not have
        """
        unknown = sorted(set(self.allowed) - set(links))
        if unknown and links:
            raise DataError(f'volume {self.name!r}: allowed: the arm has no link {unknown[0]!r}; '
                            f'it has {", ".join(links)}')
        bits = 0
        for name in self.allowed:
            bits |= links.get(name, 0)
        return np.array([*self.half, self.radius, *self.centre, *self._twist_of_centre(),
                         margin if self.margin is None else self.margin, float(bits), 1.0])

    def _twist_of_centre(self) -> np.ndarray:
        lever = self.centre[:3] - self.pose[:3]
        return np.concatenate([self.twist[:3] + np.cross(self.twist[3:], lever), self.twist[3:]])

