"""Server and arm on two hosts, with a network between them that is good, bad or gone."""
from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
import time

import numpy as np

from gdmp_ros.data import runs
from gdmp_ros.data.runs import REFERENCE_TOPIC, Run, STATE_TOPIC
from gdmp_ros.errors import GdmpError
from gdmp_ros.experiments.reliability import motion
from gdmp_ros.experiments.reliability.network import Quality, TwoHosts
from gdmp_ros.experiments.reliability.outcome import Outcome
from gdmp_ros.experiments.reliability.trial import goal_of, START_UP_S, Trial
from gdmp_ros.util.dds_network import reaching_other_machines
from gdmp_ros.util.processes import ChildProcesses

RELIABILITIES = ('reliable', 'best_effort')


def good_network(trial: Trial, quick: bool) -> Outcome:
    """Server and arm on two hosts"""
    return _tried(trial, quick, Quality(), 0.999, 10.0)


def lossy_network(trial: Trial, quick: bool) -> Outcome:
    """Two hosts, and a network that loses one frame in twenty"""
    return _tried(trial, quick, Quality(loss=0.05), 0.93, 200.0)


def slow_network(trial: Trial, quick: bool) -> Outcome:
    """Two hosts, and a network that takes 20 to 30 ms"""
    return _tried(trial, quick, Quality(delay=0.02, jitter=0.01), 0.99, 60.0)


def network_cut(trial: Trial, quick: bool) -> Outcome:
    """Two hosts, and a network that is cut for 1.5 s in mid-motion"""
    def held(which: str, run: Run, outcome: Outcome) -> None:
        outcome.need(f'{which}speed after a second without references [m/s]', _speed_in_gap(run),
                     lambda v: v < 0.02)
    return _tried(trial, quick, Quality(), None, None, 1.5, held)


class NotPossible(GdmpError):
    """Two hosts cannot be made here."""


def _tried(trial: Trial, quick: bool, quality: Quality, arrive: float | None,
           late_ms: float | None, cut: float = 0.0,
           more: Callable[[str, Run, Outcome], None] | None = None) -> Outcome:
    """One execution for each reliability, held against what every network has to do."""
    outcome = Outcome()
    try:
        for reliability in RELIABILITIES[:1] if quick else RELIABILITIES:
            run, said = _run(trial, trial.folder / reliability, reliability, quality, cut)
            _judge(run, said, trial, outcome, f'{reliability}: ', arrive, late_ms)
            if more is not None:
                more(f'{reliability}: ', run, outcome)
    except NotPossible as problem:
        outcome.missing = str(problem)
    return outcome


def _run(trial: Trial, folder: Path, reliability: str, quality: Quality, cut: float
         ) -> tuple[Run, str]:
    """Execute the skill across the network; the recorded run and what the operator said."""
    folder.mkdir(parents=True)
    environment = reaching_other_machines(trial.environment)
    with ExitStack() as stack:
        try:
            hosts = stack.enter_context(TwoHosts(Quality()))
        except (GdmpError, OSError) as error:
            raise NotPossible(str(error)) from None
        children = stack.enter_context(ChildProcesses(environment, folder / 'logs'))
        return _execute(trial, folder, reliability, quality, cut, hosts, children)


def _execute(trial: Trial, folder: Path, reliability: str, quality: Quality, cut: float,
             hosts: TwoHosts, children: ChildProcesses) -> tuple[Run, str]:
    server, robot = hosts.on('server'), hosts.on('robot')
    children.start_node('panda_sim', 'gdmp_ros.ros.arm.node', {
        f'qos_overrides.{REFERENCE_TOPIC}.subscription.reliability': reliability}, prefix=robot)
    children.start_node('trajectory_server', 'gdmp_ros.ros.server.node', {
        'skill': str(trial.skill), 'measured_pose_topic': '/panda_sim/measured_pose',
        f'qos_overrides.{REFERENCE_TOPIC}.publisher.reliability': reliability}, prefix=server)
    loose = ['--best-effort', REFERENCE_TOPIC] if reliability == 'best_effort' else []
    children.start('recorder', 'gdmp_ros.ros.recorder.record', [
        str(folder / 'run'), f'{REFERENCE_TOPIC}=gdmp_msgs/msg/Reference',
        f'{STATE_TOPIC}=gdmp_msgs/msg/RobotState', *loose], robot)
    _wait(trial, children, 'the recorder', 'recorder', 'recording\n', START_UP_S)
    # Discovery is over: from here on the network is what it is.
    hosts.cable.quality = quality
    children.start('operator', 'gdmp_ros.experiments.reliability.operate', ['60'], server)
    _wait(trial, children, 'the motion', 'operator', 'executing', START_UP_S)
    if cut:
        time.sleep(1.0)
        hosts.cable.quality = Quality(cut=True)
        time.sleep(cut)
        hosts.cable.quality = quality
    _wait(trial, children, 'the end of the motion', 'operator', 'ended with', 90.0)
    time.sleep(3.0)
    children.stop('recorder', timeout=60.0)
    return runs.read(folder / 'run'), children.log('operator').read_text()


def _wait(trial: Trial, children: ChildProcesses, what: str, name: str, word: str,
          timeout: float) -> None:
    def look() -> bool:
        children.check(but=name)
        text = children.log(name).read_text(errors='replace')
        if 'error:' in text:
            raise GdmpError(f'{name}: {text.strip()}')
        return word in text
    trial.operator.wait(what, look, timeout)


def _judge(run: Run, said: str, trial: Trial, outcome: Outcome, which: str,
           arrive: float | None, late_ms: float | None) -> None:
    outcome.claim(f'{which}the motion reaches its goal', 'ended with 0' in said)
    numbers = np.unique(run.sequences)
    arrived = len(numbers) / float(numbers[-1] - numbers[0] + 1)
    age = 1e3 * _ages(run)
    median, high = np.percentile(age, [50.0, 99.0])
    outcome.need(f'{which}references that arrived [%]', 100.0 * arrived,
                 lambda v: arrive is None or v >= 100.0 * arrive)
    outcome.measured[f'{which}age when followed, median [ms]'] = float(median)
    outcome.need(f'{which}age when followed, 99 % [ms]', float(high),
                 lambda v: late_ms is None or v <= late_ms)
    away = float(np.abs(run.poses[-1, :3] - goal_of(trial.skill)[:3]).max())
    outcome.need(f'{which}away from the goal at the end [m]', away, lambda v: v < 0.002)
    judged = Outcome()
    motion.judge(run, judged)
    outcome.measured.update({which + name: value for name, value in judged.measured.items()})
    outcome.failed += [which + text for text in judged.failed]


def _ages(run: Run) -> np.ndarray:
    """How old each reference was when the arm first followed it [s]."""
    first = motion.begun(run)
    at = np.searchsorted(run.sequences, run.applied[first])
    known = (run.applied[first] > 0) & (at < len(run.sequences))
    first, at = first[known], at[known]
    return np.asarray((run.state_stamps[first] - run.reference_stamps[at]) * 1e-9)


def _speed_in_gap(run: Run) -> float:
    """Largest speed of the tool from a second into the longest gap to its end; NaN: no gap."""
    gaps = motion.gaps(run)
    length, ends = gaps[int(np.argmax(gaps[:, 0]))]
    inside = ((run.state_stamps > ends - (length - 1.0) * 1e9) & (run.state_stamps < ends))
    if length < 1.2 or not inside.any():
        return float('nan')
    return float(np.linalg.norm(run.twists[inside, :3], axis=1).max())
