"""Several takes of one demonstration: comparing them, outliers, contexts, putting one aside."""
from __future__ import annotations

from collections.abc import Sequence
import csv
import io
import math
from pathlib import Path
from typing import NamedTuple
import warnings

import numpy as np

from gdmp_ros.data import episodes
from gdmp_ros.data.recordings import Recording
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError, GdmpWarning
from gdmp_ros.manifolds.quaternion import rotation_angles, UnitQuaternion
from gdmp_ros.util.files import read_text

#: Takes are compared at this many points, equally spaced along their paths.
SAMPLES = 100
#: A take is an outlier if its distance to the others is this many times the usual distance …
OUTLIER = 2.5
#: … and larger than this [m, rad].
LEAST_M, LEAST_RAD = 0.01, 0.1
#: A take is also an outlier if it is this many times longer or shorter than usual.
TEMPO = 2.0
#: Folder for takes that are not learned from.
DROPPED = 'dropped'
#: Heading of the column with the names of the bags.
TAKE = 'take'
#: Suffixes of tables in a folder of takes.
TABLES = ('.csv', '.txt', '.tsv', '.tum', '.npz')
#: Larger files are refused [bytes].
MAX_BYTES = 10_000_000


class ComparedTake(NamedTuple):
    """
    One take compared with the others.

    :ivar duration: [s]
    :ivar length: of its path [m]
    :ivar distance: RMS distance from the mean of the other takes, along the path [m]
    :ivar angle: RMS angle to the mean orientation of the other takes [rad]
    :ivar outlier: why it is an outlier; empty if it is not
    """

    name: str
    duration: float
    length: float
    distance: float
    angle: float
    outlier: str


def compare(recordings: Sequence[Recording]) -> list[ComparedTake]:
    """Compare takes point by point along their paths: their timing may differ."""
    paths = [_sampled(recording.demonstration) for recording in recordings]
    distances, angles = (np.array(column) for column in zip(*(
        _distance(own, paths[:i] + paths[i + 1:]) for i, own in enumerate(paths))))
    usual = [_usual(paths[:i] + paths[i + 1:]) for i in range(len(paths))]
    durations = np.array([recording.demonstration.duration for recording in recordings])
    result = []
    for i, recording in enumerate(recordings):
        reasons = [reason for reason in (
            _outlier('path', distances[i], usual[i][0], LEAST_M, 'm'),
            _outlier('rotation', angles[i], usual[i][1], LEAST_RAD, 'rad'),
            _tempo(durations, i)) if reason]
        positions = recording.demonstration.points[:, :3]
        length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
        result.append(ComparedTake(
            Path(recording.bag).name, recording.demonstration.duration, length,
            float(distances[i]), float(angles[i]), '; '.join(reasons)))
    return result


def _sampled(demonstration: Demonstration) -> np.ndarray:
    """Poses equally spaced along the path, shape ``(SAMPLES, 7)``."""
    steps = np.linalg.norm(np.diff(demonstration.points[:, :3], axis=0), axis=1)
    passed = np.concatenate([[0.0], np.cumsum(steps)])
    # The small term makes it increase at rest too.
    passed += 1e-9 * demonstration.times
    at = np.interp(np.linspace(0.0, passed[-1], SAMPLES), passed, demonstration.times)
    return demonstration.at(at)[:, :7]


def _usual(paths: list[np.ndarray]) -> tuple[float, float]:
    """Median distance of a path to the others [m, rad]; infinite with fewer than two."""
    if len(paths) < 2:
        return np.inf, np.inf
    figures = [_distance(own, paths[:i] + paths[i + 1:]) for i, own in enumerate(paths)]
    distance, angle = np.median(figures, axis=0)
    return float(distance), float(angle)


def _distance(own: np.ndarray, others: list[np.ndarray]) -> tuple[float, float]:
    """RMS distance of a path from the mean of others [m, rad]; 0 if there are none."""
    if not others:
        return 0.0, 0.0
    manifold = UnitQuaternion()
    offset = own[:, :3] - np.mean([path[:, :3] for path in others], axis=0)
    means = np.array([manifold.mean([manifold.align(path[k, 3:], own[k, 3:]) for path in others])
                      for k in range(SAMPLES)])
    angles = rotation_angles(own[:, 3:], means)
    return (float(np.sqrt((offset ** 2).sum(axis=1).mean())),
            float(np.sqrt(np.mean(np.square(angles)))))


def _outlier(what: str, value: float, usual: float, least: float, unit: str) -> str:
    if value <= max(least, OUTLIER * usual):
        return ''
    return f'{what} is {value:.3g} {unit} from the others, usual is {usual:.3g} {unit}'


def _tempo(durations: np.ndarray, which: int) -> str:
    if len(durations) < 3:
        return ''
    # With the take itself: among three, one that is long would make the other two outliers.
    usual = float(np.median(durations))
    if usual / TEMPO <= durations[which] <= usual * TEMPO:
        return ''
    return f'lasts {durations[which]:.1f} s, usual is {usual:.1f} s'


def takes_in(takes: Path) -> list[Path]:
    """
    Bags of all takes in a folder, in order.

    :raises DataError: if there are none
    """
    result = sorted(path.parent for path in takes.glob('*/metadata.yaml'))
    if not result:
        raise DataError(f'{takes}: neither a rosbag2 folder nor a folder of them')
    return result


def next_name(takes: Path, prefix: str = 'take') -> str:
    """Name of the next take in a folder: ``PREFIX_001``, and so on."""
    start = f'{prefix}_'
    used = [int(path.name[len(start):]) for path in takes.glob(f'{start}*')
            if path.name[len(start):].isdigit()]
    return f'{start}{max(used, default=0) + 1:03d}'


def bags_in(path: Path) -> list[Path]:
    """
    Bag at a path, all bags or tables in a folder, or all episodes of a file.

    :raises DataError: if a folder has none
    """
    if episodes.is_foreign(path):
        return episodes.sources(path)
    if path.name == DROPPED and path.is_dir():
        warnings.warn(f'{path}: takes that were dropped are left out', GdmpWarning, stacklevel=2)
        return []
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return [path]
    if any(path.glob('*/metadata.yaml')):
        return takes_in(path)
    files = sorted(item for item in path.iterdir() if item.suffix == '.mcap'
                   or item.suffix in TABLES)
    if len(files) == 1 and files[0].suffix == '.mcap':
        return [path]  # of a recorder that was killed
    return [source for file in files for source in (
        episodes.sources(file) if episodes.is_foreign(file) else [file])] or takes_in(path)


def drop(takes: Path, name: str) -> Path:
    """
    Move a take to the folder ``dropped`` beside the others, from which nothing is learned.

    :returns: its new path
    :raises DataError: if there is no such take
    """
    bag, aside = takes / name, takes / DROPPED
    if not (bag / 'metadata.yaml').exists():
        have = ', '.join(path.name for path in takes_in(takes))
        raise DataError(f'{bag}: no such take; there are {have}')
    target, number = aside / name, 1
    while target.exists():
        number += 1
        target = aside / f'{name}_{number}'
    try:
        aside.mkdir(exist_ok=True)
        bag.rename(target)
    except OSError as error:
        raise DataError(f'{bag}: cannot be moved: {error.strerror}') from None
    return target


def read_numbers(path: Path, takes: Sequence[str]) -> dict[str, list[float]]:
    """
    Read the numbers of takes.

    The first line has the headings: ``take`` and the name of each number.

    :param takes: names of the bags
    :returns: for each name the numbers, in the order of ``takes``
    :raises DataError: if a take is missing or occurs twice, or an entry is no number
    """
    try:
        rows = csv.reader(io.StringIO(read_text(path, 'table of takes', MAX_BYTES)))
        lines = [(rows.line_num, [entry.strip() for entry in row]) for row in rows if any(row)]
    except csv.Error as error:
        raise DataError(f'{path}: not a CSV file: {error}') from None
    heads = lines[0][1] if lines else []
    if TAKE not in heads or len(heads) < 2 or len(set(heads)) < len(heads) or not all(heads):
        raise DataError(f'{path}: the first line is {",".join(heads)!r}, expected {TAKE!r} and '
                        'different names of numbers')
    at, result = heads.index(TAKE), {}
    for number, row in lines[1:]:
        where = f'{path}, line {number}'
        if len(row) != len(heads):
            raise DataError(f'{where}: {len(row)} entries, expected {len(heads)}')
        if row[at] in result:
            raise DataError(f'{where}: {row[at]!r} occurs twice')
        result[row[at]] = [_number(entry, f'{where}, {head}')
                           for head, entry in zip(heads, row) if head != TAKE]
    missing = [take for take in takes if take not in result]
    if missing:
        raise DataError(f'{path}: no line for {", ".join(missing)}')
    names = [head for head in heads if head != TAKE]
    return {name: [result[take][i] for take in takes] for i, name in enumerate(names)}


def _number(entry: str, where: str) -> float:
    try:
        value = float(entry)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(f'{where}: {entry!r} is not a finite number')
    return value
