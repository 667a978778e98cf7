"""Names of columns and arrays: the words, the axis, the unit and the order that they tell."""
from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import re

import numpy as np

#: Units, in the unit that is used here.
LENGTHS = {'m': 1.0, 'meter': 1.0, 'meters': 1.0, 'metre': 1.0, 'metres': 1.0, 'mm': 1e-3,
           'millimeter': 1e-3, 'millimeters': 1e-3, 'millimetres': 1e-3, 'cm': 1e-2,
           'centimeters': 1e-2, 'centimetres': 1e-2}
TIMES = {'s': 1.0, 'sec': 1.0, 'secs': 1.0, 'second': 1.0, 'seconds': 1.0, 'ms': 1e-3,
         'msec': 1e-3, 'millis': 1e-3, 'milliseconds': 1e-3, 'us': 1e-6, 'usec': 1e-6, 'µs': 1e-6,
         'microseconds': 1e-6, 'ns': 1e-9, 'nsec': 1e-9, 'nsecs': 1e-9, 'nanosec': 1e-9,
         'nanosecs': 1e-9, 'nanoseconds': 1e-9}
ANGLES = {'rad': 1.0, 'radian': 1.0, 'radians': 1.0, 'deg': np.pi / 180.0,
          'degree': np.pi / 180.0, 'degrees': np.pi / 180.0, '°': np.pi / 180.0}
_UNITS = {**LENGTHS, **TIMES, **ANGLES}
#: Before the number of a column whose name occurs more than once.
COPY = '#'
#: Orders of a quaternion.
ORDERS = ('wxyz', 'xyzw')
#: Words by what they say.
TIME = {'t', 'time', 'times', 'timestamp', 'timestamps', 'stamp', 'stamps', 'clock', 'rosbagtime'}
POSITION = {'pos', 'position', 'positions', 'xyz', 'translation', 'trans', 'p', 't', 'tr',
            'location', 'coordinates', 'point', 'points', 'traj', 'trajectory'}
QUATERNION = {'quat', 'quaternion', 'quaternions', 'q'}
ORIENTATION = {*QUATERNION, 'orientation', 'orientations', 'rotation', 'rot', 'ori', 'attitude'}
ROTATION_VECTOR = {'rotvec', 'rvec', 'rv', 'axisangle', 'axang', 'rodrigues', 'aa'}
EULER = {'euler', 'angles', 'eul'}
ROLL_PITCH_YAW = {'rpy', 'roll', 'pitch', 'yaw'}
POSES = {'points', 'pose', 'poses', 'trajectory', 'traj', 'state', 'tcp', 'eef', 'ee', 'transform',
         'matrix', 'tf', 'h'}
STIFFNESS = {'stiffness', 'k'}
JOINT = {'joint', 'joints', 'j', 'q', 'qpos', 'motor', 'motors', 'servo', 'axis', 'angle', 'jpos'}
GRIPPER = {'gripper', 'finger', 'fingers', 'jaw'}
#: Words of what belongs to the tool.
TOOL = {'eef', 'ee', 'tcp', 'tool', 'hand', 'effector', 'flange', 'gripper'}
#: Words of what has axes too, but is neither the pose of the tool nor a time of it.
OTHERS = {'v', 'vel', 'velocity', 'twist', 'linear', 'angular', 'omega', 'f', 'force', 'torque',
          'tau', 'next', 'action', 'actions', 'wrench', 'a', 'acc', 'acceleration', 'accel',
          'goal', 'target', 'camera', 'cam', 'image', 'imu', 'gyro', 'mag', 'magnetometer',
          'jerk', 'cov', 'covariance', 'bias', 'b', 'g', 'cmd', 'command', 'commanded', 'desired',
          'des', 'ref', 'reference', 'error', 'err', 'std', 'speed', 'to', 'relative', 'object',
          'delta', 'duration', 'elapsed', 'ft', 'marker', 'setpoint', 'planned', 'plan', 'cos',
          'sin', 'qvel', 'qacc'}
_PREFIX = ('p|pos|position|t|tr|trans|q|quat|quaternion|r|rot|rotation|ori|orientation|euler|eul|'
           'rpy|rv|rvec|rotvec|w|xyz')
_LETTERED = re.compile(rf'({_PREFIX}|[a-z])([xyzw])')
_NUMBERED = re.compile(rf'({_PREFIX}|pose|joint|j|motor|servo|axis|a|k|[a-z]+)?([0-9]{{1,2}})')


@dataclass(frozen=True)
class Label:
    """
    What a name says.

    :ivar words: in lower case, without axis and unit
    :ivar axis: ``x`` to ``w``, ``roll``, ``pitch``, ``yaw``, or a number; empty without one
    :ivar unit: as it is written; empty without one
    """

    text: str
    words: tuple[str, ...]
    axis: str
    unit: str

    def says(self, *kinds: Iterable[str]) -> bool:
        """Whether a word is of one of these kinds."""
        return any(word in kind for kind in kinds for word in self.words)

    @property
    def order(self) -> str:
        """Order of a quaternion that the name tells; empty without one."""
        return next((order for order in ORDERS if order in (*self.words, self.unit)), '')


def label(text: str) -> Label:
    """Read a name, such as ``pose.position.x``, ``Position X [mm]``, ``roll_deg`` or ``qw``."""
    rest, mark, copy = text.strip().partition(COPY)
    unit = ''
    bracket = re.search(r'[\[(]\s*([^\])]*?)\s*[\])]\s*$', rest)
    if bracket is not None:
        rest, unit = rest[:bracket.start()], bracket.group(1).lower()
    rest = re.sub(r'(?<=[a-z0-9])(?=[A-Z])', '_', rest).lower()
    words = [word for word in re.split(r'[^a-z0-9µ°]+', rest) if word]
    if not unit and words and words[-1] in _UNITS and (len(words) > 1 or len(words[-1]) > 2):
        unit = words.pop()
        words = words or (['time'] if unit in TIMES else [])
    axis = ''
    if words:
        last = words.pop()
        lettered, numbered = _LETTERED.fullmatch(last), _NUMBERED.fullmatch(last)
        if last in ORDERS:
            words.append(last)
        elif last in ('x', 'y', 'z', 'w'):
            axis = last
        elif last in ('roll', 'pitch', 'yaw'):
            axis = last
            words.append('rpy')
        elif lettered is not None:
            axis = lettered.group(2)
            words.append(lettered.group(1))
        elif numbered is not None:
            axis = numbered.group(2)
            words += [numbered.group(1)] if numbered.group(1) else []
        else:
            words.append(last)
    return Label(text, (*words, *([mark + copy] if mark else [])), axis, unit)


class Group(dict[str, str]):
    """
    Columns of one vector: their names by axis.

    :ivar label: of one of them
    """

    def __init__(self, shared: Label):
        super().__init__()
        self.label = shared

    def in_order(self, axes: Iterable[str]) -> list[str]:
        """Names of these axes."""
        return [self[axis] for axis in axes]


def groups(names: Iterable[str]) -> list[Group]:
    """Columns whose names differ in their axis only."""
    result: dict[tuple[str, ...], Group] = {}
    for name in names:
        part = label(name)
        if part.axis:
            result.setdefault(part.words, Group(part)).setdefault(part.axis, name)
    return list(result.values())


def matching(names: Mapping[str, object], given: str) -> str:
    """The name that a user means: it may be given without its unit in brackets."""
    if given in names:
        return given
    bare = {re.sub(r'\s*[\[(][^\])]*[\])]\s*$', '', name): name for name in names}
    return bare.get(given, given)
