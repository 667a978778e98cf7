"""Growth of the time of a step with the size of SPD matrices."""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments.bench.spd import SIZES, step_times
from experiments.paper.experiment import Data, Settings, Verdict
from gdmp_ros.util.terminal import progress
from gdmp_ros.view import plots

CLAIM = ('From SPD(2) to SPD(20), G-DMP is cheaper than explicit parallel transport: with '
         'parallel frames at every size, as published on average over SPD(3) to SPD(20).')
SOURCE = '[GDMP] Fig. 7, section 5.3'
CURVES = {'parallel_us': 'G-DMP parallel', 'published_us': 'G-DMP published',
           'explicit_us': '[18], transport to the start', 'along_us': 'transport along the path'}


def run(settings: Settings) -> Data:
    """Step times [µs] at each size."""
    rows = []
    with progress('SPD(2) to SPD(20)', len(SIZES)) as done:
        for m in SIZES:
            rows.append(step_times(m, 7))
            done()
    return {'m': np.array(SIZES), **{name: np.array([row[name] for row in rows])
                                     for name in CURVES}}


def verdict(data: Data) -> Verdict:
    """Whether parallel frames are cheaper at every size, and published ones on average."""
    ratio = data['explicit_us'] / data['parallel_us']
    # Those of published frames are near those of transport: single sizes are within the noise.
    published = {one: np.exp(np.log(data[one] / data['published_us'])[data['m'] > 2].mean())
                 for one in ('explicit_us', 'along_us')}
    cheaper = min(published.values()) > 1.0 and all(
        (data[one] > data['parallel_us']).all() for one in published)
    large = data['m'] >= 10
    growth = {f'{name[:-3]}_grows_as_m_to_the': np.polyfit(
        np.log(data['m'][large]), np.log(data[name][large]), 1)[0] for name in CURVES}
    measured = {'times_cheaper_than_[18]_smallest': ratio.min(),
                'times_cheaper_than_[18]_largest': ratio.max(),
                'times_published_is_cheaper_than_[18]': published['explicit_us'],
                **growth, **{f'{name[:-3]}_m=2_us': data[name][0] for name in CURVES},
                **{f'{name[:-3]}_m=20_us': data[name][-1] for name in CURVES}}
    return Verdict(bool(cheaper), measured, (
        'A step of 1 ms of a skill of 5 s. The times grow like a power of m, above m = 10 with '
        'the exponents above; the paper writes “exponentially”.'))


def draw(data: Data) -> dict[str, Any]:
    """Growth curves."""
    figure, axes = plots.panels(1, 1, (6.4, 4.4))
    for i, (name, label) in enumerate(CURVES.items()):
        axes[0, 0].plot(data['m'], data[name], marker='osv^'[i], ms=4, ls=plots.STYLES[i],
                        color=plots.INK[i], label=label)
    axes[0, 0].set(xlabel='size m of the matrices', ylabel='time of a step [µs]', yscale='log',
                   xticks=data['m'][::2])
    axes[0, 0].legend()
    return {'fig7': figure}
