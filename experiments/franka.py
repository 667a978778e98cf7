"""
A Franka over its protocol: identification, the letter again and again, the first day, tasks.

The server of the protocol enforces limits and communication as the robot does. Server, arm,
recorder and the simulated robot run on this machine. The first runs after the start count, and all
are reported.
"""
from __future__ import annotations

from collections.abc import Collection
import json
from pathlib import Path
import tempfile
import time
from typing import Any

import numpy as np

from experiments.franka_page import run_page
from gdmp_ros.demo.run import run_demo
from gdmp_ros.demo.tasks import run_task
from gdmp_ros.errors import GdmpError
from gdmp_ros.franka.bare_client import exchange
from gdmp_ros.franka.protocol_server import HOST
from gdmp_ros.franka.settings import BETWEEN_CLIENTS_S
from gdmp_ros.realtime.loop import in_loop_thread
from gdmp_ros.ros.arm_choice import ArmChoice, FRANKA
from gdmp_ros.ros.clients.arm_client import identify_alone
from gdmp_ros.ros.clients.testbed import MODULES

#: Cycles of the client that only reads and writes; the first do not count.
CYCLES, FIRST = 10_000, 200
#: Letters beside a busy interpreter.
BURDENED = 5
#: What is asked: commands in time, cycles lost in a row, tracking and distance at rest [m]; CPU
#: time at 99 %, and beyond that client at 50 and 99 % [µs].
SHARE, LOST, TRACKING_M, REST_M, CPU_US, MORE_US = 0.99, 5, 0.004, 0.003, 300.0, (100.0, 150.0)


def bare(folder: Path) -> tuple[float, float]:
    """CPU time of a cycle of a client that only reads and writes, at 50 and 99 % [µs]."""
    with ArmChoice('franka', protocol_server=True).robot(folder):
        figures, _ = in_loop_thread(lambda: exchange(HOST, CYCLES))
    time.sleep(BETWEEN_CLIENTS_S)
    middle, high = np.percentile(figures[FIRST:, 0], [50, 99]) * 1e-3
    return float(middle), float(high)


def identification(folder: Path) -> tuple[Path, dict[str, Any]]:
    """File of parameters, and what was found, or why the robot ended it."""
    path = folder / 'friction.yaml'
    try:
        found = identify_alone(ArmChoice('franka', protocol_server=True), path)
    except GdmpError as error:
        return path, {'aborted': str(error)}
    return path, {'aborted': '', **found}


def letter(folder: Path, friction: Path) -> dict[str, Any]:
    """Figures of one run, or why the robot ended it."""
    choice = ArmChoice('franka', protocol_server=True,
                       parameter_files=(friction,) if friction.is_file() else ())
    try:
        run_demo(folder, 'GShape', choice)
    except GdmpError as error:
        return {'aborted': str(error)}
    report = json.loads((folder / 'report.json').read_text())
    robot, tracking = report['robot'], report['tracking']
    return {'aborted': '', 'scheduler': report['stream']['scheduler'],
            'commands_in_time': robot['commands_in_time'], 'cycles_lost': robot['cycles_lost'],
            'lost_in_a_row': report['arm_ticks']['lost_in_a_row'],
            'cycle_cpu_us': robot['cycle_cpu_us'], 'tracking_m': tracking['position_rmse_m'],
            'rest_m': report['goal_switch']['final_position_error_m']}


def rows(found: dict[str, Any], native: tuple[float, float], runs: list[dict[str, Any]]
         ) -> list[dict[str, Any]]:
    """Rows of ``case``, ``asked``, ``measured`` and ``holds``."""
    aborted = sum(bool(run['aborted']) for run in [found, *runs])
    ended = [run for run in runs if not run['aborted']]

    def worst(name: str) -> float:
        return max((float(run[name]) for run in ended), default=np.inf)

    def cpu(name: str) -> float:
        return max((float(run['cycle_cpu_us'][name]) for run in ended), default=np.inf)
    in_time = float(np.mean([run['commands_in_time'] for run in ended])) if ended else 0.0
    limits = native[0] + MORE_US[0], min(native[1] + MORE_US[1], CPU_US)
    return [_row('identifications and letters that the robot ended', aborted, 0),
            {'case': 'share of commands in time, mean', 'asked': f'at least {SHARE:g}',
             'measured': in_time, 'holds': in_time >= SHARE},
            _row('cycles lost in a row', worst('lost_in_a_row'), LOST),
            _row('tracking, worst run [m RMS]', worst('tracking_m'), TRACKING_M),
            _row('distance at rest, worst run [m]', worst('rest_m'), REST_M),
            _row('CPU of a cycle, 50 %, worst run [us]', cpu('p50'), limits[0]),
            _row('CPU of a cycle, 99 %, worst run [us]', cpu('p99'), limits[1])]


def _row(case: str, measured: float, asked: float) -> dict[str, Any]:
    return {'case': case, 'asked': f'at most {asked:g}', 'measured': float(measured),
            'holds': bool(measured <= asked)}


def burdened_letter(folder: Path, friction: Path) -> dict[str, Any]:
    """`letter`, while another thread of the arm's node keeps the interpreter busy."""
    before, MODULES[FRANKA] = MODULES[FRANKA], 'experiments.burdened_arm'
    try:
        return letter(folder, friction)
    finally:
        MODULES[FRANKA] = before


def task(name: str, folder: Path, friction: Path) -> dict[str, Any]:
    """Report of a task, or why it failed."""
    choice = ArmChoice('franka', protocol_server=True, parameter_files=(friction,))
    try:
        run_task(name, folder, choice)
    except GdmpError as error:
        return {'error': str(error), 'succeeded': False}
    return dict(json.loads((folder / 'report.json').read_text()))


def measure(count: int, parts: Collection[str]) -> dict[str, Any]:
    """
    Everything: ``identification``, ``bare_cpu_us``, ``runs``, ``page``, ``tasks`` and ``rows``.

    :param count: number of letters
    :param parts: ``letters``, ``burden``, ``tasks``, ``page``
    """
    document: dict[str, Any] = {'rows': []}
    with tempfile.TemporaryDirectory(prefix='gdmp-franka-') as name:
        folder = Path(name)
        if 'letters' in parts:
            native = bare(folder)
        if {'letters', 'burden', 'tasks'} & set(parts):
            friction, document['identification'] = identification(folder)
        if 'letters' in parts:
            runs = document['runs'] = []
            for number in range(count):
                print(f'letter {number + 1} of {count}', flush=True)
                runs.append(letter(folder / f'run{number}', friction))
            document['bare_cpu_us'] = {'p50': native[0], 'p99': native[1]}
            document['rows'] += rows(document['identification'], native, runs)
        if 'burden' in parts:
            print(f'{BURDENED} letters beside a busy interpreter', flush=True)
            burdened = document['burdened'] = [
                burdened_letter(folder / f'burdened{number}', friction)
                for number in range(BURDENED)]
            document['rows'] += [
                _row('letters beside a busy interpreter that the robot ended',
                     sum(bool(run['aborted']) for run in burdened), 0),
                _row('cycles lost in a row there', max((
                    run['lost_in_a_row'] for run in burdened if not run['aborted']),
                    default=np.inf), LOST)]
        if 'tasks' in parts:
            document['tasks'] = {kind: task(kind, folder / kind, friction)
                                 for kind in ('pick', 'joints', 'objects', 'wipe')}
            document['rows'].append(_row('tasks that failed', sum(
                not done['succeeded'] for done in document['tasks'].values()), 0))
        if 'page' in parts:
            document['page'] = run_page(folder / 'page')
            document['rows'].append(_row('commands of the first day that failed', sum(
                bool(done['exit_code']) for done in document['page']), 0))
    return document
