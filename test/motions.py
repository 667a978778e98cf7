"""Smooth motions on any manifold, to learn from."""
import numpy as np

from gdmp_ros import (
    Demonstration,
    Euclidean,
    Product,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.util.profiles import minimum_jerk

TOOL = Product(Euclidean(3), UnitQuaternion(), SymmetricPositiveDefinite(3),
               names=['position', 'orientation', 'stiffness'])
#: One of each kind, and a product.
MANIFOLDS = [Euclidean(3), Sphere(2), UnitQuaternion(), SpecialOrthogonal(3),
             SymmetricPositiveDefinite(3), TOOL]
#: Stamps of `takes` [s].
TAKE_TIMES = np.linspace(0.0, 2.0, 300)


def motion(manifold, rng, duration=2.0, size=0.5):
    """A curve of 500 samples, at rest at both ends."""
    times = np.linspace(0.0, 1.0, 500)
    blend = minimum_jerk(times)
    base = manifold.random_point(rng)
    first, second = manifold.random_tangent(base, rng), manifold.random_tangent(base, rng)
    first *= size / manifold.norm(base, first)
    second *= 0.3 * size / manifold.norm(base, second)
    points = [manifold.exp(base, b * first + np.sin(2.0 * np.pi * b) * second) for b in blend]
    return Demonstration(duration * times, np.array(points), manifold)


def wave(manifold, rng, times, cycles=1.0, size=0.5):
    """A curve with a number of cycles at given times, at rest at both ends."""
    base = manifold.random_point(rng)
    first, second = manifold.random_tangent(base, rng), manifold.random_tangent(base, rng)
    first *= size / manifold.norm(base, first)
    second *= 0.4 * size / manifold.norm(base, second)
    t = (times - times[0]) / (times[-1] - times[0])
    points = [manifold.exp(base, b * first + np.sin(2.0 * np.pi * cycles * b) * second)
              for b in minimum_jerk(t)]
    return Demonstration(times, np.array(points), manifold)


def takes(manifold, count, rng, spread=0.05, timing=0.05):
    """Takes with their own starts, goals, bows and timing around one motion."""
    base = manifold.random_point(rng)
    frame = manifold.frame(base)
    directions = [manifold.to_frame(frame, manifold.random_tangent(base, rng)) for _ in range(2)]
    passed, result = TAKE_TIMES / TAKE_TIMES[-1], []
    for _ in range(count):
        start, goal, bow = spread * rng.standard_normal((3, manifold.tangent_size))
        progress = passed + timing * rng.uniform(-1.0, 1.0) * np.sin(np.pi * passed) ** 2
        blend = minimum_jerk(progress)[:, None]
        wave = np.sin(np.pi * blend) ** 2
        away = ((1.0 - blend) * start + blend * (goal + 0.5 * directions[0])
                + wave * (bow + 0.2 * directions[1]))
        result.append(Demonstration(TAKE_TIMES, np.array(
            [manifold.exp(base, manifold.from_frame(frame, one)) for one in away]), manifold))
    return result


def accelerations(rollout, ticks=400):
    """Accelerations of the next ticks of a roll-out."""
    return np.array([rollout.advance(1e-3).acceleration for _ in range(ticks)])


class ClosedCurve:
    """
    A closed curve on a manifold, as a function of the cycles passed.

    :ivar span: largest distance from its start
    """

    def __init__(self, manifold, base, coordinates):
        self.manifold, self._base, self._coordinates = manifold, base, coordinates
        around = self.points(np.linspace(0.0, 1.0, 200))
        self.span = float(np.linalg.norm(manifold.factor_distances(
            np.repeat(around[:1], 200, axis=0), around), axis=1).max())

    def at(self, progress):
        """Point."""
        manifold = self.manifold
        return manifold.exp(self._base, manifold.from_frame(
            manifold.frame(self._base), self._coordinates(progress)))

    def points(self, progress):
        """Flat points."""
        return np.array([self.manifold.flat(self.at(s)) for s in progress])


def cycle(manifold, rng, size=0.6, harmonics=3):
    """A closed curve with some harmonics, of a largest distance ``size`` from a point."""
    base = manifold.random_point(rng)
    frame = manifold.frame(base)
    drawn = np.array([[manifold.to_frame(frame, manifold.random_tangent(base, rng)) / (k + 1) ** 2
                       for k in range(harmonics)] for _ in range(2)])
    order = 2.0 * np.pi * np.arange(1, harmonics + 1)

    def coordinates(progress):
        return np.cos(order * progress) @ drawn[0] + np.sin(order * progress) @ drawn[1]

    largest = max(np.linalg.norm(coordinates(s)) for s in np.linspace(0.0, 1.0, 100))
    drawn *= size / largest
    return ClosedCurve(manifold, base, coordinates)


def recorded_cycles(manifold, curve, period, cycles, dt=0.01, noise=0.0, rng=None):
    """A demonstration of a closed curve; ``noise`` is the sd along each direction."""
    times = np.arange(0.0, cycles * period, dt)
    points = [curve.at(t / period) for t in times]
    if noise:
        points = [manifold.exp(p, noise * manifold.random_tangent(p, rng)) for p in points]
    return Demonstration(times, np.array(points), manifold)


def cycle_error(rollout, curve):
    """Distances of the next cycle of a roll-out from the demonstrated curve, at equal phases."""
    manifold, skill = curve.manifold, rollout.skill
    begin, s = rollout.motion.scalars.time, np.linspace(0.0, 1.0, 101)
    points = rollout.sample(begin + s * skill.duration).points.reshape(len(s), -1)
    expected = curve.points(begin / skill.duration + s)
    expected = np.array([manifold.flat(manifold.align(
        one.reshape(manifold.point_shape), there.reshape(manifold.point_shape)))
        for one, there in zip(expected, points)])
    return np.linalg.norm(manifold.factor_distances(points, expected), axis=1)


def circles(pose, radius, cycles, turn=0.0):
    """
    The tool goes round a pose, once in a second.

    :param turn: by which it also turns to and fro about z [rad / 2]
    """
    times, manifold = np.arange(0.0, cycles, 0.01), tool_manifold(None)
    angle = 2.0 * np.pi * times
    away = np.zeros((len(times), 6))
    away[:, 0], away[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    away[:, 5] = turn * np.sin(angle)
    return Demonstration(times, np.array([manifold.exp(pose, one) for one in away]), manifold)
