"""Processes that die, stand still, come late or come back."""
from __future__ import annotations

from dataclasses import replace
import os
import signal
import time

import numpy as np
import psutil

from gdmp_ros.data.runs import ONE_STREAM, Run
from gdmp_ros.experiments.reliability import motion
from gdmp_ros.experiments.reliability.outcome import Outcome
from gdmp_ros.experiments.reliability.trial import now_ns, SERVER, short_skill, SIM, Trial


def server_killed(trial: Trial, quick: bool) -> Outcome:
    """Server killed (SIGKILL) in mid-motion and started again"""
    outcome = Outcome()
    trial.start()
    trial.operator.execute()
    trial.progress(0.4)
    killed = now_ns()
    trial.children.kill(SERVER)
    trial.spend(3.0)
    trial.start_server()
    trial.holding()
    trial.operator.execute()
    outcome.claim('the next motion reaches its goal', trial.succeeded())
    run = trial.recorded()
    before = run.reference_stamps < killed
    outcome.need('references lost before the fault',
                 float(run.sequences[before][-1] - run.sequences[0] + 1 - before.sum()),
                 lambda v: v == 0)
    outcome.need('at rest after [s]', motion.at_rest(_until(run, killed + 3_000_000_000), killed),
                 lambda v: v < 2.5)
    motion.judge(run, outcome)
    return outcome


def _until(run: Run, ns: int) -> Run:
    """First part of a run's states."""
    kept = run.state_stamps < ns
    return replace(run, state_stamps=run.state_stamps[kept], twists=run.twists[kept])


def simulation_killed(trial: Trial, quick: bool) -> Outcome:
    """Simulation killed (SIGKILL) under a moving server and started again"""
    outcome = Outcome()
    trial.start()
    trial.operator.execute()
    trial.progress(0.3)
    ticks = trial.state.ticks
    trial.children.kill(SIM)
    trial.spend(1.0)
    outcome.need('references a second without the arm', trial.state.ticks - ticks,
                 lambda v: v > 900)
    trial.start_sim()
    trial.operator.wait('the new arm', lambda: trial.log(SIM).count('the arm follows') == 2, 60.0)
    outcome.claim('the server finishes its motion', trial.succeeded())
    trial.spend(6.0)
    trial.closing(outcome)
    return outcome


def server_stopped(trial: Trial, quick: bool) -> Outcome:
    """Server stopped (SIGSTOP) for 50 ms to 5 s in mid-motion"""
    outcome = Outcome()
    trial.start(server={'speed_rate': 5.0})
    for seconds in (0.05, 0.3) if quick else (0.05, 0.1, 0.2, 0.5, 1.0, 5.0):
        trial.operator.execute()
        trial.progress(0.4)
        process = trial.children.processes[SERVER]
        process.send_signal(signal.SIGSTOP)
        try:
            time.sleep(seconds)
        finally:
            process.send_signal(signal.SIGCONT)
        outcome.claim(f'goal reached after a stop of {seconds:g} s', trial.succeeded())
    outcome.claim('the server says that the time jumped',
                  'the time jumped by' in trial.log(SERVER))
    trial.closing(outcome, 0.01)
    return outcome


def late_discovery(trial: Trial, quick: bool) -> Outcome:
    """The arm appears long after the server and its operator"""
    outcome = Outcome()
    trial.start_server()
    trial.operator.wait('the server', lambda: trial.operator.state is not None, 120.0)
    trial.operator.execute()
    result = trial.operator.result(10.0)
    outcome.claim('a start without an arm is refused with the reason',
                  result.error_code == result.INVALID_GOAL
                  and 'no measured pose' in result.error_string)
    trial.spend(1.0 if quick else 8.0)
    trial.start_sim()
    trial.holding()
    trial.record()
    trial.operator.execute()
    outcome.claim('then the motion reaches its goal', trial.succeeded())
    trial.closing(outcome, None)
    return outcome


def restarts(trial: Trial, quick: bool) -> Outcome:
    """Server started and ended again and again under a running arm"""
    outcome, count = Outcome(), 3 if quick else 50
    trial.start()
    trial.children.stop(SERVER)
    shared, memory = _shared_files(), _memory(trial)
    codes = []
    for number in range(count):
        trial.start_server()
        trial.holding()
        if number % 2:
            trial.children.kill(SERVER)
        else:
            codes.append(trial.children.stop(SERVER))
    outcome.need('restarts', count, lambda v: v >= 3)
    outcome.measured['exit codes'] = ' '.join(map(str, sorted(set(codes))))
    outcome.claim('every end it was asked for is clean', not any(codes))
    outcome.need('shared-memory files more than before, per kill', (
        _shared_files() - shared) / (count // 2), lambda v: v == 0)
    outcome.need('memory of the simulation grew by, per restart [KiB]',
                 (_memory(trial) - memory) / count / 1024, lambda v: v < 256)
    run = trial.closing(outcome, None)
    path = run.poses[:, :3] - run.poses[0, :3]
    outcome.need('the arm moved by [m]', float(abs(path).max()), lambda v: v < 1e-3)
    return outcome


def _shared_files() -> int:
    return sum(name.startswith('fastrtps') for name in os.listdir('/dev/shm'))


def _memory(trial: Trial) -> int:
    return int(psutil.Process(trial.children.processes[SIM].pid).memory_info().rss)


def two_servers(trial: Trial, quick: bool) -> Outcome:
    """A second server streams to the same arm"""
    outcome = Outcome()
    trial.start()
    other = short_skill(trial.folder, name='Angle')
    trial.start_server('second_server', skill=str(other), extra=[
        '-r', '__node:=second_server', '-r', '~/reference:=/trajectory_server/reference'],
        start_from='skill', execute_on_activate=True)
    trial.operator.wait('the second server', lambda: 'does not follow' in trial.log(SIM), 60.0)
    trial.operator.execute()
    outcome.claim('the first reaches its goal', trial.succeeded())
    trial.spend(3.0)
    outcome.claim('the arm says so', 'more than one publisher of references (published by '
                  '/second_server, /trajectory_server)' in trial.log(SIM))
    outcome.claim('the servers say so', '2 nodes publish references' in trial.log(SERVER))
    run = trial.closing(outcome)
    followed = run.applied[run.applied > 0].astype(np.int64)
    foreign = np.abs(followed - int(run.sequences[0])) > ONE_STREAM
    outcome.need('references of the second that were followed', int(foreign.sum()),
                 lambda v: v == 0)
    return outcome
