"""
Demonstrations in files of other programs, one after the other.

A file or a LeRobot data set may have several episodes: ``data.hdf5#2`` is its third one.
"""
from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
import re
from typing import Any

import numpy as np

from gdmp_ros.data import foreign, lerobot, robomimic, tables
from gdmp_ros.data.columns import Import, MARKS
from gdmp_ros.data.foreign import Imported
from gdmp_ros.errors import DataError

#: What separates a file from the number of its episode.
MARK = '#'
#: Numbers of the pose of an object.
PARTS = ('x', 'y', 'z', 'qw', 'qx', 'qy', 'qz')


def is_foreign(source: Path) -> bool:
    """Whether a source is one of another program, and no recording."""
    path, _ = _parts(source)
    return path.suffix.lower() in tables.SUFFIXES or (path.is_dir() and lerobot.is_dataset(path))


def sources(path: Path) -> list[Path]:
    """
    All episodes of a file or data set, as sources.

    :raises DataError: if it cannot be read
    """
    path, number = _parts(path)
    count = len(_episodes(path, _stamp(path)))
    if number is not None or count == 1:
        return [path if number is None else Path(f'{path}{MARK}{number}')]
    return [Path(f'{path}{MARK}{i}') for i in range(count)]


def read(source: Path, settings: Import | None = None) -> Imported:
    """
    Read an episode.

    :raises DataError: naming the file and what is missing in it
    """
    return foreign.demonstration(str(source), _arrays(source), settings or Import())


def read_joints(source: Path, settings: Import | None = None, group: str = '') -> Imported:
    """
    Read the joints of an episode.

    :param group: beginning of their names, such as the feature ``action`` of a LeRobot data set:
        all of it, the gripper too
    :raises DataError: naming the file and what is missing in it
    """
    arrays, settings = _arrays(source), settings or Import()
    if group:
        names = [name for name in arrays if name.startswith(f'{group}.')]
        if not names and group not in arrays:
            raise DataError(f'{source}: no array {group}, and none whose name begins with '
                            f'{group}.; there are {", ".join(arrays)}')
        settings = replace(settings, keys={**settings.keys, 'joints': ','.join(names or [group])})
    result = foreign.joint_demonstration(str(source), arrays, settings)
    return replace(result, joints=tuple(name.removeprefix(f'{group}.') for name in result.joints))


def described(source: Path) -> dict[str, Any]:
    """What a LeRobot data set says of its robot and its frames per second; else nothing."""
    path, _ = _parts(source)
    return lerobot.described(path) if path.is_dir() and lerobot.is_dataset(path) else {}


def read_object(source: Path, column: str, settings: Import | None = None) -> Imported:
    """
    Read the poses of an object in an episode.

    :param column: array of seven numbers a sample, or beginning of the names of seven columns that
        end in x, y, z, qw, qx, qy, qz
    :raises DataError: if there are none
    """
    arrays, settings = _arrays(source), settings or Import()
    keys = {role: name for role, name in settings.keys.items() if role == 'times'}
    for mark in MARKS:
        names = [f'{column}{mark}{part}' for part in PARTS]
        if all(name in arrays for name in names):
            keys['position'], keys['orientation'] = ','.join(names[:3]), ','.join(names[3:])
    if column in arrays:
        keys['points'] = column
    elif 'position' not in keys:
        raise DataError(f'{source}: no array {column}, and no columns {column}.x to {column}.qz; '
                        f'there are {", ".join(arrays)}')
    return foreign.demonstration(str(source), arrays, replace(settings, keys=keys, objects=()))


def _arrays(source: Path) -> dict[str, np.ndarray]:
    path, number = _parts(source)
    result = _episodes(path, _stamp(path))
    if not 0 <= (number or 0) < len(result):
        raise DataError(f'{path}: there is no episode {number}, it has {len(result)}')
    return dict(result[number or 0])


def _parts(source: Path) -> tuple[Path, int | None]:
    """File and number of the episode."""
    name, mark, number = str(source).rpartition(MARK)
    if mark and number.isdigit() and not source.exists():
        return Path(name), int(number)
    return source, None


def _stamp(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        raise DataError(f'{path}: no such file') from None


@lru_cache(maxsize=2)
def _episodes(path: Path, _: int) -> list[dict]:
    """Arrays of every episode; all are in the same file, so it is read once."""
    if path.is_dir():
        return lerobot.episodes(path)
    arrays = tables.read_arrays(path)
    rate = robomimic.control_rate(path) if path.suffix.lower() in tables.HDF5 else None
    return robomimic.episodes(arrays, rate) or _grouped(arrays) or [arrays]


def _grouped(arrays: dict[str, np.ndarray]) -> list[dict[str, np.ndarray]]:
    """Episodes of a file with a numbered group for each; empty if it has none."""
    result: dict[int, dict[str, np.ndarray]] = {}
    for name, array in arrays.items():
        group, _, rest = name.partition('/')
        number = re.search('[0-9]+$', group)
        if number is not None and rest:
            result.setdefault(int(number.group()), {})[rest] = array
    return [result[number] for number in sorted(result)]
