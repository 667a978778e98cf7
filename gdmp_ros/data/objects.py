"""Poses of objects (task frames) in recordings: from transforms, topics, or a table."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import warnings

import numpy as np

from gdmp_ros.data import bags, episodes
from gdmp_ros.data.columns import Import
from gdmp_ros.data.episodes import PARTS
from gdmp_ros.data.recordings import Recording
from gdmp_ros.data.takes import read_numbers
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.frames import BASE
from gdmp_ros.errors import DataError, GdmpWarning
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import rotation_angles

#: A frame that was not declared moving stands still within these [m, rad].
STANDS = 0.005, 0.03
#: Longest time without the transforms of a frame that moves [s].
LOST_S = 0.5


def with_objects(recordings: Sequence[Recording], demonstrations: Sequence[Demonstration],
                 names: Sequence[str], moving: Sequence[str] = (), table: Path | None = None,
                 reading: Import | None = None) -> list[Demonstration]:
    """
    The same demonstrations with the poses of objects as task frames.

    :param names: of the frames, in ``/tf`` and ``/tf_static`` of the bags, or in columns of files
        of other programs; ``NAME=/topic``, or ``NAME=column``, if they are called otherwise
    :param moving: those of them that may move; the others stand still
    :param table: file with more of them, which stand still (`read_poses`)
    :param reading: what is said about files of other programs
    :raises DataError: if a bag or the table does not have one, or one that moves was lost
    """
    topics = {name.partition('=')[0]: name.partition('=')[2] for name in names}
    for name in moving:
        if name not in topics:
            raise DataError(f'frame {name!r} is declared moving, expected one of '
                            f'{", ".join(topics)}')
    given = ([{} for _ in recordings] if table is None else
             read_poses(table, [Path(recording.bag).name for recording in recordings]))
    for name in topics:
        if any(name in poses for poses in given):
            raise DataError(f'{table}: frame {name!r} is named twice, with --frames and here')
    return [replace(same, frames={**poses, **{
        name: _poses(recording, same, name, name in moving, _series(recording, name, topic,
                                                                     reading))
        for name, topic in topics.items() if name != BASE}})
            for recording, same, poses in zip(recordings, demonstrations, given)]


def read_poses(path: Path, takes: Sequence[str]) -> list[dict[str, np.ndarray]]:
    """
    Poses of objects in each take, from a table.

    The columns are ``take`` and, of each object, ``NAME.x`` to ``NAME.qz``.

    :param takes: names of the bags
    :raises DataError: if it is no such table, or a column is missing
    """
    numbers = read_numbers(path, takes)
    names = list(dict.fromkeys(column.rpartition('.')[0] for column in numbers))
    for column in (f'{name}.{part}' for name in names for part in PARTS):
        if column not in numbers:
            raise DataError(f'{path}: no column {column}; an object has {", ".join(PARTS)}')
    if len(numbers) != len(names) * len(PARTS):
        raise DataError(f'{path}: the columns are {", ".join(numbers)}, expected '
                        f'NAME.{", NAME.".join(PARTS)} of each object')
    return [{name: np.array([numbers[f'{name}.{part}'][i] for part in PARTS])
             for name in names} for i in range(len(takes))]


def _series(recording: Recording, name: str, called: str, reading: Import | None) -> bags.Series:
    """
    Poses of a frame in a recording, in the frame of its poses.

    :param called: topic, or columns; empty if they are called as the frame
    """
    bag = recording.bag
    if episodes.is_foreign(Path(bag)):
        shown = episodes.read_object(Path(bag), called or name, reading).demonstration
        return bags.Series(bag, name, np.round(shown.times * bags.NS).astype(np.int64),
                           shown.flat_points[:, :7], recording.frame)
    if not recording.frame:
        raise DataError(f'{bag}: the poses have no frame_id, so it is not known where {name} is')
    with bags.opened(bag) as reader:
        if not called:
            return bags.transforms_in(reader, bag, name, recording.frame)
        series = bags.series_in(reader, bag, called, bags.POSE)
        if series.frame == recording.frame:
            return series
        return _in_base(series, bags.transforms_in(reader, bag, series.frame, recording.frame))


def _poses(recording: Recording, demonstration: Demonstration, name: str, moving: bool,
           series: bags.Series) -> np.ndarray:
    """Pose of a frame while a demonstration was shown, or its poses at the samples."""
    stamps = recording.begins + np.round(demonstration.times * bags.NS).astype(np.int64)
    if moving:
        return _at(series, stamps, name)
    during = (series.stamps >= stamps[0]) & (series.stamps <= stamps[-1])
    # One that was published before only, as static ones are, is known from then on.
    known = series.values[during] if during.any() else series.values[
        [max(int(np.searchsorted(series.stamps, stamps[0], side='right')) - 1, 0)]]
    moved = (float(np.linalg.norm(known[:, :3] - known[0, :3], axis=1).max()),
             float(rotation_angles(known[:, 3:], np.broadcast_to(
                 known[0, 3:], known[:, 3:].shape).copy()).max()))
    if moved[0] > STANDS[0] or moved[1] > STANDS[1]:
        warnings.warn(f'{recording.bag}: {name} moved by {1e3 * moved[0]:.0f} mm and '
                      f'{moved[1]:.2f} rad while it was shown; its first pose is used, as it was '
                      'not declared moving', GdmpWarning, stacklevel=4)
        return np.asarray(known[0])
    middle = np.array(known[len(known) // 2])
    middle[:3] = np.median(known[:, :3], axis=0)
    return middle


def _in_base(series: bags.Series, place: bags.Series) -> bags.Series:
    """Poses in a frame, in the one in which that frame is at a place."""
    outer = bags.transforms_at(place.stamps, place.values, series.stamps)
    return series._replace(values=np.array([
        compose(one, pose) for one, pose in zip(outer, series.values)]), frame=place.frame)


def _at(series: bags.Series, stamps: np.ndarray, name: str) -> np.ndarray:
    known = series.stamps[(series.stamps > stamps[0]) & (series.stamps < stamps[-1])]
    gaps = np.diff(np.concatenate([stamps[:1], known, stamps[-1:]]))
    if gaps.max() > LOST_S * bags.NS:
        at = int(np.argmax(gaps))
        time = (np.concatenate([stamps[:1], known])[at] - stamps[0]) / bags.NS
        raise DataError(f'{series.bag}: {name} was lost for {gaps[at] / bags.NS:.2f} s at '
                        f't = {time:.3f} s, longer than {LOST_S:g} s')
    return bags.transforms_at(series.stamps, series.values, stamps)
