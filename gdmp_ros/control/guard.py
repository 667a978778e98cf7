"""Reference guard: checks the stream of references, and stops the arm when it ends."""
from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.stiffness import relative_modes
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    extrapolate_pose,
    POSE,
    resting_target,
    STIFFNESS,
    TWIST,
)
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.util.profiles import smoothstep

#: Largest deviation of a message's quaternion from unit norm; it is normalized then.
QUATERNION_TOLERANCE = 1e-3
#: Largest difference between symmetric entries of a stiffness, relative to its largest entry.
SYMMETRY_TOLERANCE = 1e-6
#: Smallest pivot of a positive definite stiffness, relative to its largest entry.
SMALLEST_PIVOT = 1e-9
#: Largest number of a reference; products of such numbers stay finite.
LARGEST_NUMBER = 1e6
LARGEST_DAMPING_RATIO = 2.0
#: Largest velocity of a reference, before any limit of the arm [m/s, rad/s].
LARGEST_TWIST = 10.0
#: Time for which the acceleration of the last reference is used between two references [s].
ACCELERATION_S = 0.01
#: A stream may skip this many sequence numbers.
LARGEST_GAP = 10_000


@dataclass(frozen=True)
class Origin:
    """
    Where a reference comes from.

    :ivar age: present time minus its stamp [s]
    :ivar sequence: number in its stream; 0 if it has none
    """

    frame: str
    age: float = 0.0
    sequence: int = 0


def refusal(target: np.ndarray, origin: Origin, settings: GuardSettings) -> str | None:
    """
    Why a reference must not be followed; None if it may.

    :param target: `TARGET_SIZE` numbers (`gdmp_ros.control.target`)
    """
    if origin.frame != settings.frame:
        return f'frame is {origin.frame!r}, expected {settings.frame!r}'
    if abs(origin.age) > settings.stamp_tolerance:
        side = 'past' if origin.age > 0.0 else 'future'
        return (f'stamp is {abs(origin.age):.3g} s in the {side}, expected within '
                f'{settings.stamp_tolerance:g} s: the clocks of the machines differ, or simulated '
                'and wall time are mixed')
    return _why_invalid(target) if _is_invalid(target) else None


@kernel
def _is_invalid(target):
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
    norm = 0.0
    for i in range(POSE + 3, POSE + 7):
        norm += target[i] * target[i]
    if abs(math.sqrt(norm) - 1.0) > QUATERNION_TOLERANCE:
        return True
    return not _is_positive_definite(target[STIFFNESS:STIFFNESS + 36])


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
    left = stiffness.copy()
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
    stiffness = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
    difference = np.abs(stiffness - stiffness.T).max()
    if difference > SYMMETRY_TOLERANCE * np.abs(stiffness).max():
        return f'stiffness is not symmetric: entries differ by {difference:.3g}'
    scale = max(float(np.abs(stiffness).max()), 1e-300)
    least = scale * np.linalg.eigvalsh(stiffness / scale)[0]
    return f'stiffness is not positive definite: smallest eigenvalue is {least:.4g}'


@kernel
def _steps(last, target):
    """Steps of position [m], rotation [rad] and stiffness (largest |log| of a ratio)."""
    rotation, values, modes = np.empty(3), np.empty(6), np.empty(36)
    distance, angle, ratio = 0.0, 0.0, 0.0
    rotation_between(last[POSE + 3:POSE + 7], target[POSE + 3:POSE + 7], rotation)
    for i in range(3):
        distance += (target[POSE + i] - last[POSE + i]) ** 2
        angle += rotation[i] ** 2
    relative_modes(last[STIFFNESS:STIFFNESS + 36], target[STIFFNESS:STIFFNESS + 36], values,
                   modes)
    for i in range(6):
        ratio = max(ratio, abs(math.log(max(values[i], 1e-300))))
    return math.sqrt(distance), math.sqrt(angle), ratio


class ReferenceGuard:
    """
    Turns references, as they arrive, into a target for every tick.

    Accepted references are followed, and extrapolated between two of them. When they end, the
    motion slows down and the pose is held. A stream that is followed must not jump. After a
    time-out any stream is accepted; the reference governor then catches up with it.
    """

    def __init__(self, settings: GuardSettings, pose: np.ndarray, damping_ratio: float):
        """
        Hold a pose until the first reference.

        :param pose: (x, y, z, qw, qx, qy, qz)
        """
        self.settings = settings
        self.refused = 0
        self.last_refusal = ''
        self.following = False
        self._target = resting_target(pose, damping_ratio=damping_ratio)
        self._age = np.inf
        self._fresh = False
        self._sequence = 0
        self._stop_progress = 1.0
        self._last_twist = np.zeros(6)

    def offer(self, target: np.ndarray, origin: Origin) -> bool:
        """
        Accept a reference, or count and explain the refusal; the last good one stays valid.

        :param target: `TARGET_SIZE` numbers; the quaternion of an accepted one is normalised here
        :returns: whether it was accepted
        """
        reason = refusal(target, origin, self.settings)
        if reason is None and self.following:
            reason = self._out_of_sequence(origin) or self._jump(target)
        if reason is not None:
            self.refuse(reason)
            return False
        target[POSE + 3:POSE + 7] /= np.linalg.norm(target[POSE + 3:POSE + 7])
        self._target[:] = target
        self.following = self._fresh = True
        self._sequence = origin.sequence
        self._age = 0.0
        return True

    def configure(self, settings: GuardSettings, damping_ratio: float) -> None:
        """Use other settings from now on; the damping ratio only while nothing is followed."""
        self.settings = settings
        if not self.following:
            self._target[DAMPING_RATIO] = damping_ratio

    def refuse(self, reason: str) -> None:
        """Count a reference that is not accepted, and keep the reason."""
        self.refused += 1
        self.last_refusal = reason

    def hold(self, pose: np.ndarray) -> None:
        """Follow nothing, and hold a pose (x, y, z, qw, qx, qy, qz)."""
        self.following = False
        self._stop_progress, self._sequence = 1.0, 0
        self._target[:STIFFNESS] = 0.0
        self._target[POSE:POSE + 7] = pose

    def target(self, dt: float) -> np.ndarray:
        """
        Target of this tick, ``dt`` after the last one.

        :returns: `TARGET_SIZE` numbers, the same array every time
        """
        if self.following and self._age > self.settings.timeout + 1e-9:
            self.following = False
            self._stop_progress = 0.0
            self._last_twist = self._target[TWIST:TWIST + 6].copy()
        if not self.following:
            self._slow_down(dt)
        elif not self._fresh:
            self._extrapolate(dt)
        self._fresh = False
        self._age += dt
        return self._target

    def _out_of_sequence(self, origin: Origin) -> str | None:
        ahead = origin.sequence - self._sequence
        if not self._sequence or 0 < ahead <= LARGEST_GAP:
            return None
        return (f'sequence number {origin.sequence} does not follow {self._sequence}: there is '
                'more than one publisher of references')

    def _jump(self, target: np.ndarray) -> str | None:
        settings = self.settings
        distance, angle, ratio = _steps(self._target, target)
        if not distance <= settings.jump_position:
            return (f'the position jumps by {distance:.3g} m, '
                    f'expected at most {settings.jump_position:g} m')
        if not angle <= settings.jump_rotation:
            return (f'the rotation jumps by {angle:.3g} rad, '
                    f'expected at most {settings.jump_rotation:g} rad')
        if not ratio <= settings.jump_stiffness:
            return (f'the stiffness jumps by a factor of {math.exp(ratio):.3g}, '
                    f'expected at most {math.exp(settings.jump_stiffness):.3g}')
        return None

    def _extrapolate(self, dt: float) -> None:
        target = self._target
        if self.following and self._age <= ACCELERATION_S:
            target[TWIST:TWIST + 6] += dt * target[ACCELERATION:ACCELERATION + 6]
        else:
            target[ACCELERATION:ACCELERATION + 6] = 0.0
        extrapolate_pose(target, dt, target[POSE:POSE + 7])

    def _slow_down(self, dt: float) -> None:
        """Reduce the last velocity to zero within the stop time."""
        if self._stop_progress >= 1.0:
            return
        self._stop_progress = min(1.0, self._stop_progress + dt / self.settings.stop_time)
        self._target[TWIST:TWIST + 6] = (1.0 - smoothstep(self._stop_progress)) * self._last_twist
        self._extrapolate(dt)
