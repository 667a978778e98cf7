"""A learned movement primitive: everything a roll-out needs, frozen; and states of a motion."""
from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
import math
from typing import Any, NamedTuple, TypeVar

import numpy as np

from gdmp_ros.choices import CONNECTIONS
from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.frames import check_views, View
from gdmp_ros.dmp.segments import Segments
from gdmp_ros.dmp.variation import Variation
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.factors import CUT_LOCUS_LIMIT
from gdmp_ros.util.numeric import numbers

#: Goal gain of rhythmic skills: with that of others entry and exit need 1.7 times the acceleration
#: of the cycle.
CYCLE_ALPHA_G = 4.0
#: Fewest basis functions of a rhythmic skill.
FEWEST_PERIODIC = 4
#: Fewest grid intervals per duration (less than 1 ms each for a skill of 4 s).
MIN_STEPS = 4000


class State:
    """
    One moment of a motion; its parts are views of one array, cut when they are asked for.

    :ivar time: since the roll-out began [s]
    :ivar phase: x, from 1 towards 0; of a rhythmic motion φ, 0 to 2π
    :ivar point: shape ``point_shape``
    :ivar velocity: tangent at the point [1/s], shape ``(tangent_size,)``
    :ivar acceleration: covariant, at the point [1/s²], shape ``(tangent_size,)``
    """

    __slots__ = ('numbers', 'manifold')

    def __init__(self, numbers: np.ndarray, manifold: Manifold):
        """:param numbers: time, phase, point, velocity, acceleration; not copied"""
        self.numbers = numbers
        self.manifold = manifold

    @property
    def time(self) -> float:
        return float(self.numbers[0])

    @property
    def phase(self) -> float:
        return float(self.numbers[1])

    @property
    def point(self) -> np.ndarray:
        size, shape = self.manifold.point_size, self.manifold.point_shape
        return self.numbers[2:2 + size].reshape(shape)

    @property
    def velocity(self) -> np.ndarray:
        first = 2 + self.manifold.point_size
        return self.numbers[first:first + self.manifold.tangent_size]

    @property
    def acceleration(self) -> np.ndarray:
        return self.numbers[2 + self.manifold.point_size + self.manifold.tangent_size:]

    def __iter__(self) -> Iterator[float | np.ndarray]:
        """Time, phase, point, velocity, acceleration."""
        return iter((self.time, self.phase, self.point, self.velocity, self.acceleration))

    def __repr__(self) -> str:
        return (f'State(time={self.time!r}, phase={self.phase!r}, point={self.point!r}, '
                f'velocity={self.velocity!r}, acceleration={self.acceleration!r})')


#: Range of the gains.
LEAST_GAIN, MOST_GAIN = 1e-6, 1e9


class GripperEvent(NamedTuple):
    """
    A command for the gripper at a progress of the motion.

    :ivar progress: from 0 (start) to 1 (nominal end)
    :ivar width: between the fingers [m]
    :ivar force: with which the fingers press [N]; 0: they move to the width only
    :ivar speed: of the fingers [m/s]
    """

    progress: float
    width: float
    force: float
    speed: float


def checked_events(events: tuple[GripperEvent, ...]) -> tuple[GripperEvent, ...]:
    """
    Events in their order.

    :raises ParameterError: if a number is not finite or negative, a progress is beyond 1, or they
        are not in order
    """
    events = tuple(GripperEvent(*_event(event)) for event in events)
    for number, event in enumerate(events):
        if not all(math.isfinite(value) and value >= 0.0 for value in event):
            raise ParameterError(f'gripper event {number}: {tuple(event)}, expected finite '
                                 'numbers of at least 0')
        if event.progress > 1.0 or event.speed == 0.0:
            raise ParameterError(f'gripper event {number}: progress is {event.progress:g}, '
                                 f'expected 0 to 1; speed is {event.speed:g} m/s, expected more '
                                 'than 0')
        if number and event.progress < events[number - 1].progress:
            raise ParameterError(f'gripper event {number}: progress is {event.progress:g}, before '
                                 f'that of the event before, {events[number - 1].progress:g}')
    return events


def _event(event: Sequence[float]) -> list[float]:
    given = numbers('gripper event', event)
    if given.shape != (len(GripperEvent._fields),):
        raise ParameterError(f'gripper event: expected {len(GripperEvent._fields)} numbers, got '
                             f'{event!r}')
    return [float(value) for value in given]


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
    :param alpha_g: gain of a moving goal: a larger one reaches it sooner with a larger jerk
    """

    alpha_z: float = 60.0
    alpha_x: float = 4.6052
    alpha_g: float = 8.0

    def __post_init__(self) -> None:
        for part in fields(self):
            value = getattr(self, part.name)
            if not (isinstance(value, (int, float, np.number)) and LEAST_GAIN <= value
                    <= MOST_GAIN):
                raise ParameterError(f'{part.name} is {value!r}, expected a number from '
                                     f'{LEAST_GAIN:g} to {MOST_GAIN:g}')
            object.__setattr__(self, part.name, float(value))

    @property
    def beta_z(self) -> float:
        """Second gain of the transformation system."""
        return self.alpha_z / 4.0


@dataclass(frozen=True, eq=False)
class Primitive:
    """
    A learned motion on a manifold.

    A rhythmic one repeats a cycle: its start is the point of the cycle at φ = 0, its goal the
    centre (the Fréchet mean of the cycle), its duration the period, and its weights have their
    coordinates in the canonical frame of the centre.

    :ivar manifold: manifold of its points
    :ivar connection: ``parallel`` (exact transport) or ``published`` (the paper's)
    :ivar start: point, shape ``point_shape``
    :ivar goal: point, shape ``point_shape``
    :ivar frame: frame at the start, in which velocity and weights have their coordinates
    :ivar duration: mean of the demonstrations' [s]
    :ivar velocity: ``τ ẏ(0)`` in the frame, shape ``(tangent_size,)``
    :ivar weights: shape ``(n_basis, tangent_size)``
    :ivar steps: grid intervals per duration
    :ivar segments: parts of a motion that is split at the cut locus; empty otherwise
    :ivar via: progress of the via points that the motion has been made to pass, increasing
    :ivar variation: how the takes varied, if there were several
    :ivar events: commands for a gripper on the way, in their order
    :ivar provenance: source of the skill, as text; no part of the computation
    :ivar rhythmic: whether it repeats a cycle; `parallel` only, without segments and via points
    :ivar couplings: what factors keep, such as two arms that carry something; `parallel` only
    :ivar views: the motion as seen from task frames, that of the start first and that of the goal
        last; the rest of the primitive is the motion with the frames where they were shown then
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
    via: tuple[float, ...] = ()
    variation: Variation | None = None
    events: tuple[GripperEvent, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    rhythmic: bool = False
    couplings: tuple[Coupling, ...] = ()
    views: tuple[View, ...] = ()

    def __post_init__(self) -> None:
        check_connection(self.connection)
        if self.rhythmic:
            self._check_rhythmic()
        self._check_couplings()
        for name in ('start', 'goal', 'frame', 'velocity', 'weights'):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64).copy()
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, 'events', checked_events(self.events))
        if self.variation is not None:
            self.variation.check(self.n_basis, self.manifold.tangent_size)
        object.__setattr__(self, 'views', tuple(self.views))
        if self.views:
            check_views(self.views, self.manifold)

    def __repr__(self) -> str:
        return (f'{type(self).__name__}({self.manifold!r}, {self.n_basis} basis functions, '
                f'{self.duration:.4g} s)')

    @property
    def n_basis(self) -> int:
        """Number of basis functions."""
        return len(self.weights)

    def _check_rhythmic(self) -> None:
        if self.connection != 'parallel':
            raise ParameterError(f'connection is {self.connection!r}, expected parallel for a '
                                 'rhythmic skill')
        if len(self.weights) < FEWEST_PERIODIC:
            raise ParameterError(f'weights: {len(self.weights)} basis functions, expected at '
                                 f'least {FEWEST_PERIODIC} for a rhythmic skill')
        for what, given in (('segments', len(self.segments) > 1), ('via points', self.via),
                            ('variation', self.variation), ('gripper commands', self.events)):
            if given:
                self.check_ends(what)

    def _check_couplings(self) -> None:
        object.__setattr__(self, 'couplings', tuple(self.couplings))
        if self.couplings and self.connection != 'parallel':
            raise ParameterError(f'connection is {self.connection!r}, expected parallel for a '
                                 'skill with couplings')
        for coupling in self.couplings:
            coupling.check(self.manifold, self.steps)

    def check_ends(self, what: str) -> None:
        """
        Refuse something that only a motion from a start to a goal has.

        :param what: for the message
        :raises ParameterError: if this is a rhythmic one
        """
        if self.rhythmic:
            raise ParameterError(f'{what}: a rhythmic skill repeats a cycle and has no end')

    def check_plain(self, what: str) -> None:
        """
        Refuse something that a skill with task frames cannot do.

        :param what: for the message
        :raises ParameterError: if it has task frames
        """
        if self.views:
            raise ParameterError(
                f'{what}: the motion of a skill with task frames '
                f'({", ".join(view.name for view in self.views)}) is made of one motion in each '
                'frame; learn it from demonstrations without frames for that')


#: A `Primitive`, or a `gdmp_ros.dmp.Skill`: functions that change one return the same kind.
P = TypeVar('P', bound=Primitive)


def check_connection(connection: str) -> None:
    """:raises ParameterError: if the connection is unknown; the message lists the known ones"""
    if connection not in CONNECTIONS:
        raise ParameterError(f'connection is {connection!r}, expected one of '
                             f'{", ".join(CONNECTIONS)}')


def frame_of(primitive: Primitive, point: np.ndarray) -> np.ndarray:
    """The frame of a primitive, carried from its start to a point."""
    return carry_frame(primitive.manifold, primitive.frame, point)[0]


def change_of_frame(manifold: Manifold, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """
    Matrix from coordinates in a frame to those in another one at the same point.

    On a sphere it also removes the normal component.
    """
    columns = [manifold.to_frame(second, manifold.from_frame(first, unit))
               for unit in np.eye(manifold.tangent_size)]
    return np.array(columns).T


def carry_frame(manifold: Manifold, frame: np.ndarray,
                point: np.ndarray) -> tuple[np.ndarray, bool]:
    """
    Transport a frame along the geodesic to ``point``.

    :returns: the frame, and whether ``point`` is on the cut locus: one of the shortest geodesics
        was taken then
    """
    step, distance = manifold.log_in_frame(frame, point)
    return manifold.transport_frame(frame, step), distance < CUT_LOCUS_LIMIT
