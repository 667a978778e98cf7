"""Random sequences of requests hold what the documentation says; and each fault is seen."""
import pytest

from experiments.requests import Requests, run
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


#: Requests on the way to the robot, each with what loses it.
ON_THE_WAY = {
    '_retarget': (lost_goal, lambda server: server.goal_pose(0.2, 0.4, 0.0)),
    '_pause': (lost_pause, lambda server: server.pause(True)),
    '_stop': (sudden_stop, lambda server: (server.stop(), server.tick(50)))}


@pytest.mark.parametrize('method', ON_THE_WAY)
def test_a_broken_transition_is_found(method, monkeypatch):
    broken, request = ON_THE_WAY[method]

    def ask():
        server = Requests()
        server.begin()
        server.start_far(0.15, 100)
        request(server)
        server.teardown()
    ask()
    monkeypatch.setattr(Player, method, broken)
    with pytest.raises(AssertionError):
        ask()
