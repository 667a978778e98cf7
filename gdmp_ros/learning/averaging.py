"""Averages of neighbouring samples, so that many samples cost no more time than few."""
from __future__ import annotations

from typing import NamedTuple

from gdmp_ros.dmp.demonstration import Demonstration

#: Demonstrations with more samples are averaged to at least this many.
SAMPLES = 1000


class Samples(NamedTuple):
    """
    A demonstration with few samples.

    :ivar progress: of the first and the last sample, and their number
    """

    demonstration: Demonstration
    progress: tuple[float, float, int]


def averaged(demonstration: Demonstration) -> Samples:
    """Average neighbouring samples, so that many samples cost no more time than few."""
    count = len(demonstration.times)
    size = count // SAMPLES
    if size < 2:
        return Samples(demonstration, (0.0, 1.0, count))
    manifold, groups = demonstration.manifold, count // size
    points = demonstration.points[:groups * size].reshape(groups, size, *manifold.point_shape)
    middles = points[:, size // 2]
    tangents, _ = manifold.log_anyway(middles[:, None], points)
    averages = manifold.exp(middles, tangents.mean(axis=1))
    times = demonstration.times[:groups * size].reshape(groups, size).mean(axis=1)
    progress = (times - demonstration.times[0]) / demonstration.duration
    return Samples(Demonstration(times, averages, manifold),
                   (float(progress[0]), float(progress[-1]), groups))
