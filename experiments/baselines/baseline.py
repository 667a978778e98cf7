"""
Common parts of the compared primitives: phase, basis functions, regression and goal filter.

Each is integrated by Euler's method with the spacing of its demonstration, velocity first, as its
authors do. By default the derivatives are those that this scheme reproduces exactly: the methods
are compared, not their differencing. A cycle is one kernel, as ours is: the methods are compared,
not the languages.
"""
from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.forcing import basis, forcing
from gdmp_ros.errors import ParameterError
from gdmp_ros.kernels.cache import kernel
from gdmp_ros.learning.regression import regress
from gdmp_ros.manifolds.factors import work_size

#: Index of the numbers of a cycle: s = t/τ, h = dt/τ and the gains.
S, H, ALPHA_Z, ALPHA_X, ALPHA_G = range(5)


@kernel
def forcing_term(functions, weights, numbers, offset, scale, out):
    """``scale F - e_0 x``: the forcing term and the start term."""
    x = math.exp(-numbers[ALPHA_X] * numbers[S])
    forcing(functions, weights, numbers[S], x, out)
    for i in range(out.size):
        out[i] = scale[i] * out[i] - offset[i] * x


@kernel
def integrate_spring(numbers, error, force, velocity):
    """``τ ż = α_z (β_z (e + force) - z)`` over one cycle; advances the time."""
    h, alpha_z = numbers[H], numbers[ALPHA_Z]
    for i in range(velocity.size):
        target = 0.25 * alpha_z * (error[i] + force[i])
        velocity[i] += h * alpha_z * (target - velocity[i])
    numbers[S] += h


@kernel
def accelerate(functions, weights, numbers, error, offset, scale, velocity, force):
    """
    Integrate τ times the velocity over one cycle.

    ``τ ż = α_z (β_z (e - e_0 x + F) - z)`` with ``F = scale Σ w Ψ x / Σ Ψ``.

    :param error: e, from the current point to the goal
    :param offset: e_0; zeros if the method has no start term
    """
    forcing_term(functions, weights, numbers, offset, scale, force)
    integrate_spring(numbers, error, force, velocity)


class Baseline:
    """
    A primitive of another publication, learned from one demonstration.

    Subclasses define its spaces, its error and velocities, and one cycle.
    """

    #: Name with the citation number of [GDMP], and the publication.
    name: ClassVar[str]
    source: ClassVar[str]
    #: Kinds of manifold it was published for.
    spaces: ClassVar[tuple[str, ...]]
    #: Whether it has the start term ``e_0 x``; whether its forcing term is scaled by ``e_0``.
    start_term: ClassVar[bool] = True
    scaled: ClassVar[bool] = False

    def __init__(self, shown: Demonstration, n_basis: int = 60, alpha_z: float = 60.0,
                 alpha_x: float = 4.6052, alpha_g: float = 8.0, differences: str = 'matched'):
        """
        Learn.

        :param shown: uniform in time; its spacing is the cycle
        :param differences: ``matched`` to the integration, or ``backward`` as in [GDMP] eq. (20)
        :raises ParameterError: if the method is not defined on this space
        """
        if not self.handles(shown):
            raise ParameterError(f'{self.name} is not defined on {shown.manifold!r}')
        self.manifold, self.duration = shown.manifold, shown.duration
        self._shown = np.array(shown.flat_points)
        self._goal = self._shown[-1].copy()
        self._functions = basis(n_basis, alpha_x)
        self._gains, self._matched = (alpha_z, alpha_x, alpha_g), differences == 'matched'
        self._work = np.empty(4 * work_size(max(2, math.isqrt(shown.manifold.point_size))))
        self.learn()
        self.reset()

    @classmethod
    def handles(cls, shown: Demonstration) -> bool:
        """Whether the method is defined on the space of ``shown``."""
        return shown.manifold.kind in cls.spaces

    @property
    def dt(self) -> float:
        """Duration of a cycle [s]."""
        return self.duration / (len(self._shown) - 1)

    def errors(self) -> np.ndarray:
        """Error e at each sample, in the coordinates of the method."""
        raise NotImplementedError

    def start_error(self) -> np.ndarray:
        """e_0, from the start to the current goal."""
        raise NotImplementedError

    def rates(self) -> np.ndarray:
        """Velocity between neighbouring samples [1/s], in the coordinates of the method."""
        raise NotImplementedError

    def _step(self) -> None:
        """Advance by one cycle."""
        raise NotImplementedError

    def step(self) -> np.ndarray:
        """
        Advance by one cycle.

        :returns: the flat point that the equations of the method give
        """
        self._step()
        if self._moving:
            self._anchor(self.start_error())
        return np.asarray(self._point)

    def output(self, raw: np.ndarray) -> np.ndarray:
        """Flat point for the robot; only [4] has to project it."""
        return raw

    def retarget(self, goal: np.ndarray) -> None:
        """Switch to a new goal (shape ``point_shape``)."""
        self._new_goal = self.manifold.flat(self.manifold.align(
            goal, self._goal.reshape(self.manifold.point_shape))).copy()
        self._moving = True

    def reset(self, dt: float | None = None) -> None:
        """
        Restart at the first sample of the demonstration, with its velocity.

        :param dt: duration of a cycle [s]; the spacing of the demonstration by default
        """
        alpha_z, alpha_x, alpha_g = self._gains
        self._cycle_s = dt or self.dt
        self._numbers = np.array([0.0, self._cycle_s / self.duration, alpha_z, alpha_x, alpha_g])
        self._moving = False
        self._anchor(self._first_error)
        self._start, self._point = self._shown[0].copy(), self._shown[0].copy()
        self._goal, self._new_goal = self._shown[-1].copy(), self._shown[-1].copy()
        self._velocity = self._begin.copy()
        self._error, self._force = np.empty((2, self._velocity.size))

    def rollout(self, cycles: int, goal: np.ndarray | None = None, switch: int = 0,
                dt: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """
        Run from the start.

        :param goal: new goal from cycle ``switch`` on
        :param dt: duration of a cycle [s]; the spacing of the demonstration by default
        :returns: points for the robot and as the equations give them, flat, one row per sample
        """
        self.reset(dt)
        raw = [self._shown[0].copy()]
        for cycle in range(cycles):
            if goal is not None and cycle == switch:
                self.retarget(goal)
            raw.append(self.step().copy())
        return np.array([self.output(point) for point in raw]), np.array(raw)

    def _changes(self) -> tuple[np.ndarray, np.ndarray]:
        """τ times the velocity at the beginning of each cycle, and its change in the cycle."""
        z = self.duration * self.rates()
        if self._matched:
            # Extrapolate the velocity before the first cycle.
            before = np.vstack([2.0 * z[0] - z[1], z[:-1]])
            return before, z - before
        before = np.vstack([z[0], z[:-1]])
        return before, np.diff(before, axis=0, prepend=before[:1])

    def _to_weights(self, vectors: np.ndarray) -> np.ndarray:
        """Transport vectors at the samples to the tangent space of the weights."""
        return vectors

    def _anchor(self, error: np.ndarray) -> None:
        """Set start term and scale to e_0, if the method has them."""
        self._offset = error.copy() if self.start_term else np.zeros(error.size)
        self._scale = np.ones(error.size)
        if self.scaled:
            self._scale = np.where(np.abs(error) > 1e-9, error, 1e-9)

    def learn(self) -> None:
        """Learn the weights; called by the constructor."""
        alpha_z, alpha_x, _ = self._gains
        errors, h = self.errors(), self.dt / self.duration
        before, change = self._changes()
        self._begin = before[0].copy()
        s = h * np.arange(len(before))
        self._first_error = np.array(errors[0])
        self._anchor(self._first_error)
        demanded = (change / h + alpha_z * before) / (0.25 * alpha_z * alpha_z)
        target = (self._to_weights(demanded - errors[:-1])
                  + np.exp(-alpha_x * s)[:, None] * self._offset)
        self._weights = regress(self._functions, alpha_x, s, target / self._scale)

    def _cycle(self) -> tuple[Any, ...]:
        """Arguments of `accelerate`."""
        return (self._functions, self._weights, self._numbers, self._error, self._offset,
                self._scale, self._velocity, self._force)
