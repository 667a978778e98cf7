"""Processes that are killed, stopped, started late or started again."""
from __future__ import annotations

from dataclasses import replace
import os
import signal
import time

import numpy as np
import psutil

from experiments.reliability.trial import FaultTrial, judge_limits, short_skill
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.data import runs
from gdmp_ros.data.runs import ONE_STREAM, Run
from gdmp_ros.ros.clients.testbed import ARM, SERVER


def server_killed(trial: FaultTrial, quick: bool) -> TrialResult:
    """Server killed (SIGKILL) in mid-motion and started again"""
    outcome = TrialResult()
    trial.start()
    trial.execute()
    trial.wait_progress(0.4)
    killed = time.time_ns()
    trial.children.kill(SERVER)
    trial.spend(3.0)
    trial.start_server()
    trial.wait_holding()
    trial.execute()
    trial.reaches_goal(outcome, 'the next motion reaches its goal')
    run = trial.recorded()
    before = run.reference_stamps < killed
    outcome.need('references lost before the fault',
                 float(run.sequences[before][-1] - run.sequences[0] + 1 - before.sum()),
                 lambda v: v == 0)
    rest = runs.time_to_rest(_until(run, killed + 3_000_000_000), killed)
    outcome.need('time to rest [s]', rest, lambda v: v < 2.5, of_speed=True)
    judge_limits(run, outcome)
    return outcome


def _until(run: Run, ns: int) -> Run:
    """The states of a run before a stamp."""
    kept = run.state_stamps < ns
    return replace(run, state_stamps=run.state_stamps[kept], twists=run.twists[kept])


def simulation_killed(trial: FaultTrial, quick: bool) -> TrialResult:
    """Simulation killed (SIGKILL) under a moving server and started again"""
    from gdmp_msgs.action import ExecuteSkill
    outcome = TrialResult()
    trial.start()
    # Long enough that the simulation is killed in mid-motion on any machine.
    trial.execute(ExecuteSkill.Goal(duration=10.0))
    trial.wait_progress(0.3)
    ticks = trial.state.ticks
    trial.children.kill(ARM)
    trial.spend(1.0)
    outcome.need('references a second without the arm', trial.state.ticks - ticks,
                 lambda v: v > 900, of_speed=True)
    trial.start_arm()
    trial.wait('the new arm', lambda: trial.log(ARM).count('the arm follows') == 2, 60.0)
    trial.stays_and_begins_again(outcome)
    run = trial.finish(outcome)
    new = run.state_stamps > run.state_stamps[int(np.argmax(np.diff(run.state_stamps)))]
    holds = new & (np.cumsum(new & (run.arm_modes == ArmMode.FOLLOW)) == 0)
    outcome.claim('the recorder found the new arm before the next motion', bool(holds.any()), True)
    if holds.any():
        path = run.poses[holds, :3] - run.poses[holds, :3][0]
        outcome.need('the new arm moved before the next motion by [m]', float(abs(path).max()),
                     lambda v: v < 1e-3)
    return outcome


def server_stopped(trial: FaultTrial, quick: bool) -> TrialResult:
    """Server stopped (SIGSTOP) for 50 ms to 5 s in mid-motion"""
    outcome, gap = TrialResult(), GuardSettings().resume_time
    trial.start(server={'speed_rate': 5.0})
    for seconds in (0.05, 0.3) if quick else (0.05, 0.1, 0.2, 0.5, 1.5, 5.0):
        trial.execute()
        trial.wait_progress(0.4)
        process = trial.children.processes[SERVER]
        process.send_signal(signal.SIGSTOP)
        try:
            time.sleep(seconds)
        finally:
            process.send_signal(signal.SIGCONT)
        if seconds < gap:
            trial.reaches_goal(outcome, f'goal reached after a stop of {seconds:g} s')
        else:
            trial.stays_and_begins_again(outcome)
    outcome.claim('the server reports the time jump',
                  'the time jumped by' in trial.log(SERVER))
    trial.finish(outcome, 0.01)
    return outcome


def late_discovery(trial: FaultTrial, quick: bool) -> TrialResult:
    """The arm starts long after the server and the client that executes the skill"""
    outcome = TrialResult()
    trial.start_server()
    trial.wait('the server', lambda: trial.client.state is not None, 120.0)
    trial.execute()
    result = trial.client.result(10.0)
    outcome.claim('a start without an arm is refused with the reason',
                  result.error_code == result.INVALID_GOAL
                  and 'no measured pose' in result.error_string)
    trial.spend(1.0 if quick else 8.0)
    trial.start_arm()
    trial.wait_holding()
    trial.record()
    trial.execute()
    trial.reaches_goal(outcome, 'then the motion reaches its goal')
    trial.finish(outcome, None)
    return outcome


#: The allocator and the pools of DDS take memory in steps, however many restarts there are: this
#: much is not counted as growth [bytes].
ALLOCATED = 1024 * 1024


def restarts(trial: FaultTrial, quick: bool) -> TrialResult:
    """Server started and ended again and again under a running arm"""
    outcome, count = TrialResult(), 3 if quick else 50
    trial.start()
    trial.children.stop(SERVER)
    shared, memory = _shared_files(), _memory(trial)
    codes = []
    for number in range(count):
        trial.start_server()
        trial.wait_holding()
        if number % 2:
            trial.children.kill(SERVER)
        else:
            codes.append(trial.children.stop(SERVER))
    outcome.need('restarts', count, lambda v: v >= 3)
    outcome.measured['exit codes'] = ' '.join(map(str, sorted(set(codes))))
    outcome.claim('all exit codes are 0', not any(codes))
    outcome.need('new shared-memory files per kill', (
        _shared_files() - shared) / (count // 2), lambda v: v == 0)
    outcome.need('growth of the memory of the simulation per restart [KiB]',
                 max(_memory(trial) - memory - ALLOCATED, 0) / count / 1024, lambda v: v < 256)
    run = trial.finish(outcome, None, follows=False)
    path = run.poses[:, :3] - run.poses[0, :3]
    outcome.need('the arm moved by [m]', float(abs(path).max()), lambda v: v < 1e-3)
    return outcome


def _shared_files() -> int:
    return sum(name.startswith('fastrtps') for name in os.listdir('/dev/shm'))


def _memory(trial: FaultTrial) -> int:
    return int(psutil.Process(trial.children.processes[ARM].pid).memory_info().rss)


def two_servers(trial: FaultTrial, quick: bool) -> TrialResult:
    """A second server streams to the same arm"""
    from gdmp_msgs.action import ExecuteSkill
    outcome = TrialResult()
    trial.start()
    other = short_skill(trial.folder, name='Angle')
    trial.execute(ExecuteSkill.Goal(duration=20.0))
    trial.start_server('second_server', skill=str(other), extra=[
        '-r', '__node:=second_server', '-r', '~/reference:=/trajectory_server/reference'],
                       start_from='skill', execute_on_activate=True)
    trial.wait('the second server', lambda: 'does not follow' in trial.log(ARM), 60.0)
    trial.reaches_goal(outcome, 'the first reaches its goal')
    trial.spend(3.0)
    outcome.claim('the arm reports it', 'more than one publisher of references (published by '
                  '/second_server, /trajectory_server)' in trial.log(ARM))
    outcome.claim('the servers report it', '2 nodes publish references' in trial.log(SERVER))
    run = trial.finish(outcome)
    followed = run.applied[run.applied > 0].astype(np.int64)
    foreign = np.abs(followed - int(run.sequences[0])) > ONE_STREAM
    outcome.need('references of the second server that were followed', int(foreign.sum()),
                 lambda v: v == 0)
    return outcome
