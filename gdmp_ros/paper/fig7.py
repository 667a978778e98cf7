"""How the time of a step grows with the size of SPD matrices."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros import plots
from gdmp_ros.bench.spd import SIZES, step_times
from gdmp_ros.paper.experiment import Data, Settings, Verdict
from gdmp_ros.terminal import progress

CLAIM = ('From SPD(2) to SPD(20), explicit parallel transport costs more and more; G-DMP, '
         'published or with parallel frames, is cheaper at every size.')
SOURCE = '[GDMP] Fig. 7, section 5.3'
METHODS = {'parallel_us': 'G-DMP parallel', 'published_us': 'G-DMP published',
           'explicit_us': '[18], transport to the start', 'along_us': 'transport along the path'}


def run(settings: Settings) -> Data:
    """Median step times [µs] at each size."""
    rows = []
    with progress('SPD(2) to SPD(20)', len(SIZES)) as done:
        for m in SIZES:
            rows.append(step_times(m, 7))
            done()
    return {'m': np.array(SIZES), **{name: np.array([row[name] for row in rows])
                                     for name in METHODS}}


def verdict(data: Data) -> Verdict:
    """Whether ours is cheaper at every size."""
    ratio = data['explicit_us'] / data['parallel_us']
    measured = {'times_cheaper_than_[18]_smallest': ratio.min(),
                'times_cheaper_than_[18]_largest': ratio.max(),
                **{f'{name[:-3]}_m=2_us': data[name][0] for name in METHODS},
                **{f'{name[:-3]}_m=20_us': data[name][-1] for name in METHODS}}
    cheaper = (ratio > 1.0).all() and (data['explicit_us'] > data['published_us']).all()
    return Verdict(bool(cheaper), measured, (
        'The growth is that of an eigenproblem, m³, for all of them: a constant factor lies '
        'between the methods, not an exponential.'))


def draw(data: Data) -> dict[str, Any]:
    """Growth curves."""
    figure, axes = plots.panels(1, 1, (6.4, 4.4))
    for i, (name, label) in enumerate(METHODS.items()):
        axes[0, 0].plot(data['m'], data[name], marker='osv^'[i], ms=4, ls=plots.STYLES[i],
                        color=plots.INK[i], label=label)
    axes[0, 0].set(xlabel='size m of the matrices', ylabel='time of a step [µs]', yscale='log',
                   xticks=data['m'][::2])
    axes[0, 0].legend()
    return {'fig7': figure}
