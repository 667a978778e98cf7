"""Whether the numbers of a reference can be followed at all, by any controller."""
from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gdmp_ros.control.joint_target import joints_of, MOST_STIFFNESS
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    STIFFNESS,
    TWIST,
    WRENCH_GAIN,
)
from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.manifolds.linalg import copy_into, is_finite

#: Largest deviation of a message's quaternion from unit norm; it is normalized then.
QUATERNION_TOLERANCE = 1e-3
#: Largest difference between symmetric entries of a stiffness, relative to its largest entry.
SYMMETRY_TOLERANCE = 1e-6
#: Smallest pivot of a positive definite stiffness, relative to its largest entry.
SMALLEST_PIVOT = 1e-9
#: Largest number of a reference; products of such numbers stay finite.
LARGEST_NUMBER = 1e6
LARGEST_DAMPING_RATIO = 2.0
#: Beyond it a force that is fed back oscillates at a stiff surface [1/s].
LARGEST_WRENCH_GAIN = 20.0
#: Largest velocity of a reference, before any limit of the arm [m/s, rad/s].
LARGEST_TWIST = 10.0
#: The same of a joint [rad/s].
LARGEST_RATE = 20.0
_MODES, LAST_MODE = frozenset(int(mode) for mode in StreamMode), int(max(StreamMode))
#: A stream may skip this many sequence numbers.
LARGEST_GAP = 10_000


@dataclass(frozen=True)
class Origin:
    """
    Where a reference comes from.

    :ivar age: present time minus its stamp [s]
    :ivar sequence: number in its stream; 0 if it has none
    :ivar mode: a `StreamMode`
    :ivar stamp: [s]; 0 if it has none
    """

    frame: str
    age: float = 0.0
    sequence: int = 0
    mode: int = StreamMode.STREAMING
    stamp: float = 0.0


@kernel
def continues(sequence, last):
    """Whether a sequence number continues a stream; 0 says nothing."""
    return last == 0 or 0 < sequence - last <= LARGEST_GAP


#: In the reason why a reference is refused that came too late.
HELD_UP = 'was held up'


def refusal(origin: Origin, settings: GuardSettings, on_time_before: bool = False) -> str | None:
    """
    Why a reference must not be followed because of where it comes from; None if it may.

    :param on_time_before: whether an earlier one of its stream was on time: the clocks agree then
    """
    if origin.frame != settings.frame:
        return f'frame is {origin.frame!r}, expected {settings.frame!r}'
    if not is_on_time(origin, settings):
        past = origin.age > 0.0
        clocks = 'the clocks of the machines differ, simulated and wall time are mixed, or '
        late = (f'their publisher, the network or this process {HELD_UP}' if past else
                'this process was held up and its time is behind')
        return (f'stamp is {abs(origin.age):.3g} s in the {"past" if past else "future"}, '
                f'expected within {settings.stamp_tolerance:g} s: '
                f'{"the stream was on time before: " if on_time_before else clocks}{late}')
    return None if origin.mode in _MODES else f'mode is {origin.mode}, expected 0 to {LAST_MODE}'


def is_on_time(origin: Origin, settings: GuardSettings) -> bool:
    """Whether the stamp of a reference is near the present time."""
    return abs(origin.age) <= settings.stamp_tolerance


def invalid_target(target: np.ndarray) -> str | None:
    """
    Why a pose reference cannot be followed; None if it can.

    :param target: `TARGET_SIZE` numbers (`gdmp_ros.control.target`)
    """
    return _why_invalid(target) if is_invalid(target) else None


@kernel
def is_invalid(target):
    """Whether a number is not finite or too large, or a part is not on its manifold."""
    for i in range(target.size):
        # False for NaN too.
        if not abs(target[i]) <= LARGEST_NUMBER:
            return True
    if not 0.0 <= target[DAMPING_RATIO] <= LARGEST_DAMPING_RATIO:
        return True
    for i in range(TWIST, ACCELERATION):
        if abs(target[i]) > LARGEST_TWIST:
            return True
    for i in range(WRENCH_GAIN, WRENCH_GAIN + 6):
        if not 0.0 <= target[i] <= LARGEST_WRENCH_GAIN:
            return True
    norm = 0.0
    for i in range(POSE + 3, POSE + 7):
        norm += target[i] * target[i]
    if abs(math.sqrt(norm) - 1.0) > QUATERNION_TOLERANCE:
        return True
    return not _is_positive_definite(target[STIFFNESS:STIFFNESS + 36])


@kernel
def is_invalid_for_joints(target):
    """Whether a target of the joints has a number that is not finite, or beyond its bounds."""
    n = joints_of(target)
    if not is_finite(target):
        return True
    for i in range(n):
        if not (abs(target[n + i]) <= LARGEST_RATE and 0.0 < target[2 * n + i] <= MOST_STIFFNESS):
            return True
    return not 0.0 <= target[3 * n] <= LARGEST_DAMPING_RATIO


@kernel
def _is_positive_definite(stiffness):
    """Whether 36 numbers are symmetric, and all pivots of the elimination are positive."""
    largest = 0.0
    for i in range(36):
        largest = max(largest, abs(stiffness[i]))
    for i in range(6):
        for j in range(i):
            if abs(stiffness[6 * i + j] - stiffness[6 * j + i]) > SYMMETRY_TOLERANCE * largest:
                return False
    left = local_numbers(36)
    copy_into(stiffness, left)
    for k in range(6):
        if not left[7 * k] > SMALLEST_PIVOT * largest:
            return False
        for i in range(k + 1, 6):
            factor = left[6 * i + k] / left[7 * k]
            for j in range(k + 1, 6):
                left[6 * i + j] -= factor * left[6 * k + j]
    return True


def _why_invalid(target: np.ndarray) -> str:
    """Say what makes a target invalid."""
    if not np.isfinite(target).all():
        return 'a number is NaN or infinite'
    largest = float(np.abs(target).max())
    if largest > LARGEST_NUMBER:
        return f'a number is {largest:.3g}, expected at most {LARGEST_NUMBER:g}'
    fastest = float(np.abs(target[TWIST:ACCELERATION]).max())
    if fastest > LARGEST_TWIST:
        return f'the twist is {fastest:.3g} m/s or rad/s, expected at most {LARGEST_TWIST:g}'
    norm = float(np.linalg.norm(target[POSE + 3:POSE + 7]))
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        return f'quaternion norm is {norm:.6g}, expected 1 within {QUATERNION_TOLERANCE:g}'
    if not 0.0 <= target[DAMPING_RATIO] <= LARGEST_DAMPING_RATIO:
        return (f'damping ratio is {target[DAMPING_RATIO]:.3g}, '
                f'expected 0 to {LARGEST_DAMPING_RATIO:g}')
    for gain in target[WRENCH_GAIN:WRENCH_GAIN + 6]:
        if not 0.0 <= gain <= LARGEST_WRENCH_GAIN:
            return f'a wrench gain is {gain:.3g}, expected 0 to {LARGEST_WRENCH_GAIN:g} 1/s'
    stiffness = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
    difference = np.abs(stiffness - stiffness.T).max()
    if difference > SYMMETRY_TOLERANCE * np.abs(stiffness).max():
        return f'stiffness is not symmetric: entries differ by {difference:.3g}'
    scale = max(float(np.abs(stiffness).max()), 1e-300)
    least = scale * np.linalg.eigvalsh(stiffness / scale)[0]
    return f'stiffness is not positive definite: smallest eigenvalue is {least:.4g}'
