"""A recorded run: references and states of an arm at 1 kHz, its figures and its events."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
import gc
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.control.limits import Limit, LIMITS
from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.data.bags import (
    message_of,
    NS,
    ns_of,
    opened,
    pose_numbers,
    REFERENCE,
    reference_target,
    topics,
    topics_in,
    vector_numbers,
)
from gdmp_ros.errors import DataError
from gdmp_ros.learning.correction import FollowedMotion
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Sequence numbers of different publishers differ by more than this.
ONE_STREAM = 1 << 20
REFERENCE_TOPIC, STATE_TOPIC = '/trajectory_server/reference', '/panda_sim/state'
SERVER_STATE_TOPIC = '/trajectory_server/state'
STATE = 'gdmp_msgs/msg/RobotState'
#: Between states further apart than this the simulation stood still or was restarted [ns].
STATE_GAP_NS = 5_000_000
#: References published this long after their stamps have stamps of another clock [s].
OTHER_CLOCK_S = 10.0
#: References further apart than this are an interruption [ns].
INTERRUPTION_NS = 20_000_000
#: A limit that is not active for less than this is still the same event [ns].
SAME_EVENT_NS = 200_000_000
#: A reference at rest for this long is a pause between motions [ns].
PAUSE_NS = 100_000_000
#: A goal that changes again within this time still moves [ns]: the server tells it at 10 Hz.
GOAL_MOVES_NS = 350_000_000
#: A goal has changed if it is this far from the one before [m, rad].
OTHER_GOAL = 1e-4
#: Status of the server during a motion.
_MOVING = ('moving', 'paused')
#: States of the arm that are used: one in so many.
_EVERY = 10
#: A longer pause between two references is not replayed [s].
LONGEST_PAUSE_S = 60.0


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


def streams(topics: Sequence[tuple[str, str, int]], robot: str = ''
            ) -> tuple[list[str], list[str]]:
    """
    Topics with references and with states in a bag (`gdmp_ros.data.bags.topics`).

    :param robot: namespace; by default any
    """
    within = f'/{robot.strip("/")}/' if robot else '/'
    references, states = (sorted({topic for topic, kind, _ in topics
                                  if kind == message and topic.startswith(within)})
                          for message in (REFERENCE, STATE))
    return references, states


def is_run(bag: Path, robot: str = '') -> bool:
    """Whether a bag has references and states of an arm; see `streams`."""
    return all(streams(topics(bag), robot))


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
        result = streams(topics_in(reader), robot)
        for what, topics in zip(('references', 'states of an arm'), result):
            if len(topics) != 1:
                have = ', '.join(topics) or 'none'
                raise DataError(f'{bag}: expected one topic with {what}'
                                f'{f" in {robot}" if robot else ""}, the bag has {have}')
        reference_topic, state_topic = result[0][0], result[1][0]
        server_topic = reference_topic.rpartition('/')[0] + '/state'
        used = [c for c in reader.connections
                if c.topic in (reference_topic, state_topic, server_topic)]
        for connection, bag_time, raw in reader.messages(used):
            if connection.topic == reference_topic:
                published.append(bag_time)
            message = message_of(reader, connection, raw)
            {server_topic: server, reference_topic: references, state_topic: states}[
                connection.topic].append(message)
    for topic, messages in ((reference_topic, references), (state_topic, states)):
        if not messages:
            raise DataError(f'{bag}: nothing was recorded on {topic}')
    goals = [message for message in server if len(message.goal)]
    return Run(
        reference_stamps=_stamps(references), published=np.array(published, dtype=np.int64),
        sequences=_column(references, lambda m: m.sequence),
        references=_column(references, _pose),
        reference_stiffness=_column(references, lambda m: m.stiffness),
        moving=_column(references, _speed) > 0.0,
        modes=_column(references, lambda m: m.mode), state_stamps=_stamps(states),
        applied=_column(states, lambda m: m.sequence), poses=_column(states, _pose),
        stiffness=_column(states, lambda m: m.stiffness),
        twists=_column(states, _twist), joints=_column(states, lambda m: m.position),
        velocities=_column(states, lambda m: m.velocity),
        torques=_column(states, lambda m: m.torque),
        tank=_column(states, lambda m: m.tank_energy),
        limited=_column(states, limited),
        arm_modes=_column(states, lambda m: m.mode), ticks=_column(states, lambda m: m.tick),
        wrenches=_column(states, lambda m: vector_numbers(m.wrench.force, m.wrench.torque)),
        joint_references=_column(states, _joint_reference), goal_stamps=_stamps(goals),
        goals=np.array([pose_numbers(message.goal[0]) for message in goals]).reshape(-1, 7),
        statuses=tuple(message.status for message in goals),
        progress=_column(goals, lambda m: m.progress), steps=_steps(server))


def _steps(states: list[Any]) -> tuple[tuple[int, str], ...]:
    """When each step of a sequence began, in the states of a server."""
    result, last = [], ('', 0)
    for message, stamp in zip(states, _stamps(states).tolist()):
        now = message.sequence, message.step
        if now != last and now[1]:
            result.append((stamp, f'step {now[1]} of {message.steps} begins: {message.step_name}'))
        last = now
    return tuple(result)


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
    return np.array([ns_of(m.header.stamp) for m in messages], dtype=np.int64)


def _joint_reference(message: Any) -> np.ndarray:
    for joints in message.joint_reference:
        return np.array(joints.position)
    return np.full(len(message.position), np.nan)


def limited(message: Any) -> np.ndarray:
    """By how much each of `LIMITS` was exceeded in a RobotState."""
    exceeded: np.ndarray = message.limited[:len(LIMITS)]
    return exceeded


def _pose(message: Any) -> list[float]:
    return pose_numbers(message.pose)


def _twist(message: Any) -> list[float]:
    return vector_numbers(message.twist.linear, message.twist.angular)


def _speed(message: Any) -> float:
    return max(abs(number) for number in _twist(message))


class Tracking(NamedTuple):
    """
    Distance between the arm and the reference that it followed.

    :ivar states: indices of the states that followed a recorded reference
    :ivar references: indices of these references
    :ivar position: distances [m]
    :ivar rotation: angles [rad]
    """

    states: np.ndarray
    references: np.ndarray
    position: np.ndarray
    rotation: np.ndarray


def tracking(run: Run, begin_ns: int | None = None, end_ns: int | None = None) -> Tracking:
    """
    Compare every measured pose with the reference that was followed.

    :param begin_ns: stamp of the first state; by default all
    :param end_ns: stamp of the last state
    """
    order = np.argsort(run.sequences, kind='stable')
    at = np.minimum(np.searchsorted(run.sequences[order], run.applied), len(order) - 1)
    references = order[at]
    followed = run.sequences[references] == run.applied
    if begin_ns is not None:
        followed &= run.state_stamps >= begin_ns
    if end_ns is not None:
        followed &= run.state_stamps <= end_ns
    states = np.flatnonzero(followed)
    references = references[states]
    desired, measured = run.references[references], run.poses[states]
    return Tracking(states, references,
                    np.linalg.norm(measured[:, :3] - desired[:, :3], axis=1),
                    rotation_angles(measured[:, 3:], desired[:, 3:]))


def stiffness_error(run: Run, tracked: Tracking) -> float:
    """Mean relative difference between applied stiffness and that of the reference."""
    desired = run.reference_stiffness[tracked.references]
    difference = np.linalg.norm(run.stiffness[tracked.states] - desired, axis=1)
    return float(np.mean(difference / np.linalg.norm(desired, axis=1)))


class GoalError(NamedTuple):
    """Distance of arm and applied stiffness from a goal: m, rad, geodesic."""

    position: float
    rotation: float
    stiffness: float


def goal_error(run: Run, when_ns: int, pose: np.ndarray, stiffness: np.ndarray) -> GoalError:
    """
    Compare arm and applied translational stiffness with a goal at a time.

    :param stiffness: shape ``(3, 3)``
    """
    i = min(int(np.searchsorted(run.state_stamps, when_ns)), len(run.state_stamps) - 1)
    applied = run.stiffness[i].reshape(6, 6)[:3, :3].copy()
    return GoalError(float(np.linalg.norm(run.poses[i, :3] - pose[:3])),
                     float(rotation_angles(run.poses[i, 3:], pose[3:])),
                     SymmetricPositiveDefinite(3).distance(applied, stiffness))


class LimitFigures(NamedTuple):
    """
    How close a run came to the limits of the arm.

    :ivar torque: largest, relative to the limit of its joint
    :ivar torque_rate: largest change between neighbouring states [Nm]
    :ivar joint_distance: smallest distance from a joint limit, negative beyond it [rad]
    :ivar joint_speed: largest [rad/s]
    :ivar speed: largest of the tool [m/s]
    :ivar tank_energy: smallest [J]
    """

    torque: float
    torque_rate: float
    joint_distance: float
    joint_speed: float
    speed: float
    tank_energy: float


def limit_figures(run: Run, joints: JointLimits) -> LimitFigures:
    """Compare a run with the limits of the joints."""
    # The recording may lack states: only those of two ticks in a row are compared.
    neighbours = ((np.diff(run.state_stamps) < STATE_GAP_NS)
                  & (np.diff(run.ticks.astype(np.int64)) == 1))
    rate = np.abs(np.diff(run.torques, axis=0))[neighbours]
    beyond = np.maximum(run.joints - joints.upper, joints.lower - run.joints)
    return LimitFigures(
        float((np.abs(run.torques) / joints.torque).max()), float(rate.max(initial=0.0)),
        float(-beyond.max()), float(np.abs(run.velocities).max()),
        float(np.linalg.norm(run.twists[:, :3], axis=1).max()), float(run.tank.min()))


def lateness(run: Run) -> np.ndarray:
    """Time from the stamp of each reference, its deadline, to its publication [s]."""
    return np.asarray((run.published - run.reference_stamps) * 1e-9)


def newly_followed(run: Run) -> np.ndarray:
    """Indices of the states in which the arm first followed a reference."""
    return np.flatnonzero(np.diff(run.applied.astype(np.int64), prepend=0) != 0)


def reference_gaps(run: Run) -> np.ndarray:
    """Time between two references that were followed [s], and stamp of its end [ns], as rows."""
    first = newly_followed(run)
    return np.column_stack([np.diff(run.state_stamps[first]) * 1e-9, run.state_stamps[first[1:]]])


def longest_wait(run: Run) -> int:
    """
    Largest number of consecutive ticks of the arm without a new reference, after the first.

    In ticks, because a busy machine delays the arm too.
    """
    return int(np.diff(newly_followed(run)).max()) - 1


def final_distance(run: Run) -> float:
    """Distance at the end between the arm and the last reference that it followed [m]."""
    # The recording may end between a state and its reference.
    followed = run.applied[np.isin(run.applied, run.sequences)]
    if not len(followed):
        return float('nan')
    at = np.flatnonzero(run.sequences == followed[-1])
    return float(np.linalg.norm(run.poses[-1, :3] - run.references[at[-1], :3]))


def time_to_rest(run: Run, since_ns: int, speed: float = 2e-3) -> float:
    """Time until the tool stays slower than ``speed`` [m/s]; NaN if it does not [s]."""
    after = run.state_stamps >= since_ns
    moving = np.linalg.norm(run.twists[after, :3], axis=1) > speed
    stamps = run.state_stamps[after]
    if not len(stamps) or moving[-1]:
        return float('nan')
    last = int(np.flatnonzero(moving)[-1]) if moving.any() else 0
    return float((stamps[last] - since_ns) * 1e-9)


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values ** 2)))


def summary(run: Run, tracked: Tracking) -> list[tuple[str, str]]:
    """Rows of a table: what was measured, and its value with unit."""
    late = 1e6 * lateness(run)
    same_clock = np.abs(np.median(late)) < 1e6 * OTHER_CLOCK_S
    seconds = np.ptp(run.reference_stamps) * 1e-9
    speed = np.linalg.norm(run.twists[:, :3], axis=1)
    rows = [
        ('duration', f'{np.ptp(run.state_stamps) * 1e-9:.2f} s'),
        ('references', f'{len(run.sequences)}, {len(run.sequences) / max(seconds, 1e-9):.1f} per '
                       'second'),
        ('references lost', f'{lost(run)}'),
        ('lateness p50, p99, max', ', '.join(f'{value:.0f}' for value in (
            *np.percentile(late, [50, 99]), late.max())) + ' µs' if same_clock else
         'not known: the stamps are of another clock'),
        ('largest speed', f'{speed.max():.3f} m/s'),
        ('smallest energy in the tank', f'{run.tank.min():.2f} J'),
    ]
    if len(tracked.states):
        rows.insert(3, ('tracking error, RMS', f'{1e3 * rms(tracked.position):.2f} mm, '
                                               f'{rms(tracked.rotation):.4f} rad'))
        rows.insert(4, ('tracking error, largest', f'{1e3 * tracked.position.max():.2f} mm, '
                                                   f'{tracked.rotation.max():.4f} rad'))
    return rows


class Event(NamedTuple):
    """
    Something that happened.

    :ivar time: since the first state [s]
    """

    time: float
    text: str


class Limited(NamedTuple):
    """
    A limit that was active.

    :ivar begins: times since the first state at which it became active [s]
    :ivar ends: times at which it no longer was, for longer than a moment [s]
    :ivar seconds: during which it was active, in total
    :ivar largest: by how much what was asked for exceeded the limit, at most
    """

    limit: Limit
    begins: np.ndarray
    ends: np.ndarray
    seconds: float
    largest: float


def events(run: Run) -> list[Event]:
    """What happened: motions, changes of the goal, interruptions."""
    result = [*_motions(run), *_goals(run), *run.steps, *_interruptions(run)]
    origin = run.state_stamps[0]
    return [Event((stamp - origin) * 1e-9, text) for stamp, text in sorted(result)]


def limited_times(run: Run) -> list[Limited]:
    """
    The limits that were active, in the order in which they first were.

    What the reference or the law asked for exceeded them: the arm was commanded less.
    """
    result, tick = [], 1e-9 * float(np.median(np.diff(run.state_stamps)))
    for limit, column in zip(LIMITS, run.limited.T):
        active = np.flatnonzero(column > 0.0)
        if not len(active):
            continue
        parts = np.flatnonzero(np.diff(run.state_stamps[active]) > SAME_EVENT_NS) + 1
        ends = np.array([(run.state_stamps[part[0]], run.state_stamps[part[-1]])
                         for part in np.split(active, parts)])
        begins, ends = (ends.T - run.state_stamps[0]) * 1e-9
        result.append(Limited(limit, begins, ends + tick, tick * len(active), float(column.max())))
    return sorted(result, key=lambda item: float(item.begins[0]))


def _motions(run: Run) -> list[tuple[int, str]]:
    moving = run.moving
    edges = np.flatnonzero(np.diff(moving.astype(int), prepend=0, append=0))
    merged: list[list[int]] = []
    for first, last in zip(edges[::2], edges[1::2]):
        begin = int(run.reference_stamps[first])
        end = int(run.reference_stamps[min(last, len(moving) - 1)])
        if merged and begin - merged[-1][1] < PAUSE_NS:
            merged[-1][1] = end
        else:
            merged.append([begin, end])
    return [event for begin, end in merged for event in (
        (begin, 'the reference begins to move'),
        (end, f'the reference stops, after {(end - begin) * 1e-9:.2f} s'))]


def _interruptions(run: Run) -> list[tuple[int, str]]:
    stamps = run.reference_stamps
    result = [(int(stamps[i]), f'no reference for {(stamps[i + 1] - stamps[i]) * 1e-6:.0f} ms')
              for i in np.flatnonzero(np.diff(stamps) > INTERRUPTION_NS)]
    steps = np.diff(run.sequences.astype(np.int64))
    result += [(int(stamps[i + 1]), 'another stream of references begins')
               for i in np.flatnonzero(np.abs(steps) >= ONE_STREAM)]
    return result


def _goals(run: Run) -> list[tuple[int, str]]:
    stamps, goals = run.goal_stamps, run.goals
    offset = np.linalg.norm(np.diff(goals[:, :3], axis=0), axis=1)
    turned = rotation_angles(goals[1:, 3:], goals[:-1, 3:])
    changed = np.flatnonzero((offset > OTHER_GOAL) | (turned > OTHER_GOAL))
    if not len(changed):
        return []
    parts = np.flatnonzero(np.diff(stamps[changed]) > GOAL_MOVES_NS) + 1
    result = []
    for part in np.split(changed, parts):
        first, last = part[0], part[-1] + 1
        angle = rotation_angles(goals[last:last + 1, 3:], goals[first:first + 1, 3:])[0]
        by = f'{np.linalg.norm(goals[last, :3] - goals[first, :3]):.3f} m, {angle:.2f} rad'
        seconds = (stamps[last] - stamps[first + 1]) * 1e-9
        result.append((int(stamps[first + 1]), f'the goal changes by {by}' if len(part) == 1 else
                       f'the goal moves for {seconds:.1f} s, by {by}'))
    return result


def followed_motion(run: Run) -> FollowedMotion:
    """
    The last motion of a run of the nodes.

    :raises DataError: if the server's state was not recorded, or the arm followed no motion
    """
    moving = np.array([status in _MOVING for status in run.statuses], dtype=bool)
    if not moving.any():
        raise DataError('the run has no motion of a trajectory server: record its topic '
                        '~/state too')
    last = int(np.flatnonzero(moving)[-1])
    rest = np.flatnonzero(~moving[:last])
    first = int(rest[-1]) + 1 if len(rest) else 0
    stamps, progress = run.goal_stamps[first:last + 1], run.progress[first:last + 1]
    result = tracking(run, int(stamps[0]), int(stamps[-1]))
    states, references = result.states[::_EVERY], result.references[::_EVERY]
    # Differences of stamps are exact; stamps as numbers with a decimal point are not.
    at = np.interp(run.state_stamps[states] - stamps[0], stamps - stamps[0], progress)
    return FollowedMotion(at, run.references[references], run.poses[states])


class RecordedReferences(NamedTuple):
    """
    References in the order of their stamps.

    :ivar frame: ``frame_id`` of all of them
    :ivar times: since the first one [s], shape ``(T,)``
    :ivar targets: shape ``(T, TARGET_SIZE)`` (`gdmp_ros.control.target`)
    :ivar modes: `StreamMode` of each
    :ivar steps: by which the sequence number grows at each
    """

    topic: str
    frame: str
    times: np.ndarray
    targets: np.ndarray
    modes: list[StreamMode]
    steps: np.ndarray


def read_references(bag: Path, topic: str = '') -> RecordedReferences:
    """
    Read the references of one stream from a bag.

    :param topic: by default the only topic of this type
    :raises DataError: if there are none, of several topics or publishers, in several frames, or of
        joints
    """
    with opened(bag) as reader:
        known = [name for name, kind, count in topics_in(reader) if kind == REFERENCE and count]
        if topic not in known if topic else len(known) != 1:
            raise DataError(f'{bag}: expected {"references on " + topic if topic else "one topic"}'
                            f' of type {REFERENCE}, the bag has {", ".join(known) or "none"}')
        topic = topic or known[0]
        connections = [c for c in reader.connections if c.topic == topic]
        messages: list[Any] = [message_of(reader, connection, raw)
                               for connection, _, raw in reader.messages(connections)]
    messages.sort(key=lambda m: int(m.sequence))
    frames = sorted({message.header.frame_id for message in messages})
    if len(frames) > 1:
        raise DataError(f'{bag}, topic {topic}: the frames are {", ".join(frames)}, expected one')
    if any(len(message.joints) for message in messages):
        raise DataError(f'{bag}, topic {topic}: references of the joints cannot be replayed')
    stamps = _stamps(messages)
    times = (stamps - stamps[0]) / NS
    pauses = np.diff(times)
    wrong = (pauses < 0.0) | (pauses > LONGEST_PAUSE_S)
    if wrong.any():
        at = int(np.argmax(wrong)) + 1
        raise DataError(f'{bag}, topic {topic}, reference {at}: its stamp is '
                        f'{pauses[at - 1]:.3g} s after that of the one before, expected 0 to '
                        f'{LONGEST_PAUSE_S:g} s: are there several publishers?')
    sequences = [int(m.sequence) for m in messages]
    return RecordedReferences(
        topic, frames[0], times, np.array([reference_target(m) for m in messages]),
        [StreamMode(m.mode) for m in messages],
        np.diff(sequences, prepend=sequences[0] - 1))
