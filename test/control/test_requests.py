"""Random sequences of requests to an arm hold what the documentation says; faults are seen."""
import pytest

from experiments.arm_requests import run
from gdmp_ros.control.arm_states import Request, State, TABLE
from gdmp_ros.control.guard import ReferenceGuard


def test_sequences_of_requests_hold():
    run(12)


@pytest.mark.long
def test_many_sequences_of_requests_hold():
    run(200)


@pytest.mark.long
@pytest.mark.parametrize('state, request_, entry', [
    (State.FOLLOWING, Request.DEACTIVATE, State.INACTIVE),  # without brakes
    (State.FAULT, Request.GUIDE, State.GUIDED),
    (State.MOVING, Request.STOP, State.HOLDING)])
def test_a_broken_transition_is_found(state, request_, entry, monkeypatch):
    monkeypatch.setitem(TABLE[state], request_, entry)
    with pytest.raises((AssertionError, ExceptionGroup)):
        run(200, shortest=False)


@pytest.mark.long
def test_a_stream_that_goes_on_after_a_stop_is_found(monkeypatch):
    entered = ReferenceGuard._entered

    def resumes(guard, before):
        entered(guard, before)
        guard._resumable = guard._resumable or guard.states.state is State.STOPPING
    monkeypatch.setattr(ReferenceGuard, '_entered', resumes)
    with pytest.raises((AssertionError, ExceptionGroup)):
        run(200, shortest=False)


@pytest.mark.long
def test_a_stream_that_began_before_the_activation_and_is_followed_is_found(monkeypatch):
    monkeypatch.setattr(ReferenceGuard, 'observe', lambda *_: None)
    with pytest.raises((AssertionError, ExceptionGroup)):
        run(200, shortest=False)
