"""Somebody at the terminal who has a running server execute its skill."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.srv import LoadSkill, SetSpeed
import numpy as np

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros import messages as wire
from gdmp_ros.ros.clients.server_client import Operator
from gdmp_ros.util.terminal import progress


class Wish(NamedTuple):
    """
    What is wanted.

    :ivar server: name of the node, with its namespace
    :ivar skill: file to load first, or empty
    :ivar position: to switch the goal to [m], None to leave it
    :ivar after: when, after the start [s]
    :ivar speed: tempo, None to leave it
    :ivar wait: for the server, and for the server to hear of its robot, at most [s]
    """

    server: str
    skill: str
    position: Sequence[float] | None
    after: float
    speed: float | None
    wait: float


def execute(wish: Wish) -> int:
    """
    Execute, and say how it ended.

    :returns: 0 if the goal was reached, else 1
    :raises GdmpError: if the server is not there, or refuses
    """
    operator = Operator(wish.server)
    try:
        operator.wait(f'{wish.server} to say what it does', lambda: operator.state is not None,
                      wish.wait)
        for kind, name, fields in (
                (LoadSkill, 'load_skill', {'path': wish.skill} if wish.skill else None),
                (SetSpeed, 'set_speed', {'scale': wish.speed} if wish.speed is not None
                 else None)):
            if fields is not None:
                reply = operator.call(kind, f'{wish.server}/{name}', **fields)
                if not reply.success:
                    raise GdmpError(reply.message)
        _meet_robot(operator, wish.wait)
        try:
            operator.execute()
            return _follow(operator, wish)
        except (KeyboardInterrupt, GdmpError):
            if operator.cancel():
                print('stopped')
            raise
    finally:
        operator.close()


def _meet_robot(operator: Operator, patience: float) -> None:
    """Let the server learn where the robot is; after that it says itself why it does not start."""
    state, left, refusal = operator.state, patience, ''
    if state is None or 'no_robot' not in state.flags:
        return
    print(f'waiting for the pose of the robot, {patience:g} s at most', flush=True)
    refused = state.refused
    while left > 0.0 and 'no_robot' in state.flags:
        if state.refused > refused and state.last_refusal != refusal:
            refusal = state.last_refusal
            print(f'the server refused {refusal}', flush=True)
        operator.spend(0.1)
        state, left = operator.state or state, left - 0.1


def _follow(operator: Operator, wish: Wish) -> int:
    """Switch the goal in time and show progress until it is over."""
    with progress('executing', 100) as step:
        if wish.position is not None:
            operator.spend(wish.after)
            _switch(operator, wish.position)
        done = 0.0
        while not operator.done():
            operator.spend(0.1)
            now = 100.0 * min(operator.state.progress if operator.state else 0.0, 1.0)
            step(max(now - done, 0.0))
            done = max(done, now)
    result = operator.result(10.0)
    left = ', '.join(f'{name} {value:.2g}'
                     for name, value in zip(result.factors, result.distance_to_goal))
    reached = result.error_code == ExecuteSkill.Result.SUCCESSFUL
    print(f'{"the goal is reached" if reached else result.error_string}; distance: {left}')
    return 0 if reached else 1


def _switch(operator: Operator, position: Sequence[float]) -> None:
    state = operator.state
    if state is None or not state.goal:
        raise GdmpError('the server has no goal to switch')
    goal = wire.pose_numbers(state.goal[0])
    goal[:3] = position
    refused = state.refused
    operator.goal_pose(np.asarray(goal), state.header.frame_id)
    operator.wait('the goal to be switched', lambda: operator.state is not None and (
        operator.state.refused > refused or bool(operator.state.goal) and np.allclose(
            wire.pose_numbers(operator.state.goal[0])[:3], position)), 5.0)
    if operator.state is not None and operator.state.refused > refused:
        print(f'the new goal was refused: {operator.state.last_refusal}')
    else:
        print(f'the goal is now at {", ".join(f"{value:g}" for value in position)} m')
