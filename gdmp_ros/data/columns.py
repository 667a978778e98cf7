"""
A motion in arrays of other programs: which array is what, in which unit and order.

Names tell it (`gdmp_ros.data.labels`). What they do not tell is decided from the numbers where
these decide, and stated; where two readings fit, the error names the option to give.
"""
from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.control.reference_check import QUATERNION_TOLERANCE
from gdmp_ros.data import labels
from gdmp_ros.data.arm_joints import (
    ArmJoints,
    ArmKinematics,
    columns_of,
    finger_commands,
    FingerCommand,
    opening,
    PERCENT,
    radians,
)
from gdmp_ros.data.labels import Group, groups, Label, label, ORDERS
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.quaternion import rotation_angles

#: Time between two samples of a recording [s], and its duration [s].
STEPS_S, DURATIONS_S = (4e-5, 2.6), (0.1, 7200.0)
#: Mean speed of a motion that somebody demonstrates, and one that is possible [m/s]; a turn by one
#: radian counts as `RADIAN_M`.
USUAL, POSSIBLE, RADIAN_M = (0.01, 2.0), (1e-3, 5.0), 0.2
#: Positions are in metres up to here, in millimetres from there on, if no name tells [m, mm].
METRES, MILLIMETRES = 5.0, 250.0
#: Angles are in radians up to the first, in degrees from the second on, if no name tells.
RADIANS, DEGREES = 3.3, 6.6
#: Norms of quaternions that are this near 1 are exact.
EXACT = 1e-9
#: A quaternion that changes its sign from one sample to the next: its real part is near zero.
NEAR_ZERO = 0.2
NEEDS_KEY = ('name them with --key position=NAME --key orientation=NAME (or NAME,NAME,NAME for '
             'columns), or --key points=NAME')
#: Beginnings of names in LeRobot data sets: what was measured, and what was commanded.
LEROBOT_STATE, LEROBOT_ACTION = 'observation.state.', 'action.'
#: What separates the name of an object from that of a number.
MARKS = '._/'


@dataclass(frozen=True)
class Import:
    """
    How arrays become a demonstration; what is not given is found, and stated.

    :ivar keys: names of arrays by role, one of `gdmp_ros.choices.ROLES`; columns are separated by
        commas, w first
    :ivar quaternion: order of the numbers of quaternions, one of `ORDERS`
    :ivar rate_hz: samples per second, instead of times
    :ivar scale: factor of the positions, such as 0.001 for millimetres
    :ivar offset: added to the scaled positions [m]
    :ivar rotation: of three numbers, one of `gdmp_ros.choices.ROTATIONS`
    :ivar time_unit: of the times: s, ms, us or ns
    :ivar angle_unit: of angles: rad or deg
    :ivar drop_bad: leave out samples that are not numbers, or whose times do not increase
    :ivar tf_frames: of a bag with transforms: frame of the tool, and of its base
    :ivar joints: arm whose tool is shown by recordings of its joints; None: they show the tool
    :ivar objects: arrays, or beginnings of their names, with poses of objects and not of the tool
    """

    keys: Mapping[str, str] = field(default_factory=dict)
    quaternion: str = ''
    rate_hz: float | None = None
    scale: float | None = None
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: str = ''
    time_unit: str = ''
    angle_unit: str = ''
    drop_bad: bool = False
    tf_frames: tuple[str, str] | None = None
    objects: tuple[str, ...] = ()
    joints: ArmJoints | None = None


def _angle_unit(part: Label) -> str:
    """rad or deg, if a name tells it."""
    factor = labels.ANGLES.get(part.unit)
    if factor is None:
        return ''
    return 'rad' if factor == 1.0 else 'deg'


def belongs(name: str, column: str) -> bool:
    """Whether an array is that of an object, or one of its columns."""
    return name == column or any(name.startswith(column + mark) for mark in MARKS)


class Motion(NamedTuple):
    """
    A motion of the tool.

    :ivar times: from 0 on [s], shape ``(T,)``
    :ivar points: x, y, z, qw, qx, qy, qz, and a stiffness row by row, shape ``(T, 7 + k)``
    :ivar notes: how it was read, for people
    :ivar fingers: commands that the fingers of a gripper have carried out
    """

    times: np.ndarray
    points: np.ndarray
    notes: tuple[str, ...]
    fingers: tuple[FingerCommand, ...] = ()


class JointMotion(NamedTuple):
    """
    A motion of joints.

    :ivar times: from 0 on [s], shape ``(T,)``
    :ivar positions: [rad], shape ``(T, n)``
    :ivar names: of the joints
    :ivar unit: of the recorded numbers [rad]
    """

    times: np.ndarray
    positions: np.ndarray
    names: tuple[str, ...]
    notes: tuple[str, ...]
    unit: float


class _Found(NamedTuple):
    """A vector: what is printed of its names, its numbers, what names it, and its kind."""

    names: str
    rows: np.ndarray
    label: Label
    kind: str


class Columns:
    """Arrays of one episode, and what is said about them."""

    def __init__(self, where: str, arrays: Mapping[str, np.ndarray], settings: Import):
        """
        Check what is said.

        :param where: the file, for messages
        :raises DataError: if an array is named that does not exist
        """
        self._where, self._settings = where, settings
        self._arrays = {name: array for name, array in arrays.items()
                        if not any(belongs(name, one) for one in settings.objects)}
        self.notes: list[str] = []
        self._rest: np.ndarray | None = None
        self._width: np.ndarray | None = None
        self._keys = {}
        for role, given in settings.keys.items():
            names = [labels.matching(self._arrays, name) for name in given.split(',')]
            for name in names:
                if name not in self._arrays:
                    raise DataError(f'{where}: no array is called {name!r} ({role}); there are '
                                    f'{self._listed()}')
            self._keys[role] = names
        self._labels = {name: label(name) for name in self._arrays}

    def motion(self) -> Motion:
        """
        Find times, positions, orientations and a stiffness.

        :raises DataError: naming the arrays, if something is missing, invalid or ambiguous
        """
        position, orientation = self._pose()
        stiffness = self._stiffness()
        parts = [position.rows, orientation.rows, *([] if stiffness is None else [stiffness])]
        lengths = [len(part) for part in parts]
        if len(set(lengths)) > 1:
            raise DataError(f'{self._where}: position, orientation and stiffness have '
                            f'{", ".join(map(str, lengths))} samples; found '
                            f'{"; ".join(self.notes)}')
        times = self._time_columns(len(position.rows))
        kept = self._kept(times, np.hstack(parts))
        scale = self._scale(position, kept)
        positions = scale * position.rows[kept] + np.asarray(self._settings.offset)
        quaternions = self._quaternions(orientation, kept)
        turned = rotation_angles(quaternions[1:], quaternions[:-1]).sum()
        moved = _length(positions) + RADIAN_M * float(turned)
        points = np.hstack([positions, quaternions,
                            *([] if stiffness is None else [stiffness[kept]])])
        seconds = self._seconds(times, kept, moved)
        self._note_grippers()
        fingers = () if self._width is None else tuple(finger_commands(seconds, self._width[kept]))
        return Motion(seconds, points, tuple(self.notes), fingers)

    def joints(self) -> JointMotion:
        """
        Find times and the positions of joints.

        :raises DataError: naming the arrays, if something is missing, invalid or ambiguous
        """
        found = self._joint_columns()
        if found is None:
            raise DataError(f'{self._where}: no joints were found; name their columns with --key '
                            f'joints=NAME,NAME or an array with --key joints=NAME. There are '
                            f'{self._listed()}')
        names, rows = found
        times = self._time_columns(len(rows))
        kept = self._kept(times, rows)
        listed = ', '.join(names)
        if self._settings.angle_unit == 'percent':
            unit = 1.0 / PERCENT  # of motors: no angles without their calibration
        else:
            # An arm with all joints within a few degrees of 0 is unusual.
            unit = self._radians(listed, self._labels.get(names[0], label('')), rows[kept],
                                 DEGREES)
        positions = unit * rows[kept]
        unwrapped = np.unwrap(positions, axis=0)
        wrapped = [name for name, a, b in zip(names, positions.T, unwrapped.T)
                   if not np.allclose(a, b)]
        percent = ' in percent of motors' if self._settings.angle_unit == 'percent' else ''
        self.notes.append(f'joints: {listed}{percent}')
        if wrapped:
            self.notes.append(f'{", ".join(wrapped)} pass from pi to -pi: read as continuous')
        moved = float(np.abs(np.diff(unwrapped, axis=0)).max(axis=1).sum()) * RADIAN_M
        return JointMotion(self._seconds(times, kept, moved), unwrapped, tuple(names),
                           tuple(self.notes), unit)

    # Pose

    def _pose(self) -> tuple[_Found, _Found]:
        """Position, and orientation as it is written."""
        joints = self._settings.joints
        if joints is not None and not joints.if_needed:
            return self._pose_of_joints(joints)
        if 'points' not in self._keys:
            positions = self._candidates('position')
            orientations = self._candidates('orientation')
            if positions and orientations:
                return self._pair(positions, orientations)
        pose = self._pose_array()
        if pose is not None:
            return pose
        if joints is not None:
            return self._pose_of_joints(joints)
        hint = ''
        if self._joint_columns() is not None:
            hint = ('. There are joints: learn a skill of them with --joints, or of the tool with '
                    '--urdf FILE --tip LINK')
        elif 'points' not in self._keys and self._candidates('position'):
            hint = '. A position was found, but no orientation'
        raise DataError(f'{self._where}: no position and orientation were found; {NEEDS_KEY}. '
                        f'There are {self._listed()}{hint}')

    def _pose_of_joints(self, joints: ArmJoints) -> tuple[_Found, _Found]:
        """
        Pose of the tool at the joints, and the width of a gripper.

        :raises DataError: if a joint is missing, or its unit cannot be told
        """
        names, rows = self._arm_columns(joints.arm)
        unit = self._settings.angle_unit or _angle_unit(self._labels.get(names[0], label('')))
        positions, unit = radians(self._where, joints, rows, unit,
                                  names[0].startswith((LEROBOT_STATE, LEROBOT_ACTION)))
        self.notes.append(f'joints: {", ".join(names)} in {unit}')
        poses = joints.arm.poses(positions)
        part = label('tool [m]')
        return (_Found('tool', poses[:, :3], part, 'position'),
                _Found('tool', poses[:, 3:], part, 'wxyz'))

    def _arm_columns(self, arm: ArmKinematics) -> tuple[list[str], np.ndarray]:
        """Names and numbers of the joints of an arm."""
        named = self._keys.get('joints', [])
        if len(named) == len(arm.names) > 1:
            return named, self._stacked(named)
        single = [name for name in self._free() if self._arrays[name].ndim == 1]
        states = [name for name in single if name.startswith(LEROBOT_STATE)]
        single = states or [name for name in single if not name.startswith(LEROBOT_ACTION)]
        if not named and len(single) >= len(arm.names):
            at, fingers = columns_of(arm, single)
            self._use_fingers([single[i] for i in fingers])
            names = [single[i] for i in at]
            return names, self._stacked(names)
        found = self._joint_columns()
        if found is None or found[1].shape[1] < len(arm.names):
            raise DataError(f'{self._where}: the joints {", ".join(arm.names)} were not found; '
                            'name their columns with --key joints=NAME,NAME or an array with '
                            f'--key joints=NAME. There are {self._listed()}')
        names, rows = found
        if rows.shape[1] > len(arm.names):
            self.notes.append(f'the first {len(arm.names)} of {rows.shape[1]} joints are those of '
                              'the arm')
        return names[:len(arm.names)], rows[:, :len(arm.names)]

    def _use_fingers(self, names: list[str]) -> None:
        """Learn the commands of two fingers in metres; others are left out."""
        if not names:
            return
        self._width = opening(self._stacked(names))
        self.notes.append(f'{", ".join(names)} ' + (
            'is no joint of the arm: left out' if self._width is None else
            'are fingers: their commands are those of the skill'))

    def _candidates(self, role: str) -> list[_Found]:
        """Vectors that may be the position, or the orientation."""
        given = self._keys.get(role)
        if given is not None:
            return [self._named(role, given)]
        vectors = groups(self._free())
        # With a force, tx, ty, tz are a torque.
        force = any(group.label.words == ('f',) for group in vectors)
        result = [found for group in vectors if not (force and group.label.words == ('t',))
                  for found in self._of_group(role, group)]
        for name in self._free():
            part, array = self._labels[name], self._arrays[name]
            if part.says(labels.OTHERS) or part.axis:
                continue
            found = self._of_array(role, name, part, array)
            if found is not None:
                result.append(found)
        return result

    def _free(self) -> list[str]:
        """Names that no key has been given."""
        taken = {name for names in self._keys.values() for name in names}
        return [name for name in self._arrays if name not in taken]

    def _named(self, role: str, names: list[str]) -> _Found:
        """
        The vector that a user has named.

        :raises DataError: if it has not as many numbers as it needs
        """
        part = self._labels[names[0]]
        if len(names) == 1:
            widths = (3,) if role == 'position' else (4, 3, 9)
            rows = _rows(self._arrays[names[0]], widths)
            if rows is None:
                raise DataError(f'{self._where}: {names[0]} has shape '
                                f'{self._arrays[names[0]].shape}, expected '
                                f'{" or ".join(map(str, widths))} numbers a sample')
            kind = {3: self._settings.rotation or _three(part), 4: 'quaternion',
                    9: 'matrix'}[rows.shape[1]]
            return _Found(names[0], rows, part, 'position' if role == 'position' else kind)
        expected = {'position': (3,)}.get(role, (4, 3))
        if len(names) not in expected:
            raise DataError(f'{self._where}: --key {role}={",".join(names)}: expected '
                            f'{" or ".join(map(str, expected))} columns')
        # Columns are named in the order of an axis, w first.
        kind = 'position' if role == 'position' else (
            'wxyz' if len(names) == 4 else self._settings.rotation or _three(part))
        return _Found(', '.join(names), self._stacked(names), part, kind)

    def _of_group(self, role: str, group: Group) -> list[_Found]:
        """The vector that columns make, if they make one of this role."""
        part, axes = group.label, set(group)
        if part.says(labels.OTHERS):
            return []
        kind, order = '', 'xyz'
        if role == 'position':
            if axes >= {'x', 'y', 'z'} and 'w' not in axes and not (
                    _turns(part) or part.words[-1:] == ('w',)):
                kind = 'position'
            elif part.says(labels.POSITION) and 'joint' not in part.words:
                order = next((run for run in ('012', '123') if axes == set(run)), '')
                kind = 'position' if order else ''
        elif axes >= {'w', 'x', 'y', 'z'}:
            kind, order = 'wxyz', 'wxyz'
        elif axes >= {'roll', 'pitch', 'yaw'}:
            return [_Found(', '.join(names := group.in_order(('roll', 'pitch', 'yaw'))),
                           self._stacked(names), part, self._settings.rotation or 'xyz')]
        elif part.says(labels.QUATERNION, labels.ORIENTATION) and (
                run := next((run for run in ('0123', '1234') if axes == set(run)), '')):
            kind, order = 'quaternion', run
        elif axes == {'x', 'y', 'z'} and _turns(part):
            kind = self._settings.rotation or _three(part)
        if not kind:
            return []
        names = group.in_order(order)
        units = sorted({self._labels[name].unit for name in names})
        if len(units) > 1:
            raise DataError(f'{self._where}: {", ".join(names)} have the units '
                            f'{", ".join(map(repr, units))}, expected one')
        return [_Found(', '.join(names), self._stacked(names), part, kind)]

    def _of_array(self, role: str, name: str, part: Label, array: np.ndarray) -> _Found | None:
        """The vector that an array is, if it is one of this role."""
        if role == 'position':
            rows = _rows(array, (3,)) if part.says(labels.POSITION) else None
            return None if rows is None else _Found(name, rows, part, 'position')
        if part.says(labels.ROTATION_VECTOR, labels.EULER, labels.ROLL_PITCH_YAW):
            rows = _rows(array, (3,))
            return None if rows is None else _Found(name, rows, part,
                                                    self._settings.rotation or _three(part))
        if not part.says(labels.ORIENTATION, {'r'}):
            return None
        rows = _rows(array, (4, 9))
        if rows is None:
            return None
        return _Found(name, rows, part, 'quaternion' if rows.shape[1] == 4 else 'matrix')

    def _pair(self, positions: list[_Found], orientations: list[_Found]) -> tuple[_Found, _Found]:
        """
        The position and the orientation that belong together.

        :raises DataError: if several do
        """
        pairs = [(position, orientation) for position in positions for orientation in orientations
                 if len(position.rows) == len(orientation.rows)]
        if not pairs:
            position, orientation = positions[0], orientations[0]
            raise DataError(f'{self._where}: position, orientation and stiffness have '
                            f'{len(position.rows)}, {len(orientation.rows)} samples: '
                            f'{position.names}; {orientation.names}')
        for better in (lambda p, o: _body(p.label) == _body(o.label),
                       lambda p, o: p.label.says(labels.TOOL) or o.label.says(labels.TOOL),
                       # Angles beside a quaternion are the same rotation.
                       lambda p, o: o.rows.shape[1] == 4):
            if len(pairs) > 1:
                pairs = [pair for pair in pairs if better(*pair)] or pairs
        for at, role in enumerate(('position', 'orientation')):
            names = list(dict.fromkeys(pair[at].names for pair in pairs))
            if len(names) > 1:
                raise DataError(f'{self._where}: {"; ".join(names)} may be the {role}: choose '
                                f'with --key {role}={names[0].replace(", ", ",")}')
        position, orientation = pairs[0]
        self.notes.append(f'position: {position.names}')
        self.notes.append(f'orientation: {orientation.names}')
        return position, orientation

    def _pose_array(self) -> tuple[_Found, _Found] | None:
        """Position and orientation in one array: a pose, or a homogeneous matrix."""
        given = self._keys.get('points')
        names = given or [name for name in self._arrays if self._labels[name].says(labels.POSES)
                          and not self._labels[name].says(labels.OTHERS)]
        fitting = []
        for name in names:
            rows = _rows(self._arrays[name], (7, 12, 16, 43))
            if rows is not None:
                fitting.append((name, rows))
            elif given:
                raise DataError(f'{self._where}: {name} has shape {self._arrays[name].shape}, '
                                'expected 7, 12, 16 or 43 numbers a sample')
        if len(fitting) > 1:
            fitting = [item for item in fitting if self._labels[item[0]].says(labels.TOOL)
                       ] or fitting
        if len(fitting) > 1:
            raise DataError(f'{self._where}: {", ".join(name for name, _ in fitting)} may be the '
                            f'points: choose with --key points={fitting[0][0]}')
        if not fitting:
            return None
        name, rows = fitting[0]
        part = self._labels[name]
        if not given:
            self.notes.append(f'points: {name}')
        matrices = _homogeneous(rows)
        if matrices is not None:
            return (_Found(name, matrices[:, :3, 3], part, 'position'),
                    _Found(name, matrices[:, :3, :3].reshape(-1, 9), part, 'matrix'))
        if rows.shape[1] == 12:
            raise DataError(f'{self._where}: {name} has 12 numbers a sample, which are no '
                            'rotation matrix with a position')
        # Archives that are written here have these names, and w first.
        own = {'times', 'points'} <= set(self._arrays) and name == 'points'
        self._rest = rows[:, 7:] if rows.shape[1] > 7 else None
        return (_Found(name, rows[:, :3], part, 'position'),
                _Found(name, rows[:, 3:7], part, 'wxyz' if own else 'quaternion'))

    # Numbers

    def _scale(self, position: _Found, kept: np.ndarray) -> float:
        """
        Metres of the unit of the positions.

        :raises DataError: if it is not given and cannot be told from the numbers
        """
        if self._settings.scale is not None:
            return self._settings.scale
        given = labels.LENGTHS.get(position.label.unit)
        if given is not None:
            return given
        largest = float(np.linalg.norm(position.rows[kept], axis=1).max())
        if largest <= METRES:
            return 1.0
        if MILLIMETRES <= largest <= 1e3 * METRES:
            self.notes.append(f'positions in mm: they reach {largest:.4g}')
            return 1e-3
        raise DataError(f'{self._where}: the positions ({position.names}) reach {largest:.4g}: in '
                        'metres this is too far, in which unit are they? Give --scale 0.001 for '
                        'millimetres, 0.01 for centimetres, or 1')

    def _quaternions(self, found: _Found, kept: np.ndarray) -> np.ndarray:
        """
        Quaternions, w first.

        :raises DataError: if the order, the unit or the meaning of the numbers is not known
        """
        rows, part = found.rows[kept], found.label
        if found.kind == 'matrix':
            return self._of_matrices(found, rows.reshape(-1, 3, 3))
        if rows.shape[1] == 3:
            if found.kind == '?':
                raise DataError(f'{self._where}: {found.names} may be a rotation vector or angles '
                                'about axes: give --rotation rotvec, xyz (fixed axes, as roll, '
                                'pitch, yaw) or XYZ (moving axes)')
            factor = self._radians(found.names, part, rows, RADIANS)
            rotation = (Rotation.from_rotvec(factor * rows) if found.kind == 'rotvec' else
                        Rotation.from_euler(found.kind, factor * rows))
            return np.asarray(np.roll(rotation.as_quat(), 1, axis=1))
        norms = np.linalg.norm(rows, axis=1)
        off = np.abs(norms - 1.0)
        if off.max() > QUATERNION_TOLERANCE:
            at = int(np.argmax(off))
            raise DataError(f'{self._where}: {found.names} is no unit quaternion: the norm of '
                            f'sample {int(np.flatnonzero(kept)[at])} is {norms[at]:.4g}, expected '
                            f'1 within {QUATERNION_TOLERANCE:g}')
        order = found.kind if found.kind == 'wxyz' else self._order(found, rows)
        # Numbers that are exact stay so.
        norms[off < EXACT] = 1.0
        ordered = rows if order == 'wxyz' else rows[:, [3, 0, 1, 2]]
        return np.asarray(ordered / norms[:, None])

    def _radians(self, names: str, part: Label, angles: np.ndarray, most: float) -> float:
        """
        Radians of the unit of angles.

        :param most: up to which they are in radians, if nothing tells the unit
        :raises DataError: if it cannot be told
        """
        given = labels.ANGLES.get(self._settings.angle_unit) or labels.ANGLES.get(part.unit)
        if given is not None:
            return given
        largest = float(np.abs(angles).max())
        if most < largest <= DEGREES:
            raise DataError(f'{self._where}: {names} reach {largest:.3g}, which may be rad or '
                            'deg: give --angle-unit')
        unit = 'rad' if largest <= most else 'deg'
        self.notes.append(f'{names} in {unit}: they reach {largest:.3g}')
        return labels.ANGLES[unit]

    def _of_matrices(self, found: _Found, matrices: np.ndarray) -> np.ndarray:
        """:raises DataError: if a matrix is no rotation"""
        off = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        if off.max() > 1e-3 or (np.linalg.det(matrices) < 0.0).any():
            at = int(np.argmax(off))
            raise DataError(f'{self._where}: {found.names} is no rotation matrix: R Rᵀ of sample '
                            f'{at} differs from 1 by {off[at]:.3g}, allowed 0.001')
        return np.roll(Rotation.from_matrix(matrices).as_quat(), 1, axis=1)

    def _order(self, found: _Found, rows: np.ndarray) -> str:
        """
        Order of the numbers of a quaternion.

        :raises DataError: if neither a name nor the numbers tell it
        """
        if self._settings.quaternion:
            return self._settings.quaternion
        if found.label.order:
            return found.label.order
        real, reason = _real_part(rows)
        if real is None:
            raise DataError(f'{self._where}: the quaternions in {found.names} may be in the order '
                            'wxyz or xyzw, and the numbers fit both: give --quaternion wxyz or '
                            '--quaternion xyzw')
        order = ORDERS[0] if real == 0 else ORDERS[1]
        self.notes.append(f'quaternions in {found.names} are {order}: {reason}')
        return order

    def _stiffness(self) -> np.ndarray | None:
        """Stiffness matrices row by row: behind a pose, in an array, or in columns k11, k12, …"""
        if self._rest is not None:
            return self._rest
        for name in self._keys.get('stiffness', [
                name for name, part in self._labels.items() if part.says(labels.STIFFNESS)
                and not part.axis and not part.says(labels.OTHERS)]):
            rows = _rows(self._arrays[name], (9, 36))
            if rows is not None:
                self.notes.append(f'stiffness: {name}')
                return rows
        for size in (6, 3):
            entries = [f'k{i}{j}' for i in range(1, size + 1) for j in range(1, size + 1)]
            named = {name.lower().rpartition('.')[2]: name for name in reversed(self._arrays)}
            if all(entry in named for entry in entries):
                self.notes.append(f'stiffness: {named[entries[0]]} to {named[entries[-1]]}')
                return self._stacked([named[entry] for entry in entries])
        return None

    def _joint_columns(self) -> tuple[list[str], np.ndarray] | None:
        """Names and positions of joints; None if there are none."""
        names = self._keys.get('joints', [])
        if not names:
            usable = [name for name in self._free() if not self._labels[name].says(labels.OTHERS)]
            for group in groups(usable):
                if group.label.says(labels.JOINT) and len(group) > 1 and all(
                        axis.isdigit() for axis in group):
                    names = group.in_order(sorted(group, key=int))
                    break
            else:
                names = [name for name in usable if self._labels[name].words[-1:] == ('pos',)
                         and not self._labels[name].axis and self._arrays[name].ndim == 1]
                if len(names) < 2:
                    arrays = [name for name in usable if self._arrays[name].ndim == 2
                              and self._labels[name].says(labels.JOINT)]
                    arrays.sort(key=lambda name: self._labels[name].says(labels.GRIPPER))
                    names = arrays[:1]
        fingers = [name for name in names if self._labels[name].says(labels.GRIPPER)]
        if len(names) > len(fingers) > 0 and 'joints' not in self._keys:
            self.notes.append(f'{", ".join(fingers)} is no joint of the arm: left out')
            names = [name for name in names if name not in fingers]
        if not names:
            return None
        if len(names) > 1:
            return names, self._stacked(names)
        rows = self._arrays[names[0]].reshape(len(self._arrays[names[0]]), -1)
        return [f'joint{i + 1}' for i in range(rows.shape[1])], rows

    # Times

    def _time_columns(self, count: int) -> tuple[str, np.ndarray, float | None]:
        """
        Name of the times, the numbers since the first one, and the seconds of their unit.

        :raises DataError: if there are none
        """
        if self._settings.rate_hz is not None:
            return '', np.arange(count) / self._settings.rate_hz, 1.0
        given = self._keys.get('times')
        parts = {name: self._labels[name] for name in self._arrays
                 if self._arrays[name].size == count and self._labels[name].says(labels.TIME)
                 and not self._labels[name].says(labels.OTHERS) and not self._labels[name].axis}
        if given is None:
            for name, part in parts.items():
                for other, fine in parts.items():
                    if fine.words == part.words and (labels.TIMES.get(part.unit),
                                                     labels.TIMES.get(fine.unit)) == (1.0, 1e-9):
                        whole, small = (self._arrays[item].reshape(-1) for item in (name, other))
                        return f'{name} and {other}', (whole - whole[0]) + 1e-9 * small, 1.0
        names = given or list(parts) or [name for name in self._arrays if name.split(' [')[0] in (
            'index', '__index_level_0__') and self._arrays[name].size == count]
        if not names:
            raise DataError(f'{self._where}: no times were found; give --rate-hz, or --key '
                            f'times=NAME. There are {self._listed()}')
        values = self._arrays[names[0]].reshape(-1)
        if len(values) != count:
            raise DataError(f'{self._where}: {names[0]} has {len(values)} times, the pose has '
                            f'{count} samples')
        first = values[np.isfinite(values)][:1]
        # Integers are subtracted exactly.
        since = (values - (first[0] if len(first) else 0)).astype(float)
        return names[0], since, (labels.TIMES.get(self._settings.time_unit)
                                 or labels.TIMES.get(self._labels[names[0]].unit))

    def _kept(self, times: tuple[str, np.ndarray, float | None], rows: np.ndarray) -> np.ndarray:
        """
        Which samples are good.

        :raises DataError: naming the first bad one, unless bad ones are to be dropped
        """
        finite, good = usable(times[1], rows)
        if good.all():
            return good
        at = int(np.argmin(finite))
        why = 'a number is missing, NaN or infinite'
        if finite.all():
            at = int(np.argmax(np.diff(times[1]) <= 0.0)) + 1
            why = (f'{times[0]} does not increase: {times[1][at]:.9g} after '
                   f'{times[1][at - 1]:.9g}, counted from the first one')
        if not self._settings.drop_bad:
            raise DataError(f'{self._where}: sample {at}: {why} ({int((~good).sum())} of '
                            f'{len(good)} samples are bad: --drop-bad leaves them out)')
        self.notes.append(f'{int((~good).sum())} of {len(good)} samples are left out, the first '
                          f'is sample {at}: {why}')
        return good

    def _seconds(self, times: tuple[str, np.ndarray, float | None], kept: np.ndarray, moved: float
                 ) -> np.ndarray:
        """
        Times from 0 on [s].

        :param moved: length of the path [m], in which turns count too
        :raises DataError: if the unit is not known, and several or none fit
        """
        name, values, factor = times
        values = values[kept] - values[kept][0]
        if len(values) < 3:
            raise DataError(f'{self._where}: {len(values)} samples, expected at least 3')
        reason = ''
        if factor is None:
            step, span = float(np.median(np.diff(values))), float(values[-1])
            fits = {unit: moved / (labels.TIMES[unit] * span) for unit in ('s', 'ms', 'us', 'ns')
                    if STEPS_S[0] <= labels.TIMES[unit] * step <= STEPS_S[1]
                    and DURATIONS_S[0] <= labels.TIMES[unit] * span <= DURATIONS_S[1]}
            chosen = [unit for unit, speed in fits.items() if USUAL[0] <= speed <= USUAL[1]] or [
                unit for unit, speed in fits.items() if POSSIBLE[0] <= speed <= POSSIBLE[1]
            ] or list(fits)
            if len(chosen) != 1:
                fit = ' and '.join(chosen) or 'no unit from s to ns'
                raise DataError(f'{self._where}: the samples of {name} are {step:.4g} apart, and '
                                f'{fit} fit{"" if chosen else "s"} a recording: give --time-unit')
            factor, reason = labels.TIMES[chosen[0]], ' (no unit is given, others do not fit)'
        values = factor * values
        unit = next((unit for unit in ('s', 'ms', 'us', 'ns') if labels.TIMES[unit] == factor), '')
        what = f'times: {name} [{unit}]{reason}' if name else 'times: by --rate-hz'
        self.notes.append(f'{what}, {values[-1]:.4g} s, {len(values)} samples, '
                          f'{1.0 / np.median(np.diff(values)):.4g} Hz')
        return np.asarray(values)

    def _stacked(self, names: Sequence[str]) -> np.ndarray:
        """
        Columns side by side.

        :raises DataError: if their lengths differ
        """
        columns = [self._arrays[name].reshape(-1) for name in names]
        if len({len(column) for column in columns}) > 1:
            raise DataError(f'{self._where}: {", ".join(names)} have different lengths')
        return np.column_stack(columns).astype(float)

    def _note_grippers(self) -> None:
        """Note a gripper that is recorded beside the pose."""
        left = [name for name in self._arrays if self._labels[name].says(labels.GRIPPER)
                and not any(name in note for note in self.notes)
                and not self._labels[name].says(labels.OTHERS)]
        if left:
            self.notes.append(f'not used: {", ".join(left)}')

    def _listed(self) -> str:
        listed = [f'{name} {array.shape}' for name, array in self._arrays.items()]
        more = f' and {len(listed) - 12} more' if len(listed) > 12 else ''
        return (', '.join(listed[:12]) + more) or 'no arrays of numbers'


def usable(times: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Which samples are numbers, and which of these have times that increase; shape ``(T,)`` each.

    :param rows: shape ``(T, k)``
    """
    finite = np.asarray(np.isfinite(times) & np.isfinite(rows).all(axis=1))
    good = finite.copy()
    good[np.flatnonzero(finite)] = increasing(times[finite])
    return finite, good


def increasing(times: np.ndarray) -> np.ndarray:
    """
    Which samples increase beyond doubt: of two that contradict each other neither is kept.

    :param times: finite, shape ``(T,)``
    :returns: the samples that all longest increasing subsequences have in common, shape ``(T,)``
    """
    if len(times) < 2 or (np.diff(times) > 0.0).all():
        return np.ones(len(times), dtype=bool)
    before = _ranks(times)
    after = _ranks(-times[::-1])[::-1]
    longest = before + after - 1 == before.max()
    alone = np.bincount(before[longest], minlength=before.max() + 1) == 1
    return np.asarray(longest & alone[before])


def _ranks(values: np.ndarray) -> np.ndarray:
    """Length of the longest increasing subsequence that ends at each value."""
    tails: list[float] = []
    result = np.empty(len(values), dtype=int)
    for i, value in enumerate(values.tolist()):
        at = bisect_left(tails, value)
        tails[at:at + 1] = [value]
        result[i] = at + 1
    return result


def _turns(part: Label) -> bool:
    """Whether a name with the axes x, y, z is that of a rotation."""
    return part.says(labels.ORIENTATION, labels.EULER, labels.ROTATION_VECTOR,
                     labels.ROLL_PITCH_YAW) or _three(part) == 'rotvec' or (
        part.words[-1:] == ('r',) and not part.says(labels.POSITION))


def _three(part: Label) -> str:
    """Kind of a rotation of three numbers, by its name; ``?`` if it tells none."""
    if part.says(labels.ROTATION_VECTOR) or {'ee', 'w'} <= set(part.words):
        return 'rotvec'
    return 'xyz' if part.says(labels.ROLL_PITCH_YAW) else '?'


def _body(part: Label) -> set[str]:
    """Words of a name that say whose position or orientation it is."""
    return set(part.words) - labels.POSITION - labels.ORIENTATION - labels.POSES - {
        *labels.ORDERS, 'rpy', 'r', 'w'} - labels.ROTATION_VECTOR - labels.EULER


def _rows(array: np.ndarray, widths: Sequence[int]) -> np.ndarray | None:
    """An array with one row for each sample; None if it has another width."""
    if array.ndim < 2:
        return None
    if array.ndim == 3 and array.shape[0] == array.shape[1] != array.shape[2]:
        array = np.moveaxis(array, 2, 0)  # MATLAB often has samples last
    rows = array.reshape(len(array), -1)
    if rows.shape[1] not in widths and rows.shape[0] in widths:
        rows = rows.T
    return rows.astype(float) if rows.shape[1] in widths else None


def _homogeneous(rows: np.ndarray) -> np.ndarray | None:
    """Matrices of shape ``(T, 4, 4)``, row by row or column by column; None if they are none."""
    last = np.array([0.0, 0.0, 0.0, 1.0])
    if rows.shape[1] == 12:
        matrices = np.concatenate([rows.reshape(-1, 3, 4), np.tile(last, (len(rows), 1, 1))],
                                  axis=1)
        blocks = matrices[:, :3, :3]
        square = np.abs(blocks @ blocks.transpose(0, 2, 1) - np.eye(3)).max() < 1e-3
        return matrices if square else None
    if rows.shape[1] != 16:
        return None
    matrices = rows.reshape(-1, 4, 4)
    for candidate in (matrices, matrices.transpose(0, 2, 1)):
        if np.allclose(candidate[:, 3], last, atol=1e-9):
            return candidate
    return None


def _real_part(rows: np.ndarray) -> tuple[int | None, str]:
    """
    Which number of quaternions is the real part, 0 or 3, and why; None if they do not tell.

    Programs that keep the real part positive change all signs where it passes zero.
    """
    flips = np.flatnonzero((rows[1:] * rows[:-1]).sum(axis=1) < 0.0)
    if len(flips):
        near = np.abs(np.vstack([rows[flips], rows[flips + 1]])).max(axis=0) < NEAR_ZERO
        kept = [k for k in (0, 3) if near[k] and rows[:, k].min() >= 0.0
                and rows[:, k].max() > NEAR_ZERO]
        if len(kept) == 1:
            return kept[0], 'all signs change where it passes zero'
    if rows[:, 3].min() > 0.9:
        return 3, 'the rotation stays near the identity'
    return None, ''


def _length(positions: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
