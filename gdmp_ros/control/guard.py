"""Between a stream of references and the controller: checks, time-out, smooth stop."""
from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gdmp_ros.compilation import compiled
from gdmp_ros.control.governor import moved
from gdmp_ros.control.impedance import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    rotation_error,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
)
from gdmp_ros.control.tank import relative_modes

#: A message's quaternion may deviate this much from unit norm; it is then normalised.
QUATERNION_TOLERANCE = 1e-3
#: A stiffness may deviate from symmetry by this share of its largest entry.
SKEW = 1e-6
#: Pivots of a stiffness below this share of its largest entry count as not positive.
PIVOT = 1e-9
#: No number of a reference is larger; their products stay finite.
LARGEST = 1e6
MOST_DAMPED = 2.0
#: No reference moves faster, before any limit of the arm's own [m/s, rad/s].
FASTEST = 10.0
#: Between two references the last one is carried on with its acceleration for so long [s].
ACCELERATED_S = 0.01
#: A stream may skip this many sequence numbers while it is being followed.
MOST_SKIPPED = 10_000


@dataclass(frozen=True)
class GuardSettings:
    """
    How references are treated.

    :ivar frame: the only ``frame_id`` accepted
    :ivar timeout: without a good reference for this long the arm stops and holds [s]
    :ivar stop_time: the speed of the last reference fades over this [s]
    :ivar stamp_tolerance: largest difference between a stamp and the present time [s]
    :ivar jump_position: largest step of a stream that is being followed [m]
    :ivar jump_rotation: the same for its rotation [rad]
    :ivar jump_stiffness: the same for its stiffness: log of the ratio in any direction
    """

    frame: str = 'panda_link0'
    timeout: float = 0.1
    stop_time: float = 0.3
    stamp_tolerance: float = 0.5
    jump_position: float = 0.05
    jump_rotation: float = 0.2
    jump_stiffness: float = 1.0


@dataclass(frozen=True)
class Origin:
    """
    Where a reference comes from.

    :ivar age: present time less its stamp [s]
    :ivar sequence: number in its stream; 0 where there is none
    """

    frame: str
    age: float = 0.0
    sequence: int = 0


def refusal(target: np.ndarray, origin: Origin, settings: GuardSettings) -> str | None:
    """
    Why a reference must not be followed, None where it may.

    :param target: `TARGET_SIZE` numbers (`gdmp_ros.control.impedance`)
    """
    if origin.frame != settings.frame:
        return f'frame is {origin.frame!r}, expected {settings.frame!r}'
    if abs(origin.age) > settings.stamp_tolerance:
        side = 'past' if origin.age > 0.0 else 'future'
        return (f'stamp is {abs(origin.age):.3g} s in the {side}, expected within '
                f'{settings.stamp_tolerance:g} s: the clocks of the machines differ, or simulated '
                'and wall time are mixed')
    return _describe(target) if _unfit(target) else None


@compiled
def _unfit(target):
    """Whether a target has a number that is not finite, or a part that is not on its manifold."""
    for i in range(target.size):
        # False for NaN too.
        if not abs(target[i]) <= LARGEST:
            return True
    if not 0.0 <= target[DAMPING_RATIO] <= MOST_DAMPED:
        return True
    for i in range(TWIST, ACCELERATION):
        if abs(target[i]) > FASTEST:
            return True
    norm = 0.0
    for i in range(POSE + 3, POSE + 7):
        norm += target[i] * target[i]
    if abs(math.sqrt(norm) - 1.0) > QUATERNION_TOLERANCE:
        return True
    stiffness, largest = target[STIFFNESS:STIFFNESS + 36], 0.0
    for i in range(36):
        largest = max(largest, abs(stiffness[i]))
    for i in range(6):
        for j in range(i):
            if abs(stiffness[6 * i + j] - stiffness[6 * j + i]) > SKEW * largest:
                return True
    # Positive definite where every pivot of the elimination is positive.
    left = stiffness.copy()
    for k in range(6):
        if not left[7 * k] > PIVOT * largest:
            return True
        for i in range(k + 1, 6):
            factor = left[6 * i + k] / left[7 * k]
            for j in range(k + 1, 6):
                left[6 * i + j] -= factor * left[6 * k + j]
    return False


def _describe(target: np.ndarray) -> str:
    """Say what makes a target unfit."""
    if not np.isfinite(target).all():
        return 'a number is NaN or infinite'
    largest = float(np.abs(target).max())
    if largest > LARGEST:
        return f'a number is {largest:.3g}, expected at most {LARGEST:g}'
    fastest = float(np.abs(target[TWIST:ACCELERATION]).max())
    if fastest > FASTEST:
        return f'the twist is {fastest:.3g} m/s or rad/s, expected at most {FASTEST:g}'
    norm = float(np.linalg.norm(target[POSE + 3:POSE + 7]))
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        return f'quaternion norm is {norm:.6g}, expected 1 within {QUATERNION_TOLERANCE:g}'
    stiffness = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
    skew = np.abs(stiffness - stiffness.T).max()
    if skew > SKEW * np.abs(stiffness).max():
        return f'stiffness is not symmetric: entries differ by {skew:.3g}'
    if not 0.0 <= target[DAMPING_RATIO] <= MOST_DAMPED:
        return f'damping ratio is {target[DAMPING_RATIO]:.3g}, expected 0 to {MOST_DAMPED:g}'
    scale = max(float(np.abs(stiffness).max()), 1e-300)
    least = scale * np.linalg.eigvalsh(stiffness / scale)[0]
    return f'stiffness is not positive definite: smallest eigenvalue is {least:.4g}'


@compiled
def _steps(last, target):
    """Position step [m], turn [rad], and largest |log| of a ratio of the stiffnesses."""
    error, values, modes = np.empty(3), np.empty(6), np.empty(36)
    step = 0.0
    for i in range(3):
        step += (target[POSE + i] - last[POSE + i]) ** 2
    rotation_error(last[POSE + 3:POSE + 7], target[POSE + 3:POSE + 7], error)
    relative_modes(last[STIFFNESS:STIFFNESS + 36], target[STIFFNESS:STIFFNESS + 36], values,
                   modes)
    change = 0.0
    for i in range(6):
        change = max(change, abs(math.log(max(values[i], 1e-300))))
    return (math.sqrt(step), math.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2), change)


class ReferenceGuard:
    """
    Turns references as they come into a target at every tick.

    Good references are followed, and carried on with their own velocity between two of them; when
    they stop, the motion stops smoothly and the pose is held. A stream that is being followed must
    not jump; after a time-out any stream is accepted, and caught up with at a bounded speed
    (`gdmp_ros.control.governor`).
    """

    def __init__(self, settings: GuardSettings, pose: np.ndarray, stiffness: np.ndarray,
                 damping_ratio: float):
        """
        Hold a pose until the first reference.

        :param pose: (x, y, z, qw, qx, qy, qz)
        :param stiffness: 6×6 [N/m, Nm/rad]
        """
        self.settings = settings
        self.refused = 0
        self.last_refusal = ''
        self.following = False
        self._target = np.zeros(TARGET_SIZE)
        self._target[POSE:POSE + 7] = pose
        self._target[STIFFNESS:STIFFNESS + 36] = np.asarray(stiffness).reshape(-1)
        self._target[DAMPING_RATIO] = damping_ratio
        self._since = np.inf
        self._fresh = False
        self._sequence = 0
        self._stopped = 1.0
        self._last_twist = np.zeros(6)

    def offer(self, target: np.ndarray, origin: Origin) -> bool:
        """Take a reference, or refuse, count and explain it; the last good one stays in force."""
        reason = refusal(target, origin, self.settings)
        if reason is None and self.following:
            reason = self._strange(origin) or self._jump(target)
        if reason is not None:
            self.refuse(reason)
            return False
        target[POSE + 3:POSE + 7] /= np.linalg.norm(target[POSE + 3:POSE + 7])
        self._target[:] = target
        self.following = self._fresh = True
        self._sequence = origin.sequence
        self._since = 0.0
        return True

    def configure(self, settings: GuardSettings, damping_ratio: float) -> None:
        """Use other settings from now on, and another damping ratio while nothing is followed."""
        self.settings = settings
        if not self.following:
            self._target[DAMPING_RATIO] = damping_ratio

    def refuse(self, reason: str) -> None:
        """Count a reference that is not taken, and say why."""
        self.refused += 1
        self.last_refusal = reason

    def hold(self, pose: np.ndarray) -> None:
        """Follow nothing, and hold a pose (x, y, z, qw, qx, qy, qz)."""
        self.following = False
        self._stopped, self._sequence = 1.0, 0
        self._target[:STIFFNESS] = 0.0
        self._target[POSE:POSE + 7] = pose

    def target(self, dt: float) -> np.ndarray:
        """
        Target of this tick, ``dt`` after the last one.

        :returns: `TARGET_SIZE` numbers, the same array every time
        """
        if self.following and self._since > self.settings.timeout + 1e-9:
            self.following = False
            self._stopped = 0.0
            self._last_twist = self._target[TWIST:TWIST + 6].copy()
        if not self.following:
            self._stop(dt)
        elif not self._fresh:
            self._carry_on(dt)
        self._fresh = False
        self._since += dt
        return self._target

    def _strange(self, origin: Origin) -> str | None:
        """Why a reference does not belong to the stream that is being followed."""
        ahead = origin.sequence - self._sequence
        if not self._sequence or 0 < ahead <= MOST_SKIPPED:
            return None
        return (f'sequence number {origin.sequence} does not follow {self._sequence}: there is '
                'more than one publisher of references')

    def _jump(self, target: np.ndarray) -> str | None:
        settings = self.settings
        step, turn, change = _steps(self._target, target)
        if not step <= settings.jump_position:
            return f'the position jumps by {step:.3g} m, expected {settings.jump_position:g} m'
        if not turn <= settings.jump_rotation:
            return f'the rotation jumps by {turn:.3g} rad, expected {settings.jump_rotation:g} rad'
        if not change <= settings.jump_stiffness:
            return (f'the stiffness jumps by a factor of {math.exp(change):.3g}, '
                    f'expected {math.exp(settings.jump_stiffness):.3g}')
        return None

    def _carry_on(self, dt: float) -> None:
        target = self._target
        if self.following and self._since <= ACCELERATED_S:
            target[TWIST:TWIST + 6] += dt * target[ACCELERATION:ACCELERATION + 6]
        else:
            target[ACCELERATION:ACCELERATION + 6] = 0.0
        moved(target, dt, target[POSE:POSE + 7])

    def _stop(self, dt: float) -> None:
        """Let the last speed fade, then stand."""
        if self._stopped >= 1.0:
            return
        target = self._target
        u = self._stopped = min(1.0, self._stopped + dt / self.settings.stop_time)
        target[TWIST:TWIST + 6] = (1.0 - u * u * (3.0 - 2.0 * u)) * self._last_twist
        self._carry_on(dt)
