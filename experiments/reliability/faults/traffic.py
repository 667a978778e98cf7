"""Floods of goals and of invalid messages."""
from __future__ import annotations

from experiments.reliability.trial import FaultTrial
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.data import runs
from gdmp_ros.ros.clients.testbed import ARM, SERVER


def goal_flood(trial: FaultTrial, quick: bool) -> TrialResult:
    """A flood of goals at 1 kHz"""
    return _flooded(trial, 'goals', 3.0 if quick else 10.0)


def garbage_flood(trial: FaultTrial, quick: bool) -> TrialResult:
    """Invalid goals and references at 1 kHz besides the valid ones"""
    outcome = _flooded(trial, 'invalid', 3.0 if quick else 10.0)
    outcome.claim('the arm reports what it refuses', 'reference refused' in trial.log(ARM))
    return outcome


def _flooded(trial: FaultTrial, what: str, seconds: float) -> TrialResult:
    outcome = TrialResult()
    trial.start()
    trial.execute()
    trial.wait_progress(0.1)
    trial.children.start('flood', 'experiments.reliability.flood', [what])
    trial.wait('the flood', lambda: 'flooding' in trial.log('flood'), 60.0)
    trial.spend(0.5)
    before = trial.state
    trial.spend(seconds)
    after = trial.state
    trial.children.stop('flood')
    sent = int(trial.log('flood').split()[-1])
    outcome.need('messages sent', sent, lambda v: v > 500 * seconds, of_speed=True)
    ticks, missed = after.ticks - before.ticks, after.missed - before.missed
    outcome.need('fraction of missed ticks', missed / (ticks + missed),
                 lambda v: v < 0.25, of_speed=True)
    trial.reaches_goal(outcome, 'the motion reaches a goal')
    if what == 'invalid':
        refused = after.refused - before.refused
        outcome.claim('goals are refused', refused > 0)
        outcome.need('goals refused', refused, lambda v: v > 100, of_speed=True)
        outcome.claim('the server reports what it refuses', 'refused' in trial.log(SERVER))
    run = trial.finish(outcome, None)
    outcome.need('consecutive ticks of the arm without a valid reference',
                 runs.longest_wait(run), lambda v: v < 100, of_speed=True)
    return outcome
