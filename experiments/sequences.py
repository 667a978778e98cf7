"""Tries random sequences of requests: the rules of a state machine of hypothesis."""
from __future__ import annotations

from collections.abc import Callable

from hypothesis import HealthCheck, Phase, settings
from hypothesis.stateful import RuleBasedStateMachine, run_state_machine_as_test


def run(machine: type[RuleBasedStateMachine], sequences: int, *, steps: int = 25,
        tried: Callable[[], None] = lambda: None, shortest: bool = True) -> None:
    """
    Try random sequences.

    :param steps: most requests of a sequence
    :param tried: called after each sequence
    :param shortest: whether to look for the shortest sequence that does not hold
    :raises AssertionError: with the sequence that does not hold
    """
    class Told(machine):  # type: ignore[misc, valid-type]
        def teardown(self) -> None:
            super().teardown()
            tried()
    run_state_machine_as_test(Told, settings=settings(
        max_examples=sequences, stateful_step_count=steps, deadline=None, database=None,
        phases=(Phase.generate, Phase.shrink) if shortest else (Phase.generate,),
        derandomize=True, suppress_health_check=list(HealthCheck)))
