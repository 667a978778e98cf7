"""Time of a step on SPD(m): both connections, explicit transport, and maps of pymanopt."""
from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

import numpy as np

from experiments import timing
from experiments.baselines.baseline import Baseline
from experiments.baselines.transported import TransportedAlong, TransportedToStart
from experiments.bench.peers import spd_manifold
from experiments.bench.step import measure_step
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

TITLE = 'one step on SPD(m), 50 basis functions'
SIZES = tuple(range(2, 21))


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Figures; the keys are those of the file, times in µs."""
    lines = []
    for m in SIZES:
        times = step_times(m, settings.repetitions)
        with timing.one_core():
            times.update(_maps(SymmetricPositiveDefinite(m), settings.repetitions))
        lines.append({'m': m, **times, 'ratio': times['parallel_us'] / times['published_us']})
    return {'rows': lines}


def step_times(m: int, repetitions: int) -> dict[str, float]:
    """
    Time of one step on SPD(m), by method [µs].

    The methods alternate, so that other load of the machine affects all of them equally; only the
    time of the thread counts.
    """
    manifold = SymmetricPositiveDefinite(m)
    shown = timing.demonstration(manifold, 5.0, samples=300)
    ours = {name: timing.skill(manifold, 5.0, connection=name)
            for name in ('parallel', 'published')}
    theirs = {'explicit': TransportedToStart(shown, 50), 'along': TransportedAlong(shown, 50)}
    taken: dict[str, list[float]] = {}
    with timing.one_core():
        for _ in range(repetitions):
            for name, skill in ours.items():
                taken.setdefault(name, []).append(measure_step(
                    skill, 1, clock=time.thread_time))
            for name, method in theirs.items():
                taken.setdefault(name, []).append(
                    1e6 * timing.median_time(_from_start(method), 300, 1, time.thread_time))
    return {f'{name}_us': float(np.median(times)) for name, times in taken.items()}


def _maps(manifold: SymmetricPositiveDefinite, repetitions: int) -> dict[str, float]:
    """Logarithm and exponential, of gdmp_ros and of pymanopt [µs]."""
    rng, peer = np.random.default_rng(0), spd_manifold(manifold.size)
    a, b = manifold.random_point(rng), manifold.random_point(rng)
    ours, theirs = manifold.log(a, b), peer.log(a, b)
    timed = {'log_us': lambda: manifold.log(a, b), 'peer_log_us': lambda: peer.log(a, b),
             'exp_us': lambda: manifold.exp(a, ours), 'peer_exp_us': lambda: peer.exp(a, theirs)}
    return {key: timing.median_time(_always(call), 100, repetitions) * 1e6
            for key, call in timed.items()}


def _always(call: Callable[[], object]) -> Callable[[], Callable[[], object]]:
    return lambda: call


def _from_start(method: Baseline) -> Callable[[], Callable[[], object]]:
    def prepare() -> Callable[[], object]:
        method.reset()
        return method.step
    return prepare


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    heads = ['m', 'parallel µs', 'published µs', 'ratio', 'transport to the start µs',
             'along µs', 'log µs',
             'pymanopt', 'exp µs', 'pymanopt']
    return [heads, *([str(r['m']), f'{r["parallel_us"]:.2f}', f'{r["published_us"]:.2f}',
                      f'{r["ratio"]:.2f}', f'{r["explicit_us"]:.2f}',
                      f'{r["along_us"]:.2f}', f'{r["log_us"]:.1f}',
                      f'{r["peer_log_us"]:.0f}', f'{r["exp_us"]:.1f}', f'{r["peer_exp_us"]:.0f}']
                     for r in document['rows'])]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Growth with m."""
    m = [r['m'] for r in document['rows']]
    for key, name, style in (('parallel_us', 'parallel', '-o'),
                             ('published_us', 'published', '--s'),
                             ('explicit_us', 'transport to the start', ':^'),
                             ('along_us', 'transport along the path', '-.v')):
        axes.plot(m, [r[key] for r in document['rows']], style, color='black', ms=4, label=name)
    axes.set(xlabel='m', ylabel='time of a step [µs]', yscale='log', title=TITLE)
    axes.set_xticks(m[::3])
    axes.legend()
