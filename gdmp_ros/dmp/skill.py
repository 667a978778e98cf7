"""What was learned: everything a roll-out needs, frozen."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
import math
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.segments import Segments
from gdmp_ros.errors import ParameterError
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
    :ivar segments: where the motion is cut at the cut locus, if it is
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
    segments: Segments = field(default_factory=Segments)
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
    def learn(cls, demonstrations: Demonstration | Sequence[Demonstration],
              n_basis: int | str = 60, alpha_z: float = 60.0, alpha_x: float = 4.6052,
              connection: str = 'parallel', *, alpha_g: float = 8.0, tolerance: float = 1e-4,
              smoothing: float | None = None, regularization: float = 0.0, split: bool = True,
              provenance: Mapping[str, Any] | None = None) -> Skill:
        """
        Learn from one demonstration or several, each with its own start, goal and duration.

        Stamps may be irregular and have gaps. Where a demonstration meets the cut locus of its
        goal, the motion is cut into segments by itself (`gdmp_ros.dmp.segments`).

        :param n_basis: number of basis functions, at least 2; ``'auto'`` for the smallest that
            meets ``tolerance``
        :param connection: ``parallel`` or ``published``
        :param tolerance: for ``'auto'``: mean geodesic error / span of the reproduction; with
            several demonstrations, between it and that of very many basis functions
        :param smoothing: cut-off [Hz] of `Demonstration.smoothed`; None leaves noise alone
        :param regularization: ridge added to the normal equations, as a share of their diagonal:
            1e-3 to 1e-1 for noisy or few samples
        :param split: False refuses a demonstration through the cut locus instead
        :raises DataError: without demonstrations, or if their manifolds differ
        :raises CutLocusError: if samples are so coarse that neighbours are opposite each other

        Source: [GDMP] eqs. (20), (21).
        """
        from gdmp_ros.dmp.learning import learn, Settings
        settings = Settings(Gains(alpha_z, alpha_x, alpha_g), connection, smoothing,
                            regularization, split)
        skill = learn(demonstrations, n_basis, settings, tolerance)
        return replace(skill, provenance=dict(provenance or {}))

    def through(self, points: Sequence[tuple[float, np.ndarray]],
                factors: Sequence[str] | None = None) -> Skill:
        """
        Give the skill that also passes through points on the way.

        :param points: progress s (0 to 1; s = 0.5 is half of the duration) and point of each
        :param factors: names of the factors that have to pass; all by default
        :raises ParameterError: see `gdmp_ros.dmp.via.through`
        """
        from gdmp_ros.dmp.via import through
        return through(self, points, factors)

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


def check_connection(connection: str) -> None:
    """Refuse an unknown connection by naming the known ones."""
    if connection not in CONNECTIONS:
        raise ParameterError(f'connection is {connection!r}, expected one of '
                             f'{", ".join(CONNECTIONS)}')


def carry_frame(manifold: Manifold, frame: np.ndarray,
                point: np.ndarray) -> tuple[np.ndarray, bool]:
    """
    Carry a frame parallel along the geodesic to ``point``; and whether it is opposite.

    To an opposite point there is no one shortest geodesic; one of them is taken.
    """
    step, none = np.empty(manifold.tangent_size), np.empty(0)
    carried = frame.copy()
    gap = manifold._apply(ops.FRAME_LOG, carried, manifold._flat(point), step)
    manifold._apply(ops.MOVE, carried, step, none)
    return carried, gap < ops.CUT_LOCUS_LIMIT


def in_frame(manifold: Manifold, frame: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Coordinates of a tangent in a frame."""
    out = np.empty(manifold.tangent_size)
    manifold._apply(ops.COORDS, frame, manifold._vector(tangent), out)
    return out
