"""Random sequences of requests to an arm hold what the documentation says; faults are seen."""
import pytest

from experiments.arm_requests import ArmRequests, run
from gdmp_ros.control.arm_states import Request, State, TABLE
from gdmp_ros.control.guard import ReferenceGuard


def test_sequences_of_requests_hold():
    run(12)


@pytest.mark.long
def test_many_sequences_of_requests_hold():
    run(200)


def following():
    """An arm that follows a motion."""
    machine = ArmRequests()
    machine.stream(0.0, 0.03, False)
    machine.pass_ticks(150)
    assert machine.state == 'following'
    return machine


def moving():
    """An arm whose joints move."""
    machine = ArmRequests()
    machine.move_joints(0, 0.2)
    machine.pass_ticks(150)
    assert machine.state == 'moving'
    return machine


def faulty():
    """An arm in a fault."""
    machine = ArmRequests()
    machine.fail()
    return machine


#: What comes then, as the random sequences have it.
DEACTIVATE = ('deactivate_and_activate', (1, False))
CASES = {
    'no brakes at a deactivation': (following, DEACTIVATE, (
        State.FOLLOWING, Request.DEACTIVATE, State.INACTIVE)),
    'guided in a fault': (faulty, ('service', (Request.GUIDE,)), (
        State.FAULT, Request.GUIDE, State.GUIDED)),
    'no brakes of the joints': (moving, ('service', (Request.STOP,)), (
        State.MOVING, Request.STOP, State.HOLDING))}


@pytest.mark.parametrize('name', CASES)
def test_a_broken_transition_is_found(name, monkeypatch):
    begin, (rule, arguments), (state, request, entry) = CASES[name]
    getattr(begin(), rule)(*arguments)
    monkeypatch.setitem(TABLE[state], request, entry)
    with pytest.raises(AssertionError):
        getattr(begin(), rule)(*arguments)


def test_a_stream_that_goes_on_after_a_stop_is_found(monkeypatch):
    entered = ReferenceGuard._entered

    def resumes(guard, before):
        entered(guard, before)
        if guard.states.state is State.STOPPING:
            guard._stream.resumable = 1.0

    def stopped():
        machine = following()
        machine.service(Request.STOP)
        machine.pass_ticks(300)
    stopped()
    monkeypatch.setattr(ReferenceGuard, '_entered', resumes)
    with pytest.raises(AssertionError, match='it follows what it must not'):
        stopped()


def test_a_stream_that_began_before_the_activation_and_is_followed_is_found(monkeypatch):
    ArmRequests().deactivate_and_activate(1, True)
    monkeypatch.setattr(ReferenceGuard, 'observe', lambda *_: None)
    with pytest.raises(AssertionError, match='it follows what it must not'):
        ArmRequests().deactivate_and_activate(1, True)
