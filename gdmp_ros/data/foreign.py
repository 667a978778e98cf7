"""Demonstrations from and to other programs: arrays, CSV, NumPy, movement_primitives."""
from __future__ import annotations

from collections.abc import Mapping
import csv
from dataclasses import dataclass
import io
import json
from pathlib import Path
from typing import cast

import numpy as np

from gdmp_ros.data.arm_joints import FingerCommand
from gdmp_ros.data.columns import Columns, Import
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.util.files import write_archive, write_text

POSE = ('time', 'x', 'y', 'z', 'qw', 'qx', 'qy', 'qz')
#: Largest text file that is read [bytes].
LARGEST = 500_000_000
#: Sampling interval when a skill is converted from or to movement_primitives [s].
STEP_S = 0.005
_DMP = {'module': 'movement_primitives.dmp._cartesian_dmp', 'class': 'CartesianDMP'}


@dataclass(frozen=True)
class Imported:
    """
    A demonstration and how it was found.

    :ivar notes: how it was read, for people
    :ivar fingers: commands that the fingers of a gripper have carried out
    :ivar joints: names of the joints, of a demonstration of them
    :ivar joint_unit: of their recorded numbers [rad]
    """

    demonstration: Demonstration
    notes: tuple[str, ...]
    fingers: tuple[FingerCommand, ...] = ()
    joints: tuple[str, ...] = ()
    joint_unit: float = 1.0


def demonstration(where: str, arrays: Mapping[str, np.ndarray], settings: Import) -> Imported:
    """
    Find times, positions, orientations and a stiffness.

    :param where: the file, for messages
    :raises DataError: naming the arrays, if something is missing or invalid
    """
    times, points, notes, fingers = Columns(where, arrays, settings).motion()
    try:
        size = {0: None, 9: 3, 36: 6}[points.shape[1] - 7]
        return Imported(Demonstration(times, points, tool_manifold(size)), notes, fingers)
    except GdmpError as error:
        raise DataError(f'{where}: {error}') from None


def joint_demonstration(where: str, arrays: Mapping[str, np.ndarray], settings: Import
                        ) -> Imported:
    """
    Find times and positions of joints [rad], and their names.

    :param where: the file, for messages
    :raises DataError: naming the arrays, if something is missing or invalid
    """
    times, positions, names, notes, unit = Columns(where, arrays, settings).joints()
    try:
        manifold = Product(Euclidean(positions.shape[1]), names=('joints',))
        return Imported(Demonstration(times, positions, manifold), notes, joints=names,
                        joint_unit=unit)
    except GdmpError as error:
        raise DataError(f'{where}: {error}') from None


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


def write_tum(path: Path, demonstration: Demonstration) -> None:
    """Write the poses of a demonstration of a tool as lines of TUM: time, x y z, qx qy qz qw."""
    stiffness_size_of(demonstration, path)
    poses = demonstration.points[:, [0, 1, 2, 4, 5, 6, 3]]
    write_text(path, ''.join(' '.join(repr(float(value)) for value in (time, *pose)) + '\n'
                             for time, pose in zip(demonstration.times, poses)))


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


def motion(skill: Skill, step: float, start: np.ndarray | None = None) -> Demonstration:
    """
    Motion of a skill as a demonstration with a sample every ``step`` seconds.

    :param start: point; by default that of the skill
    """
    result = (skill.reproduce(step) if start is None else
              skill.rollout(start=start).sample(skill.reproduce(step).times))
    points = result.points.reshape(len(result.times), -1)
    return Demonstration(result.times, points, cast(Product, skill.manifold))
