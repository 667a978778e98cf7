"""Tries faults one after another and writes a table: fault, measurements, verdict."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import shutil
import time
import traceback

from experiments.reliability.faults import fault, FAULTS
from experiments.reliability.trial import FaultTrial, short_skill
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.ros.clients.testbed import process_bed
from gdmp_ros.util.files import write_json, write_text
from gdmp_ros.util.processes import interrupt_on_sigterm
from gdmp_ros.util.terminal import table

WORDS = {True: 'holds', False: 'FAILS', None: 'not tried'}


def run(names: Sequence[str], folder: Path, quick: bool) -> bool:
    """
    Try faults; the report is written again after each.

    :returns: whether all trials that were possible hold
    :raises DataError: if the folder cannot be written
    """
    interrupt_on_sigterm()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        skill = short_skill(folder)
    except OSError as error:
        raise DataError(f'{folder}: cannot write the report: {error.strerror}') from None
    outcomes: dict[str, TrialResult] = {}
    for number, name in enumerate(names, 1):
        title = (fault(name).__doc__ or '').strip()
        print(f'[{number}/{len(names)}] {name}: {title} …', flush=True)
        begun = time.monotonic()
        outcomes[name] = attempt(name, folder / name, skill, quick)
        print(f'    {_verdict(outcomes[name])} ({time.monotonic() - begun:.0f} s)', flush=True)
        _write(folder, outcomes)
    table('faults', ['', 'verdict', 'measured'],
          [[name, WORDS[one.holds], _figures(one)] for name, one in outcomes.items()])
    print(f'report: {folder / "faults.md"}')
    return all(one.holds is not False for one in outcomes.values())


def attempt(name: str, folder: Path, skill: Path, quick: bool) -> TrialResult:
    """Try one fault in its own DDS domain; a trial that raises an exception has failed."""
    try:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        with process_bed(FaultTrial, folder, skill=skill) as trial:
            return fault(name)(trial, quick)
    except GdmpError as error:
        return TrialResult(failed=[str(error)])
    except Exception as error:
        traceback.print_exc()
        return TrialResult(failed=[f'{type(error).__name__}: {error}'])


def _verdict(outcome: TrialResult) -> str:
    detail = outcome.missing or '; '.join(outcome.failed + outcome.late)
    return WORDS[outcome.holds] + (f': {detail}' if detail else '')


def _figures(outcome: TrialResult) -> str:
    words = [f'{name} {value:.4g}' if isinstance(value, (int, float)) else f'{name}: {value}'
             for name, value in outcome.measured.items()]
    return '; '.join(words) or _verdict(outcome)


def _write(folder: Path, outcomes: dict[str, TrialResult]) -> None:
    document = {name: {'fault': (fault(name).__doc__ or '').strip(), 'holds': one.holds,
                       'measured': one.measured, 'failed': one.failed, 'late': one.late,
                       'missing': one.missing}
                for name, one in outcomes.items()}
    lines = ['| fault | measured | verdict |', '|---|---|---|']
    lines += [f'| {entry["fault"]} | {_figures(one)} | {_verdict(one)} |'
              for entry, one in zip(document.values(), outcomes.values())]
    write_json(folder / 'faults.json', document)
    write_text(folder / 'faults.md', '\n'.join(lines) + '\n')


def known() -> str:
    """Names and descriptions of all faults."""
    return '\n'.join(f'{name:22}{(fault(name).__doc__ or "").strip()}' for name in FAULTS)
