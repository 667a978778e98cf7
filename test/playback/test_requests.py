"""Random sequences of requests hold what the documentation says; and each fault is seen."""
import pytest

from experiments.requests import run
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.states import Request, State, TABLE


def test_sequences_of_requests_hold():
    run(25)


@pytest.mark.long
def test_many_sequences_of_requests_hold():
    run(200)


def test_every_request_has_a_result_in_every_state():
    assert set(TABLE) == set(State)
    assert all(set(row) == set(Request) for row in TABLE.values())


def lost_goal(player, goal):
    if player._pending is None:
        RETARGET(player, goal)


def lost_pause(player):
    if player._pending is None:
        PAUSE(player)


def sudden_stop(player):
    if player._approach is None:
        STOP(player)
        return
    player._approach, player._pending, player._state = None, None, State.RESTING
    player.playing.stop(player.target)


RETARGET, PAUSE, STOP = Player._retarget, Player._pause, Player._stop


@pytest.mark.long
@pytest.mark.parametrize('method, broken', [
    ('_retarget', lost_goal), ('_pause', lost_pause), ('_stop', sudden_stop)])
def test_a_broken_transition_is_found(method, broken, monkeypatch):
    monkeypatch.setattr(Player, method, broken)
    with pytest.raises((AssertionError, ExceptionGroup)):
        run(200, shortest=False)
