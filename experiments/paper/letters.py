"""The 2D-Letters data set on every manifold; SPD(2) is the manipulability of a writing arm."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from experiments.paper.best_fit import best_error
from experiments.paper.experiment import Data, Settings, Verdict
from experiments.paper.fig3 import curves, errors_of, print_errors, profiles, spread
from gdmp_ros.choices import CONNECTIONS, LASA_MANIFOLDS
from gdmp_ros.data import public_sets
from gdmp_ros.util.parallel import map_tasks

CLAIM = ('Every demonstration of the 2D-Letters data set is reproduced on R², S², S³, SO(3) and, '
         'as manipulability, on SPD(2), nearly as accurately as 60 basis functions can.')
SOURCE = '[GDMP] section 5, second data set'
#: Largest mean error, relative to the mean of the smallest errors that are possible.
RATIO = 1.3
#: An error of this part of the span is a failure, not a reproduction.
FAILED = 0.1


def errors(task: tuple[str, str]) -> list[list[float]]:
    """Mean error / span of each demonstration of a letter: each connection, then the best."""
    path, manifold = task
    shown = [public_sets.on_manifold(stroke, manifold)
             for stroke in public_sets.strokes(Path(path))]
    return [*errors_of(shown), [best_error(one) for one in shown]]


def run(settings: Settings) -> Data:
    """Errors of every letter in the folder; nothing without the data set."""
    if settings.letters is None:
        return {}
    found = public_sets.files(settings.letters)
    done = map_tasks('2D-Letters', errors, {
        f'{path.stem} {manifold}': (str(path), manifold)
        for manifold in LASA_MANIFOLDS for path in found}, settings.jobs)
    longest = max(len(result[0]) for result in done.values())
    count = sum(len(public_sets.strokes(path)) for path in found)
    data: Data = {'letters': np.array([path.stem for path in found]),
                  'expected': np.full(len(LASA_MANIFOLDS), count)}
    for manifold in LASA_MANIFOLDS:
        for i, kind in enumerate((*CONNECTIONS, 'best')):
            rows = [done[f'{path.stem} {manifold}'][i] for path in found]
            data[f'errors_{manifold}_{kind}'] = np.array(
                [row + [np.nan] * (longest - len(row)) for row in rows])
        shown = public_sets.on_manifold(public_sets.strokes(found[0])[0], manifold)
        data.update({f'{manifold}_{key}': value for key, value in curves(shown).items()})
    return data


def verdict(data: Data) -> Verdict:
    """Mean error over the mean of the best errors, by manifold; None without the data set."""
    if not data:
        return Verdict(None, {}, 'The 2D-Letters data set was not given. It is public: '
                       f'{public_sets.ADDRESS}. Name its folder with --letters or GDMP_LETTERS.')
    found = tuple(str(name) for name in data['letters'])
    print_errors(data, LASA_MANIFOLDS, found)
    measured: dict[str, Any] = {'files': len(found), 'letters': ' '.join(found),
                                'demonstrations': int(data['expected'][0])}
    ratios, complete = {}, True
    for manifold, expected in zip(LASA_MANIFOLDS, data['expected']):
        ours, published, best = (data[f'errors_{manifold}_{kind}'].reshape(-1)
                                 for kind in (*CONNECTIONS, 'best'))
        ratios[manifold] = float(np.nanmean(ours) / np.nanmean(best))
        complete = complete and int(np.isfinite(ours).sum()) == expected
        # `published` is reported by its failures: their mean says nothing about the others.
        good = published[published < FAILED]
        measured |= {
            f'{manifold}_ratio_to_the_best': ratios[manifold],
            f'{manifold}_mean': float(np.nanmean(ours)),
            f'{manifold}_best_mean': float(np.nanmean(best)),
            f'{manifold}_largest': float(np.nanmax(ours)),
            f'{manifold}_more_than_{RATIO:g}_times_their_best': int(
                np.nansum(ours > RATIO * best)),
            f'{manifold}_published_failures': int(expected - len(good)),
            f'{manifold}_published_mean_without_failures': float(good.mean())}
    return Verdict(bool(complete and max(ratios.values()) <= RATIO), measured, (
        f'{len(found)} of 26 letters were found. The verdict compares the means with the smallest '
        'means that 60 basis functions can reach: least squares of the positions on the unrolled '
        f'curve. A failure is an error of more than {FAILED:g} of the span. Single strokes on S² '
        'and S³ have errors of many times their best. They stay for a long time between π/2 and '
        '2.04 rad from the goal. There the spring towards the goal pushes sideways '
        '(r cot r < 0), and deviations of the regression grow. A motion is split only 1.1 rad '
        'before the cut locus. Split from π/2 on, the 40 worst strokes have a median of 1.2 '
        'times their best error.'))


def draw(data: Data) -> dict[str, Any]:
    """The first letter on every manifold, and the errors of all."""
    return {'letters': profiles(data, list(LASA_MANIFOLDS)),
            'letters-errors': spread(data, LASA_MANIFOLDS)}
