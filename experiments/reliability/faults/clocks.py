"""Clocks that jump, and simulated time mixed with wall time."""
from __future__ import annotations

import importlib.util
from pathlib import Path

from rosgraph_msgs.msg import Clock

from experiments.reliability.trial import FaultTrial
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.data.bags import ns_of
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from gdmp_ros.util.files import write_text
from gdmp_ros.util.optional_imports import extra


def simulated_clock(trial: FaultTrial, quick: bool) -> TrialResult:
    """/clock jumps forwards and backwards in mid-motion"""
    outcome = TrialResult()
    trial.start(arm={'pace': 'fast'}, server={'use_sim_time': True})
    publisher = trial.client.publisher(Clock, '/clock')
    trial.wait('the server to subscribe', lambda: publisher.subscribers() > 0, 10.0)
    trial.execute()
    trial.wait_progress(0.2)
    now = ns_of(trial.state.header.stamp)
    for jump in (10 * messages.NS, -5 * messages.NS, 3600 * messages.NS, -now,
                 -now - 5 * messages.NS):
        for _ in range(5):
            publisher.publish(Clock(clock=messages.stamp_of(now + jump)))
            trial.spend(0.02)
    trial.reaches_goal(outcome)
    outcome.claim('the server reports the time jump',
                  'the time jumped by' in trial.log(SERVER))
    trial.finish(outcome)
    return outcome


def mixed_clocks(trial: FaultTrial, quick: bool) -> TrialResult:
    """An arm on simulated time, a server on wall time"""
    outcome = TrialResult()
    trial.start_arm(pace='fast')
    trial.start_server()
    trial.wait_holding()
    trial.record()
    trial.execute()
    trial.client.result(60.0)
    outcome.claim('the arm reports the mixed clocks', 'simulated and wall time are mixed'
                  in trial.log(ARM))
    run = trial.finish(outcome, None, follows=False)
    outcome.need('references followed', int((run.applied > 0).sum()), lambda v: v == 0)
    path = run.poses[:, :3] - run.poses[0, :3]
    outcome.need('the arm moved by [m]', float(abs(path).max()), lambda v: v < 1e-3)
    return outcome


def faketime_library() -> Path | None:
    """Path of libfaketime; None if it is not installed."""
    found = importlib.util.find_spec('libfaketime')
    folders = found.submodule_search_locations if found is not None else None
    for folder in folders or ():
        for path in Path(folder).rglob('libfaketime.so.1'):
            return path
    return None


def wall_clock(trial: FaultTrial, quick: bool) -> TrialResult:
    """The wall clock of the server's machine jumps by an hour and back in mid-motion"""
    outcome, library = TrialResult(), faketime_library()
    if library is None:
        outcome.missing = f"libfaketime is missing{extra('faults')}"
        return outcome
    setting = trial.folder / 'time'
    write_text(setting, '+0')
    trial.start_arm()
    trial.start_server(environment={
        'LD_PRELOAD': str(library), 'FAKETIME_TIMESTAMP_FILE': str(setting),
        'FAKETIME_CACHE_DURATION': '1', 'FAKETIME_DONT_FAKE_MONOTONIC': '1',
        'DONT_FAKE_MONOTONIC': '1'})
    trial.wait_holding()
    trial.record()
    trial.execute()
    trial.wait_progress(0.3)
    write_text(setting, '+3600')
    trial.wait('the arm to report the wrong stamps', lambda: (
        's in the future, expected within' in trial.log(ARM)), 10.0)
    outcome.measured['the arm reports the wrong stamps'] = 'yes'
    write_text(setting, '+0')
    trial.stays_and_begins_again(outcome)
    trial.finish(outcome)
    return outcome
