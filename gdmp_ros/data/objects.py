"""Poses of objects (task frames) in recordings, from the transforms of a bag."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import warnings

import numpy as np

from gdmp_ros.data import bags
from gdmp_ros.data.recordings import Recording
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.frames import BASE
from gdmp_ros.errors import DataError, GdmpWarning
from gdmp_ros.manifolds.quaternion import rotation_angles

#: A frame that was not declared moving stands still within these [m, rad].
STANDS = 0.005, 0.03
#: Longest time without the transforms of a frame that moves [s].
LOST_S = 0.5


def with_objects(recordings: Sequence[Recording], demonstrations: Sequence[Demonstration],
                 names: Sequence[str], moving: Sequence[str] = ()) -> list[Demonstration]:
    """
    The same demonstrations with task frames from ``/tf`` and ``/tf_static`` of their bags.

    :param names: of the frames
    :param moving: those of them that may move; the others stand still
    :raises DataError: if a bag does not have one, or one that moves was lost
    """
    for name in moving:
        if name not in names:
            raise DataError(f'frame {name!r} is declared moving, expected one of '
                            f'{", ".join(names)}')
    return [replace(same, frames={name: _poses(recording, same, name, name in moving)
                                  for name in names if name != BASE})
            for recording, same in zip(recordings, demonstrations)]


def _poses(recording: Recording, demonstration: Demonstration, name: str, moving: bool
           ) -> np.ndarray:
    """Pose of a frame while a demonstration was shown, or its poses at the samples."""
    if not recording.frame:
        raise DataError(f'{recording.bag}: the poses have no frame_id, so it is not known where '
                        f'{name} is')
    with bags.opened(recording.bag) as reader:
        series = bags.transforms_in(reader, recording.bag, name, recording.frame)
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


def _at(series: bags.Series, stamps: np.ndarray, name: str) -> np.ndarray:
    known = series.stamps[(series.stamps > stamps[0]) & (series.stamps < stamps[-1])]
    gaps = np.diff(np.concatenate([stamps[:1], known, stamps[-1:]]))
    if gaps.max() > LOST_S * bags.NS:
        at = int(np.argmax(gaps))
        time = (np.concatenate([stamps[:1], known])[at] - stamps[0]) / bags.NS
        raise DataError(f'{series.bag}: {name} was lost for {gaps[at] / bags.NS:.2f} s at '
                        f't = {time:.3f} s, longer than {LOST_S:g} s')
    return bags.transforms_at(series.stamps, series.values, stamps)
