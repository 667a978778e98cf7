"""Several takes of one demonstration: how alike they are, which one is not, and dropping it."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp import Demonstration
from gdmp_ros.errors import DataError
from gdmp_ros.data.recordings import Recording
from gdmp_ros.manifolds import UnitQuaternion

#: Takes are compared at so many equal parts of their paths.
PLACES = 100
#: A take this many times further from the others than is usual among them differs …
DIFFERS = 2.5
#: … if that is also more than this [m, rad].
LEAST_M, LEAST_RAD = 0.01, 0.1
#: A take so many times longer or shorter than usual differs, too.
TEMPO = 2.0
DROPPED = 'dropped'


class Take(NamedTuple):
    """
    One take beside the others.

    :ivar duration: [s]
    :ivar length: of its path [m]
    :ivar away: RMS distance from the mean of the other takes, along the path [m]
    :ivar turned: the same for the rotation [rad]
    :ivar differs: how it differs from the others, empty where it does not
    """

    name: str
    duration: float
    length: float
    away: float
    turned: float
    differs: str


def compare(recordings: Sequence[Recording]) -> list[Take]:
    """Compare takes place by place along their paths: their timing may differ."""
    paths = [_places(one.demonstration) for one in recordings]
    away, turned = (np.array(column) for column in zip(*(
        _apart(own, paths[:i] + paths[i + 1:]) for i, own in enumerate(paths))))
    usual = [_usual(paths[:i] + paths[i + 1:]) for i in range(len(paths))]
    durations = np.array([one.demonstration.duration for one in recordings])
    result = []
    for i, one in enumerate(recordings):
        words = [word for word in (
            _unlike('path', away[i], usual[i][0], LEAST_M, 'm'),
            _unlike('rotation', turned[i], usual[i][1], LEAST_RAD, 'rad'),
            _tempo(durations, i)) if word]
        positions = one.demonstration.points[:, :3]
        length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
        result.append(Take(Path(one.bag).name, one.demonstration.duration, length,
                           float(away[i]), float(turned[i]), '; '.join(words)))
    return result


def _places(demonstration: Demonstration) -> np.ndarray:
    """Poses at equal parts of the path, shape ``(PLACES, 7)``."""
    steps = np.linalg.norm(np.diff(demonstration.points[:, :3], axis=0), axis=1)
    passed = np.concatenate([[0.0], np.cumsum(steps)])
    # Where it stands still the path has no parts: time tells them apart.
    passed += 1e-9 * demonstration.times
    at = np.interp(np.linspace(0.0, passed[-1], PLACES), passed, demonstration.times)
    return demonstration.at(at)[:, :7]


def _usual(paths: list[np.ndarray]) -> tuple[float, float]:
    """How far apart paths are among themselves [m, rad]; infinite if there are not two."""
    if len(paths) < 2:
        return np.inf, np.inf
    figures = [_apart(own, paths[:i] + paths[i + 1:]) for i, own in enumerate(paths)]
    away, turned = np.median(figures, axis=0)
    return float(away), float(turned)


def _apart(own: np.ndarray, others: list[np.ndarray]) -> tuple[float, float]:
    """RMS distance of a path from the mean of others [m, rad]; 0 where there are none."""
    if not others:
        return 0.0, 0.0
    manifold = UnitQuaternion()
    away = own[:, :3] - np.mean([path[:, :3] for path in others], axis=0)
    turns = [2.0 * manifold.distance(own[k, 3:], manifold.mean([
        manifold.align(path[k, 3:], own[k, 3:]) for path in others])) for k in range(PLACES)]
    return (float(np.sqrt((away ** 2).sum(axis=1).mean())),
            float(np.sqrt(np.mean(np.square(turns)))))


def _unlike(what: str, value: float, usual: float, least: float, unit: str) -> str:
    if value <= max(least, DIFFERS * usual):
        return ''
    return f'{what} is {value:.3g} {unit} from the others, which are {usual:.3g} {unit} apart'


def _tempo(durations: np.ndarray, which: int) -> str:
    if len(durations) < 3:
        return ''
    usual = float(np.median(np.delete(durations, which)))
    if usual / TEMPO <= durations[which] <= usual * TEMPO:
        return ''
    return f'takes {durations[which]:.1f} s, the others {usual:.1f} s'


def folder_of(takes: Path) -> list[Path]:
    """
    All takes in a folder, in order.

    :raises DataError: if there are none
    """
    found = sorted(path.parent for path in takes.glob('*/metadata.yaml'))
    if not found:
        raise DataError(f'{takes}: neither a rosbag2 folder nor a folder of them')
    return found


def drop(takes: Path, name: str) -> Path:
    """
    Put a take aside: to the folder ``dropped`` beside the others, where it is not learned from.

    :returns: where it is now
    :raises DataError: if there is no such take
    """
    bag, aside = takes / name, takes / DROPPED
    if not (bag / 'metadata.yaml').exists():
        have = ', '.join(path.name for path in folder_of(takes))
        raise DataError(f'{bag}: no such take; there are {have}')
    target, number = aside / name, 1
    while target.exists():
        number += 1
        target = aside / f'{name}_{number}'
    try:
        aside.mkdir(exist_ok=True)
        bag.rename(target)
    except OSError as error:
        raise DataError(f'{bag}: cannot be put aside: {error.strerror}') from None
    return target
