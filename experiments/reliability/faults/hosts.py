"""Server and arm on two hosts, with a good, a bad or no network between them."""
from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
import re
import time
from typing import Any

import numpy as np

from experiments.reliability.network import Quality, TwoHosts
from experiments.reliability.trial import FaultTrial, goal_of, judge_limits
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.control.reference_check import HELD_UP
from gdmp_ros.data import runs
from gdmp_ros.data.runs import REFERENCE_TOPIC, Run
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.testbed import START_UP_S
from gdmp_ros.util.dds_network import reaching_other_machines

RELIABILITIES = ('reliable', 'best_effort')


def good_network(trial: FaultTrial, quick: bool) -> TrialResult:
    """Server and arm on two hosts"""
    return _tried(trial, quick, Quality(), 0.999, 10.0)


def lossy_network(trial: FaultTrial, quick: bool) -> TrialResult:
    """Two hosts, and a network that loses one frame in twenty"""
    return _tried(trial, quick, Quality(loss=0.05), 0.93, 200.0)


def slow_network(trial: FaultTrial, quick: bool) -> TrialResult:
    """Two hosts, and a network with a delay of 20 to 30 ms"""
    return _tried(trial, quick, Quality(delay=0.02, jitter=0.01), 0.99, 60.0)


def network_cut(trial: FaultTrial, quick: bool) -> TrialResult:
    """Two hosts, and a network that is cut for 1.5 s in mid-motion"""
    def held(which: str, run: Run, outcome: TrialResult) -> None:
        outcome.need(f'{which}speed after a second without references [m/s]', _speed_in_gap(run),
                     lambda v: v < 0.02)
    return _tried(trial, quick, Quality(), None, None, 1.5, held)


class NotPossible(GdmpError):
    """Two hosts cannot be created on this machine."""


def _tried(trial: FaultTrial, quick: bool, quality: Quality, arrive: float | None,
           late_ms: float | None, cut: float = 0.0,
           more: Callable[[str, Run, TrialResult], None] | None = None) -> TrialResult:
    """Execute once for each reliability, and compare with the requirements."""
    outcome = TrialResult()
    try:
        for reliability in RELIABILITIES[:1] if quick else RELIABILITIES:
            which = f'{reliability}: '
            run, output, held_up = _run(trial, trial.folder / reliability, reliability, quality,
                                        cut)
            _judge(run, output, trial, outcome, which, arrive, late_ms, cut > 0.0, held_up)
            if more is not None:
                more(which, run, outcome)
    except NotPossible as problem:
        outcome.missing = str(problem)
    return outcome


def _run(trial: FaultTrial, folder: Path, reliability: str, quality: Quality, cut: float
         ) -> tuple[Run, str, bool]:
    """
    Execute the skill across the network.

    :returns: the recorded run, the output of the client, and whether references came too late for
        the arm
    """
    folder.mkdir(parents=True)
    environment = reaching_other_machines(trial.environment)
    with ExitStack() as stack:
        try:
            hosts = stack.enter_context(TwoHosts(Quality()))
        except (GdmpError, OSError) as error:
            raise NotPossible(str(error)) from None
        nodes = stack.enter_context(FaultTrial(folder, environment, trial.skill))
        return _execute(nodes, reliability, quality, cut, hosts)


def _execute(nodes: FaultTrial, reliability: str, quality: Quality, cut: float, hosts: TwoHosts
             ) -> tuple[Run, str, bool]:
    server, robot = hosts.on('server'), hosts.on('robot')
    overrides = f'qos_overrides.{REFERENCE_TOPIC}'
    subscribes: dict[str, Any] = {f'{overrides}.subscription.reliability': reliability}
    nodes.start_arm(prefix=robot, **subscribes)
    nodes.start_server(prefix=server, **{f'{overrides}.publisher.reliability': reliability})
    best_effort = reliability == 'best_effort'
    nodes.record(arguments=['--best-effort', REFERENCE_TOPIC] if best_effort else [],
                 prefix=robot)
    # Discovery has ended: from now on the network has its quality.
    hosts.cable.quality = quality
    nodes.may_end.add('client')
    nodes.children.start('client', 'experiments.reliability.operate', ['60'], server)
    nodes.wait_log('client', 'executing', START_UP_S)
    if cut:
        time.sleep(1.0)
        hosts.cable.quality = Quality(cut=True)
        time.sleep(cut)
        hosts.cable.quality = quality
    nodes.wait_log('client', 'done', 120.0)
    nodes.children.stop('client')
    time.sleep(3.0)
    return nodes.recorded(), nodes.log('client'), HELD_UP in nodes.log(nodes.arm.node)


def _judge(run: Run, output: str, trial: FaultTrial, outcome: TrialResult, which: str,
           arrive: float | None, late_ms: float | None, lost: bool, held_up: bool) -> None:
    from gdmp_msgs.action import ExecuteSkill
    # After a cut a second motion is needed: the arm does not go on by itself.
    ended = _ends(output)
    code, said = ended[-1]
    outcome.claim(f'{which}the motion reaches its goal'
                  + (f' ({code} {said})' if code != ExecuteSkill.Result.SUCCESSFUL else ''),
                  code == ExecuteSkill.Result.SUCCESSFUL and (lost or len(ended) == 1),
                  held_up or code == ExecuteSkill.Result.GOAL_TOLERANCE_VIOLATED)
    outcome.claim(f'{which}a lost motion is not called reached',
                  not lost or ended[0][0] != ExecuteSkill.Result.SUCCESSFUL)
    numbers = np.unique(run.sequences)
    arrived = len(numbers) / float(numbers[-1] - numbers[0] + 1)
    age = 1e3 * _ages(run)
    outcome.claim(f'{which}the arm follows references', len(age) > 0, held_up)
    outcome.need(f'{which}references that arrived [%]', 100.0 * arrived,
                 lambda v: arrive is None or v >= 100.0 * arrive, of_speed=True)
    if len(age):
        median, high = np.percentile(age, [50.0, 99.0])
        outcome.measured[f'{which}median age of a followed reference [ms]'] = float(median)
        outcome.need(f'{which}99 % age of a followed reference [ms]', float(high),
                     lambda v: late_ms is None or v <= late_ms, of_speed=True)
    final = float(np.abs(run.poses[-1, :3] - goal_of(trial.skill)[:3]).max())
    outcome.need(f'{which}final distance from the goal [m]', final, lambda v: v < 0.002,
                 held_up and not lost)
    judged = TrialResult()
    judge_limits(run, judged)
    outcome.measured.update({which + name: value for name, value in judged.measured.items()})
    outcome.failed += [which + text for text in judged.failed]


def _ends(output: str) -> list[tuple[int, str]]:
    """Result code and text of each motion that the client executed."""
    return [(int(code), text) for code, text in
            re.findall(r'^ended with (-?\d+) ?(.*)$', output, re.MULTILINE)]


def _ages(run: Run) -> np.ndarray:
    """Age of each reference when the arm first followed it [s]."""
    first = runs.newly_followed(run)
    at = np.searchsorted(run.sequences, run.applied[first])
    known = (run.applied[first] > 0) & (at < len(run.sequences))
    first, at = first[known], at[known]
    return np.asarray((run.state_stamps[first] - run.reference_stamps[at]) * 1e-9)


def _speed_in_gap(run: Run) -> float:
    """Largest speed in the longest gap from its second second on; NaN without such a gap."""
    gaps = runs.reference_gaps(run)
    length, ends = gaps[int(np.argmax(gaps[:, 0]))]
    inside = ((run.state_stamps > ends - (length - 1.0) * 1e9) & (run.state_stamps < ends))
    if length < 1.2 or not inside.any():
        return float('nan')
    return float(np.linalg.norm(run.twists[inside, :3], axis=1).max())
