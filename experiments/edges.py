"""
Learning at its edges: bad stamps, few samples, wrong ends, missing blocks, relations, cycles.

Every draw is another motion. A row of the result has what was asked of every draw, and the worst.
"""
from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any, NamedTuple
import warnings

import numpy as np
from scipy.interpolate import CubicSpline

from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.learning.report import cycle_takes
from gdmp_ros.manifolds import Euclidean, Product, UnitQuaternion
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.util.profiles import minimum_jerk

TOOL = Product(Euclidean(3), UnitQuaternion(), names=['position', 'orientation'])
#: Noise of positions [m]; that of rotations is 4 rad/m of it.
NOISE_M, NOISE_RAD = 5e-4, 4.0
RATE_HZ = 100.0
SAMPLES = 1500


class Motion(NamedTuple):
    """
    A motion whose truth is known.

    :ivar at: poses at times [s], shape ``(T, 7)``
    """

    at: Callable[[np.ndarray], np.ndarray]
    duration: float


class Bound(NamedTuple):
    """What is asked of a number: at most this."""

    name: str
    most: float


def motion(rng: np.random.Generator) -> Motion:
    """A reach with an arc and a turn of the tool, from rest to rest."""
    duration, way = rng.uniform(1.5, 5.0), rng.uniform(-0.3, 0.3, 3)
    arc, axis = 0.1 * rng.standard_normal(3), rng.standard_normal(3)
    turn = rng.uniform(0.2, 2.0) * axis / np.linalg.norm(axis)

    def at(times: np.ndarray) -> np.ndarray:
        share = minimum_jerk(np.clip(times / duration, 0.0, 1.0))
        poses = np.zeros((len(times), 7))
        poses[:, :3] = np.outer(share, way) + np.outer(16.0 * (share * (1.0 - share)) ** 2, arc)
        for row, part in zip(poses, share):
            rotate_by_vector(np.array([1.0, 0.0, 0.0, 0.0]), part * turn, row[3:])
        return poses
    return Motion(at, duration)


def noisy(poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Poses with noise."""
    result = poses.copy()
    result[:, :3] += NOISE_M * rng.standard_normal((len(poses), 3))
    for row, turn in zip(result, NOISE_RAD * NOISE_M * rng.standard_normal((len(poses), 3))):
        rotate_by_vector(row[3:].copy(), turn, row[3:])
    return result


def grating(rng: np.random.Generator, cycles: int, samples: int, uneven: float, walk: float
            ) -> tuple[Demonstration, float]:
    """
    Strokes of a hand: each cycle has its own length and size, and the centre walks.

    :param samples: of a cycle, at 30 Hz
    :param uneven: largest difference of a cycle from the mean, as a part of it
    :param walk: of the centre in each cycle, as a part of the length of the strokes
    :returns: the recording, and its largest acceleration without the noise [m/s²]
    """
    lengths = samples / 30.0 * (1.0 + uneven * rng.uniform(-1.0, 1.0, cycles + 1))
    sizes = 0.1 * (1.0 + uneven * rng.uniform(-1.0, 1.0, cycles + 1))
    marks = np.concatenate([[0.0], np.cumsum(lengths)])
    passed = CubicSpline(marks, np.arange(cycles + 2.0))
    size = CubicSpline(np.arange(cycles + 1.0) + 0.5, sizes)

    def at(times: np.ndarray) -> np.ndarray:
        phase = passed(times)
        radius, angle = size(np.clip(phase, 0.5, cycles + 0.5)), 2.0 * np.pi * phase
        path = np.column_stack([radius * np.sin(angle),
                                0.15 * radius * np.cos(angle) + 0.02 * np.sin(2.0 * angle),
                                0.02 * np.cos(2.0 * angle)])
        return np.asarray(path + np.outer(0.2 * walk * phase, [0.2, 0.9, 0.1]))
    times = np.arange(0.0, marks[cycles], 1.0 / 30.0)
    points = at(times) + NOISE_M * rng.standard_normal((len(times), 3))
    return (Demonstration(times, points, Euclidean(3)),
            largest_acceleration(at, float(times[-1]))[0])


def largest_acceleration(at: Callable[[np.ndarray], np.ndarray], duration: float
                         ) -> tuple[float, float]:
    """Largest acceleration of a path [m/s²], and its speed at the start [m/s]."""
    times = np.linspace(0.0, duration, SAMPLES)
    velocity = np.gradient(at(times)[:, :3], times, axis=0)
    acceleration = np.gradient(velocity, times, axis=0)[5:-5]
    return (float(np.linalg.norm(acceleration, axis=1).max()),
            float(np.linalg.norm(velocity[0])))


def _judged(shown: Motion, times: np.ndarray, poses: np.ndarray) -> dict[str, float]:
    """
    A skill of a recording beside the truth.

    Errors and noise are distances in space, or angles: the noise of three coordinates together.
    """
    noise = math.sqrt(3.0) * NOISE_M
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter('always')
        skill = Skill.learn(Demonstration(times, poses, TOOL))
    wanted = np.linspace(0.0, shown.duration, SAMPLES)

    def at(moments: np.ndarray) -> np.ndarray:
        return skill.rollout(duration=shown.duration).sample(moments).points

    path, truth = at(wanted), shown.at(wanted)
    fastest, start = largest_acceleration(at, shown.duration)
    turned = np.clip(np.abs((path[:, 3:] * truth[:, 3:]).sum(axis=1)), 0.0, 1.0)
    away = np.linalg.norm(path[:, :3] - truth[:, :3], axis=1)
    return {'error / noise': float(np.sqrt((away ** 2).mean())) / noise,
            'largest rotation error / noise': float(2.0 * np.arccos(turned).max())
            / (NOISE_RAD * noise),
            'acceleration / clean': fastest / largest_acceleration(shown.at, shown.duration)[0],
            'start speed [mm/s]': 1e3 * start, 'start error / noise': float(away[0]) / noise,
            'goal error / noise': float(away[-1]) / noise, 'not told': float(not told)}


def bursts(rng: np.random.Generator) -> dict[str, float]:
    """Samples taken evenly, and stamped three at a time."""
    shown = motion(rng)
    times = np.linspace(0.0, shown.duration, round(RATE_HZ * shown.duration))
    number = np.arange(len(times))
    last = np.minimum(number // 3 * 3 + 2, len(times) - 1)
    stamps = times[last] + number % 3 * rng.uniform(20e-6, 200e-6)
    return _judged(shown, stamps, noisy(shown.at(times), rng))


def near_stamps(rng: np.random.Generator) -> dict[str, float]:
    """A pair of samples 1 µs apart."""
    shown = motion(rng)
    times = np.linspace(0.0, shown.duration, round(RATE_HZ * shown.duration))
    at = rng.integers(5, len(times) - 5)
    times = np.insert(times, at + 1, times[at] + 1e-6)
    return _judged(shown, times, noisy(shown.at(times), rng))


def rates(rng: np.random.Generator) -> dict[str, float]:
    """Few samples: 20 to 150."""
    shown = motion(rng)
    times = np.linspace(0.0, shown.duration, int(rng.integers(20, 151)))
    return _judged(shown, times, noisy(shown.at(times), rng))


def _end(rng: np.random.Generator, at: int) -> dict[str, float]:
    shown, away = motion(rng), rng.standard_normal(3)
    times = np.linspace(0.0, shown.duration, round(RATE_HZ * shown.duration))
    poses = noisy(shown.at(times), rng)
    poses[at, :3] += rng.uniform(0.02, 0.05) * away / np.linalg.norm(away)
    return _judged(shown, times, poses)


def first_sample(rng: np.random.Generator) -> dict[str, float]:
    """The first sample is 20 to 50 mm off."""
    return _end(rng, 0)


def last_sample(rng: np.random.Generator) -> dict[str, float]:
    """The last sample is 20 to 50 mm off."""
    return _end(rng, -1)


def blocks(rng: np.random.Generator) -> dict[str, float]:
    """Three blocks of 0.3 s are missing."""
    shown = motion(rng)
    times = np.linspace(0.0, shown.duration, round(RATE_HZ * shown.duration))
    kept = np.ones(len(times), dtype=bool)
    for part in range(3):
        begin = shown.duration * rng.uniform(0.06 + 0.3 * part, 0.16 + 0.3 * part)
        kept &= (times < begin) | (times > begin + min(0.3, 0.15 * shown.duration))
    return _judged(shown, times[kept], noisy(shown.at(times), rng)[kept])


def relations(rng: np.random.Generator) -> dict[str, float]:
    """Two arms that begin up to 2.5 rad and 0.3 m away from their relation."""
    shown = motion(rng)
    grasp = np.array([*rng.uniform(-0.5, 0.5, 3), 1.0, 0.0, 0.0, 0.0])
    rotate_by_vector(grasp[3:].copy(), rng.standard_normal(3), grasp[3:])
    times = np.linspace(0.0, shown.duration, 300)
    left = shown.at(times)
    right = np.array([compose(pose, grasp) for pose in left])
    first, second = (Skill.learn(Demonstration(times, path, TOOL)) for path in (left, right))
    pair = Skill.joined(first, second, ('left', 'right'))
    ours, theirs = (tuple(f'{side}_{name}' for name in TOOL.names) for side in ('left', 'right'))
    pair = pair.coupled(Coupling.at('pose', ours, theirs, pair.manifold, pair.goal))
    start, axis = pair.start.copy(), rng.standard_normal(3)
    rotate_by_vector(start[10:].copy(), rng.uniform(0.3, 2.5) * axis / np.linalg.norm(axis),
                     start[10:])
    offset = 0.1 * rng.standard_normal(3)
    start[7:10] += offset
    dt = float(rng.choice([0.0005, 0.001, 0.005, 0.02]))
    moments = np.arange(0.0, 1.2 * shown.duration, dt)
    paths = [pair.rollout(start=begin).sample(moments).points for begin in (pair.start, start)]
    steps = [float(np.linalg.norm(np.diff(path[:, 7:10], axis=0), axis=1).max())
             for path in paths]
    # What fades over a quarter of the motion is at most twice as fast as its mean.
    allowed = 1.2 * steps[0] + float(np.linalg.norm(offset)) * 2.0 * dt / (
        0.25 * shown.duration)
    later = paths[1][moments > 0.27 * shown.duration][::max(1, round(0.02 / dt))]
    left_over = max(float(pair.couplings[0].deviation(pair.manifold, point).max())
                    for point in later)
    return {'largest step / smooth': steps[1] / allowed,
            'deviation after a quarter [mm, mrad]': 1e3 * left_over}


def cycles(rng: np.random.Generator) -> dict[str, float]:
    """Three to eight cycles that differ by 10 to 30 %, with a centre that may walk."""
    count, uneven = int(rng.integers(3, 9)), rng.uniform(0.1, 0.3)
    walk = float(rng.choice([0.0, 0.02, 0.05, 0.1, 0.2]))
    shown, fastest = grating(rng, count, int(rng.integers(20, 61)), uneven, walk)
    try:
        skill = Skill.learn_rhythmic(shown)
    except DataError:
        return {'acceleration / data': np.inf, 'refused': 1.0, 'one cycle': 0.0}
    found = cycle_takes(skill, [shown])[0].cycles
    own, _ = largest_acceleration(lambda times: skill.rollout().sample(times).points,
                                  2.0 * skill.duration)
    return {'acceleration / data': own / fastest, 'refused': 0.0,
            'one cycle': float(found < 1.8 or found > count + 1.0)}


_FIT = (Bound('error / noise', 3.0), Bound('acceleration / clean', 2.0))
CASES: dict[str, tuple[Callable[[np.random.Generator], dict[str, float]], tuple[Bound, ...]]] = {
    'bursts': (bursts, (*_FIT, Bound('largest rotation error / noise', 3.0),
                        Bound('not told', 0.0))),
    'near stamps': (near_stamps, (*_FIT, Bound('largest rotation error / noise', 3.0))),
    'rates': (rates, (*_FIT, Bound('start speed [mm/s]', 5.0))),
    'first sample': (first_sample, (*_FIT, Bound('start error / noise', 3.0),
                                    Bound('not told', 0.0))),
    'last sample': (last_sample, (*_FIT, Bound('goal error / noise', 3.0),
                                  Bound('not told', 0.0))),
    'blocks': (blocks, (*_FIT, Bound('not told', 0.0))),
    'relations': (relations, (Bound('largest step / smooth', 1.0),
                              Bound('deviation after a quarter [mm, mrad]', 1.0))),
    'cycles': (cycles, (Bound('acceleration / data', 1.5), Bound('refused', 0.0),
                        Bound('one cycle', 0.0))),
}


def draw(task: tuple[str, int]) -> dict[str, float]:
    """One draw of a case."""
    case, seed = task
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        return CASES[case][0](np.random.default_rng([seed, list(CASES).index(case)]))


def rows(case: str, results: list[dict[str, float]]) -> list[dict[str, Any]]:
    """The rows of the result: what was asked of each draw, the worst, and how many hold."""
    result = []
    for bound in CASES[case][1]:
        values = np.array([one[bound.name] for one in results])
        result.append({'case': f'{case}: {bound.name}', 'asked': f'<= {bound.most:g}',
                       'measured': float(values.max()), 'median': float(np.median(values)),
                       'draws': len(values), 'holding': int((values <= bound.most).sum()),
                       'holds': bool((values <= bound.most).all())})
    return result
