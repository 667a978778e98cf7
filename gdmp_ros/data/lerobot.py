"""LeRobot data sets, versions 2 and 3: episodes in Parquet files, described in JSON. No images."""
from __future__ import annotations

from collections.abc import Sequence
import json
from pathlib import Path
import shutil
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.data.foreign import columns, frames, next_of, stiffness_size_of
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import

VERSION = 'v3.0'
#: Versions that are read: the frames tell their episode themselves.
READABLE = ('v2.0', 'v2.1', VERSION)
DATA = 'data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet'
EPISODES = 'meta/episodes/chunk-000/file-000.parquet'
STATE, ACTION = 'observation.state', 'action'
_INFO, _STATS, _TASKS = 'meta/info.json', 'meta/stats.json', 'meta/tasks.parquet'
_INDICES = ('frame_index', 'episode_index', 'index', 'task_index')
_QUANTILES = {'q01': 0.01, 'q10': 0.10, 'q50': 0.50, 'q90': 0.90, 'q99': 0.99}


class Joints(NamedTuple):
    """
    What the numbers of demonstrations of joints are called in a data set.

    :ivar names: of the joints
    :ivar unit: of the numbers in the data set [rad]
    """

    names: Sequence[str]
    unit: float = 1.0


def is_dataset(folder: Path) -> bool:
    """Whether a folder has the description of a LeRobot data set."""
    return (folder / _INFO).is_file()


def episodes(folder: Path) -> list[dict[str, np.ndarray]]:
    """
    Numbers of every episode by name: ``timestamp [s]``, and the features.

    A feature whose parts have names, such as ``observation.state``, becomes one array for each
    part, such as ``observation.state.x``.

    :raises DataError: naming the file and what is wrong with it
    """
    with optional_import(extra('datasets')):
        import pyarrow.parquet as pq
    info = _info(folder)
    paths = sorted((folder / 'data').glob('*/*.parquet'))
    if not paths:
        raise DataError(f'{folder}: no files in data/')
    demos = {name: part for name, part in info['features'].items()
             if part.get('dtype') not in ('image', 'video', 'string') and name not in _INDICES}
    result: dict[int, dict[str, list[np.ndarray]]] = {}
    for path in paths:
        try:
            table = pq.read_table(path, columns=[*demos, 'episode_index'])
            numbers = {name: np.array(table[name].to_pylist(), dtype=float) for name in demos}
            owner = np.asarray(table['episode_index']).astype(int)
        except Exception as error:  # Arrow passes on errors of many kinds
            raise DataError(f'{path}: damaged ({type(error).__name__}: {error})') from None
        for episode in np.unique(owner):
            parts = result.setdefault(int(episode), {})
            for name, rows in numbers.items():
                parts.setdefault(name, []).append(rows[owner == episode])
    return [_named(demos, {name: np.concatenate(rows) for name, rows in result[episode].items()})
            for episode in sorted(result)]


def described(folder: Path) -> dict[str, Any]:
    """
    Type of the robot, and frames per second, as far as a data set says them.

    :raises DataError: naming the file and what is wrong with it
    """
    info = _info(folder)
    return {name: info[name] for name, kind in (('robot_type', str), ('fps', int))
            if isinstance(info.get(name), kind)}


def _info(folder: Path) -> dict[str, Any]:
    path = folder / _INFO
    try:
        info = json.loads(path.read_text())
        version = info['codebase_version']
        if not all(isinstance(part, dict) for part in info['features'].values()):
            raise ValueError('a feature is no table')
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(f'{path}: damaged ({type(error).__name__}: {error})') from None
    if version not in READABLE:
        raise DataError(f'{path}: version {version}, expected {", ".join(READABLE)}: convert it '
                        "with LeRobot's own script for older versions")
    return dict(info)


def _named(features: dict[str, Any], rows: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays of features, and of their parts with names."""
    result = {f'{name} [s]' if name == 'timestamp' else name: array
              for name, array in rows.items()}
    for name, array in rows.items():
        names = features[name].get('names')
        if isinstance(names, dict):  # older files: {'motors': [...]}
            names = next(iter(names.values()), None)
        if isinstance(names, list) and array.ndim == 2 and len(names) == array.shape[1]:
            del result[name]
            result.update({f'{name}.{part}': array[:, i] for i, part in enumerate(names)})
    return result


def write(folder: Path, demos: Sequence[Demonstration], rate_hz: float, task: str,
          robot: str = 'panda', joints: Joints | None = None) -> None:
    """
    Write demonstrations of a tool, or of joints, as episodes.

    The state is the pose (and the stiffness), or the joints, at each frame; the action is that of
    the next frame, which is what a controller gets as its reference. Numbers are float32, as
    policies expect.

    :param rate_hz: frames per second; demonstrations are resampled
    :param task: what is done, in words
    :param robot: its type
    :param joints: that the demonstrations are of; None for a tool
    :raises DataError: unless they are poses with the same stiffness, or these joints; or the
        folder exists
    """
    with optional_import(extra('datasets')):
        import pyarrow as pa
        import pyarrow.parquet as pq
    if folder.exists():
        raise DataError(f'{folder}: exists already')
    if rate_hz != round(rate_hz):
        raise DataError(f'{rate_hz:g} frames per second: expected a whole number')
    names = _names_of(folder, demos, joints)
    unit = 1.0 if joints is None else joints.unit
    rows = [frames(demo, rate_hz)[1] / unit for demo in demos]
    features = {STATE: _feature('float32', len(names), names),
                ACTION: _feature('float32', len(names), names),
                'timestamp': _feature('float32'),
                **{name: _feature('int64') for name in _INDICES}}
    numbers = [_columns(row, episode, rate_hz, sum(map(len, rows[:episode])))
               for episode, row in enumerate(rows)]
    partial = folder.with_name(f'.{folder.name}.partial')
    shutil.rmtree(partial, ignore_errors=True)
    try:
        for path in (DATA.format(chunk_index=0, file_index=0), EPISODES):
            (partial / path).parent.mkdir(parents=True, exist_ok=True)
        full = {name: np.concatenate([number[name] for number in numbers]) for name in numbers[0]}
        pq.write_table(_table(pa, features, full),
                       partial / DATA.format(chunk_index=0, file_index=0))
        pq.write_table(_episode_table(pa, numbers, task), partial / EPISODES)
        pq.write_table(_task_table(pa, task), partial / _TASKS)
        statistics = {name: _statistics(column) for name, column in full.items()}
        _write_json(partial / _STATS, statistics)
        _write_json(partial / _INFO, {
            'codebase_version': VERSION, 'robot_type': robot, 'total_episodes': len(demos),
            'total_frames': sum(map(len, rows)), 'total_tasks': 1, 'chunks_size': 1000,
            'data_files_size_in_mb': 100, 'video_files_size_in_mb': 200, 'fps': round(rate_hz),
            'splits': {'train': f'0:{len(demos)}'}, 'data_path': DATA, 'video_path': None,
            'features': features})
        partial.rename(folder)
    except OSError as error:
        raise DataError(f'{folder}: cannot write: {error.strerror}') from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _names_of(folder: Path, demos: Sequence[Demonstration], joints: Joints | None) -> list[str]:
    if not demos:
        raise DataError(f'{folder}: there is nothing to write')
    if joints is not None:
        for demo in demos:
            if demo.manifold.point_size != len(joints.names):
                raise DataError(f'{folder}: {len(joints.names)} joints expected, got a '
                                f'demonstration on {demo.manifold!r}')
        return list(joints.names)
    sizes = {stiffness_size_of(demo, folder) for demo in demos}
    if len(sizes) > 1:
        raise DataError(f'{folder}: only poses with the same kind of stiffness can be written')
    return columns(sizes.pop())[1:]


def _feature(dtype: str, size: int = 1, names: list[str] | None = None) -> dict[str, Any]:
    return {'dtype': dtype, 'shape': [size], 'names': names}


def _columns(rows: np.ndarray, episode: int, rate_hz: float, first: int) -> dict[str, np.ndarray]:
    """Columns of an episode."""
    count = len(rows)
    return {STATE: rows.astype(np.float32),
            ACTION: next_of(rows).astype(np.float32),
            'timestamp': (np.arange(count) / rate_hz).astype(np.float32),
            'frame_index': np.arange(count), 'episode_index': np.full(count, episode),
            'index': first + np.arange(count), 'task_index': np.zeros(count, dtype=int)}


def _table(pa: Any, features: dict[str, Any], full: dict[str, np.ndarray]) -> Any:
    """The table of the frames, with the types that the library ``datasets`` looks for."""
    arrays, described = {}, {}
    for name, rows in full.items():
        kind = features[name]['dtype']
        value = {'dtype': kind, '_type': 'Value'}
        if rows.ndim == 2:
            flat = pa.array(rows.reshape(-1), type=pa.float32())
            arrays[name] = pa.FixedSizeListArray.from_arrays(flat, rows.shape[1])
            described[name] = {'feature': value, 'length': rows.shape[1], '_type': 'List'}
        else:
            arrays[name] = pa.array(rows, type=getattr(pa, kind)())
            described[name] = value
    table = pa.table(arrays)
    text = json.dumps({'info': {'features': described}})
    return table.replace_schema_metadata({'huggingface': text})


def _episode_table(pa: Any, numbers: Sequence[dict[str, np.ndarray]], task: str) -> Any:
    """One row for each episode: where it is, and its statistics."""
    rows = []
    for episode, number in enumerate(numbers):
        first = int(number['index'][0])
        row: dict[str, Any] = {
            'episode_index': episode, 'tasks': [task], 'length': len(number['index']),
            'data/chunk_index': 0, 'data/file_index': 0, 'dataset_from_index': first,
            'dataset_to_index': first + len(number['index']),
            'meta/episodes/chunk_index': 0, 'meta/episodes/file_index': 0}
        for name, values in number.items():
            row.update({f'stats/{name}/{key}': value
                        for key, value in _statistics(values).items()})
        rows.append(row)
    return pa.Table.from_pylist(rows)


def _task_table(pa: Any, task: str) -> Any:
    """The task, as pandas writes a table whose index has the tasks."""
    table = pa.table({'task_index': pa.array([0], type=pa.int64()), 'task': [task]})
    column = {'field_name': 'task', 'metadata': None, 'name': 'task', 'numpy_type': 'object',
              'pandas_type': 'unicode'}
    number = {'field_name': 'task_index', 'metadata': None, 'name': 'task_index',
              'numpy_type': 'int64', 'pandas_type': 'int64'}
    text = json.dumps({'index_columns': ['task'], 'column_indexes': [],
                       'columns': [number, column], 'pandas_version': '2.2.0'})
    return table.replace_schema_metadata({'pandas': text})


def _statistics(rows: np.ndarray) -> dict[str, list[float] | list[int]]:
    table = rows.reshape(len(rows), -1).astype(float)
    return {'min': table.min(axis=0).tolist(), 'max': table.max(axis=0).tolist(),
            'mean': table.mean(axis=0).tolist(), 'std': table.std(axis=0).tolist(),
            'count': [len(table)],
            **{key: np.quantile(table, share, axis=0).tolist()
               for key, share in _QUANTILES.items()}}


def _write_json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=4))
