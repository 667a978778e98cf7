"""What transport costs on SPD(m): both connections, an explicit one, and a peer's maps."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gdmp_ros.bench import measure
from gdmp_ros.bench.explicit import ExplicitTransport
from gdmp_ros.bench.peers import spd_manifold
from gdmp_ros.bench.step import measure_step
from gdmp_ros.manifolds import SymmetricPositiveDefinite

TITLE = 'one step on SPD(m), 50 basis functions'
SIZES = tuple(range(2, 21))


def run(settings: measure.Settings) -> dict[str, Any]:
    """The figures, keys as in the file; times in µs."""
    lines = []
    for m in SIZES:
        manifold = SymmetricPositiveDefinite(m)
        parallel, published = (measure.skill(manifold, 5.0, connection=name)
                               for name in ('parallel', 'published'))
        explicit = ExplicitTransport(parallel)
        with measure.one_core():
            lines.append({
                'm': m, 'parallel_us': measure_step(parallel, settings.repetitions),
                'published_us': measure_step(published, settings.repetitions),
                'explicit_us': measure.median_time(
                    _always(explicit.step), 300, settings.repetitions) * 1e6,
                **_maps(manifold, settings.repetitions)})
        lines[-1]['ratio'] = lines[-1]['parallel_us'] / lines[-1]['published_us']
    return {'rows': lines}


def _maps(manifold: SymmetricPositiveDefinite, repetitions: int) -> dict[str, float]:
    """Logarithm and exponential, ours and pymanopt's [µs]."""
    rng, peer = np.random.default_rng(0), spd_manifold(manifold.m)
    a, b = manifold.random_point(rng), manifold.random_point(rng)
    ours, theirs = manifold.log(a, b), peer.log(a, b)
    timed = {'log_us': lambda: manifold.log(a, b), 'peer_log_us': lambda: peer.log(a, b),
             'exp_us': lambda: manifold.exp(a, ours), 'peer_exp_us': lambda: peer.exp(a, theirs)}
    return {key: measure.median_time(_always(call), 100, repetitions) * 1e6
            for key, call in timed.items()}


def _always(call: Callable[[], object]) -> Callable[[], Callable[[], object]]:
    return lambda: call


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heads, then lines."""
    heads = ['m', 'parallel µs', 'published µs', 'ratio', 'explicit transport µs', 'log µs',
             'pymanopt', 'exp µs', 'pymanopt']
    return [heads, *([str(r['m']), f'{r["parallel_us"]:.2f}', f'{r["published_us"]:.2f}',
                      f'{r["ratio"]:.2f}', f'{r["explicit_us"]:.2f}', f'{r["log_us"]:.1f}',
                      f'{r["peer_log_us"]:.0f}', f'{r["exp_us"]:.1f}', f'{r["peer_exp_us"]:.0f}']
                     for r in document['rows'])]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Growth with m."""
    m = [r['m'] for r in document['rows']]
    for key, name, style in (('parallel_us', 'parallel', '-o'),
                             ('published_us', 'published', '--s'),
                             ('explicit_us', 'explicit transport', ':^')):
        axes.plot(m, [r[key] for r in document['rows']], style, color='black', ms=4, label=name)
    axes.set(xlabel='m', ylabel='time of a step [µs]', yscale='log', title=TITLE)
    axes.set_xticks(m[::3])
    axes.legend()
