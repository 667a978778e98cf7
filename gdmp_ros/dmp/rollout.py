"""A motion under way: the only state that moves."""
from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp import stepping as st
from gdmp_ros.dmp.forcing import basis
from gdmp_ros.dmp.skill import carry_frame, in_frame, Skill, Trajectory
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.registry import factor_table

#: How near every factor must be to the goal: [m], [rad], half-angle [rad], [rad], [1].
TOLERANCES = {'euclidean': 0.0005, 'sphere': 0.0025, 'quaternion': 0.00125, 'rotation': 0.0025,
              'spd': 0.0025}
#: Fastest tempo `Rollout.set_speed` accepts.
MAX_SPEED = 2.0


class State(NamedTuple):
    """
    One moment of a motion.

    :ivar time: since the roll-out began [s]
    :ivar phase: x, from 1 towards 0
    :ivar point: shape ``point_shape``
    :ivar velocity: tangent at the point [1/s], shape ``(tangent_size,)``
    :ivar acceleration: covariant, at the point [1/s²], shape ``(tangent_size,)``
    """

    time: float
    phase: float
    point: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


class Rollout:
    """
    Executes a skill: `advance` lets time pass, `retarget` and `set_speed` act at any moment.

    Not to be shared between threads. `flags` tells what happened: ``cut_locus`` (the goal was met
    exactly opposite; the motion went on along its last direction), ``held`` (a step was not
    finite; the last state is kept), ``not_settled`` (finished without reaching the goal's
    tolerance).
    """

    def __init__(self, skill: Skill, start: np.ndarray | None = None,
                 goal: np.ndarray | None = None, duration: float | None = None,
                 velocity: np.ndarray | None = None, *, speed: float = 1.0,
                 speed_rate: float = 5.0, tolerances: Sequence[float] | None = None):
        """
        Begin at the skill's start, or elsewhere.

        :param start: point; the skill's frame is carried to it along the geodesic
        :param goal: point, from the beginning; the skill's by default
        :param duration: of the motion at speed 1 [s]
        :param velocity: tangent at the start [1/s] at speed 1; the demonstrated one by default
        :param speed: tempo at the beginning, 0 to 2
        :param speed_rate: largest change of the tempo [1/s]
        :param tolerances: distance to the goal at which each factor counts as arrived
        :raises ManifoldError: if a point is not on the manifold
        :raises CutLocusError: if start and goal are on each other's cut locus
        :raises ParameterError: if a number is out of range
        """
        self.skill = skill
        manifold = skill.manifold
        self._table = factor_table(manifold.factors)
        self._functions = basis(skill.n_basis, skill.gains.alpha_x)
        self._weights = skill.weights.copy()  # kernels take writable arrays only
        first = self._aligned(start, skill.start)
        last = self._aligned(goal, skill.goal)
        frame = (skill.frame.copy() if start is None
                 else carry_frame(manifold, skill.frame, first))
        coordinates = skill.velocity
        self._numbers = self._initial_numbers(duration, speed, speed_rate)
        if velocity is not None:
            coordinates = self._numbers[st.DURATION] * in_frame(manifold, frame, velocity)
        self._tolerances = self._checked_tolerances(tolerances)
        self._gains = self._step_gains()
        self._allocate(first, last, frame, coordinates)

    def advance(self, dt: float) -> State:
        """
        Let ``dt`` seconds pass and return the state then.

        :param dt: 0 or more [s]; the path does not depend on how time is cut into steps
        """
        out = np.empty((1, self._out_size))
        self._durations[0] = dt
        self._advance(out, self._durations)
        return self._view(out[0])

    def sample(self, times: np.ndarray) -> Trajectory:
        """
        Advance through ``times`` (elapsed, not decreasing, [s]) in one compiled call.

        :raises ParameterError: if a time lies before the previous one
        """
        times = np.asarray(times, dtype=np.float64)
        steps = np.diff(times, prepend=self._numbers[st.TIME])
        if not (steps >= 0.0).all():
            raise ParameterError('sample: times must not decrease, nor lie before the present')
        out = np.empty((len(times), self._out_size))
        self._advance(out, steps)
        size = self._points.shape[1]
        return Trajectory(times, out[:, :size].reshape(len(times), *self._shape),
                          out[:, size:size + self._vectors.shape[1]])

    @property
    def state(self) -> State:
        """The present moment, without letting time pass."""
        return self.advance(0.0)

    def retarget(self, goal: np.ndarray) -> None:
        """
        Switch to a new goal; the present one moves there along the geodesic, [GDMP] eq. (28).

        :param goal: point; its representative (±q) nearest to the present goal is taken
        :raises ManifoldError: if it is not a point; nothing has changed then
        :raises CutLocusError: if it lies opposite to the present goal; nothing has changed then
        """
        numbers, points = self._numbers, self._points
        manifold = self.skill.manifold
        new = manifold.align(manifold.check_point(goal), self.goal)
        switched = (numbers[st.INTERVAL] + 1.0) / numbers[st.STEPS]
        present = self._goal_at(switched)
        self._vectors[st.DIRECTION] = manifold.log(present, new)
        points[st.GOAL_FROM] = present.reshape(-1)
        points[st.GOAL_NEW] = new.reshape(-1)
        numbers[st.SWITCHED] = switched
        numbers[st.MOVING] = 1.0
        numbers[st.FINISHED] = numbers[st.NOT_SETTLED] = 0.0

    def set_speed(self, scale: float) -> None:
        """
        Change the tempo to ``scale`` (1 as shown, 0 a stop) at the bounded rate; the path stays.

        :raises ParameterError: outside 0 … 2
        """
        self._numbers[st.SPEED_GOAL] = _in_range('speed', scale, 0.0, MAX_SPEED)

    @property
    def speed(self) -> float:
        """Present tempo."""
        return float(self._numbers[st.SPEED])

    @property
    def progress(self) -> float:
        """``s = ∫ dt/τ``: 1 at the nominal end, and runs on."""
        return float(self._numbers[st.S])

    @property
    def goal(self) -> np.ndarray:
        """The goal last asked for, shape ``point_shape``."""
        return np.array(self._points[st.GOAL_NEW].reshape(self._shape))

    @property
    def duration(self) -> float:
        """Duration at speed 1 [s]."""
        return float(self._numbers[st.DURATION])

    @property
    def finished(self) -> bool:
        """
        Whether the motion is over.

        From the nominal end on, once every factor is within its tolerance of the goal; or at
        ``s >= max(2, s_switch + 1)``, then with the flag ``not_settled``. A new goal reopens it.
        """
        return bool(self._numbers[st.FINISHED] > 0.0)

    @property
    def flags(self) -> set[str]:
        """What happened so far."""
        named = {'cut_locus': st.CUT_LOCUS, 'held': st.HELD, 'not_settled': st.NOT_SETTLED}
        return {name for name, entry in named.items() if self._numbers[entry] > 0.0}

    def _advance(self, out: np.ndarray, durations: np.ndarray) -> None:
        st.advance(self._table, self._gains, self._functions, self._weights, self._tolerances,
                   self._numbers, self._frames, self._points, self._vectors, out, durations)

    def _goal_at(self, s: float) -> np.ndarray:
        if self._numbers[st.MOVING] == 0.0:
            return np.array(self._points[st.GOAL].reshape(self._shape))
        elapsed = self._numbers[st.ALPHA_G] * (s - self._numbers[st.SWITCHED])
        return self.skill.manifold.exp(self._points[st.GOAL_FROM].reshape(self._shape),
                                       -math.expm1(-elapsed) * self._vectors[st.DIRECTION])

    def _aligned(self, given: np.ndarray | None, default: np.ndarray) -> np.ndarray:
        if given is None:
            return default
        manifold = self.skill.manifold
        return manifold.align(manifold.check_point(given), default)

    def _initial_numbers(self, duration: float | None, speed: float,
                         speed_rate: float) -> np.ndarray:
        skill, numbers = self.skill, np.zeros(st.NUMBERS)
        numbers[st.INTERVAL] = -1.0
        numbers[st.SPEED] = numbers[st.SPEED_GOAL] = _in_range('speed', speed, 0.0, MAX_SPEED)
        numbers[st.SPEED_RATE] = _in_range('speed_rate', speed_rate, 1e-6, math.inf)
        numbers[st.DURATION] = (skill.duration if duration is None
                                else _in_range('duration', duration, 1e-3, 1e6))
        numbers[st.STEPS] = skill.steps
        numbers[st.ALPHA_X] = skill.gains.alpha_x
        numbers[st.ALPHA_G] = skill.gains.alpha_g
        numbers[st.PARALLEL] = float(skill.connection == 'parallel')
        return numbers

    def _checked_tolerances(self, tolerances: Sequence[float] | None) -> np.ndarray:
        factors = self.skill.manifold.factors
        if tolerances is None:
            tolerances = [TOLERANCES[factor.kind] for factor in factors]
        array = np.asarray(tolerances, dtype=np.float64)
        if array.shape != (len(factors),) or not (array > 0.0).all():
            raise ParameterError(f'tolerances: expected {len(factors)} numbers > 0, '
                                 f'got {tolerances!r}')
        return array

    def _step_gains(self) -> np.ndarray:
        gains, size = self.skill.gains, self.skill.manifold.tangent_size
        decay = -gains.alpha_z / self.skill.steps
        rows = np.empty((2, size))
        rows[st.DECAY] = math.exp(decay)
        rows[st.PULL] = -math.expm1(decay) * gains.beta_z
        return rows

    def _allocate(self, start: np.ndarray, goal: np.ndarray, frame: np.ndarray,
                  coordinates: np.ndarray) -> None:
        manifold = self.skill.manifold
        self._shape = manifold.point_shape
        self._frames = np.zeros((st.FRAME_ROWS, manifold.frame_size))
        self._points = np.zeros((st.POINT_ROWS, start.size))
        self._vectors = np.zeros((st.VECTOR_ROWS, manifold.tangent_size))
        self._out_size = start.size + 2 * manifold.tangent_size
        self._frames[[st.START, st.NODE]] = frame
        self._points[[st.START, st.NODE]] = start.reshape(-1)
        self._points[[st.GOAL, st.GOAL_FROM, st.GOAL_NEW]] = goal.reshape(-1)
        self._vectors[st.Z] = coordinates
        if self.skill.connection == 'published':
            manifold._apply(ops.VECTOR, frame, np.array(coordinates), self._vectors[st.Z])
        # Refused here rather than flagged later: nothing has moved yet.
        self._vectors[st.TO_GOAL] = manifold.log(start, goal)
        self._durations = np.zeros(1)
        self.advance(0.0)

    def _view(self, out: np.ndarray) -> State:
        numbers = self._numbers
        size, count = self._points.shape[1], self._vectors.shape[1]
        point = out[:size]
        if len(self._shape) > 1:
            point = point.reshape(self._shape)
        phase = math.exp(-numbers[st.ALPHA_X] * numbers[st.S])
        return State(float(numbers[st.TIME]), phase, point,
                     out[size:size + count], out[size + count:])


def _in_range(name: str, value: float, low: float, high: float) -> float:
    if not (isinstance(value, (int, float, np.number)) and low <= value <= high):
        raise ParameterError(f'{name} is {value!r}, expected a number from {low:g} to {high:g}')
    return float(value)
