"""More messages than anybody can use, and messages that nobody should use."""
from __future__ import annotations

from gdmp_ros.experiments.reliability import motion
from gdmp_ros.experiments.reliability.outcome import Outcome
from gdmp_ros.experiments.reliability.trial import SERVER, SIM, Trial


def goal_flood(trial: Trial, quick: bool) -> Outcome:
    """Goals at 1 kHz from a publisher that floods"""
    return _flooded(trial, 'goals', 3.0 if quick else 10.0)


def garbage_flood(trial: Trial, quick: bool) -> Outcome:
    """Bad goals and bad references at 1 kHz beside the good ones"""
    outcome = _flooded(trial, 'garbage', 3.0 if quick else 10.0)
    outcome.claim('the arm says what it refuses', 'reference refused' in trial.log(SIM))
    return outcome


def _flooded(trial: Trial, what: str, seconds: float) -> Outcome:
    outcome = Outcome()
    trial.start()
    trial.operator.execute()
    trial.progress(0.1)
    trial.children.start('flood', 'gdmp_ros.experiments.reliability.flood', [what])
    trial.operator.wait('the flood', lambda: 'flooding' in trial.log('flood'), 60.0)
    trial.spend(0.5)
    before = trial.state
    trial.spend(seconds)
    after = trial.state
    trial.children.stop('flood')
    sent = int(trial.log('flood').split()[-1])
    outcome.need('messages sent', sent, lambda v: v > 500 * seconds)
    ticks, missed = after.ticks - before.ticks, after.missed - before.missed
    outcome.need('share of the ticks missed', missed / (ticks + missed), lambda v: v < 0.25)
    outcome.claim('the motion reaches a goal', trial.succeeded())
    if what == 'garbage':
        outcome.need('goals refused', after.refused - before.refused, lambda v: v > 100)
        outcome.claim('the server says what it refuses', 'refused' in trial.log(SERVER))
    run = trial.closing(outcome, None)
    outcome.need('ticks of the arm in a row without a good reference',
                 motion.most_ticks_unled(run), lambda v: v < 100)
    return outcome
