"""Smooth motions on any manifold, to learn from."""
import numpy as np

from gdmp_ros import Demonstration, Euclidean, Product, SymmetricPositiveDefinite, UnitQuaternion
from gdmp_ros.util.profiles import minimum_jerk

TOOL = Product(Euclidean(3), UnitQuaternion(), SymmetricPositiveDefinite(3),
               names=['position', 'orientation', 'stiffness'])
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
