"""A long run with random skills, goals, tempo changes and pauses, monitored."""
from __future__ import annotations

import json
from pathlib import Path
import shutil
import time
from typing import Any

import numpy as np
import psutil

from experiments.reliability.monitor import WINDOW_S
from experiments.reliability.trial import FaultTrial, FRAME, goal_of, short_skill
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.errors import DataError
from gdmp_ros.realtime.statistics import punctuality_of
from gdmp_ros.ros.clients.testbed import ARM, process_bed, SERVER
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.files import write_json
from gdmp_ros.util.processes import interrupt_on_sigterm
from gdmp_ros.util.terminal import progress, table
from gdmp_ros.view import plots

CLASSES = ('GShape', 'Angle', 'CShape', 'Sine', 'WShape', 'Leaf_1')
SAMPLE_S = 5.0
PERIOD_NS = 1_000_000
#: Memory is judged in runs of at least this duration [min], after this fraction of the run.
JUDGED_MIN, WARM_UP = 10.0, 0.25
MIB = 1 << 20


def run(minutes: float, folder: Path, seed: int) -> bool:
    """
    Run for a number of minutes; write ``soak.json`` and ``soak.png``.

    :returns: whether all requirements hold
    :raises DataError: if the folder cannot be written
    """
    interrupt_on_sigterm()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in ('logs', 'skills'):
            shutil.rmtree(folder / name, ignore_errors=True)
        (folder / 'skills').mkdir()
    except OSError as error:
        raise DataError(f'{folder}: cannot write the report: {error.strerror}') from None
    rng = np.random.default_rng(seed)
    print('learning six skills', flush=True)
    skills = [short_skill(folder / 'skills', float(rng.uniform(2.5, 5.0)), name)
              for name in CLASSES]
    with process_bed(FaultTrial, folder, skill=skills[0]) as trial:
        samples, actions = _work(trial, minutes, skills, rng)
    document = _document(folder, minutes, samples, actions)
    outcome = judge(document)
    document.update(measured=outcome.measured, failed=outcome.failed,
                    late=outcome.late, holds=outcome.holds)
    write_json(folder / 'soak.json', document)
    draw(document, folder / 'soak.png')
    table(f'{minutes:g} minutes', ['', 'measured'],
          [[name, f'{value:.4g}' if isinstance(value, float) else value]
           for name, value in outcome.measured.items()])
    print('all hold' if outcome.holds else f'FAILS: {"; ".join(outcome.failed + outcome.late)}')
    print(f'report: {folder / "soak.json"}, {folder / "soak.png"}')
    return bool(outcome.holds)


def _work(trial: FaultTrial, minutes: float, skills: list[Path], rng: np.random.Generator
          ) -> tuple[list[dict[str, float]], dict[str, int]]:
    """Use the nodes until they have streamed long enough; returns samples and actions."""
    folder, wanted = trial.folder, round(minutes * 60_000)
    trial.start_arm()
    trial.start_server()
    trial.wait_holding()
    trial.children.start('monitor', 'experiments.reliability.monitor', [
        str(folder / 'monitor.json'), FRAME])
    trial.wait('the monitor', lambda: 'monitoring' in trial.log('monitor'), 60.0)
    trial.children.start('bare', 'gdmp_ros.realtime.bare_loop', [str(folder / 'bare.npy'),
                                                                 str(2 * wanted + 100_000)])
    trial.spend(1.0)
    first = trial.state.ticks
    worker, samples, begun = Worker(trial, skills, rng), [], time.monotonic()
    with progress('soaking', wanted) as step:
        shown, due = 0, 0.0
        while (done := trial.state.ticks - first) < wanted:
            trial.children.check()
            if time.monotonic() - begun > 1.25 * 60.0 * minutes + 60.0:
                break  # the stream is too slow or has ended: the figures show it
            for _ in range(done // 1000 - shown // 1000):
                step(1000)
            shown = done
            if time.monotonic() - begun >= due:
                samples.append(_sample(trial, time.monotonic() - begun))
                due += SAMPLE_S
            worker.work(begun + due)
    samples.append(_sample(trial, time.monotonic() - begun))
    for name in ('monitor', 'bare'):
        trial.children.stop(name, timeout=60.0)
    return samples, worker.actions


def _sample(trial: FaultTrial, seconds: float) -> dict[str, float]:
    state, result = trial.state, {'seconds': seconds}
    for name in (SERVER, ARM):
        process = psutil.Process(trial.children.processes[name].pid)
        result[f'{name} memory'] = process.memory_info().rss
        result[f'{name} cpu'] = sum(process.cpu_times()[:2])
    result.update(ticks=state.ticks, missed=state.missed, refused=state.refused)
    return result


class Worker:
    """Does random things with the nodes, as a user might."""

    def __init__(self, trial: FaultTrial, skills: list[Path], rng: np.random.Generator):
        self.actions = dict.fromkeys(('motions', 'reached', 'skills loaded', 'goals switched',
                                    'tempo changes', 'pauses'), 0)
        self._trial, self._skills, self._rng = trial, skills, rng
        self._skill = skills[0]
        self._running = False

    def work(self, until: float) -> None:
        """Continue until a time of the monotonic clock [s]."""
        while time.monotonic() < until:
            if not self._running:
                self._begin()
            elif self._trial.client.done():
                result = self._trial.client.result(1.0)
                self.actions['reached'] += result.error_code == result.SUCCESSFUL
                self._running = False
            else:
                self._act()
            self._trial.spend(float(self._rng.uniform(0.1, 0.5)))

    def _begin(self) -> None:
        from gdmp_msgs.srv import LoadSkill
        if self._rng.random() < 0.5:
            self._skill = self._skills[self._rng.integers(len(self._skills))]
            self._trial.call(LoadSkill, f'{SERVER}/load_skill', path=str(self._skill))
            self.actions['skills loaded'] += 1
        self._trial.client.execute()
        self._running = True
        self.actions['motions'] += 1

    def _act(self) -> None:
        from gdmp_msgs.srv import SetSpeed
        from std_srvs.srv import SetBool
        choice = self._rng.random()
        if choice < 0.15:
            goal = goal_of(self._skill)
            goal[:3] += self._rng.uniform(-0.06, 0.06, 3)
            self._trial.client.goal_pose(goal, FRAME)
            self._trial.client.goal_stiffness(np.diag(self._rng.uniform(200.0, 800.0, 3)))
            self.actions['goals switched'] += 1
        elif choice < 0.22:
            self._trial.call(SetSpeed, f'{SERVER}/set_speed',
                             scale=float(self._rng.uniform(0.5, 1.3)))
            self.actions['tempo changes'] += 1
        elif choice < 0.26:
            for paused in (True, False):
                self._trial.call(SetBool, f'{SERVER}/pause', data=paused)
                self._trial.spend(0.4)
            self.actions['pauses'] += 1


def _document(folder: Path, minutes: float, samples: list[dict[str, float]],
              actions: dict[str, int]) -> dict[str, Any]:
    seen = json.loads((folder / 'monitor.json').read_text())
    ticks = np.load(folder / 'bare.npy')
    bare = punctuality_of(ticks, PERIOD_NS)
    edges = np.arange(ticks[0, 0], ticks[-1, 0], round(WINDOW_S * 1e9))
    skipped = np.diff(ticks[:, 0]) // PERIOD_NS - 1
    per_window = np.add.reduceat(skipped, np.searchsorted(ticks[:-1, 0], edges))
    (folder / 'bare.npy').unlink()
    (folder / 'monitor.json').unlink()
    return {'minutes': minutes, 'samples': samples, 'actions': actions, 'seen': seen,
            'bare': {**bare._asdict(), 'missed_per_window': per_window.tolist()}}


def judge(document: dict[str, Any]) -> TrialResult:
    """Compare the figures of a run with the requirements."""
    outcome, samples, seen = TrialResult(), document['samples'], document['seen']
    limits, arm = LimitSettings(), Arm().limits
    first, last, bare = samples[0], samples[-1], document['bare']
    ticks, missed = last['ticks'] - first['ticks'], last['missed'] - first['missed']
    missed_part, bare_part = (missed / (ticks + missed),
                              bare['missed'] / (bare['ticks'] + bare['missed']))
    outcome.need('ticks', ticks, lambda v: v >= 0.99 * 60_000 * document['minutes'],
                 of_speed=True)
    outcome.need('references lost', seen['lost'], lambda v: v == 0)
    outcome.need('states of the arm', seen['states'],
                 lambda v: v >= 0.9 * 60_000 * document['minutes'], of_speed=True)
    outcome.need('smallest number of states in a window',
                 min(w['states'] for w in seen['windows'][:-1]), lambda v: v >= 500 * WINDOW_S,
                 of_speed=True)
    outcome.need('missed ticks [%]', 100 * missed_part, lambda v: v <= 100 * bare_part + 0.5,
                 of_speed=True)
    outcome.measured['missed ticks of a bare loop [%]'] = 100 * bare_part
    rate = ticks / (last['seconds'] - first['seconds'])
    outcome.need('rate [Hz]', rate, lambda v: v >= bare['rate_hz'] - 5.0, of_speed=True)
    for name in (SERVER, ARM):
        memory = np.array([sample[f'{name} memory'] for sample in samples]) / MIB
        growth = _growth(memory)
        outcome.need(f'{name}: memory grew by [MiB]', growth,
                     lambda v: v < 1.0 or document['minutes'] < JUDGED_MIN)
        outcome.measured[f'{name}: memory [MiB]'] = float(memory[-1])
        outcome.measured[f'{name}: CPU [cores]'] = (
            (last[f'{name} cpu'] - first[f'{name} cpu']) / (last['seconds'] - first['seconds']))
    windows = seen['windows']
    torque = np.max([w['torque'] for w in windows], axis=0)
    outcome.need('torque [fraction of the limit]', float((torque / arm.torque).max()),
                 lambda v: v <= 1.0)
    outcome.need('torque rate [Nm per tick]', max(w['rate'] for w in windows),
                 lambda v: v <= 1e-3 * limits.torque_slew + 1e-9)
    outcome.need('joint speed [rad/s]', max(w['joint_speed'] for w in windows),
                 lambda v: v <= limits.joint_speed)
    outcome.need('speed [m/s]', max(w['speed'] for w in windows), lambda v: v <= limits.speed)
    inside = min(float((arm.upper - np.max([w['upper'] for w in windows], axis=0)).min()),
                 float((np.min([w['lower'] for w in windows], axis=0) - arm.lower).min()))
    outcome.need('distance to joint limits [rad]', inside, lambda v: v >= 0.0)
    outcome.need('smallest energy in the tank [J]', min(w['tank'] for w in windows),
                 lambda v: v >= 0.0)
    actions = document['actions']
    outcome.measured.update(actions)
    outcome.need('motions that did not reach their goal', actions['motions'] - actions['reached'],
                 lambda v: v <= 1)
    return outcome


def _growth(memory: np.ndarray) -> float:
    """Growth from the end of the warm-up to the end, medians over a tenth each."""
    begin, part = int(WARM_UP * len(memory)), max(len(memory) // 10, 1)
    return float(np.median(memory[-part:]) - np.median(memory[begin:begin + part]))


def draw(document: dict[str, Any], path: Path) -> None:
    """Memory, missed ticks, speed and tank over the run."""
    samples, windows = document['samples'], document['seen']['windows']
    minutes = np.array([sample['seconds'] for sample in samples]) / 60.0
    at = (np.arange(len(windows)) + 1) * WINDOW_S / 60.0
    figure, axes = plots.panels(4, 1, (7.5, 1.9))
    memory, missed, speed, tank = axes[:, 0]
    for name, style, ink in ((SERVER, '-', plots.INK[0]), (ARM, '--', plots.INK[1])):
        values = np.array([sample[f'{name} memory'] for sample in samples]) / MIB
        memory.plot(minutes, values - values[int(WARM_UP * len(values))], style, color=ink,
                    label=name)
    memory.set(ylabel='memory, from the end\nof the warm-up [MiB]')
    memory.legend(fontsize=7)
    counts = np.diff([sample['missed'] for sample in samples])
    missed.step(minutes[1:], counts * WINDOW_S / np.diff(minutes) / 60.0, where='pre',
                color=plots.INK[0], label=SERVER)
    bare = document['bare']['missed_per_window']
    missed.step((np.arange(len(bare)) + 1) * WINDOW_S / 60.0, bare, where='pre', color='0.6',
                ls=':', label='bare loop')
    missed.set(ylabel=f'ticks missed\nin {WINDOW_S:g} s')
    missed.legend(fontsize=7)
    speed.plot(at, [w['joint_speed'] for w in windows], color=plots.INK[0],
               label='largest joint speed [rad/s]')
    speed.plot(at, [w['speed'] for w in windows], color=plots.INK[1], ls='--',
               label='tool speed [m/s]')
    speed.axhline(LimitSettings().joint_speed, color='0.5', ls=':', lw=0.8,
                  label='joint speed limit')
    speed.set(ylabel='largest speed')
    speed.legend(fontsize=7, ncols=3)
    tank.plot(at, [w['tank'] for w in windows], color=plots.INK[0])
    tank.set(ylabel='smallest energy\nin the tank [J]', xlabel='time [min]')
    plots.save(figure, path)
