"""A recorded run: references and states of an arm at 1 kHz, as arrays."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
import gc
from pathlib import Path
from typing import Any

import numpy as np

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.data.bags import message_of, NS, opened, REFERENCE, topics_in
from gdmp_ros.data.message_numbers import pose_numbers, vector_numbers
from gdmp_ros.errors import DataError

#: Sequence numbers of different publishers differ by more than this.
ONE_STREAM = 1 << 20
REFERENCE_TOPIC, STATE_TOPIC = '/trajectory_server/reference', '/panda_sim/state'
SERVER_STATE_TOPIC = '/trajectory_server/state'
STATE = 'gdmp_msgs/msg/RobotState'


@dataclass(frozen=True)
class Run:
    """
    References and states of an arm; stamps in ns, poses (x, y, z, qw, qx, qy, qz).

    :ivar published: times at which the references were published [ns]
    :ivar moving: whether a reference has a velocity
    :ivar modes: of the references (`gdmp_ros.control.modes.StreamMode`)
    :ivar arm_modes: of the states (`gdmp_ros.control.modes.ArmMode`)
    :ivar ticks: control ticks of the arm, by its own count
    :ivar wrenches: external, acting on the tool [N, Nm]
    :ivar joint_references: positions that the joints were to follow; NaN where there were none
    :ivar applied: sequence number of the reference that the arm followed at each state
    :ivar goal_stamps: of the states of the server, if it had a goal and they were recorded
    :ivar goals: of the server at these times
    :ivar statuses: of the server at these times
    :ivar progress: of its motion at these times
    :ivar steps: of sequences: when each began [ns], and what it is
    """

    reference_stamps: np.ndarray
    published: np.ndarray
    sequences: np.ndarray
    references: np.ndarray
    reference_stiffness: np.ndarray
    moving: np.ndarray
    modes: np.ndarray
    state_stamps: np.ndarray
    applied: np.ndarray
    poses: np.ndarray
    stiffness: np.ndarray
    twists: np.ndarray
    joints: np.ndarray
    velocities: np.ndarray
    torques: np.ndarray
    tank: np.ndarray
    limited: np.ndarray
    arm_modes: np.ndarray
    ticks: np.ndarray
    wrenches: np.ndarray
    joint_references: np.ndarray
    goal_stamps: np.ndarray
    goals: np.ndarray
    statuses: tuple[str, ...] = ()
    progress: np.ndarray = field(default_factory=lambda: np.empty(0))
    steps: tuple[tuple[int, str], ...] = ()


def streams(found: Sequence[tuple[str, str, int]], robot: str = '') -> tuple[list[str], list[str]]:
    """
    Topics with references and with states in a bag (`gdmp_ros.data.bags.topics`).

    :param robot: namespace; by default any
    """
    within = f'/{robot.strip("/")}/' if robot else '/'
    references, states = (sorted({topic for topic, kind, _ in found
                                  if kind == wanted and topic.startswith(within)})
                          for wanted in (REFERENCE, STATE))
    return references, states


def read(bag: Path, robot: str = '') -> Run:
    """
    Read a recorded run.

    :param robot: namespace of the robot, if the bag has several
    :raises DataError: if a topic is missing, empty or not unique
    """
    references: list[Any] = []
    states: list[Any] = []
    server: list[Any] = []
    published: list[int] = []
    with opened(bag) as reader, _without_garbage_collection():
        found = streams(topics_in(reader), robot)
        for what, topics in zip(('references', 'states of an arm'), found):
            if len(topics) != 1:
                have = ', '.join(topics) or 'none'
                raise DataError(f'{bag}: expected one topic with {what}'
                                f'{f" in {robot}" if robot else ""}, the bag has {have}')
        reference_topic, state_topic = found[0][0], found[1][0]
        server_topic = reference_topic.rpartition('/')[0] + '/state'
        for connection, bag_time, raw in reader.messages():
            if connection.topic == reference_topic:
                published.append(bag_time)
            message = message_of(reader, connection, raw)
            {server_topic: server, reference_topic: references, state_topic: states}.get(
                connection.topic, []).append(message)
    for topic, messages in ((reference_topic, references), (state_topic, states)):
        if not messages:
            raise DataError(f'{bag}: nothing was recorded on {topic}')
    goals = [message for message in server if getattr(message, 'goal', ())]
    return Run(
        reference_stamps=_stamps(references), published=np.array(published, dtype=np.int64),
        sequences=_column(references, lambda m: m.sequence),
        references=_column(references, _pose),
        reference_stiffness=_column(references, lambda m: m.stiffness),
        moving=_column(references, _speed) > 0.0,
        modes=_column(references, lambda m: _later(m, 'mode')), state_stamps=_stamps(states),
        applied=_column(states, lambda m: m.sequence), poses=_column(states, _pose),
        stiffness=_column(states, lambda m: m.stiffness),
        twists=_column(states, _twist), joints=_column(states, lambda m: m.position),
        velocities=_column(states, lambda m: m.velocity),
        torques=_column(states, lambda m: m.torque),
        tank=_column(states, lambda m: m.tank_energy),
        limited=_column(states, limited),
        arm_modes=_column(states, lambda m: _later(m, 'mode')),
        ticks=_column(states, lambda m: _later(m, 'tick')),
        wrenches=_column(states, lambda m: vector_numbers(m.wrench.force, m.wrench.torque)),
        joint_references=_column(states, _joint_reference), goal_stamps=_stamps(goals),
        goals=np.array([pose_numbers(message.goal[0]) for message in goals]).reshape(-1, 7),
        statuses=tuple(message.status for message in goals),
        progress=_column(goals, lambda m: m.progress), steps=_steps(server))


def _steps(states: list[Any]) -> tuple[tuple[int, str], ...]:
    """When each step of a sequence began, in the states of a server."""
    found, last = [], ('', 0)
    for message, stamp in zip(states, _stamps(states).tolist()):
        now = getattr(message, 'sequence', ''), _later(message, 'step')
        if now != last and now[1]:
            found.append((stamp, f'step {now[1]} of {message.steps} begins: {message.step_name}'))
        last = now
    return tuple(found)


def lost(run: Run) -> int:
    """References missing between the first and the last of each publisher."""
    # Sorted, because the order in the bag differs after a jump of wall time.
    steps = np.diff(np.unique(run.sequences.astype(np.int64)))
    return int((steps[steps < ONE_STREAM] - 1).sum())


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Disable the garbage collector: it would traverse tens of thousands of messages."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _column(messages: list[Any], get: Any) -> np.ndarray:
    return np.array([get(message) for message in messages])


def _stamps(messages: list[Any]) -> np.ndarray:
    return np.array([m.header.stamp.sec * NS + m.header.stamp.nanosec
                     for m in messages], dtype=np.int64)


def _later(message: Any, name: str) -> int:
    """A field that older recordings do not have: 0 there."""
    return int(getattr(message, name, 0))


def _joint_reference(message: Any) -> np.ndarray:
    for joints in getattr(message, 'joint_reference', ()):
        return np.array(joints.position)
    return np.full(len(message.position), np.nan)


def limited(message: Any) -> np.ndarray:
    """By how much each of `LIMITS` was exceeded in a RobotState; 0 for those that came later."""
    numbers = np.concatenate([message.limited, getattr(message, 'limited_more', [])])
    return np.pad(numbers, (0, max(0, len(LIMITS) - len(numbers))))[:len(LIMITS)]


def _pose(message: Any) -> list[float]:
    return pose_numbers(message.pose)


def _twist(message: Any) -> list[float]:
    return vector_numbers(message.twist.linear, message.twist.angular)


def _speed(message: Any) -> float:
    return max(abs(number) for number in _twist(message))
