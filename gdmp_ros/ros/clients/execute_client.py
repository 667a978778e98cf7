"""Executes the skill of a running server, from the terminal."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.srv import LoadSkill, SetSpeed
import numpy as np

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.server_client import ServerClient
from gdmp_ros.util.terminal import progress, rising

#: Of the distances by factor.
_UNITS = {'position': ' m', 'orientation': ' rad / 2', 'joints': ' rad', 'wrench': ' (N, Nm)'}


class ExecuteRequest(NamedTuple):
    """
    What to execute.

    :ivar server: name of the node, with its namespace
    :ivar skill: file to load first; empty for the loaded skill
    :ivar position: new goal position [m]; None for no goal switch
    :ivar after: time of the goal switch after the start [s]
    :ivar speed: tempo; None to keep the present one
    :ivar wait: timeout for the server, and then for the pose of its robot [s]
    :ivar cycles: of a rhythmic skill; 0: until its amplitude is 0
    :ivar sequence: file to execute instead of a skill; empty for a skill
    :ivar first_step: of the sequence, counted from 1
    :ivar context: that the skill is to be used in; empty for that of the server
    :ivar objects: poses of task frames in the frame of the server; the others are looked up
    """

    server: str
    skill: str
    position: Sequence[float] | None
    after: float
    speed: float | None
    wait: float
    cycles: float = 0.0
    sequence: str = ''
    first_step: int = 1
    context: Mapping[str, float] = MappingProxyType({})
    objects: Mapping[str, Sequence[float]] = MappingProxyType({})


def execute(request: ExecuteRequest) -> int:
    """
    Execute, and print the result.

    :returns: 0 if the goal was reached, else 1
    :raises GdmpError: if the server does not answer, or refuses
    """
    client = ServerClient(request.server)
    try:
        client.find_server(request.wait)
        for kind, name, fields in (
                (LoadSkill, 'load_skill', {
                    'path': request.skill, 'contents': Skill.load(request.skill).text()}
                 if request.skill else None),
                (SetSpeed, 'set_speed', {'scale': request.speed} if request.speed is not None
                 else None)):
            if fields is not None:
                reply = client.call(kind, f'{request.server}/{name}', **fields)
                if not reply.success:
                    raise GdmpError(reply.message)
                if reply.message:
                    print(f'warning: {reply.message}', flush=True)
        if request.context:
            _use_context(client, request.context)
        _wait_for_robot(client, request.wait)
        try:
            if request.sequence:
                client.execute_sequence(request.sequence, request.first_step)
                return _follow_sequence(client)
            client.execute(_goal(request))
            return _follow(client, request)
        except BaseException:  # rclpy turns a KeyboardInterrupt into other exceptions
            if client.cancel():
                print('stopped')
            raise
    finally:
        client.close()


def _use_context(client: ServerClient, context: Mapping[str, float]) -> None:
    """:raises GdmpError: if the server refuses it"""
    state = client.state
    if state is None:
        return
    refused = state.refused
    client.context(context)

    def used() -> bool:
        state = client.state
        return state is not None and (state.refused > refused or context == dict(
            zip(state.context.names, state.context.values)))
    client.wait('the context to be used', used, 5.0)
    if client.state is not None and client.state.refused > refused:
        raise GdmpError(client.state.last_refusal)


def _wait_for_robot(client: ServerClient, timeout: float) -> None:
    """Wait until the server has the pose of the robot; before that it refuses a start."""
    state, left, refusal = client.state, timeout, ''
    if state is None or 'no_robot' not in state.flags:
        return
    print(f'waiting for the pose of the robot, at most {timeout:g} s', flush=True)
    refused = state.refused
    while left > 0.0 and 'no_robot' in state.flags:
        if state.refused > refused and state.last_refusal != refusal:
            refusal = state.last_refusal
            print(f'the server refused {refusal}', flush=True)
        client.spend(0.1)
        state, left = client.state or state, left - 0.1


def _follow(client: ServerClient, request: ExecuteRequest) -> int:
    """Show the progress until the end, and when the goal is switched."""
    with progress('executing', 100) as step:
        show, position = rising(step), request.position
        while not client.done():
            client.spend(0.1)
            show(100.0 * min(_share(client, request), 1.0))
            if position is not None and _has_goal(client, position):
                print('the goal is switched to '
                      f'{", ".join(f"{value:g}" for value in position)} m')
                position = None
    result = client.result(10.0)
    if result.error_code == result.INVALID_GOAL:
        raise GdmpError(result.error_string)
    left = ', '.join(f'{name} {value:.2g}{_UNITS.get(name, "")}'
                     for name, value in zip(result.factors, result.distance_to_goal))
    reached = result.error_code == ExecuteSkill.Result.SUCCESSFUL
    metres = 'joints' not in result.factors
    robot = [f'{1e3 * value:.1f} mm' if metres and i % 2 == 0 else f'{value:.3f} rad'
             for i, value in enumerate(result.robot_distance)]
    print(f'{"the goal was reached" if reached else result.error_string}; distance of the '
          f'reference: {left}' + (f'; of the robot: {", ".join(robot)}' if robot else ''))
    return 0 if reached else 1


def _share(client: ServerClient, request: ExecuteRequest) -> float:
    """Part of the motion that is done; a rhythmic one without an end has none."""
    state = client.state
    if state is None:
        return 0.0
    if not state.rhythmic:
        return float(state.progress)
    return float(state.progress / request.cycles) if request.cycles else 0.0


def _follow_sequence(client: ServerClient) -> int:
    """Print each step when it begins, and how the sequence ended."""
    reported = 0
    while not client.done():
        client.spend(0.1)
        state = client.state
        if state is not None and state.step and state.step != reported:
            reported = state.step
            print(f'step {state.step} of {state.steps}: {state.step_name}', flush=True)
    result = client.result(10.0)
    done = client.succeeded()
    print('the sequence is done' if done else
          f'the sequence ended at step {result.step}: {result.error_string}')
    return 0 if done else 1


def _goal(request: ExecuteRequest) -> ExecuteSkill.Goal:
    """The request as a goal of the action: the server checks all of it before anything moves."""
    goal = ExecuteSkill.Goal(cycles=request.cycles)
    if request.position is not None:
        goal.use_goal_pose, goal.goal_after = True, request.after
        place, turned = goal.goal_pose.pose.position, goal.goal_pose.pose.orientation
        place.x, place.y, place.z = map(float, request.position)
        turned.w = 0.0  # the rotation stays that of the skill
    for name, pose in request.objects.items():
        goal.objects.append(messages.stamped_transform('', name, np.array(pose)))
    return goal


def _has_goal(client: ServerClient, position: Sequence[float]) -> bool:
    """Whether the server has a goal at this position [m]."""
    state = client.state
    return state is not None and bool(state.goal) and np.allclose(
        messages.pose_numbers(state.goal[0])[:3], position)
