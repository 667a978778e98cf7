"""Unit quaternions by a classical primitive in the logarithm of the error."""
from __future__ import annotations

import numpy as np

from experiments.baselines.baseline import accelerate, Baseline, H
from gdmp_ros.kernels import kernel
from gdmp_ros.manifolds.quaternion import exp, log, UnitQuaternion

S3 = UnitQuaternion()


@kernel
def _step(functions, weights, numbers, error, offset, scale, velocity, force, point, goal, work):
    """``e = 2 Log(Q_g * conj(Q))`` converges to 0 in Euclidean space; the velocity is -τ ė."""
    log(3, point, goal, error, work)
    for i in range(3):
        error[i] *= 2.0
    accelerate(functions, weights, numbers, error, offset, scale, velocity, force)
    for i in range(3):
        error[i] -= numbers[H] * velocity[i]
        force[i] = -0.5 * error[i]
    # Q = conj(Exp(e/2)) * Q_g
    exp(3, goal, force, point, work)


class LogError(Baseline):
    """
    A Euclidean primitive in ``e = 2 Log(Q_g * conj(Q))``.

    A new goal acts at once: e and ė are computed again, so that the motion is continuous.
    """

    name = '[9] logarithm of the error'
    source = 'Koutras, Doulgeri 2020'
    spaces = ('quaternion',)

    def errors(self) -> np.ndarray:
        """``e``, the rotation vector to the goal [rad]."""
        return np.array([2.0 * S3.log(q, self._shown[-1]) for q in self._shown])

    def rates(self) -> np.ndarray:
        """``-ė`` [rad/s]."""
        return np.asarray(-np.diff(self.errors(), axis=0) / self.dt)

    def start_error(self) -> np.ndarray:
        """``e`` at the start [rad]."""
        return np.asarray(2.0 * S3.log(self._start, self._goal))

    def reset(self, dt: float | None = None) -> None:
        """Restart at the first sample."""
        super().reset(dt)
        # The point one cycle before the first.
        back = S3.log(self._start, self._goal) + 0.5 * self._cycle_s * self._begin / self.duration
        self._before = S3.exp(self._goal, -back)

    def _step(self) -> None:
        self._before = self._point.copy()
        _step(*self._cycle(), self._point, self._goal, self._work)

    def retarget(self, goal: np.ndarray) -> None:
        """Compute ``e`` and ``ė`` with respect to the new goal."""
        super().retarget(goal)
        self._goal = self._new_goal.copy()
        after, before = (S3.log(q, self._goal) for q in (self._point, self._before))
        self._velocity = -2.0 * self.duration * (after - before) / self._cycle_s
        self._anchor(self.start_error())


class LogErrorShorter(LogError):
    """
    The same with a logarithm of the smaller rotation, as many implementations compute it.

    Where the motion passes half a turn from its goal, e changes its sign.
    """

    name = '[9] with the shorter logarithm'

    def errors(self) -> np.ndarray:
        """``e`` with the sign of Q that makes it shorter [rad]."""
        goal = self._shown[-1]
        return np.array([2.0 * S3.log(q, S3.align(goal, q)) for q in self._shown])

    def _step(self) -> None:
        self._goal = S3.align(self._goal, self._point)
        super()._step()
