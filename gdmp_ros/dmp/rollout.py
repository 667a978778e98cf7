"""A motion under way: the only state that moves."""
from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from gdmp_ros.dmp import memory as mem
from gdmp_ros.dmp import stepping as st
from gdmp_ros.dmp.development import distances
from gdmp_ros.dmp.forcing import basis
from gdmp_ros.dmp.forcing import forcing as forcing_term
from gdmp_ros.dmp.options import in_range, MAX_SPEED, Options, options_of
from gdmp_ros.dmp.segments import targets
from gdmp_ros.dmp.skill import carry_frame, in_frame, Skill, Trajectory
from gdmp_ros.dmp.state import State
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.registry import factor_table

# Looked up once: `Rollout.advance` is called a thousand times a second.
_advance, _empty, _new = st.advance, np.empty, object.__new__

#: A start with a given acceleration is fitted to the motion over this part of a duration.
_PUSH = 0.1


class Rollout:
    """
    Executes a skill: `advance` lets time pass, `retarget` and `set_speed` act at any moment.

    Not to be shared between threads. `flags` tells what happened: ``cut_locus`` (start, point or
    goal were exactly opposite each other: one of the shortest ways was taken), ``held`` (a step
    was not finite; the last state is kept), ``not_settled`` (finished without reaching the goal's
    tolerance).
    """

    def __init__(self, skill: Skill, start: np.ndarray | None = None,
                 goal: np.ndarray | None = None, duration: float | None = None,
                 velocity: np.ndarray | None = None, *, acceleration: np.ndarray | None = None,
                 options: Options | None = None, **settings: float | Sequence[float] | None):
        """
        Begin at the skill's start, or elsewhere.

        :param start: point; the skill's frame is carried to it along the geodesic
        :param goal: point, from the beginning; the skill's by default
        :param duration: of the motion at speed 1 [s]
        :param velocity: tangent at the start [1/s] that the motion begins with; the demonstrated
            one (at the initial speed) by default
        :param acceleration: tangent at the start [1/s²] that the motion begins with; by default
            zero where a velocity is given, otherwise the demonstrated one
        :param options: see `Options`; single ones may be given by name instead
        :raises ManifoldError: if a point is not on the manifold
        :raises ParameterError: if a number is out of range
        """
        self.skill = skill
        manifold = skill.manifold
        self._options = options_of(options, settings)
        self._options.check(manifold)
        first = self._aligned(start, skill.start)
        last = self._aligned(goal, skill.goal)
        opposite = False
        frame = skill.frame.copy()
        if start is not None:
            frame, opposite = carry_frame(manifold, skill.frame, first)
        self._allocate()
        self._set_numbers(duration)
        self._place(first, last, frame)
        self._numbers[mem.CUT_LOCUS] = float(opposite)
        if velocity is not None:
            self._begin_with(frame, velocity, acceleration)
        elif acceleration is not None:
            raise ParameterError('an initial acceleration needs an initial velocity beside it')
        self.advance(0.0)

    def advance(self, dt: float) -> State:
        """
        Let ``dt`` seconds pass and return the state then.

        :param dt: 0 or more [s]; the path does not depend on how time is cut into steps
        """
        out = _empty(self._out_size)
        out[0] = dt
        _advance(self._memory, out)
        state = _new(State)
        state._numbers = out
        state._manifold = self._manifold
        return state

    def sample(self, times: np.ndarray) -> Trajectory:
        """
        Advance through ``times`` (elapsed, not decreasing, [s]) in one compiled call.

        :raises ParameterError: if a time lies before the previous one
        """
        times = np.asarray(times, dtype=np.float64)
        steps = np.diff(times, prepend=self._numbers[mem.TIME])
        if not (steps >= 0.0).all():
            raise ParameterError('sample: times must not decrease, nor lie before the present')
        out = np.empty((len(times), self._out_size))
        out[:, 0] = steps
        _advance(self._memory, out.reshape(-1))
        return Trajectory(times, out[:, self._point].reshape(len(times), *self._shape),
                          out[:, self._velocity])

    @property
    def state(self) -> State:
        """The present moment, without letting time pass."""
        return self.advance(0.0)

    def copy(self) -> Rollout:
        """Make a roll-out at the same moment that goes on by itself: to look ahead."""
        result: Rollout = _new(Rollout)
        result.__dict__.update(self.__dict__)
        result._adopt(self._memory.copy())
        return result

    def go_on(self) -> None:
        """Take up the tempo 1 as if the robot had caught up (`observe`)."""
        self._numbers[mem.SLOWDOWN] = 1.0
        self.set_speed(1.0)

    def retarget(self, goal: np.ndarray) -> None:
        """
        Switch to a new goal; the present one moves there along the geodesic, [GDMP] eq. (28).

        Where the skill is cut into segments (`gdmp_ros.dmp.segments`), a factor that is split
        keeps its targets on the way and goes to the new goal in its last segment. A goal exactly
        opposite to the present one is reached along one of the shortest ways, with the flag
        ``cut_locus``.

        :param goal: point; its representative (±q) nearest to the present goal is taken
        :raises ManifoldError: if it is not a point; nothing has changed then
        """
        numbers, points, direction = self._numbers, self._points, self._vectors[mem.DIRECTION]
        manifold = self.skill.manifold
        new = manifold.align(manifold.check_point(goal), self.goal)
        switched = (numbers[mem.INTERVAL] + 1.0) / numbers[mem.STEPS]
        present = self._goal_at(switched)
        gap = manifold._apply(ops.LOG, manifold._flat(present), manifold._flat(new), direction)
        if gap < ops.CUT_LOCUS_LIMIT:
            numbers[mem.CUT_LOCUS] = 1.0
        points[mem.GOAL_FROM] = present.reshape(-1)
        points[mem.GOAL_NEW] = new.reshape(-1)
        numbers[mem.SWITCHED] = switched
        numbers[mem.GOAL_RATE], slow = self._goal_rate(present, new)
        numbers[mem.SETTLE_BY] = max(2.0, switched + 1.0 + slow)
        numbers[mem.MOVING] = 1.0
        numbers[mem.FINISHED] = numbers[mem.NOT_SETTLED] = 0.0

    def set_speed(self, scale: float) -> None:
        """
        Change the tempo to ``scale`` (1 as shown, 0 a stop) at the bounded rate; the path stays.

        :raises ParameterError: outside 0 … 2
        """
        self._numbers[mem.SPEED_GOAL] = in_range('speed', scale, 0.0, MAX_SPEED)

    def observe(self, measured: np.ndarray) -> float:
        """
        Phase stopping: slow down while the robot is behind, ``ds/dt ← ds/dt / (1 + κ e²)``.

        ``e² = Σ w_i d_i²`` over the factors, d_i the geodesic distance between reference and
        measurement; κ and w are the roll-out's options. The tempo follows at its bounded rate, and
        recovers when the error does.

        :param measured: point where the robot is
        :returns: e²
        :raises ManifoldError: if it is not a point; nothing has changed then
        """
        manifold, weights = self.skill.manifold, self._options.error_weights
        point = self.advance(0.0).point
        measured = manifold.align(manifold.check_point(measured), point)
        away = distances(manifold, point.reshape(1, -1), measured.reshape(1, -1))[0]
        error = float(np.ones(len(away)) @ away ** 2 if weights is None
                      else np.asarray(weights) @ away ** 2)
        self._numbers[mem.SLOWDOWN] = 1.0 / (1.0 + self._options.phase_stopping * error)
        return error

    def set_obstacles(self, positions: np.ndarray, gain: float = 1000.0, reach: float = 0.2,
                      bound: float = 5.0) -> None:
        """
        Steer the first Euclidean factor around point obstacles from now on; none switches it off.

        :param positions: shape ``(count, size of the factor)`` [m]
        :param gain: strength of the steering: larger keeps further away
        :param reach: obstacles further away are ignored [m]
        :param bound: largest steering acceleration at speed 1 [m/s²]
        :raises ParameterError: without such a factor of size 2 or 3, or for too many obstacles
        """
        size = self._views.obstacles.size // mem.OBSTACLE_CAPACITY
        positions = np.asarray(positions, dtype=np.float64)
        if size == 0:
            raise ParameterError(f'{self.skill.manifold!r} has no position (R² or R³) to steer')
        shape = positions.reshape(-1, size).shape if positions.size % size == 0 else (-1, size)
        if positions.size and (positions.shape != shape or len(positions) > mem.OBSTACLE_CAPACITY
                               or not np.isfinite(positions).all()):
            raise ParameterError(f'obstacles: expected up to {mem.OBSTACLE_CAPACITY} finite '
                                 f'positions of {size} numbers, got shape {positions.shape}')
        numbers = self._numbers
        self._views.obstacles[:positions.size] = positions.reshape(-1)
        numbers[mem.OBSTACLE_GAIN] = in_range('gain', gain, 0.0, 1e6)
        numbers[mem.OBSTACLE_RANGE] = in_range('reach', reach, 1e-6, 1e6)
        numbers[mem.ACCELERATION_BOUND] = (in_range('bound', bound, 0.0, 1e6)
                                           * numbers[mem.DURATION] ** 2)
        numbers[mem.OBSTACLES] = positions.size // size

    @property
    def speed(self) -> float:
        """Present tempo."""
        return float(self._numbers[mem.SPEED])

    @property
    def progress(self) -> float:
        """``s = ∫ dt/τ``: 1 at the nominal end, and runs on."""
        return float(self._numbers[mem.S])

    @property
    def goal(self) -> np.ndarray:
        """The goal last asked for, shape ``point_shape``."""
        return np.array(self._points[mem.GOAL_NEW].reshape(self._shape))

    @property
    def duration(self) -> float:
        """Duration at speed 1 [s]."""
        return float(self._numbers[mem.DURATION])

    @property
    def finished(self) -> bool:
        """
        Whether the motion is over.

        From the nominal end on, once every factor is within its tolerance of the goal; or at
        ``s >= max(2, s_switch + 1)``, then with the flag ``not_settled``. A new goal reopens it.
        """
        return bool(self._numbers[mem.FINISHED] > 0.0)

    @property
    def flags(self) -> set[str]:
        """What happened so far."""
        named = {'cut_locus': mem.CUT_LOCUS, 'held': mem.HELD, 'not_settled': mem.NOT_SETTLED}
        return {name for name, entry in named.items() if self._numbers[entry] > 0.0}

    def frame_now(self) -> np.ndarray:
        """Frame at the present point, carried along the motion (`parallel`)."""
        self.advance(0.0)
        return np.array(self._views.frames[mem.WORK])

    def _adopt(self, memory: np.ndarray) -> None:
        """Live in ``memory`` from now on."""
        self._memory = memory
        self._views = mem.cut(memory)
        self._numbers, self._points = self._views.numbers, self._views.points
        self._vectors = self._views.vectors

    def _goal_at(self, s: float) -> np.ndarray:
        numbers = self._numbers
        if numbers[mem.MOVING] == 0.0:
            return np.array(self._points[mem.GOAL].reshape(self._shape))
        fraction = st.goal_fraction.py_func(  # type: ignore[attr-defined]
            numbers[mem.ALPHA_G], numbers[mem.GOAL_RATE], s - numbers[mem.SWITCHED])
        return self.skill.manifold.exp(self._points[mem.GOAL_FROM].reshape(self._shape),
                                       fraction * self._vectors[mem.DIRECTION])

    def _goal_rate(self, present: np.ndarray, new: np.ndarray) -> tuple[float, float]:
        """Largest rate of a goal's fraction by s, and how long it moves at that rate."""
        speeds = self._options.goal_speed
        if speeds is None:
            return math.inf, 0.0
        away = distances(self.skill.manifold, present.reshape(1, -1), new.reshape(1, -1))[0]
        rate = min((speed * self.duration / d for speed, d in zip(speeds, away) if d > 0.0),
                   default=math.inf)
        slow = max(0.0, 1.0 / rate - 1.0 / self.skill.gains.alpha_g) if rate > 0.0 else 0.0
        return rate, slow

    def _aligned(self, given: np.ndarray | None, default: np.ndarray) -> np.ndarray:
        if given is None:
            return default
        manifold = self.skill.manifold
        return manifold.align(manifold.check_point(given), default)

    def _allocate(self) -> None:
        skill, manifold = self.skill, self.skill.manifold
        segments = skill.segments
        split = np.array(segments.split or [False] * len(manifold.factors), dtype=np.int64)
        self._adopt(mem.blank(factor_table(manifold.factors), skill.n_basis, len(segments.ends),
                              split, _steered(manifold)))
        self._shape, self._manifold = manifold.point_shape, manifold
        point_end = 2 + manifold.point_size
        velocity_end = point_end + manifold.tangent_size
        self._out_size = velocity_end + manifold.tangent_size
        self._point, self._velocity = slice(2, point_end), slice(point_end, velocity_end)
        self._views.functions[:] = basis(skill.n_basis, skill.gains.alpha_x)
        self._views.weights[:] = skill.weights
        self._views.tolerances[:] = self._options.tolerances_of(manifold)
        if len(segments) > 1:
            self._views.ends[:] = segments.ends
            self._views.waypoints[:] = segments.waypoints
        decay = -skill.gains.alpha_z / skill.steps
        self._views.gains[mem.DECAY] = math.exp(decay)
        self._views.gains[mem.PULL] = -math.expm1(decay) * skill.gains.beta_z

    def _set_numbers(self, duration: float | None) -> None:
        skill, numbers, options = self.skill, self._numbers, self._options
        numbers[mem.INTERVAL] = -1.0
        numbers[[mem.SPEED, mem.RAMP, mem.SPEED_GOAL]] = options.speed
        numbers[mem.SLOWDOWN] = 1.0
        numbers[mem.SPEED_RATE] = options.speed_rate
        numbers[mem.DURATION] = (skill.duration if duration is None
                                 else in_range('duration', duration, 1e-3, 1e6))
        numbers[mem.STEPS] = skill.steps
        numbers[mem.ALPHA_X] = skill.gains.alpha_x
        numbers[mem.ALPHA_G] = skill.gains.alpha_g
        numbers[mem.STIFFNESS] = skill.gains.alpha_z * skill.gains.beta_z
        numbers[mem.GOAL_RATE] = math.inf
        numbers[mem.SETTLE_BY] = 2.0
        numbers[mem.PARALLEL] = float(skill.connection == 'parallel')

    def _place(self, start: np.ndarray, goal: np.ndarray, frame: np.ndarray) -> None:
        manifold, vectors = self.skill.manifold, self._vectors
        self._views.frames[mem.START] = frame
        self._points[[mem.START, mem.NODE]] = start.reshape(-1)
        self._points[[mem.GOAL, mem.GOAL_FROM, mem.GOAL_NEW]] = goal.reshape(-1)
        vectors[mem.Z] = self.skill.velocity
        if self.skill.connection == 'published':
            manifold._apply(ops.VECTOR, frame, np.array(self.skill.velocity), vectors[mem.Z])
        # Where start and target are opposite, both logarithms begin along the same of the ways.
        drawn = targets(manifold, self.skill.segments, goal.reshape(-1), np.array([-1.0]))[0]
        if self.skill.connection == 'parallel':
            manifold._apply(ops.FRAME_LOG, frame, drawn, vectors[mem.TO_GOAL])
        else:
            manifold._apply(ops.LOG, manifold._flat(start), drawn, vectors[mem.TO_GOAL])

    def _begin_with(self, frame: np.ndarray, velocity: np.ndarray,
                    acceleration: np.ndarray | None) -> None:
        """
        Begin with a velocity and an acceleration, whatever the skill would begin with.

        A push that fades over `_PUSH` of a duration makes up the difference: at s = 0 both
        logarithms cancel, ``Z' = α_z (β_z (F + push) - Z)``.
        """
        manifold, vectors, numbers = self.skill.manifold, self._vectors, self._numbers
        speed = numbers[mem.SPEED]
        if not speed > 0.0:
            raise ParameterError('an initial velocity needs an initial speed above 0')
        scale = numbers[mem.DURATION] / speed
        wanted = np.zeros(manifold.tangent_size) if acceleration is None else acceleration
        for name, tangent in (('velocity', velocity), ('acceleration', wanted)):
            if not np.isfinite(tangent).all():
                raise ParameterError(f'the initial {name} has an entry that is NaN or infinite')
        first, second = scale * self._coordinates(frame, velocity), (
            scale * scale * self._coordinates(frame, wanted))
        forcing = np.empty(manifold.tangent_size)
        forcing_term(self._views.functions, self._views.weights, 0.0, 1.0, forcing)
        vectors[mem.Z] = first
        vectors[mem.PUSH] = ((second + self.skill.gains.alpha_z * first) / numbers[mem.STIFFNESS]
                             - forcing)
        numbers[mem.PUSH_END] = _PUSH

    def _coordinates(self, frame: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        manifold = self.skill.manifold
        if self.skill.connection == 'parallel':
            return in_frame(manifold, frame, tangent)
        return manifold._vector(tangent)


def _steered(manifold: Manifold) -> int:
    """Number of the first factor that is a position, -1 without one."""
    return next((i for i, factor in enumerate(manifold.factors)
                 if factor.kind == 'euclidean' and factor.m in (2, 3)), -1)
