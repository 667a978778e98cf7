"""The topic ``~/cloud``: clouds of points as boxes around an arm."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from gdmp_ros.data.bags import ns_of
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.manifolds.poses import IDENTITY
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.frames import FrameError, PATIENCE_S
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.middleware import deserialized
from gdmp_ros.ros.parameters import Spec
from gdmp_ros.ros.scene.topics import SceneTopics
from gdmp_ros.scene.points import PointMap
from gdmp_ros.scene.scene import Scene
from gdmp_ros.scene.volume import CAPACITY

#: Most boxes of a cloud.
MOST_BOXES = 24
#: Most cells of the region.
MOST_CELLS = 8_000_000
#: Larger ones are refused [bytes].
MOST_BYTES = 64_000_000
SPECS = (
    Spec('cloud_cell', 0.025, 'edge of the cells into which ~/cloud is sorted', 'm', 0.005, 0.2,
         changes='configure'),
    Spec('cloud_range', 1.2, 'points further from the base than this, along an axis, are left out',
         'm', 0.1, 3.0, changes='configure'),
    Spec('cloud_least_points', 3, 'fewer points in a cell do not count', low=1, high=1000,
         changes='configure'),
    Spec('cloud_padding', 0.02, 'points within this distance of the arm, or of a known volume, '
         'belong to it', 'm', 0.0, 0.2, changes='configure'),
    Spec('cloud_timeout', 1.0, 'a cloud older than this is not used; without a new one for this '
         'time the arm stops', 's', 0.1, 60.0, changes='configure'),
)


def points_of(message: PointCloud2) -> np.ndarray:
    """
    Coordinates of a cloud, shape (n, 3).

    :raises DataError: if it has none
    """
    if message.is_bigendian:
        raise DataError('the numbers are big-endian, expected little-endian')
    offsets = {}
    for field in message.fields:
        if field.name in ('x', 'y', 'z'):
            if field.datatype != PointField.FLOAT32 or field.count != 1:
                raise DataError(f'field {field.name!r}: datatype {field.datatype}, count '
                                f'{field.count}; expected one FLOAT32')
            offsets[field.name] = field.offset
    if len(offsets) != 3:
        raise DataError(f'the fields are {[field.name for field in message.fields]}, expected '
                        'x, y and z')
    rows, columns, step = message.height, message.width, message.point_step
    needed = message.row_step * (rows - 1) + step * columns if rows and columns else 0
    if max(offsets.values()) + 4 > step or message.row_step < step * columns or (
            len(message.data) < needed):
        raise DataError(f'{rows} × {columns} points of {step} bytes, in rows of '
                        f'{message.row_step} bytes, do not fit {len(message.data)} bytes')
    if not needed:
        return np.empty((0, 3))
    kind = np.dtype({'names': list(offsets), 'formats': ['<f4'] * 3,
                     'offsets': list(offsets.values()), 'itemsize': step})
    table = np.ndarray((rows, columns), kind, buffer=memoryview(message.data),
                       strides=(message.row_step, step))
    result = np.empty((rows, columns, 3))
    for at, name in enumerate(('x', 'y', 'z')):
        result[:, :, at] = table[name]
    return result.reshape(-1, 3)


class CloudTopic:
    """Keeps boxes around what a sensor sees."""

    def __init__(self, node: ManagedNode, scene: SceneTopics,
                 place_of: Callable[[Any], np.ndarray | None], parameters: Any,
                 own: Callable[[int], np.ndarray | None], hold: Callable[[str], None],
                 refuse: Callable[[str], None]):
        """
        Subscribe.

        :param scene: that has the boxes too
        :param place_of: see `SceneTopics`, as ``refuse``
        :param parameters: with `SPECS`
        :param own: gives capsules of the arm at a time [ns], in the base; shape (m, 7), of
            `gdmp_ros.scene.volume.Volume.capsules`; None while it is not known where it is
        :param hold: lets the arm make no way, with the reason; it goes on when that is empty
        """
        self._scene, self._place_of, self._own = scene, place_of, own
        self._hold, self._refuse, self._clock = hold, refuse, node.clock
        self._time_ns = node.time_ns
        p = parameters
        count = (2.0 * p.cloud_range / p.cloud_cell) ** 3
        if count > MOST_CELLS:
            raise ParameterError(f'cloud_range {p.cloud_range:g} m and cloud_cell '
                                 f'{p.cloud_cell:g} m make {count:.3g} cells, expected at most '
                                 f'{MOST_CELLS:g}')
        self._padding, self._timeout = p.cloud_padding, p.cloud_timeout
        self._map: PointMap | None = None
        self._new_map = lambda: PointMap(p.cloud_range, p.cloud_cell, p.cloud_least_points)
        self._waiting: tuple[PointCloud2, int] | None = None
        self._last, self._held = 0, ''
        self._input = node.add_sensor(PointCloud2, '~/cloud')
        node.add_report(self.look)

    def look(self) -> None:
        """Use the newest cloud; hold the arm if no cloud has come for too long."""
        now = self._clock.now()
        if self._waiting is None:
            self._take(now)
        if self._waiting is not None:
            self._use(*self._waiting)
        age = (now - self._last) / NS
        old = self._last > 0 and age > self._timeout
        held = f'the last cloud of points is {age:.1f} s old' if old else ''
        if held or self._held:
            self._hold(held)
        self._held = held

    def _take(self, now: int) -> None:
        received = None
        # The newest alone: a flood of clouds costs no more than ten in a second.
        while (newer := self._input.take()) is not None:
            received = newer
        if received is None:
            return
        try:
            if len(received.data) > MOST_BYTES:
                raise DataError(f'{len(received.data)} bytes, expected at most {MOST_BYTES}')
            self._waiting = deserialized(received.data, PointCloud2), now
        except GdmpError as error:
            self._refuse(f'~/cloud: {error}')

    def _use(self, message: PointCloud2, received: int) -> None:
        now = self._clock.now()
        try:
            pose = self._place_of(message.header)
        except FrameError as error:
            if (now - received) / NS > PATIENCE_S:
                self._waiting = None
                self._refuse(f'~/cloud: {error}')
            return
        self._waiting = None
        try:
            old = (self._time_ns() - ns_of(message.header.stamp)) / NS
            if not abs(old) < self._timeout:
                raise DataError(f'its stamp is {old:.3g} s old, expected within '
                                f'{self._timeout:g} s')
            points, own = points_of(message), self._own(ns_of(message.header.stamp))
            if own is None:
                return  # the arm would become its own obstacle
            if self._map is None:
                self._map = self._new_map()
            others = Scene([volume for volume in self._scene.scene
                            if not volume.name.startswith('cloud#')])
            finite = self._map.see(points, IDENTITY if pose is None else pose,
                                   own, others.packed(),
                                   self._padding, pose is not None)
            if not finite:
                raise DataError(f'none of {len(points)} points is finite')
            self._scene.beside('cloud', self._map.volumes(
                max(min(MOST_BOXES, CAPACITY - len(others)), 1)))
        except GdmpError as error:
            self._refuse(f'~/cloud: {error}')
            return
        self._last = now
