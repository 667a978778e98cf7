"""The execution of a skill: the only state that changes; and many of them in one call."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np

from gdmp_ros.dmp.changes import turned, with_frames
from gdmp_ros.dmp.frame_motion import TaskFrames
from gdmp_ros.dmp.goal import end_with, present_target, SETTLED, switch_goal
from gdmp_ros.dmp.initial import finite_tangent, initialise, new_memory, recover, Start
from gdmp_ros.dmp.integrator import advance
from gdmp_ros.dmp.layout import FINISHED, Motion, parts
from gdmp_ros.dmp.obstacles import store_obstacles
from gdmp_ros.dmp.options import (
    check_range,
    check_steps,
    LONGEST_STEP,
    MAX_AMPLITUDE,
    MAX_SPEED,
    merged_options,
    Options,
    SHORTEST_DURATION,
)
from gdmp_ros.dmp.primitive import Primitive, State, Trajectory
from gdmp_ros.errors import ParameterError
from gdmp_ros.scene.scene import Scene
from gdmp_ros.util.numeric import numbers


class Rollout:
    """
    Executes a skill: `advance` lets time pass; `retarget` and `set_speed` act at any moment.

    Not to be shared between threads. `flags` reports what happened: ``cut_locus`` (start, point or
    goal were exactly opposite each other; one of the shortest ways was taken), ``held`` (a step
    was not finite; the last state is kept until `retarget`), ``not_settled`` (finished without
    coming to rest within the goal's tolerance).

    :ivar skill: what is executed
    """

    def __init__(self, skill: Primitive, start: np.ndarray | None = None,
                 goal: np.ndarray | None = None, duration: float | None = None,
                 velocity: np.ndarray | None = None, *, acceleration: np.ndarray | None = None,
                 final_velocity: np.ndarray | None = None, frame: np.ndarray | None = None,
                 frames: Mapping[str, Any] | None = None, scale: str = 'none',
                 options: Options | None = None, **settings: float | Sequence[float] | None):
        """
        Begin at the skill's start, or elsewhere.

        A rhythmic skill begins on its cycle, in motion; with another start or centre it begins
        from rest, or with the velocity given, and enters the cycle.

        :param start: point; the skill's frame is transported to it along the geodesic
        :param goal: point, from the beginning; the skill's by default. The centre of a cycle
        :param duration: of the motion at speed 1 [s]
        :param velocity: initial velocity, tangent at the start [1/s]; the demonstrated one (at the
            initial speed) by default
        :param acceleration: initial acceleration, tangent at the start [1/s²]; by default zero
            where a velocity is given, otherwise the demonstrated one
        :param final_velocity: with which the motion passes its goal at the nominal end, tangent at
            the goal [1/s at speed 1]; it returns to the goal afterwards. By default that which was
            learned: none with ``end='rest'``
        :param frame: turns the whole skill about its start, its own goal too: an orthogonal matrix
            that acts on coordinates in the skill's frame (`gdmp_ros.dmp.changes`)
        :param frames: where the task frames of the skill are, by name: pose (x, y, z, qw, qx, qy,
            qz) [m], or a pair of rotation and origin; the others are where they were shown
        :param scale: with ``distance`` the shape of a skill with task frames shrinks and grows
            with the distance from start to goal (`Skill.with_frames`); with ``none`` it does not
        :param options: see `Options`; single ones may be given by name instead
        :raises ManifoldError: if a point is not on the manifold
        :raises ParameterError: if a number is out of range
        """
        skill = skill if frame is None else turned(skill, frame)
        if frames is not None or scale != 'none':
            skill = with_frames(skill, frames or {}, scale)
        self.skill = skill
        self._manifold = skill.manifold
        self._options = merged_options(options, settings)
        self._options.check(skill.manifold)
        if final_velocity is not None:
            skill.check_ends('final velocity')
            skill.check_plain('final velocity')
        self._goal_given = goal is not None and not np.array_equal(goal, skill.goal)
        self._goal = self._checked(goal, skill.goal)
        self._duration = (skill.duration if duration is None
                          else check_range('duration', duration, SHORTEST_DURATION, 1e6))
        self._frames = TaskFrames(skill, self._options) if skill.views else None
        self.use_memory(new_memory(skill, self._options) if self._frames is None
                        else self._frames.memory)
        point_end = 2 + self._manifold.point_size
        self.state_size = point_end + 2 * self._manifold.tangent_size
        self._point = slice(2, point_end)
        self._velocity = slice(point_end, point_end + self._manifold.tangent_size)
        self._final_velocity = (None if final_velocity is None else finite_tangent(
            self._manifold, 'final velocity', final_velocity))
        self.begin(start, velocity, acceleration)

    def __repr__(self) -> str:
        return (f'Rollout(progress={self.progress:.4g}, speed={self.speed:.4g}, '
                f'finished={self.finished}, skill={self.skill!r})')

    def begin(self, start: np.ndarray | None = None, velocity: np.ndarray | None = None,
              acceleration: np.ndarray | None = None, speed: float | None = None) -> None:
        """
        Begin again, with the goal, duration and options of the constructor; see there.

        :param speed: of the phase at the beginning; that of the options by default
        :raises ManifoldError: if the start is not on the manifold
        :raises ParameterError: if a number is out of range, or a velocity is given at speed 0
        """
        if speed is not None:
            check_range('speed', speed, 0.0, MAX_SPEED)
        first = Start(None if start is None else self._checked(start, self.skill.start),
                      velocity, acceleration, speed)
        if self._frames is not None:
            self._frames.begin(self._options, self._goal if self._goal_given else None,
                               self._duration, first, lambda: self.advance(0.0))
            return
        initialise(self.motion, self.skill, self._options, self._goal, self._duration, first)
        if self._final_velocity is not None:
            end_with(self._manifold, self.motion, self._missing_velocity())
        self.advance(0.0)

    def _missing_velocity(self) -> np.ndarray:
        """What the motion lacks of its final velocity at the nominal end, tangent at the goal."""
        plain = self.copy()
        plain.motion.scalars.speed = plain.motion.scalars.speed_ramp = 1.0
        plain.set_speed(1.0)
        pieces = math.ceil(self._duration / LONGEST_STEP)
        end = [plain.advance(self._duration / pieces) for _ in range(pieces)][-1]
        return np.asarray(self._final_velocity - self._manifold.transport(
            end.point, self._goal, end.velocity))

    def advance(self, dt: float) -> State:
        """
        Let ``dt`` seconds pass and return the state then.

        :param dt: from 0 to `LONGEST_STEP` [s]; the path does not depend on how time is cut into
            steps
        :raises ParameterError: for another number; nothing has changed then
        """
        # As `advance_to`, without the call.
        if not 0.0 <= dt <= LONGEST_STEP:
            check_steps(dt, dt)
        out = np.empty(self.state_size)
        out[0] = dt
        advance(self.memory, out)
        return State(out, self._manifold)

    def advance_to(self, dt: float, out: np.ndarray) -> None:
        """
        Let ``dt`` seconds pass and write the numbers of the state to ``out``.

        For loops that do not allocate.

        :param out: shape ``(state_size,)``; see `State.numbers`
        :raises ParameterError: as `advance`
        """
        if not 0.0 <= dt <= LONGEST_STEP:
            check_steps(dt, dt)
        out[0] = dt
        advance(self.memory, out)

    def sample(self, times: np.ndarray) -> Trajectory:
        """
        Advance through ``times`` (elapsed, not decreasing, [s]) in one compiled call.

        :raises ParameterError: if a time lies before the previous one
        """
        times = numbers('sample: times', times)
        if times.ndim != 1:
            raise ParameterError(f'sample: times have the shape {times.shape}, expected a list')
        steps = np.diff(times, prepend=self.motion.scalars.time)
        if not (steps >= 0.0).all():
            raise ParameterError('sample: times must not decrease, nor lie before the present')
        check_steps(0.0, steps.max(initial=0.0))
        out = np.empty((len(times), self.state_size))
        out[:, 0] = steps
        advance(self.memory, out.reshape(-1))
        points = out[:, self._point].reshape(len(times), *self._manifold.point_shape)
        return Trajectory(times, points, out[:, self._velocity])

    @property
    def state(self) -> State:
        """The present state, without letting time pass."""
        return self.advance(0.0)

    def copy(self) -> Rollout:
        """Make an independent roll-out at the same moment, for example to look ahead."""
        result = object.__new__(Rollout)
        result.__dict__.update(self.__dict__)
        memory = self.memory.copy()
        if self._frames is not None:
            result._frames = self._frames.copy(memory)
        result.use_memory(memory)
        return result

    def use_memory(self, memory: np.ndarray) -> None:
        """
        Keep the state in ``memory`` from now on.

        :param memory: with the content of `memory` (`gdmp_ros.dmp.rollout`)
        """
        self.memory = memory
        self.motion: Motion = parts(memory)
        if self._frames is not None:
            self._frames.bind(memory)

    def retarget(self, goal: np.ndarray, velocity: np.ndarray | None = None) -> None:
        """
        Switch to a new goal; the present one moves there along the geodesic, [GDMP] eq. (28).

        With a velocity the new goal moves on from now on, in real time whatever the tempo, along
        the geodesic that begins with it. The motion follows it without lag. Call this again with
        every new measurement of the goal.

        Where the skill is split into segments (`gdmp_ros.dmp.segments`), a split factor keeps its
        targets on the way and goes to the new goal in its last segment. A goal exactly opposite to
        the present one is reached along one of the shortest ways, with the flag ``cut_locus``.
        With task frames, the frame of the goal moves so that the motion ends there.

        :param goal: point; its representative (±q) nearest to the present goal is taken
        :param velocity: tangent at the goal [1/s], shape ``(tangent_size,)``
        :raises ManifoldError: if it is not a point, or the velocity no tangent; nothing has
            changed then
        """
        new = self._manifold.align(self._manifold.check_point(goal), self.goal)
        if velocity is not None:
            velocity = finite_tangent(self._manifold, 'velocity of the goal', velocity)
        if self._frames is not None:
            self._frames.retarget(new, velocity)
            return
        if self.motion.scalars.held:
            recover(self._manifold, self.motion, self.state.point)
        switch_goal(self._manifold, self.motion, new, velocity, self._options.goal_speed)

    def move_frame(self, name: str, pose: Any, twist: np.ndarray | None = None,
                   stamp: float | None = None) -> None:
        """
        Take a measurement of a task frame; the motion follows it smoothly.

        Between measurements a frame goes on with its twist, that which is given or, from several
        measurements within a second, estimated; so the motion does not lag behind a frame that
        moves at a constant velocity. Position, velocity and acceleration are continuous; what a
        measurement has changed fades in about a second and a half. Measurements older than the
        last one are not used, nor those of an object that the tool has grasped.

        :param name: of a frame of the skill
        :param pose: as in the constructor
        :param twist: velocity of the frame's origin [m/s] and angular velocity [rad/s], in the
            base, shape (6,)
        :param stamp: when it was measured, in the time of `state` [s]; now by default
        :raises ParameterError: if there is no such frame, or it is no pose; nothing has changed
            then
        """
        self._task_frames(name).measure(name, pose, twist, stamp)

    def rest_frame(self, name: str) -> None:
        """
        Let a task frame come to rest where it is, until it is measured again.

        For a frame that moves and is not seen any more: it would go on with its twist.

        :raises ParameterError: if there is no such frame
        """
        self._task_frames(name).rest(name)

    def _task_frames(self, name: str) -> TaskFrames:
        if self._frames is None:
            raise ParameterError(f'frame {name!r}: the skill was learned without task frames')
        return self._frames

    @property
    def frames(self) -> dict[str, np.ndarray]:
        """Where the motion has its task frames now: poses (x, y, z, qw, qx, qy, qz) by name."""
        return {} if self._frames is None else self._frames.poses()

    @property
    def frames_move(self) -> bool:
        """Whether a task frame moves on; its goal does not rest then."""
        return self._frames is not None and self._frames.are_moving

    def observe(self, measured: np.ndarray) -> float:
        """
        Phase stopping: slow down while the robot is behind, ``ds/dt ← ds/dt / (1 + κ e²)``.

        ``e² = Σ w_i d_i²`` over the factors, d_i the geodesic distance between reference and
        measurement; κ and w are the roll-out's options. The speed follows at its bounded rate, and
        recovers when the error does.

        :param measured: point where the robot is
        :returns: e²
        :raises ManifoldError: if it is not a point; nothing has changed then
        """
        manifold, weights = self._manifold, self._options.error_weights
        point = self.advance(0.0).point
        measured = manifold.align(manifold.check_point(measured), point)
        distances = manifold.factor_distances(point.reshape(1, -1), measured.reshape(1, -1))[0]
        error = float(np.ones(len(distances)) @ distances ** 2 if weights is None
                      else np.asarray(weights) @ distances ** 2)
        self.slow_down(error)
        return error

    def slow_down(self, error: float) -> None:
        """
        `observe` where e² is known already; any thread may call it.

        :param error: e²
        """
        self.motion.scalars.slowdown = 1.0 / (1.0 + self._options.phase_stopping * error)

    def set_obstacles(self, positions: np.ndarray | Scene, gain: float = 2e4,
                      reach: float = 0.2, bound: float = 20.0, keep: float = 0.0) -> None:
        """
        Avoid obstacles with the first Euclidean factor from now on; none ends it.

        :param positions: points, shape ``(count, size of the factor)`` [m], or a scene, whose
            margins are kept as far as ``bound`` allows it
        :param gain: strength of the avoidance: a larger one keeps a larger distance
        :param reach: obstacles further away are ignored [m]
        :param bound: largest acceleration of the avoidance at speed 1 [m/s²]
        :param keep: distance to keep besides, such as the radius of the tool [m]
        :raises ParameterError: without such a factor of size 2 or 3, or for too many obstacles
        """
        self.skill.check_plain('obstacles')
        store_obstacles(self.motion, positions, gain, reach, bound, keep)

    @property
    def speed(self) -> float:
        """Present speed of the phase; 1 is as demonstrated."""
        return float(self.motion.scalars.speed)

    @property
    def time(self) -> float:
        """Time that has passed [s]."""
        return float(self.motion.scalars.time)

    @property
    def progress(self) -> float:
        """``s = ∫ dt/τ``: 1 at the nominal end, or after one cycle, and increases further."""
        return float(self.motion.scalars.progress)

    @property
    def phase(self) -> float:
        """``x``, from 1 towards 0; of a rhythmic motion φ, 0 to 2π."""
        if self.skill.rhythmic:
            return 2.0 * math.pi * (self.progress % 1.0)
        return math.exp(-self.skill.gains.alpha_x * self.progress)

    @property
    def duration(self) -> float:
        """Duration at speed 1, of a rhythmic motion the period [s]."""
        return self._duration

    @property
    def amplitude(self) -> float:
        """Present factor of the cycle: 1 as demonstrated; 0 for a skill that is not rhythmic."""
        return float(self.motion.scalars.amplitude)

    @property
    def frequency(self) -> float:
        """Cycles per second at present [Hz]; 0 for a skill that is not rhythmic."""
        scalars = self.motion.scalars
        return float(scalars.rhythmic * scalars.speed / scalars.duration)

    def set_speed(self, scale: float) -> None:
        """
        Change the speed to ``scale`` (1 as demonstrated, 0 a stop) at a bounded rate.

        The path does not change.

        :raises ParameterError: outside 0 … 2
        """
        self.motion.scalars.speed_goal = check_range('speed', scale, 0.0, MAX_SPEED)

    def resume(self) -> None:
        """Return to speed 1, as if the robot had caught up (`observe`)."""
        self.motion.scalars.slowdown = 1.0
        self.set_speed(1.0)

    def set_amplitude(self, amplitude: float) -> None:
        """
        Change the amplitude, smoothly: 1 as demonstrated, 0 ends the motion at the centre.

        The factor acts on the forcing term. On a flat space it scales the cycle exactly; on a
        curved one nearly, the better the smaller the cycle.

        :raises ParameterError: outside 0 … 2, or if the skill is not rhythmic
        """
        self._check_rhythmic('amplitude')
        check_range('amplitude', amplitude, 0.0, MAX_AMPLITUDE)
        scalars = self.motion.scalars
        scalars.amplitude_goal = amplitude
        scalars.finished = scalars.not_settled = 0
        scalars.arrived_at = -1.0
        # The amplitude needs as long as a goal; half a cycle more for the filter behind it.
        # A centre that moves slowly may need longer.
        scalars.settle_by = max(scalars.settle_by if scalars.goal_is_moving else 0.0,
                                scalars.progress + 0.5 + max(1.0, SETTLED / scalars.alpha_g))

    def set_frequency(self, frequency: float) -> None:
        """
        Change the number of cycles per second, at a bounded rate; the cycle does not change.

        :param frequency: 0 to twice the demonstrated one [Hz]
        :raises ParameterError: for another number, or if the skill is not rhythmic
        """
        self._check_rhythmic('frequency')
        # A period that was found has errors of rounding: twice its frequency is allowed.
        check_range('frequency', frequency, 0.0, (1.0 + 1e-9) * MAX_SPEED / self._duration)
        self.set_speed(min(frequency * self._duration, MAX_SPEED))

    def _check_rhythmic(self, what: str) -> None:
        if not self.skill.rhythmic:
            raise ParameterError(f'{what}: the skill is not rhythmic; learn it with '
                                 'Skill.learn_rhythmic or gdmp learn --rhythmic')

    @property
    def goal(self) -> np.ndarray:
        """The goal that was asked for last, where it is now, shape ``point_shape``."""
        if self._frames is not None:
            return self._frames.goal().reshape(self._manifold.point_shape)
        return present_target(self._manifold, self.motion)

    @property
    def finished(self) -> bool:
        """
        Whether the motion has finished.

        From the nominal end on, as soon as every factor has been within its tolerance of the goal
        and at rest relative to it, for a twentieth of a duration. At rest: at most 1 % of the
        largest speed of the motion (`gdmp_ros.dmp.goal`). Or at ``s >= max(2, s_switch + 1)``,
        later if ``goal_speed`` delays the goal, then with the flag ``not_settled``. A new goal
        clears it, also a moving one that jumps by more than the tolerance. A rhythmic motion
        finishes only after its amplitude has been set to 0.
        """
        return bool(self.memory.item(FINISHED))

    @property
    def flags(self) -> set[str]:
        """What happened so far."""
        scalars = self.motion.scalars
        return {name for name in ('cut_locus', 'held', 'not_settled') if getattr(scalars, name)}

    def current_frame(self) -> np.ndarray:
        """Frame at the present point, transported along the motion (`parallel`)."""
        self.skill.check_plain('a frame along the motion')
        self.advance(0.0)
        return np.array(self.motion.frames.now)

    def _checked(self, given: np.ndarray | None, default: np.ndarray) -> np.ndarray:
        if given is None:
            return default
        return self._manifold.align(self._manifold.check_point(given), default)


class Batch:
    """
    Roll-outs that share a memory.

    `Rollout.retarget`, `set_speed`, `flags` and even its own `advance` act on each of them as
    before. A roll-out belongs to one batch at most. Not to be shared between threads; the step
    itself does not hold the interpreter lock.
    """

    def __init__(self, rollouts: Sequence[Rollout]):
        """
        Join roll-outs.

        :raises ParameterError: without any, or if one is in a batch already
        """
        self.rollouts = tuple(rollouts)
        if not self.rollouts:
            raise ParameterError('a batch needs at least one roll-out, got none')
        if (len({id(rollout) for rollout in self.rollouts}) < len(self.rollouts)
                or any(rollout.memory.base is not None for rollout in self.rollouts)):
            raise ParameterError('a roll-out can be in one batch only, and only once')
        sizes = [rollout.memory.size for rollout in self.rollouts]
        self._memory = np.concatenate([rollout.memory for rollout in self.rollouts])
        for rollout, end, size in zip(self.rollouts, np.cumsum(sizes), sizes):
            rollout.use_memory(self._memory[end - size:end])
        states = np.array([rollout.state_size for rollout in self.rollouts])
        ends = np.cumsum(states)
        # Plain integers: a slice of NumPy's takes longer.
        self._parts = [(slice(end - size, end), rollout.skill.manifold) for rollout, end, size
                       in zip(self.rollouts, ends.tolist(), states.tolist())]
        self._times = ends - states
        self._size = int(states.sum())

    def advance(self, dt: float | np.ndarray) -> list[State]:
        """
        Let time pass for all of them and return their states then.

        :param dt: as in `Rollout.advance`; one for all, or one for each, shape
            ``(len(rollouts),)``
        :raises ParameterError: as `Rollout.advance`
        """
        check_steps(np.min(dt), np.max(dt))
        out = np.empty(self._size)
        out[self._times] = dt
        advance(self._memory, out)
        return [State(out[part], manifold) for part, manifold in self._parts]
