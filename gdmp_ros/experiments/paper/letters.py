"""The 2D-Letters data set on every manifold, SPD as the manipulability of an arm that writes."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gdmp_ros.data import lasa, letters
from gdmp_ros.dmp.primitive import CONNECTIONS
from gdmp_ros.experiments.paper.experiment import Data, Settings, Verdict
from gdmp_ros.experiments.paper.fig3 import curves, errors_of, judged, profiles, spread
from gdmp_ros.util.parallel import map_tasks

CLAIM = ('Every demonstration of the 2D-Letters data set is reproduced on R², S², S³, SO(3) and, '
         'as manipulability, on SPD(2).')
SOURCE = '[GDMP] section 5, second data set'
#: The strokes have 200 samples of 10 ms, a fifth of LASA's.
LIMIT = 3e-4


def errors(task: tuple[str, str]) -> list[list[float]]:
    """Mean error / span of each demonstration of a letter, with each connection."""
    path, mapping = task
    return errors_of([letters.on_manifold(stroke, mapping)
                      for stroke in letters.strokes(Path(path))])


def run(settings: Settings) -> Data:
    """Errors of every letter that is found; nothing without the data set."""
    if settings.letters is None:
        return {}
    found = letters.files(settings.letters)
    done = map_tasks('2D-Letters', errors, {f'{path.stem} {mapping}': (str(path), mapping)
                                         for mapping in lasa.MAPPINGS for path in found},
                  settings.jobs)
    most = max(len(result[0]) for result in done.values())
    count = sum(len(letters.strokes(path)) for path in found)
    data: Data = {'letters': np.array([path.stem for path in found]),
                  'expected': np.full(len(lasa.MAPPINGS), count)}
    for mapping in lasa.MAPPINGS:
        for i, connection in enumerate(CONNECTIONS):
            rows = [done[f'{path.stem} {mapping}'][i] for path in found]
            data[f'errors_{mapping}_{connection}'] = np.array(
                [row + [np.nan] * (most - len(row)) for row in rows])
        shown = letters.on_manifold(letters.strokes(found[0])[0], mapping)
        data.update({f'{mapping}_{key}': value for key, value in curves(shown).items()})
    return data


def verdict(data: Data) -> Verdict:
    """Mean over all demonstrations; None without the data set."""
    if not data:
        return Verdict(None, {}, 'The 2D-Letters data set is not here. It is public: '
                       f'{letters.ADDRESS}. Name its folder by --letters or GDMP_LETTERS.')
    found = tuple(str(name) for name in data['letters'])
    result = judged(data, dict.fromkeys(lasa.MAPPINGS, LIMIT), found, ('parallel',))
    published = result.measured['SPD2_published_mean']
    return Verdict(result.holds, {'files': len(found), 'letters': ' '.join(found),
                                  **result.measured},
                   f'{len(found)} of 26 letters were found. Held against the limit are the '
                   'parallel frames; as published, manipulability is followed less exactly '
                   f'({published:.1e} of the span).')


def draw(data: Data) -> dict[str, Any]:
    """The first letter on every manifold, and the errors of all."""
    sets = [m for m in lasa.MAPPINGS if f'{m}_times' in data]
    return {'letters': profiles(data, sets), 'letters-errors': spread(data, lasa.MAPPINGS)}
