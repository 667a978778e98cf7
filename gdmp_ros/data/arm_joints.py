"""
Recordings of joints as motions of the tool: names, units, and fingers of a gripper.

What a joint is called differs from program to program: in any order, with and without a prefix.
LeRobot writes degrees, or parts of the range of a motor from -100 to 100, and does not say which.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
from pathlib import Path
import re
from typing import NamedTuple, Protocol

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.util.files import read_text
from gdmp_ros.util.names import indices_of

#: Words in the names of what belongs to a gripper, and not to an arm.
FINGERS = ('finger', 'gripper', 'jaw', 'knuckle')
#: Joints may be beyond their limits by so much [rad].
SLACK = 0.1
#: Largest value of a motor, as a part of its range [%].
PERCENT = 100.0
#: Steps of a motor in a turn, less one, as LeRobot counts them.
STEPS = 4095
#: Ends of names that say nothing of the joint, in the order in which they are taken off.
_ENDS = (r'\s*[\[(].*', r'_(?:deg|rad)', r'[._](?:pos|position|q)', r'_joint')
#: Speed of fingers that move, and the smallest change that is a command [m/s, m].
MOVES_M_S, LEAST_M = 0.01, 0.004
#: Fingers that stop this far from closed hold something, and the force of the command [m, N].
HELD_M, FORCE_N = 0.004, 20.0
#: Widest opening that fingers in metres have [m].
WIDEST_M = 0.3
_LARGEST_FILE = 1_000_000


class ArmKinematics(Protocol):
    """
    Where the tool of an arm is (`gdmp_ros.sim.tip.TipKinematics`).

    :ivar names: of its joints
    :ivar limits: shape ``(n, 2)`` [rad, m]; infinite where there are none
    :ivar turns: whether each is revolute, shape ``(n,)``
    :ivar base: frame of the poses
    """

    names: tuple[str, ...]
    limits: np.ndarray
    turns: np.ndarray
    base: str

    def poses(self, positions: np.ndarray) -> np.ndarray:
        """Poses of the tool, shape ``(T, 7)``, at positions of shape ``(T, n)``."""


class ArmJoints(NamedTuple):
    """
    The arm of recordings of joints, and what is said about them.

    :ivar calibration: of the motors, for parts of their range: a file of LeRobot
    :ivar if_needed: only where no pose was recorded
    """

    arm: ArmKinematics
    calibration: Path | None = None
    if_needed: bool = False


def columns_of(arm: ArmKinematics, names: Sequence[str]) -> tuple[list[int], list[int]]:
    """
    Where the joints of an arm are among recorded names, and those of a gripper.

    :raises DataError: if a joint is missing, or there are several of its name
    """
    bare = [_bare(name) for name in names]
    fingers = [i for i, name in enumerate(bare) if _is_finger(name)
               and not any(_is_finger(joint) for joint in arm.names)]
    left = [i for i in range(len(names)) if i not in fingers]
    found = indices_of([_bare(name) for name in arm.names], [bare[i] for i in left], 'joint')
    return [left[i] for i in found], fingers


def _is_finger(name: str) -> bool:
    return any(word in name.lower() for word in FINGERS)


def _bare(name: str) -> str:
    """A name without group and ending: ``pan`` of ``observation.state.pan.pos``."""
    for end in _ENDS:
        name = re.sub(f'(?<=.){end}$', '', name)
    return name.rpartition('/')[2].rpartition('.')[2]


def radians(where: str, joints: ArmJoints, rows: np.ndarray, unit: str, of_motors: bool
            ) -> tuple[np.ndarray, str]:
    """
    Positions in radians and metres.

    :param where: of the recording, for messages
    :param rows: of the joints of the arm, shape ``(T, n)``
    :param unit: rad, deg or percent, of what turns; empty: as the limits of the joints tell
    :param of_motors: whether a program wrote them that also writes percent
    :returns: the positions, and their unit
    :raises DataError: if the unit cannot be told, or percent have no calibration
    """
    arm = joints.arm
    largest = float(np.nanmax(np.abs(rows[:, arm.turns]), initial=0.0))
    if not unit:
        unit = _told_by_limits(where, arm, rows, largest, of_motors)
    if unit == 'percent':
        return _of_motors(where, joints, rows, largest), unit
    factors = np.where(arm.turns & (unit == 'deg'), np.pi / 180.0, 1.0)
    return rows * factors, unit


def _told_by_limits(where: str, arm: ArmKinematics, rows: np.ndarray, largest: float,
                    of_motors: bool) -> str:
    wrong = _beyond(arm, rows)
    if not wrong:
        return 'rad'
    if _beyond(arm, np.where(arm.turns, np.radians(rows), rows)):
        raise DataError(f'{where}: the positions are within the limits of {wrong} neither in rad '
                        f'nor in deg, they reach {largest:.4g}: say what they are with --units')
    if of_motors and largest <= PERCENT:
        raise DataError(f'{where}: the positions reach {largest:.4g}, which may be deg, or '
                        'percent of the range of the motors: say which with --units')
    return 'deg'


def _beyond(arm: ArmKinematics, rows: np.ndarray) -> str:
    """First joint that is beyond its limits; empty if none is. One without limits turns once."""
    low, high = np.where(np.isfinite(arm.limits), arm.limits, [-2.0 * np.pi, 2.0 * np.pi]).T
    wrong = ((rows < low - SLACK) | (rows > high + SLACK)).any(axis=0)
    return next((name for name, bad in zip(arm.names, wrong) if bad), '')


def _of_motors(where: str, joints: ArmJoints, rows: np.ndarray, largest: float) -> np.ndarray:
    if largest > PERCENT + 1.0:
        raise DataError(f'{where}: the positions reach {largest:.4g}, expected -100 to 100 '
                        'percent')
    if joints.calibration is None:
        raise DataError(f'{where}: percent of the range of motors: give their --calibration, the '
                        'file of LeRobot')
    motors = _motors(joints.calibration)
    found = indices_of([_bare(name) for name in joints.arm.names],
                       [_bare(name) for name in motors], 'motor')
    listed = list(motors.values())
    spans = np.array([listed[i][1] - listed[i][0] for i in found])
    # A motor that is mounted the other way round is mirrored in percent, not in degrees.
    signs = np.array([-1.0 if listed[i][2] else 1.0 for i in found])
    return np.asarray(rows / PERCENT * signs * spans / 2.0 * 2.0 * np.pi / STEPS)


def _motors(path: Path) -> Mapping[str, tuple[float, float, bool]]:
    """Range in steps, and whether it is mirrored, of each motor in a calibration of LeRobot."""
    try:
        document = json.loads(read_text(path, 'calibration', _LARGEST_FILE))
        return {str(name): (float(one['range_min']), float(one['range_max']),
                            bool(one.get('drive_mode', 0)))
                for name, one in document.items()}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(f'{path}: no calibration of LeRobot ({type(error).__name__}: {error}); '
                        'expected range_min and range_max of each motor') from None


def opening(rows: np.ndarray) -> np.ndarray | None:
    """
    Width of a gripper, shape (T,) [m]; None if its joints are not two fingers in metres.

    :param rows: of the joints of the gripper, shape (T, k)
    """
    metres = rows.shape[1] > 1 and bool((rows >= -LEAST_M).all() and (rows <= WIDEST_M).all())
    return rows.sum(axis=1) if metres else None


class FingerCommand(NamedTuple):
    """A command that fingers have carried out: when, width [m], force [N] and speed [m/s]."""

    time: float
    width: float
    force: float
    speed: float


def finger_commands(times: np.ndarray, width: np.ndarray) -> list[FingerCommand]:
    """
    Commands that explain how the width of a gripper changed.

    Fingers that close and stop before they are closed hold something.

    :param times: [s], shape (T,)
    :param width: [m], shape (T,)
    """
    moving = np.abs(np.gradient(width, times)) > MOVES_M_S
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(int)))
    result = []
    for first, last in zip(edges[::2], edges[1::2] - 1):
        change = float(width[last] - width[first])
        if abs(change) < LEAST_M:
            continue
        speed = float(abs(change) / max(times[last] - times[first], 1e-3))
        held = change < 0.0 and width[last] > HELD_M
        result.append(FingerCommand(float(times[first]), 0.0 if held else float(width[last]),
                                    FORCE_N if held else 0.0, speed))
    return result
