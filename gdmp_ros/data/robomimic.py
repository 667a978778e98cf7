"""Data sets of robomimic: episodes in one HDF5 file. No images."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
import math
from pathlib import Path

import numpy as np

from gdmp_ros.data.foreign import frames, next_of, stiffness_size_of
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import

GROUP = 'data'
POSITION, ORIENTATION, STIFFNESS = 'robot0_eef_pos', 'robot0_eef_quat', 'stiffness'
#: Orientation of the frame that the position belongs to, in newer data sets of robosuite: there
#: `ORIENTATION` is that of the last body, turned against it.
SITE_ORIENTATION = 'robot0_eef_quat_site'
TIMES = 'timestamps'
#: Name of times that follow from the control rate.
COUNTED = 'time, counted at control_freq [s]'


def control_rate(path: Path) -> float | None:
    """Rate at which the environment of a data set was controlled [Hz]; None if it is not told."""
    with optional_import(extra('datasets')):
        import h5py
    with h5py.File(path, 'r') as file:
        given = file[GROUP].attrs.get('env_args', '{}') if GROUP in file else '{}'
    try:
        rate = float(json.loads(given)['env_kwargs']['control_freq'])
    except (KeyError, TypeError, ValueError):
        return None
    return rate if 0.0 < rate < math.inf else None


def episodes(arrays: Mapping[str, np.ndarray], rate_hz: float | None = None
             ) -> list[dict[str, np.ndarray]]:
    """
    Arrays of each episode, without the way to it; empty if these are not episodes.

    :param arrays: of an HDF5 file, such as ``data/demo_0/actions``
    :param rate_hz: see `control_rate`; robomimic itself writes no times
    """
    result: dict[str, dict[str, np.ndarray]] = {}
    for name, array in arrays.items():
        group, _, rest = name.removeprefix(f'{GROUP}/').partition('/')
        if name.startswith(f'{GROUP}/') and rest:
            result.setdefault(group, {})[rest] = array
    order = sorted(result, key=lambda group: (len(group), group))
    for episode in result.values():
        if f'obs/{SITE_ORIENTATION}' in episode:
            episode.pop(f'obs/{ORIENTATION}', None)
        # robosuite writes all of them so.
        for name in [name for name in episode if name.startswith('obs/') and '_quat' in name]:
            episode[f'{name} (xyzw)'] = episode.pop(name)
        if TIMES in episode:
            episode[f'{TIMES} [s]'] = episode.pop(TIMES)
        if rate_hz is not None and f'{TIMES} [s]' not in episode and 'actions' in episode:
            episode[COUNTED] = np.arange(len(episode['actions'])) / rate_hz
    return [result[group] for group in order]


def write(path: Path, demos: Sequence[Demonstration], rate_hz: float) -> None:
    """
    Write demonstrations of a tool as episodes.

    Observations are position and orientation (x, y, z, w), as robosuite calls them, and a
    stiffness; the action has the same numbers of the next frame: a pose, not a difference.

    :raises DataError: if they are no poses, or the file cannot be written
    """
    with optional_import(extra('datasets')):
        import h5py
    if not demos:
        raise DataError(f'{path}: there is nothing to write')
    for demo in demos:
        stiffness_size_of(demo, path)
    partial = path.with_name(f'.{path.name}.partial')
    try:
        with h5py.File(partial, 'w') as file:
            data = file.create_group(GROUP)
            total = 0
            for number, item in enumerate(demos):
                total += _write_episode(data.create_group(f'demo_{number}'), item, rate_hz)
            data.attrs['total'] = total
            data.attrs['env_args'] = json.dumps(
                {'env_name': 'gdmp', 'type': 1, 'env_kwargs': {'control_freq': rate_hz}})
        partial.replace(path)
    except OSError as error:
        raise DataError(f'{path}: cannot write: {error.strerror or error}') from None
    finally:
        partial.unlink(missing_ok=True)


def _write_episode(group: object, demo: Demonstration, rate_hz: float) -> int:
    """Write an episode; returns its number of frames."""
    times, rows = frames(demo, rate_hz)
    later, count = next_of(rows), len(rows)
    done = np.zeros(count, dtype=int)
    done[-1] = 1
    actions = later[:, [0, 1, 2, 4, 5, 6, 3, *range(7, later.shape[1])]]
    arrays = {'actions': actions, 'rewards': done.astype(float), 'dones': done, 'states': rows,
              TIMES: times, **_observed('obs', rows), **_observed('next_obs', later)}
    for name, array in arrays.items():
        group.create_dataset(name, data=array)  # type: ignore[attr-defined]
    group.attrs['num_samples'] = count  # type: ignore[attr-defined]
    return count


def _observed(group: str, rows: np.ndarray) -> dict[str, np.ndarray]:
    result = {f'{group}/{POSITION}': rows[:, :3], f'{group}/{ORIENTATION}': rows[:, [4, 5, 6, 3]]}
    if rows.shape[1] > 7:
        result[f'{group}/{STIFFNESS}'] = rows[:, 7:]
    return result
