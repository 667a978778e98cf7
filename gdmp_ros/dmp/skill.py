"""What was learned: everything a roll-out needs, frozen."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
import math
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.development import Development, differentiate, published_derivatives
from gdmp_ros.dmp.forcing import basis, regress
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds import operations as ops

if TYPE_CHECKING:
    from gdmp_ros.dmp.rollout import Rollout

CONNECTIONS = ('parallel', 'published')
#: Fewest grid steps per duration (below 1 ms of a 4 s skill).
LEAST_STEPS = 4000


class Trajectory(NamedTuple):
    """
    A sampled motion.

    :ivar times: shape ``(T,)`` [s]
    :ivar points: shape ``(T, *point_shape)``
    :ivar velocities: tangents at the points [1/s], shape ``(T, tangent_size)``
    """

    times: np.ndarray
    points: np.ndarray
    velocities: np.ndarray


@dataclass(frozen=True)
class Gains:
    """
    Constants of the dynamical system, [GDMP] eqs. (3), (17), (28).

    :param alpha_z: gain; ``beta_z = alpha_z / 4`` makes the system critically damped
    :param alpha_x: decay of the phase
    :param alpha_g: gain of a moving goal: larger reaches it sooner and jerks more
    """

    alpha_z: float = 60.0
    alpha_x: float = 4.6052
    alpha_g: float = 8.0

    def __post_init__(self) -> None:
        for part in fields(self):
            value = getattr(self, part.name)
            if not (isinstance(value, (int, float)) and math.isfinite(value) and value > 0.0):
                raise ParameterError(f'{part.name} is {value!r}, expected a number > 0')
            object.__setattr__(self, part.name, float(value))

    @property
    def beta_z(self) -> float:
        """Second gain of the transformation system."""
        return self.alpha_z / 4.0


@dataclass(frozen=True, eq=False)
class Skill:
    """
    A learned motion on a manifold.

    :ivar manifold: where it lives
    :ivar connection: ``parallel`` (exact transport) or ``published`` (the paper's)
    :ivar start: point, shape ``point_shape``
    :ivar goal: point, shape ``point_shape``
    :ivar frame: frame at the start, in which velocity and weights have their coordinates
    :ivar duration: mean of the demonstrations' [s]
    :ivar velocity: ``τ ẏ(0)`` in the frame, shape ``(tangent_size,)``
    :ivar weights: shape ``(n_basis, tangent_size)``
    :ivar steps: grid steps per duration
    :ivar provenance: where it came from, for people
    """

    manifold: Manifold
    connection: str
    gains: Gains
    start: np.ndarray
    goal: np.ndarray
    frame: np.ndarray
    duration: float
    velocity: np.ndarray
    weights: np.ndarray
    steps: int
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_connection(self.connection)
        for name in ('start', 'goal', 'frame', 'velocity', 'weights'):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64).copy()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def n_basis(self) -> int:
        """How many basis functions there are."""
        return len(self.weights)

    @classmethod
    def learn(cls, demonstrations: Demonstration | Sequence[Demonstration], n_basis: int = 60,
              alpha_z: float = 60.0, alpha_x: float = 4.6052, connection: str = 'parallel', *,
              alpha_g: float = 8.0, provenance: Mapping[str, Any] | None = None) -> Skill:
        """
        Learn from one demonstration or several, each with its own start, goal and duration.

        :param n_basis: number of basis functions, at least 2
        :param connection: ``parallel`` or ``published``
        :raises DataError: without demonstrations, or if their manifolds differ
        :raises CutLocusError: if a demonstration meets the cut locus of its goal

        Source: [GDMP] eqs. (20), (21).
        """
        check_connection(connection)
        gains = Gains(alpha_z, alpha_x, alpha_g)
        shown = _prepared(demonstrations)
        manifold = shown[0].manifold
        functions = basis(n_basis, gains.alpha_x)
        start = _mean(manifold, [d.points[0] for d in shown])
        goal = _mean(manifold, [d.points[-1] for d in shown])
        frame = manifold.frame(start)
        parts = [_invert(d, frame, gains, connection) for d in shown]
        weights = regress(functions, gains.alpha_x, np.concatenate([p.s for p in parts]),
                          np.vstack([p.forcing for p in parts]))
        duration = float(np.mean([d.duration for d in shown]))
        return cls(manifold=manifold, connection=connection, gains=gains, start=start, goal=goal,
                   frame=frame, duration=duration,
                   velocity=np.mean([p.velocity for p in parts], axis=0), weights=weights,
                   steps=max(LEAST_STEPS, math.ceil(duration / 1e-3 - 1e-6)),
                   provenance=dict(provenance or {}))

    def rollout(self, **options: Any) -> Rollout:
        """Begin a motion: `gdmp_ros.dmp.Rollout` with this skill."""
        from gdmp_ros.dmp.rollout import Rollout
        return Rollout(self, **options)

    def reproduce(self, dt: float) -> Trajectory:
        """
        Roll out from start to goal.

        :param dt: spacing of the samples [s]; the last sample is at the duration
        :raises ParameterError: if ``dt`` is not positive
        """
        if not (isinstance(dt, (int, float)) and 0.0 < dt < math.inf):
            raise ParameterError(f'dt is {dt!r} s, expected a number > 0')
        count = math.floor(self.duration / dt - 1e-9) + 1
        times = np.append(dt * np.arange(count), self.duration)
        return self.rollout().sample(times)

    def save(self, path: str | Path) -> None:
        """Write a skill file: JSON, described in ``docs/skill_file.md``; replaces it whole."""
        from gdmp_ros.dmp.skill_file import write
        write(self, Path(path))

    @classmethod
    def load(cls, path: str | Path) -> Skill:
        """
        Read a skill file; its roll-outs are bit-identical to the saved skill's.

        :raises DataError: if the file is missing, damaged or of an unknown version
        """
        from gdmp_ros.dmp.skill_file import read
        return read(Path(path))


class _Inverted(NamedTuple):
    """A demonstration turned into regression targets."""

    s: np.ndarray
    forcing: np.ndarray
    velocity: np.ndarray


def check_connection(connection: str) -> None:
    """Refuse an unknown connection by naming the known ones."""
    if connection not in CONNECTIONS:
        raise ParameterError(f'connection is {connection!r}, expected one of '
                             f'{", ".join(CONNECTIONS)}')


def carry_frame(manifold: Manifold, frame: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Frame carried parallel along the geodesic to ``point``."""
    step, none = np.empty(manifold.tangent_size), np.empty(0)
    carried = frame.copy()
    gap = manifold._apply(ops.FRAME_LOG, carried, manifold._flat(point), step)
    manifold._check_gap(gap)
    manifold._apply(ops.MOVE, carried, step, none)
    return carried


def in_frame(manifold: Manifold, frame: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Coordinates of a tangent in a frame."""
    out = np.empty(manifold.tangent_size)
    manifold._apply(ops.COORDS, frame, manifold._vector(tangent), out)
    return out


def _prepared(demonstrations: Demonstration | Sequence[Demonstration]) -> list[Demonstration]:
    shown = ([demonstrations] if isinstance(demonstrations, Demonstration)
             else list(demonstrations))
    if not shown:
        raise DataError('learning needs at least one demonstration, got none')
    for number, demonstration in enumerate(shown):
        if demonstration.manifold != shown[0].manifold:
            raise DataError(f'demonstration {number} is on {demonstration.manifold!r}, '
                            f'the first on {shown[0].manifold!r}')
    return [d.uniform().aligned(shown[0].points[0]) for d in shown]


def _mean(manifold: Manifold, points: list[np.ndarray]) -> np.ndarray:
    aligned = [manifold.align(p, points[0]) for p in points]
    return aligned[0] if len(aligned) == 1 else manifold.mean(aligned)


def _invert(demonstration: Demonstration, frame: np.ndarray, gains: Gains,
            connection: str) -> _Inverted:
    """Solve [GDMP] eq. (17) for the forcing term along a uniform demonstration."""
    manifold, points = demonstration.manifold, demonstration.flat_points
    duration = demonstration.duration
    dt = duration / (len(points) - 1)
    carried = carry_frame(manifold, frame, demonstration.points[0])
    if connection == 'parallel':
        development = Development(manifold, points, carried, goal=demonstration.points[-1])
        velocity, acceleration = differentiate(development.steps, dt)
        to_goal, start_velocity = development.to_goal, velocity[0]
    else:
        velocity, acceleration, to_goal = published_derivatives(
            manifold, points, demonstration.points[-1], dt)
        start_velocity = in_frame(manifold, carried, velocity[0])
    s = np.linspace(0.0, 1.0, len(points))
    x = np.exp(-gains.alpha_x * s)
    forcing = ((duration ** 2 * acceleration + gains.alpha_z * duration * velocity)
               / (gains.alpha_z * gains.beta_z) - to_goal + to_goal[0] * x[:, None])
    return _Inverted(s, forcing, duration * start_velocity)
