"""Demonstrations as CSV and NumPy archives; skills of the package movement_primitives."""
from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import cast

import numpy as np

from gdmp_ros.data.tool import tool_manifold
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.util.atomic_write import write_archive, write_text

POSE = ('time', 'x', 'y', 'z', 'qw', 'qx', 'qy', 'qz')
#: Largest text file that is read [bytes].
LARGEST = 500_000_000
#: Sampling interval when a skill is converted from or to movement_primitives [s].
STEP_S = 0.005
_DMP = {'module': 'movement_primitives.dmp._cartesian_dmp', 'class': 'CartesianDMP'}


def columns(stiffness_size: int) -> list[str]:
    """Names of the columns: time, pose, and the entries of the stiffness row by row."""
    entries = [f'k{i}{j}' for i in range(1, stiffness_size + 1)
               for j in range(1, stiffness_size + 1)]
    return [*POSE, *entries]


def stiffness_size_of(demonstration: Demonstration, path: Path) -> int:
    """
    Size of the stiffness matrices of a demonstration of a tool; 0 without a stiffness.

    :raises DataError: if it is no such demonstration
    """
    manifold = demonstration.manifold
    if (not isinstance(manifold, Product)
            or manifold.factors[:2] != (Euclidean(3), UnitQuaternion())):
        raise DataError(f'{path}: only poses with stiffness can be written, got {manifold!r}')
    rest = manifold.factors[2:]
    if rest and not (len(rest) == 1 and isinstance(rest[0], SymmetricPositiveDefinite)):
        raise DataError(f'{path}: only poses with stiffness can be written, got {manifold!r}')
    return int(rest[0].size) if rest else 0


def write_csv(path: Path, demonstration: Demonstration) -> None:
    """Write a demonstration of a tool as CSV; the numbers are exact."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(columns(stiffness_size_of(demonstration, path)))
    for time, point in zip(demonstration.times, demonstration.points):
        writer.writerow([repr(float(value)) for value in (time, *point)])
    write_text(path, out.getvalue())


def read_csv(path: Path) -> Demonstration:
    """
    Read a demonstration of a tool from CSV.

    :raises DataError: naming the line and what is wrong with it
    """
    rows = list(csv.reader(io.StringIO(_text(path))))
    size = next((n for n in (0, 3, 6) if rows and rows[0] == columns(n)), None)
    if size is None:
        raise DataError(f'{path}: the first line is {",".join(rows[0]) if rows else ""!r}, '
                        f'expected {",".join(POSE)}, with k11, k12, … of a 3×3 or 6×6 stiffness')
    numbers = []
    for line, row in enumerate(rows[1:], 2):
        try:
            numbers.append([float(value) for value in row])
        except ValueError as error:
            raise DataError(f'{path}, line {line}: {error}') from None
        if len(row) != len(rows[0]):
            raise DataError(f'{path}, line {line}: {len(row)} numbers, expected {len(rows[0])}')
    table = np.array(numbers).reshape(len(numbers), len(rows[0]))
    return _demonstration(path, table[:, 0], table[:, 1:], size)


def is_own(path: Path) -> bool:
    """Whether a table or an archive has the columns or arrays that are written here."""
    try:
        if path.suffix == '.csv':
            with path.open() as text:
                first = text.readline().strip().split(',')
            return first in [columns(size) for size in (0, 3, 6)]
        if path.suffix == '.npz':
            with np.load(path, allow_pickle=False) as found:
                return set(found.files) == {'times', 'points'}
    except (OSError, ValueError, UnicodeDecodeError, EOFError):
        return False
    return False


def write_npz(path: Path, demonstration: Demonstration) -> None:
    """Write a demonstration of a tool as an archive of ``times`` and ``points``."""
    stiffness_size_of(demonstration, path)
    write_archive(path, {'times': demonstration.times, 'points': demonstration.points})


def read_npz(path: Path) -> Demonstration:
    """
    Read a demonstration of a tool from an archive; pickled objects are refused.

    :raises DataError: if it is not one
    """
    try:
        with np.load(path, allow_pickle=False) as found:
            times, points = (np.asarray(found[name], dtype=float) for name in ('times', 'points'))
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise DataError(f'{path}: not an archive of times and points: {error}') from None
    size = {7: 0, 16: 3, 43: 6}.get(points.shape[1] if points.ndim == 2 else 0)
    if size is None:
        raise DataError(f'{path}: points have shape {points.shape}, expected (T, 7), (T, 16) or '
                        '(T, 43)')
    return _demonstration(path, times, points, size)


def _demonstration(path: Path, times: np.ndarray, points: np.ndarray, size: int) -> Demonstration:
    try:
        return Demonstration(times, points, tool_manifold(size or None))
    except GdmpError as error:
        raise DataError(f'{path}: {error}') from None


def _text(path: Path) -> str:
    try:
        if not path.is_file() or path.stat().st_size > LARGEST:
            raise DataError(f'{path}: not a file of at most {LARGEST} bytes')
        return path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f'{path}: cannot be read: {error}') from None


def is_foreign(path: Path) -> bool:
    """Whether a JSON file is a movement primitive of movement_primitives."""
    try:
        document = json.loads(_text(path))
    except (ValueError, RecursionError):
        return False
    return isinstance(document, dict) and str(document.get('module', '')).startswith(
        'movement_primitives.')


def from_movement_primitives(path: Path) -> Demonstration:
    """
    Motion of a ``CartesianDMP`` from a JSON file of movement_primitives.

    No module named in the file is imported; only its numbers are used.

    :raises DataError: if it is another kind, or damaged
    """
    from movement_primitives.dmp import CartesianDMP
    document = json.loads(_text(path))
    kind = {name: document.get(name) for name in _DMP}
    if kind != _DMP:
        raise DataError(f'{path}: is a {kind["class"]!r}, expected a CartesianDMP')
    try:
        count = int(document['n_weights_per_dim'])
        primitive = CartesianDMP(float(document['_execution_time']), STEP_S, count,
                                 float(document['int_dt']), bool(document['smooth_scaling']))
        primitive.configure(start_y=np.array(document['start_y'], dtype=float),
                            goal_y=np.array(document['goal_y'], dtype=float))
        weights = [np.array(document[f'forcing_term_{part}']['weights_'], dtype=float)
                   for part in ('pos', 'rot')]
        primitive.set_weights(np.concatenate([part.reshape(-1) for part in weights]))
        times, poses = primitive.open_loop()
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise DataError(f'{path}: damaged CartesianDMP: {type(error).__name__}: {error}') from None
    return _demonstration(path, times, poses, 0)


def to_movement_primitives(path: Path, skill: Skill) -> float:
    """
    Write the pose of a skill as a ``CartesianDMP`` in the JSON format of movement_primitives.

    :returns: largest distance between its motion and the skill's [m]
    """
    from movement_primitives.dmp import CartesianDMP
    from movement_primitives.io import write_json
    shown = motion(skill, STEP_S)
    stiffness_size_of(shown, path)
    primitive = CartesianDMP(float(shown.duration), float(shown.times[1] - shown.times[0]),
                             max(skill.n_basis, 10))
    primitive.imitate(shown.times.copy(), shown.points[:, :7].copy())
    times, poses = primitive.open_loop()
    partial = path.with_name(f'.{path.name}.partial')
    try:
        write_json(str(partial), primitive)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    wanted = shown.at(np.minimum(times, shown.duration))
    return float(np.linalg.norm(poses[:, :3] - wanted[:, :3], axis=1).max())


def frames(shown: Demonstration, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Times from 0 on [s] and flat points at a rate, shapes ``(T,)`` and ``(T, n)``; T >= 2."""
    count = max(int(np.floor(shown.duration * rate_hz + 1e-6)) + 1, 2)
    times = np.minimum(np.arange(count) / rate_hz, shown.duration)
    return times, shown.at(shown.times[0] + times).reshape(count, -1)


def next_of(rows: np.ndarray) -> np.ndarray:
    """For each row the next one, and the last one again: what a controller gets next."""
    return np.vstack([rows[1:], rows[-1:]])


def motion(skill: Skill, step: float) -> Demonstration:
    """Motion of a skill as a demonstration with a sample every ``step`` seconds."""
    made = skill.reproduce(step)
    points = made.points.reshape(len(made.times), -1)
    return Demonstration(made.times, points, cast(Product, skill.manifold))
