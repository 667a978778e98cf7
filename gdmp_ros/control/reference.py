"""Between a stream of references and the controller: checks, time-out, smooth return."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdmp_ros.control.impedance import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
)
from gdmp_ros.manifolds import UnitQuaternion

_S3 = UnitQuaternion()
#: A message's quaternion may deviate this much from unit norm; it is then normalised.
QUATERNION_TOLERANCE = 1e-3


@dataclass(frozen=True)
class GuardSettings:
    """
    How references are treated.

    :ivar frame: the only ``frame_id`` accepted
    :ivar timeout: without a good reference for this long the arm stops and holds [s]
    :ivar stop_time: the speed of the last reference fades over this [s]
    :ivar fade_time: the difference to a stream that (re)appears fades over this [s]
    """

    frame: str = 'panda_link0'
    timeout: float = 0.1
    stop_time: float = 0.3
    fade_time: float = 0.5


def refusal(target: np.ndarray, frame: str, expected: str) -> str | None:
    """
    Why a reference must not be followed, None where it may.

    :param target: `TARGET_SIZE` numbers (`gdmp_ros.control.impedance`)
    """
    if frame != expected:
        return f'frame is {frame!r}, expected {expected!r}'
    if not np.isfinite(target).all():
        return 'a number is NaN or infinite'
    norm = float(np.linalg.norm(target[POSE + 3:POSE + 7]))
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        return f'quaternion norm is {norm:.6g}, expected 1 within {QUATERNION_TOLERANCE:g}'
    stiffness = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
    skew = np.abs(stiffness - stiffness.T).max()
    if skew > 1e-6 * max(np.abs(stiffness).max(), 1e-12):
        return f'stiffness is not symmetric: entries differ by {skew:.3g}'
    try:
        np.linalg.cholesky(stiffness)
    except np.linalg.LinAlgError:
        return (f'stiffness is not positive definite: smallest eigenvalue is '
                f'{np.linalg.eigvalsh(stiffness)[0]:.4g}')
    if not target[DAMPING_RATIO] >= 0.0:
        return f'damping ratio is {target[DAMPING_RATIO]:.3g}, expected at least 0'
    return None


class ReferenceGuard:
    """
    Turns references as they come into a target at every tick.

    Good references are followed; when they stop, the motion stops smoothly and the pose is held;
    when they return elsewhere, the difference fades instead of being jumped over.
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
        self._given = self._hold(pose, stiffness, damping_ratio)
        self._target = self._given.copy()
        self._since = np.inf
        self._shift = np.zeros(3)
        self._turn = np.zeros(3)
        self._faded = 1.0
        self._stopped = 1.0
        self._last_twist = np.zeros(6)

    @staticmethod
    def _hold(pose: np.ndarray, stiffness: np.ndarray, damping_ratio: float) -> np.ndarray:
        target = np.zeros(TARGET_SIZE)
        target[POSE:POSE + 7] = pose
        target[STIFFNESS:STIFFNESS + 36] = np.asarray(stiffness).reshape(-1)
        target[DAMPING_RATIO] = damping_ratio
        return target

    def offer(self, target: np.ndarray, frame: str) -> bool:
        """Take a reference, or refuse, count and explain it; the last good one stays in force."""
        reason = refusal(target, frame, self.settings.frame)
        if reason is not None:
            self.refused += 1
            self.last_refusal = reason
            return False
        target[POSE + 3:POSE + 7] /= np.linalg.norm(target[POSE + 3:POSE + 7])
        if not self.following:
            self._begin_fade(target)
        self.following = True
        self._given = target
        self._since = 0.0
        return True

    def target(self, dt: float) -> np.ndarray:
        """
        Target of this tick, ``dt`` after the last one.

        :returns: `TARGET_SIZE` numbers
        """
        if self.following and self._since > self.settings.timeout + 1e-9:
            self.following = False
            self._stopped = 0.0
        if self.following:
            self._follow(dt)
        else:
            self._stop(dt)
        self._since += dt
        return self._target

    def _begin_fade(self, target: np.ndarray) -> None:
        held = self._target
        self._shift = held[POSE:POSE + 3] - target[POSE:POSE + 3]
        wanted = _S3.align(target[POSE + 3:POSE + 7], held[POSE + 3:POSE + 7])
        self._turn = _S3.log(wanted, held[POSE + 3:POSE + 7])
        self._faded = 0.0

    def _follow(self, dt: float) -> None:
        # A copy: between two references the last one is extrapolated by nothing but its pose.
        self._target[:] = self._given
        if self._faded >= 1.0:
            return
        self._faded = min(1.0, self._faded + dt / self.settings.fade_time)
        u = self._faded
        left = 1.0 - u * u * u * (10.0 - u * (15.0 - 6.0 * u))
        self._target[POSE:POSE + 3] += left * self._shift
        self._target[POSE + 3:POSE + 7] = _S3.exp(self._given[POSE + 3:POSE + 7],
                                                  left * self._turn)

    def _stop(self, dt: float) -> None:
        """Let the last speed fade, then stand."""
        target = self._target
        if self._stopped >= 1.0:
            return
        if self._stopped == 0.0:
            self._last_twist = target[TWIST:TWIST + 6].copy()
        u = self._stopped = min(1.0, self._stopped + dt / self.settings.stop_time)
        target[TWIST:TWIST + 6] = (1.0 - u * u * (3.0 - 2.0 * u)) * self._last_twist
        target[ACCELERATION:ACCELERATION + 6] = 0.0
        target[POSE:POSE + 3] += dt * target[TWIST:TWIST + 3]
        target[POSE + 3:POSE + 7] = _S3.exp(target[POSE + 3:POSE + 7],
                                            0.5 * dt * target[TWIST + 3:TWIST + 6])
