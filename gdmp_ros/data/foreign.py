"""
Demonstrations in files of other programs: CSV, NumPy, and skills of movement_primitives.

What an array means is guessed by its name and shape, and stated.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
import csv
from dataclasses import dataclass, field
import io
import json
from pathlib import Path
import re
from typing import cast

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.util.files import write_archive, write_text

ORDERS = ('wxyz', 'xyzw')
#: What an array can be.
ROLES = ('times', 'points', 'position', 'orientation', 'stiffness')
#: Words in names, by role.
_WORDS = {'times': {'t', 'time', 'times', 'timestamp', 'timestamps', 'stamp', 'seconds', 'sec'},
          'position': {'pos', 'position', 'positions', 'xyz', 'translation', 'p'},
          'orientation': {'quat', 'quaternion', 'quaternions', 'orientation', 'rotation', 'rot',
                          'q', 'ori'},
          'stiffness': {'stiffness', 'k'},
          'points': {'points', 'pose', 'poses', 'trajectory', 'traj', 'state'}}
#: Words in names of what has axes too, but is no pose.
_OTHERS = {'v', 'vel', 'velocity', 'twist', 'linear', 'angular', 'omega', 'f', 'force', 'torque',
           'tau', 'next', 'action', 'actions', 'wrench', 'a', 'acc', 'acceleration', 'goal',
           'target', 'camera', 'image'}
#: Words in names of what belongs to the tool.
_TOOL = {'eef', 'ee', 'tcp', 'tool', 'hand', 'gripper', 'effector'}
#: An axis at the end of a name: alone, after a separator, or after one letter such as q or p.
_AXIS = re.compile(r'((?:.*[^a-z0-9])?(?:q|p|quat|pos)?)([wxyz])')
#: Units of times, and their seconds.
_UNITS = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}
#: Time between two samples of a recording [s].
SHORTEST_STEP_S, LONGEST_STEP_S = 1e-4, 0.9
POSE = ('time', 'x', 'y', 'z', 'qw', 'qx', 'qy', 'qz')
#: Largest text file that is read [bytes].
LARGEST = 500_000_000
#: Sampling interval when a skill is converted from or to movement_primitives [s].
STEP_S = 0.005
_DMP = {'module': 'movement_primitives.dmp._cartesian_dmp', 'class': 'CartesianDMP'}


@dataclass(frozen=True)
class Import:
    """
    How arrays become a demonstration; what is not given is guessed.

    :ivar keys: names of arrays by role, one of `ROLES`; columns are separated by commas, w first
    :ivar quaternion: order of the numbers of quaternions, one of `ORDERS`; empty: by the names
    :ivar rate_hz: samples per second, where no times are found; None: there must be times
    :ivar scale: factor of the positions, such as 0.001 for millimetres
    :ivar offset: added to the scaled positions [m]
    """

    keys: Mapping[str, str] = field(default_factory=dict)
    quaternion: str = ''
    rate_hz: float | None = None
    scale: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Imported:
    """
    A demonstration and how it was found.

    :ivar notes: what was guessed, for people
    """

    demonstration: Demonstration
    notes: tuple[str, ...]


def demonstration(where: str, arrays: Mapping[str, np.ndarray], settings: Import) -> Imported:
    """
    Find times, positions, orientations and a stiffness.

    :param where: the file, for messages
    :raises DataError: naming the arrays, if something is missing or invalid
    """
    search = _Search(where, arrays, settings)
    position, orientation, stiffness = search.pose()
    times = search.times(len(position))
    scaled = settings.scale * position + np.asarray(settings.offset)
    points = np.hstack([scaled, orientation])
    if stiffness is not None:
        points = np.hstack([points, stiffness])
    size = {0: None, 9: 3, 36: 6}[0 if stiffness is None else stiffness.shape[1]]
    try:
        result = Demonstration(times - times[0], points, tool_manifold(size))
    except GdmpError as error:
        raise DataError(f'{where}: {error}') from None
    return Imported(result, tuple(search.notes))


class _Search:
    """Looks for arrays by their names and shapes."""

    def __init__(self, where: str, arrays: Mapping[str, np.ndarray], settings: Import):
        self._where, self._arrays, self._settings = where, dict(arrays), settings
        self.notes: list[str] = []
        for role, given in settings.keys.items():
            for name in given.split(','):
                if name not in self._arrays:
                    raise DataError(f'{where}: no array is called {name!r} ({role}); there are '
                                    f'{self._listed()}')

    def pose(self) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Position, orientation (w first) and stiffness, one row for each sample."""
        if 'points' not in self._settings.keys:
            position = self._vector('position', 'xyz')
            orientation = self._vector('orientation', 'wxyz')
            if position is not None and orientation is not None:
                stiffness = self._stiffness()
                self._check_lengths(position, orientation, stiffness)
                return position, orientation, stiffness
            self.notes.clear()
        points = self._one('points', (7, 16, 43))
        if points is None:
            raise DataError(f'{self._where}: no position and orientation were found; name them '
                            'with --key position=NAME --key orientation=NAME (or NAME,NAME,NAME '
                            f'for columns), or --key points=NAME. There are {self._listed()}')
        name, rows = points
        rest = rows[:, 7:]
        return (rows[:, :3], _w_first(rows[:, 3:7], self._order(name, ORDERS[0])),
                rest if rest.size else None)

    def times(self, count: int) -> np.ndarray:
        """Times of the samples [s]."""
        given, rate = self._settings.keys.get('times'), self._settings.rate_hz
        named = [given] if given else [name for name in self._named('times')
                                       if self._arrays[name].size == count]
        if not named and rate is not None:
            return np.arange(count) / rate
        if not named:
            raise DataError(f'{self._where}: no times were found; give --rate-hz, or --key '
                            f'times=NAME. There are {self._listed()}')
        times = self._arrays[named[0]].reshape(-1)
        if len(times) != count:
            raise DataError(f'{self._where}: {named[0]} has {len(times)} times, the pose has '
                            f'{count} samples')
        return self._in_seconds(named[0], times - times[0])

    def _in_seconds(self, name: str, times: np.ndarray) -> np.ndarray:
        """Times in the first unit in which the samples are as far apart as in a recording."""
        step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        for unit, factor in _UNITS.items():
            if SHORTEST_STEP_S <= step * factor <= LONGEST_STEP_S:
                self.notes.append(f'times: {name} [{unit}], {factor * times[-1]:.4g} s')
                return np.asarray(factor * times)
        raise DataError(f'{self._where}: the samples of {name} are {step:.4g} apart: in no unit '
                        'from s to ns is this the time between two samples of a recording')

    def _check_lengths(self, *parts: np.ndarray | None) -> None:
        lengths = [len(part) for part in parts if part is not None]
        if len(set(lengths)) > 1:
            raise DataError(f'{self._where}: position, orientation and stiffness have '
                            f'{", ".join(map(str, lengths))} samples; found '
                            f'{"; ".join(self.notes)}')

    def _stiffness(self) -> np.ndarray | None:
        """Stiffness matrices row by row, in one array or in columns k11, k12, and so on."""
        result = self._one('stiffness', (9, 36))
        if result is not None:
            return result[1]
        for size in (6, 3):
            entries = [f'k{i}{j}' for i in range(1, size + 1) for j in range(1, size + 1)]
            named = {name.lower().rpartition('.')[2]: name for name in reversed(self._arrays)}
            if all(entry in named for entry in entries):
                self.notes.append(f'stiffness: {named[entries[0]]} to {named[entries[-1]]}')
                return np.column_stack([self._arrays[named[entry]].reshape(-1)
                                        for entry in entries])
        return None

    def _named(self, role: str) -> list[str]:
        """Names of arrays that may have a role."""
        given = self._settings.keys.get(role)
        if given:
            return [given]
        return [name for name in self._arrays
                if _words(name) & _WORDS[role] and not _words(name) & _OTHERS]

    def _one(self, role: str, widths: Sequence[int]) -> tuple[str, np.ndarray] | None:
        """
        The array of a role with one of these widths.

        :raises DataError: if there are several, or the one that was named has another width
        """
        given = self._settings.keys.get(role)
        if given and ',' in given:
            return None
        fitting = []
        for name in self._named(role):
            rows = _rows(self._arrays[name], widths)
            if rows is not None:
                fitting.append((name, rows))
            elif given:
                raise DataError(f'{self._where}: {name} has shape {self._arrays[name].shape}, '
                                f'expected {" or ".join(map(str, widths))} numbers a sample')
        if len(fitting) > 1:
            fitting = [item for item in fitting if _words(item[0]) & _TOOL] or fitting
        if len(fitting) > 1:
            raise DataError(f'{self._where}: {", ".join(name for name, _ in fitting)} may be the '
                            f'{role}: choose with --key {role}=NAME')
        if fitting and not given:
            self.notes.append(f'{role}: {fitting[0][0]}')
        return fitting[0] if fitting else None

    def _vector(self, role: str, axes: str) -> np.ndarray | None:
        """A position, or an orientation (w first), in one array or in columns."""
        result = self._one(role, (len(axes),))
        if result is not None:
            name, rows = result
            return rows if role == 'position' else _w_first(rows, self._order(name, ORDERS[1]))
        columns = self._columns(role, axes)
        if columns is None:
            return None
        self.notes.append(f'{role}: {", ".join(columns)}')
        lengths = {self._arrays[name].size for name in columns}
        if len(lengths) > 1:
            raise DataError(f'{self._where}: {", ".join(columns)} have different lengths')
        return np.column_stack([self._arrays[name].reshape(-1) for name in columns])

    def _columns(self, role: str, axes: str) -> list[str] | None:
        """
        Names of the columns of a vector, in the order of ``axes``.

        :raises DataError: if there are several such vectors
        """
        given = self._settings.keys.get(role)
        if given:
            names = given.split(',')
            if len(names) != len(axes):
                raise DataError(f'{self._where}: --key {role}={given}: expected {len(axes)} '
                                f'columns, {", ".join(axes)}')
            return names
        result: dict[str, dict[str, str]] = {}
        for name in self._arrays:
            match = _AXIS.fullmatch(name.strip().lower())
            if match is not None and not _words(match.group(1)) & _OTHERS:
                result.setdefault(match.group(1), {})[match.group(2)] = name
        fitting = [group for prefix, group in result.items()
                   if set(group) == set(axes) and (role == 'position' or 'w' in group)
                   and not (role == 'position' and _words(prefix) & _WORDS['orientation'])]
        if len(fitting) > 1:
            listed = '; '.join(', '.join(group[axis] for axis in axes) for group in fitting)
            raise DataError(f'{self._where}: {listed} may be the {role}: choose with --key '
                            f'{role}={",".join(fitting[0][axis] for axis in axes)}')
        return [fitting[0][axis] for axis in axes] if fitting else None

    def _order(self, name: str, usual: str) -> str:
        if self._settings.quaternion:
            return self._settings.quaternion
        self.notes.append(f'quaternions in {name} are taken as {usual}; else: --quaternion')
        return usual

    def _listed(self) -> str:
        listed = [f'{name} {array.shape}' for name, array in self._arrays.items()]
        more = f' and {len(listed) - 12} more' if len(listed) > 12 else ''
        return (', '.join(listed[:12]) + more) or 'no arrays of numbers'


def _rows(array: np.ndarray, widths: Sequence[int]) -> np.ndarray | None:
    """An array with one row for each sample; None if it has another width."""
    if array.ndim == 3 and array.shape[0] == array.shape[1] != array.shape[2]:
        array = np.moveaxis(array, 2, 0)  # MATLAB often has samples last
    rows = array.reshape(len(array), -1)
    if rows.shape[1] not in widths and rows.shape[0] in widths:
        rows = rows.T
    return rows if rows.shape[1] in widths else None


def _words(name: str) -> set[str]:
    return set(re.split(r'[^a-z0-9]+', name.lower()))


def _w_first(rows: np.ndarray, order: str) -> np.ndarray:
    return rows if order == 'wxyz' else rows[:, [3, 0, 1, 2]]


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


def write_npz(path: Path, demonstration: Demonstration) -> None:
    """Write a demonstration of a tool as an archive of ``times`` and ``points``."""
    stiffness_size_of(demonstration, path)
    write_archive(path, {'times': demonstration.times, 'points': demonstration.points})


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
    demo = motion(skill, STEP_S)
    stiffness_size_of(demo, path)
    primitive = CartesianDMP(float(demo.duration), float(demo.times[1] - demo.times[0]),
                             max(skill.n_basis, 10))
    primitive.imitate(demo.times.copy(), demo.points[:, :7].copy())
    times, poses = primitive.open_loop()
    partial = path.with_name(f'.{path.name}.partial')
    try:
        write_json(str(partial), primitive)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    target = demo.at(np.minimum(times, demo.duration))
    return float(np.linalg.norm(poses[:, :3] - target[:, :3], axis=1).max())


def frames(demo: Demonstration, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Times from 0 on [s] and flat points at a rate, shapes ``(T,)`` and ``(T, n)``; T >= 2."""
    count = max(int(np.floor(demo.duration * rate_hz + 1e-6)) + 1, 2)
    times = np.minimum(np.arange(count) / rate_hz, demo.duration)
    return times, demo.at(demo.times[0] + times).reshape(count, -1)


def next_of(rows: np.ndarray) -> np.ndarray:
    """For each row the next one, and the last one again: what a controller gets next."""
    return np.vstack([rows[1:], rows[-1:]])


def motion(skill: Skill, step: float) -> Demonstration:
    """Motion of a skill as a demonstration with a sample every ``step`` seconds."""
    result = skill.reproduce(step)
    points = result.points.reshape(len(result.times), -1)
    return Demonstration(result.times, points, cast(Product, skill.manifold))
