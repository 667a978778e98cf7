"""Runs experiments, stores their data and writes the report."""
from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import importlib
import json
import math
from pathlib import Path
import time
import traceback
from typing import Any

import jinja2
import numpy as np

from experiments.paper.experiment import Data, IDS, Settings, Verdict
from gdmp_ros import __version__
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.util.files import write_archive, write_json, write_text
from gdmp_ros.util.optional_imports import extra
from gdmp_ros.util.terminal import table
from gdmp_ros.view import plots

#: Experiments whose module has another name: ``baselines`` is the package of the methods.
_MODULES = {'baselines': 'comparison'}
_PICTURES = {'.png': 'image/png', '.webp': 'image/webp'}


def run(ids: Sequence[str], settings: Settings) -> bool:
    """
    Run experiments one after another; the report is updated after each.

    :returns: whether every claim that could be tried holds
    :raises DataError: if the folder cannot be written
    """
    folder = settings.folder
    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        entries = _earlier(folder)
    for number, name in enumerate(ids, 1):
        print(f'[{number}/{len(ids)}] {name} …', flush=True)
        with _writing(folder):
            # If this run is interrupted, the entry of an earlier one must not remain.
            if entries.pop(name, None):
                _write(folder, entries)
        begun = time.monotonic()
        entries[name] = _entry(name, settings)
        entries[name]['seconds'] = round(time.monotonic() - begun, 1)
        with _writing(folder):
            _write(folder, entries)
        print(f'    {_word(entries[name]["holds"])} in {entries[name]["seconds"]:.0f} s: '
              f'{_short(entries[name]["measured"]) or entries[name]["notes"]}', flush=True)
    table('the paper, reproduced', ['', 'holds', 'measured'],
          [[name, _word(entries[name]['holds']), _short(entries[name]['measured'])]
           for name in ids])
    print(f'report: {folder / "index.html"}')
    return all(entries[name]['holds'] is not False for name in ids)


def module(name: str) -> Any:
    """
    Module of an experiment.

    :raises DataError: naming the known ones
    """
    if name not in IDS:
        raise DataError(f'experiment {name!r} is unknown, expected one of {", ".join(IDS)}')
    return importlib.import_module(f'experiments.paper.{_MODULES.get(name, name)}')


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise DataError(f'{folder}: cannot write the report: {error.strerror}') from None


def _entry(name: str, settings: Settings) -> dict[str, Any]:
    """Entry of an experiment; one that cannot be run has failed, with the reason."""
    experiment = module(name)
    try:
        return _one(name, experiment, settings)
    except ModuleNotFoundError as error:
        origin = (extra('sim') if (error.name or '').partition('.')[0] == 'mujoco'
                  else ', it comes with a ROS 2 Jazzy installation')
        reason = f'{error.name} is missing{origin}'
    except GdmpError as error:
        reason = str(error)
    except Exception as error:  # an error in one experiment does not stop the others
        traceback.print_exc()
        reason = f'{type(error).__name__}: {error}'
    return {'holds': False, 'figures': [], 'claim': experiment.CLAIM, 'measured': {},
            'source': experiment.SOURCE, 'notes': f'could not be run: {reason}'}


def _one(name: str, experiment: Any, settings: Settings) -> dict[str, Any]:
    for old in _belonging(settings.folder, name):
        old.unlink()
    data: Data = experiment.run(settings)
    verdict: Verdict = experiment.verdict(data)
    figures = []
    if data:
        write_archive(settings.folder / f'{name}.npz', data)
        for picture, figure in experiment.draw(data).items():
            plots.save(figure, settings.folder / f'{picture}.png')
        figures = [path.name for path in _belonging(settings.folder, name)]
    return {'holds': verdict.holds, 'figures': figures, 'claim': experiment.CLAIM,
            'measured': _json_value(verdict.measured), 'source': experiment.SOURCE,
            'notes': verdict.notes}


def _belonging(folder: Path, name: str) -> list[Path]:
    """Pictures and films of an experiment; those of ``fig10`` do not belong to ``fig1``."""
    return sorted(path for path in folder.iterdir() if path.suffix in _PICTURES
                  and (path.stem == name or path.stem.startswith(f'{name}-')))


def _json_value(value: Any) -> Any:
    """The same for JSON, which has neither NumPy numbers nor infinity."""
    if isinstance(value, dict):
        return {str(key): _json_value(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_json_value(inner) for inner in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value


def _earlier(folder: Path) -> dict[str, Any]:
    """Entries of experiments that were run before."""
    try:
        found = json.loads((folder / 'report.json').read_text())['experiments']
        return {name: found[name] for name in IDS if name in found}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _write(folder: Path, entries: dict[str, Any]) -> None:
    ordered = {name: entries[name] for name in IDS if name in entries}
    document = {'gdmp_ros': __version__, 'experiments': ordered}
    write_json(folder / 'report.json', document)
    write_text(folder / 'index.html', page(folder, ordered))


def page(folder: Path, entries: dict[str, Any]) -> str:
    """One self-contained page with all pictures."""
    environment = jinja2.Environment(autoescape=True, trim_blocks=True,
                                     undefined=jinja2.StrictUndefined)
    template = environment.from_string((Path(__file__).parent / 'page.html').read_text())
    shown = []
    for name, entry in entries.items():
        pictures = [_embedded(folder / figure) for figure in entry['figures']
                    if (folder / figure).exists()]
        shown.append({'id': name, 'pictures': pictures, 'word': _word(entry['holds']),
                      'rows': _rows(entry['measured']), **entry})
    return template.render(experiments=shown, version=__version__)


def _embedded(path: Path) -> dict[str, str]:
    code = base64.b64encode(path.read_bytes()).decode()
    return {'name': path.stem, 'source': f'data:{_PICTURES[path.suffix]};base64,{code}'}


def _word(holds: bool | None) -> str:
    return {True: 'holds', False: 'FAILS', None: 'not tried'}[holds]


def _rows(measured: dict[str, Any]) -> list[tuple[str, str]]:
    return [(key.replace('_', ' '), _number(value)) for key, value in measured.items()]


def _short(measured: dict[str, Any], most: int = 4) -> str:
    """First few figures in one line."""
    return ', '.join(f'{key.replace("_", " ")} {_number(value)}'
                     for key, value in list(measured.items())[:most]
                     if not isinstance(value, (dict, list)))


def _number(value: Any) -> str:
    simple: dict[type, Callable[[Any], str]] = {
        float: lambda v: f'{v:.4g}', bool: lambda v: 'yes' if v else 'no',
        list: lambda v: ', '.join(map(_number, v)),
        dict: lambda v: '; '.join(f'{key}: {_number(inner)}' for key, inner in v.items())}
    return simple.get(type(value), str)(value)
