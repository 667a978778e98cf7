"""Demonstrations of pose and stiffness in bags: reading and writing."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
import shutil
from typing import NamedTuple
import warnings

import numpy as np
from rosbags.highlevel import AnyReader

from gdmp_ros.control.gripper import DEFAULT_SPEED, GripperCommand
from gdmp_ros.data import bags, episodes
from gdmp_ros.data.arm_joints import (
    ArmJoints,
    columns_of,
    finger_commands,
    FingerCommand,
    opening,
    radians,
)
from gdmp_ros.data.bags import GRIPPER, message_of, NS, ns_of
from gdmp_ros.data.columns import Import
from gdmp_ros.data.foreign import Imported
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.errors import DataError, GdmpError, GdmpWarning, InvalidPointError
from gdmp_ros.learning.alignment import align
from gdmp_ros.learning.stiffness import stiffness_of_each
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Rest at the ends of a demonstration is cut off if it is longer than this [s]. At rest every
#: factor stays within its goal tolerance.
REST_S = 0.1
#: Rest longer than this is cut off with a note [s].
TOLD_S = 1.0
#: Commands that are this close after one another in time and equal are one [s].
REPEATED_S = 0.1
POSE_TOPIC, STIFFNESS_TOPIC = '/demonstration/pose', '/demonstration/stiffness'
JOINTS_TOPIC, GRIPPER_TOPIC = '/demonstration/joint_states', '/demonstration/gripper'
#: ``frame_id`` of poses without one.
FRAME = 'panda_link0'
#: Stamp of the first sample of recordings that have no stamps of their own [ns].
EPOCH_NS = 1_700_000_000 * bags.NS
#: Relative tolerance for the coupling of a 6×6 matrix, and for changes of its rotational block.
UNCOUPLED = 1e-6


def without_rest(demonstration: Demonstration, where: str) -> slice:
    """The samples without rest longer than `REST_S` at either end, but for one sample of it."""
    times, points = demonstration.times, demonstration.flat_points
    first = _resting(demonstration.manifold, times, points)
    last = len(times) - 1 - _resting(demonstration.manifold, -times[::-1], points[::-1])
    if last - first < 2:
        raise DataError(f'{where}: nothing moves: every sample is within the goal '
                        'tolerance of the first')
    before, after = times[first] - times[0], times[-1] - times[last]
    if before + after > TOLD_S:
        warnings.warn(f'{where}: rest is cut off: {before:.1f} s before the motion, {after:.1f} s '
                      'after it', GdmpWarning, stacklevel=3)
    return slice(first, last + 1)


def _part(full: Demonstration, kept: slice) -> Demonstration:
    """These samples, with times from 0 on."""
    times = full.times[kept]
    return Demonstration(times - times[0], full.points[kept], full.manifold)


def _resting(manifold: Manifold, times: np.ndarray, points: np.ndarray) -> int:
    """Index of the last sample of the rest at the beginning; 0 without rest."""
    tolerances = [factor.goal_tolerance for factor in manifold.factors]
    origin = np.broadcast_to(points[0], points.shape)
    moved = (manifold.factor_distances(origin, points) > tolerances).any(axis=1)
    last = int(np.argmax(moved)) - 1 if moved.any() else len(points) - 1
    return last if times[last] - times[0] > REST_S else 0


class RecordedCommand(NamedTuple):
    """
    A command that was recorded.

    :ivar stamp: [ns]
    :ivar width: [m]
    :ivar force: [N]
    :ivar speed: [m/s]
    """

    stamp: int
    width: float
    force: float
    speed: float


def commands_in(reader: AnyReader, bag: str) -> list[RecordedCommand]:
    """
    Commands for a gripper in an open bag.

    :raises DataError: if there are several topics with such commands
    """
    connections = [c for c in reader.connections if c.msgtype == GRIPPER]
    topics = sorted({c.topic for c in connections})
    if len(topics) > 1:
        raise DataError(f'{bag}: there are commands for several grippers: {", ".join(topics)}')
    result: list[RecordedCommand] = []
    for connection, bag_time, raw in reader.messages(connections) if connections else ():
        message = message_of(reader, connection, raw)
        stamp = ns_of(message.header.stamp) or bag_time
        command = RecordedCommand(stamp, float(message.width), float(message.force),
                                  float(message.speed) or DEFAULT_SPEED)
        if result and result[-1][1:] == command[1:] and (
                command.stamp - result[-1].stamp < REPEATED_S * NS):
            continue
        result.append(command)
    return result


def during(commands: Sequence[RecordedCommand], first: int, last: int) -> tuple[GripperEvent, ...]:
    """
    The commands as events of the demonstration between two stamps [ns].

    Those before it count at its beginning (of several the last one), those after it at its end.
    """
    result: list[GripperEvent] = []
    for command in commands:
        progress = float(np.clip((command.stamp - first) / (last - first), 0.0, 1.0))
        if progress == 0.0 and result:
            result.clear()
        result.append(GripperEvent(progress, command.width, command.force, command.speed))
    return tuple(result)


def common_events(takes: Sequence[Demonstration], names: Sequence[str],
                  events: Sequence[tuple[GripperEvent, ...]]) -> tuple[GripperEvent, ...]:
    """
    Events of several takes, at their usual progress after the alignment of the takes in time.

    :param names: of the takes, for messages
    :param events: of each take
    :raises DataError: if the takes do not have the same commands in the same order
    """
    kinds = [[event.force > 0.0 for event in item] for item in events]
    for name, kind in zip(names, kinds):
        if kind != kinds[0]:
            raise DataError(f'{name}: the gripper was told {_words(kind)}, in {names[0]} '
                            f'{_words(kinds[0])}: a skill needs the same commands in all takes')
    if not kinds[0]:
        return ()
    result = align(takes)
    places = np.array([[np.interp(event.progress, warp, result.progress) for event in item]
                       for item, warp in zip(events, result.warps)])
    numbers = np.median(np.array([[event[1:] for event in item] for item in events]), axis=0)
    usual = np.maximum.accumulate(np.median(places, axis=0))
    return tuple(GripperEvent(float(progress), *map(float, row))
                 for progress, row in zip(usual, numbers))


def _words(kind: Sequence[bool]) -> str:
    return ', '.join('to hold' if holds else 'to move' for holds in kind) or 'nothing'


@dataclass(frozen=True)
class Recording:
    """
    A demonstration read from a bag.

    :ivar frame: ``frame_id`` of the poses
    :ivar rotational_stiffness: constant 3×3 block recorded with an SPD(3) profile [Nm/rad]; None
        if the bag has none
    :ivar wrench: that the tool exerted, in the frame of the poses, shape ``(T, 6)`` [N, Nm]; None
        if none was read
    :ivar events: commands for a gripper
    :ivar joints: names of the joints, of a demonstration of the joints (`read_joints`)
    :ivar joint_unit: of their recorded numbers [rad]
    :ivar begins: stamp of the first sample [ns]; in files of other programs since the first one
        that was read
    """

    demonstration: Demonstration
    bag: str
    frame: str
    rotational_stiffness: np.ndarray | None
    wrench: np.ndarray | None = None
    joints: tuple[str, ...] = ()
    joint_unit: float = 1.0
    events: tuple[GripperEvent, ...] = ()
    begins: int = 0


def with_stiffness(recordings: Sequence[Recording], source: str = 'auto', k_min: float = 200.0,
                   k_max: float = 800.0) -> tuple[list[Demonstration], str]:
    """
    Demonstrations with the stiffness from a source, and the name of the source.

    :param source: one of `gdmp_ros.choices.STIFFNESSES`: ``recorded``; ``variance``: high where
        the takes agree, low where they vary; ``none``; ``auto``: the first of these that is
        possible
    :param k_min: smallest eigenvalue of a stiffness from variance [N/m]
    :param k_max: largest eigenvalue
    :raises DataError: if these takes do not have this source
    """
    stiff = [len(recording.demonstration.points[0]) > 7 for recording in recordings]
    if source == 'auto':
        source = 'recorded' if any(stiff) else 'variance' if len(recordings) > 1 else 'none'
    if source == 'recorded':
        if not all(stiff):
            raise DataError(f'{recordings[stiff.index(False)].bag}: no stiffness was recorded; '
                            'choose variance or none')
        return [recording.demonstration for recording in recordings], source
    poses = [Demonstration(recording.demonstration.times, recording.demonstration.points[:, :7],
                           tool_manifold(None)) for recording in recordings]
    if source == 'none':
        return poses, source
    if len(recordings) < 2:
        raise DataError(f'{recordings[0].bag}: stiffness from variance needs two takes or more')
    profiles = stiffness_of_each(poses, k_min, k_max)
    return [Demonstration(pose.times, np.hstack([pose.points, k.reshape(-1, 9)]), tool_manifold(3))
            for pose, k in zip(poses, profiles)], source


def with_wrench(recordings: Sequence[Recording], demonstrations: Sequence[Demonstration]
                ) -> list[Demonstration]:
    """The same demonstrations with the wrenches of their recordings, if these have some."""
    return [same if recording.wrench is None else Demonstration(
        same.times, np.hstack([same.flat_points, recording.wrench]),
        tool_manifold(same.manifold.factors[2].size if len(same.manifold.factors) > 2 else None,
                      wrench=True))
            for recording, same in zip(recordings, demonstrations)]


def read(bag: str | Path, pose_topic: str = '', stiffness_topic: str = '',
         wrench_topic: str = '', settings: Import | None = None, *, keep_rest: bool = False
         ) -> Recording:
    """
    Read pose and stiffness, if the bag has one; rest at both ends is cut off.

    Files of other programs are read too (`gdmp_ros.data.episodes`), with a `GdmpWarning` that says
    what was guessed.

    :param pose_topic: of one of `bags.POSES`; by default the only one of type PoseStamped or
        gdmp_msgs/Reference, otherwise the only one with poses
    :param stiffness_topic: of type Float64MultiArray (9 or 36 numbers, row-major); by default the
        only such topic. A Reference contains its stiffness
    :param wrench_topic: of type WrenchStamped, as a sensor measures it: of the world on the tool,
        in the frame of the poses; empty: none is read
    :param settings: what is said about a file of another program, and about bad samples
    :param keep_rest: keep the rest at both ends of a bag
    :raises DataError: naming bag, topic, sample and reason
    """
    if episodes.is_foreign(Path(bag)):
        return _trimmed(bag, episodes.read(Path(bag), settings))
    settings = settings or Import()
    with bags.opened(bag) as reader:
        result = bags.topics_in(reader)
        fingers: list[RecordedCommand] = []
        joints = settings.joints
        if joints is not None and joints.if_needed and (
                pose_topic or any(kind in bags.POSES for _, kind, _ in result)):
            joints = None
        poses = (_poses_in(reader, bag, pose_topic, settings) if joints is None else
                 _poses_of_joints(reader, bag, settings, joints, fingers))
        matrices, block = None, None
        if poses.values.shape[1] > 7:
            matrices, block = _matrices(poses, poses.values[:, 7:])
        elif stiffness_topic or any(kind == bags.ARRAY for _, kind, _ in result):
            stiffness_topic = stiffness_topic or _only(bag, result, 'stiffness', bags.ARRAY)
            series = bags.series_in(reader, bag, stiffness_topic, bags.ARRAY)
            matrices, block = _matrices(series, series.values)
            matrices = _at_stamps(matrices, series, poses)
        felt = bags.series_in(reader, bag, wrench_topic, bags.WRENCH) if wrench_topic else None
        commands = commands_in(reader, str(bag)) or fingers
    full = _joined(poses, matrices)
    kept = slice(None) if keep_rest else without_rest(full, f'{poses.bag}, topic {poses.topic}')
    demonstration = _part(full, kept)
    wrench = None if felt is None else -_wrench_at(felt, poses, poses.stamps[kept])
    stamps = poses.stamps[kept]
    return Recording(demonstration, str(bag), poses.frame, block, wrench,
                     events=during(commands, stamps[0], stamps[-1]), begins=int(stamps[0]))


def read_joints(bag: str | Path, topic: str = '', settings: Import | None = None) -> Recording:
    """
    Read positions of joints; rest at both ends is cut off.

    :param topic: of type JointState; by default the only such topic. In files of other programs
        the beginning of the names of the joints, such as ``action``
    :param settings: as for `read`
    :raises DataError: naming bag, topic, sample and reason
    """
    if episodes.is_foreign(Path(bag)):
        return _trimmed(bag, episodes.read_joints(Path(bag), settings, topic))
    settings = settings or Import()
    with bags.opened(bag) as reader:
        topic = topic or _only(bag, bags.topics_in(reader), 'joint state', bags.JOINTS)
        series = bags.series_in(reader, bag, topic, bags.JOINTS, drop_bad=settings.drop_bad)
        commands = commands_in(reader, str(bag))
    if series.values.shape[1] == 0 or len(series.names) != series.values.shape[1]:
        raise DataError(f'{bag}: topic {topic} has {series.values.shape[1]} positions for '
                        f'{len(series.names)} names of joints')
    manifold = Product(Euclidean(series.values.shape[1]), names=('joints',))
    where = f'{series.bag}, topic {series.topic}'
    try:
        full = Demonstration((series.stamps - series.stamps[0]) / bags.NS,
                             np.unwrap(series.values, axis=0), manifold)
    except GdmpError as error:
        raise DataError(f'{where}: {error}') from None
    largest = np.abs(np.diff(series.values, axis=0)).max(axis=0, initial=0.0)
    wrapped = ', '.join(np.array(series.names)[largest > np.pi])
    if wrapped:
        warnings.warn(f'{where}: {wrapped} pass from pi to -pi: read as continuous', GdmpWarning,
                      stacklevel=2)
    kept = without_rest(full, where)
    return Recording(_part(full, kept), str(bag),
                     series.frame, None, joints=series.names,
                     events=during(commands, series.stamps[kept][0], series.stamps[kept][-1]))


def write(bag: str | Path, demonstration: Demonstration, frame: str, start_ns: int,
          storage: str = 'mcap', joints: tuple[Sequence[str], np.ndarray] | None = None,
          commands: Sequence[tuple[float, GripperCommand]] = ()) -> None:
    """
    Write a demonstration on R³ × S³ (× SPD) as PoseStamped and Float64MultiArray.

    :param frame: ``frame_id`` of the poses
    :param start_ns: stamp of the first sample [ns]
    :param joints: names, and positions at each sample [rad]; written as JointState
    :param commands: for a gripper, with the times of the demonstration at which they were given
        [s]; written as gdmp_msgs/GripperCommand
    """
    manifold = demonstration.manifold
    if not isinstance(manifold, Product) or manifold.names[:2] != ('position', 'orientation'):
        raise DataError(f'{bag}: only poses with stiffness can be written, got {manifold!r}')
    with bags.BagWriter(bag, storage) as writer:
        for time, point in zip(demonstration.times, demonstration.points):
            stamp = start_ns + round((time - demonstration.times[0]) * bags.NS)
            position, orientation, *stiffness = manifold.split(point)
            writer.pose(POSE_TOPIC, stamp, [*position, *orientation], frame)
            if stiffness:
                writer.matrix(STIFFNESS_TOPIC, stamp, stiffness[0])
        if joints is not None:
            for time, position in zip(demonstration.times, joints[1]):
                writer.joints(JOINTS_TOPIC, start_ns + round(
                    (time - demonstration.times[0]) * bags.NS), joints[0], position)
        for time, command in commands:
            writer.gripper(GRIPPER_TOPIC, start_ns + round(
                (time - demonstration.times[0]) * bags.NS), *command)


def _poses_in(reader: AnyReader, bag: str | Path, topic: str, settings: Import) -> bags.Series:
    """
    The poses of an open bag.

    :raises DataError: if it is not clear which; naming what there is
    """
    if settings.tf_frames is not None:
        return bags.transforms_in(reader, bag, *settings.tf_frames, settings.drop_bad)
    known = bags.topics_in(reader)
    usual = [name for name, kind, _ in known if kind in (bags.POSE, bags.REFERENCE)]
    if not topic and not usual and not any(kind in bags.POSES for _, kind, _ in known):
        frames = bags.frames_in(reader)
        hints = [f'there are transforms: --tf-frame TOOL BASE with two of {", ".join(frames)}'
                 ] if frames else []
        if any(kind == bags.JOINTS for _, kind, _ in known):
            hints.append('there are positions of joints: learn a skill of them with --joints, or '
                         'of the tool with --urdf FILE --tip LINK')
        if hints:
            raise DataError(f'{bag}: no topic holds a pose; {"; ".join(hints)}')
    topic = topic or _only(bag, known, 'pose', *(
        (bags.POSE, bags.REFERENCE) if usual else bags.POSES))
    return bags.series_in(reader, bag, topic, *bags.POSES, drop_bad=settings.drop_bad)


def _poses_of_joints(reader: AnyReader, bag: str | Path, settings: Import, joints: ArmJoints,
                     fingers: list[RecordedCommand]) -> bags.Series:
    """
    Poses of the tool at the recorded joints of an arm; what fingers have done is appended.

    :raises DataError: if no topic, or several, have the joints of the arm
    """
    found: dict[str, tuple[bags.Series, list[int], list[int]]] = {}
    problems = []
    for topic in [name for name, kind, _ in bags.topics_in(reader) if kind == bags.JOINTS]:
        series = bags.series_in(reader, bag, topic, bags.JOINTS, drop_bad=settings.drop_bad)
        try:
            found[topic] = series, *columns_of(joints.arm, series.names)
        except DataError as error:
            problems.append(f'{topic}: {error}')
    if len(found) != 1:
        several = f'{", ".join(found)} have the joints of the arm, expected one topic'
        raise DataError(f'{bag}: ' + (several if found else '; '.join(problems)
                                      or 'there are no positions of joints'))
    (topic, (series, at, ends)), = found.items()
    where = f'{bag}, topic {topic}'
    positions, unit = radians(where, joints, series.values[:, at], settings.angle_unit, False)
    said = [] if unit == 'rad' else [f'the joints are in {unit}']
    left = [name for i, name in enumerate(series.names) if i not in {*at, *ends}]
    if left:
        said.append(f'{", ".join(left)} are not joints of the arm: left out')
    if ends:
        said.append(f'{", ".join(series.names[i] for i in ends)} belong to a gripper')
        width = opening(series.values[:, ends])
        if width is not None:
            times = (series.stamps - series.stamps[0]) / bags.NS
            fingers += _recorded(finger_commands(times, width), int(series.stamps[0]))
    if said:
        warnings.warn(f'{where}: {"; ".join(said)}', GdmpWarning, stacklevel=3)
    return series._replace(values=joints.arm.poses(positions), frame=joints.arm.base, names=())


def _only(bag: str | Path, result: Sequence[tuple[str, str, int]], what: str, *types: str) -> str:
    names = [topic for topic, kind, _ in result if kind in types]
    if len(names) == 1:
        return names[0]
    have = ', '.join(f'{topic} ({kind})' for topic, kind, _ in result) or 'nothing'
    reason = f'several topics hold a {what}' if names else f'no topic holds a {what}'
    raise DataError(f'{bag}: {reason}, name one of type {" or ".join(types)}; the bag has {have}')


def _matrices(series: bags.Series, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Stiffness matrices; 6×6 ones become 3×3 if uncoupled with a constant rotational block."""
    size = {9: 3, 36: 6}.get(rows.shape[1])
    if size is None:
        raise DataError(f'{series.bag}: topic {series.topic} has {rows.shape[1]} numbers a '
                        'sample, expected 9 (3×3) or 36 (6×6) for a stiffness')
    matrices = rows.reshape(-1, size, size)
    manifold = SymmetricPositiveDefinite(size)
    try:
        manifold.check_points(matrices)
    except InvalidPointError as error:
        raise DataError(f'{series.where(error.index)}: stiffness is not symmetric positive '
                        f'definite: {error}') from None
    matrices = 0.5 * (matrices + matrices.transpose(0, 2, 1))
    if size == 3:
        return matrices, None
    coupling = np.abs(matrices[:, :3, 3:]).max() / np.abs(matrices).max()
    block = matrices[0, 3:, 3:]
    if coupling <= UNCOUPLED and np.allclose(matrices[:, 3:, 3:], block, rtol=UNCOUPLED):
        return np.ascontiguousarray(matrices[:, :3, :3]), block.copy()
    return matrices, None


def _at_stamps(matrices: np.ndarray, series: bags.Series, poses: bags.Series) -> np.ndarray:
    """Stiffness at the poses' stamps: along geodesics between the recorded matrices."""
    manifold = SymmetricPositiveDefinite(matrices.shape[1])
    if len(series.stamps) == len(poses.stamps) and np.array_equal(series.stamps, poses.stamps):
        return matrices
    _check_overlap(series, poses)
    index = np.clip(np.searchsorted(series.stamps, poses.stamps, side='right') - 1, 0,
                    max(len(series.stamps) - 2, 0))
    if len(series.stamps) == 1:
        return np.repeat(matrices, len(poses.stamps), axis=0)
    spacing = np.diff(series.stamps)[index]
    share = np.clip((poses.stamps - series.stamps[index]) / spacing, 0.0, 1.0)
    return np.array([manifold.geodesic(matrices[i], matrices[i + 1], t)
                     for i, t in zip(index, share)])


def _check_overlap(series: bags.Series, poses: bags.Series) -> None:
    overlap = min(series.stamps[-1], poses.stamps[-1]) - max(series.stamps[0], poses.stamps[0])
    if overlap < 0.5 * (poses.stamps[-1] - poses.stamps[0]):
        raise DataError(f'{series.bag}: topics {series.topic} and {poses.topic} overlap for '
                        f'{overlap / bags.NS:.3f} s of {np.ptp(poses.stamps) / bags.NS:.3f} s: '
                        'check the clocks')


def _wrench_at(felt: bags.Series, poses: bags.Series, stamps: np.ndarray) -> np.ndarray:
    """Wrench at stamps, linear between the samples."""
    _check_overlap(felt, poses)
    if felt.frame != poses.frame:
        raise DataError(f'{felt.bag}: the wrench of {felt.topic} is in frame {felt.frame!r}, '
                        f'expected {poses.frame!r} as the poses: transform it')
    # Differences are exact; stamps as numbers with a decimal point are not.
    first = felt.stamps[0]
    return np.column_stack([np.interp(stamps - first, felt.stamps - first, column)
                            for column in felt.values.T])


def _trimmed(source: str | Path, result: Imported) -> Recording:
    """The demonstration of another program without rest; how it was read is told."""
    if result.notes:
        warnings.warn(f'{source}: {"; ".join(result.notes)}', GdmpWarning, stacklevel=4)
    full = result.demonstration
    kept = without_rest(full, str(source))
    first, last = (round(full.times[kept][i] * bags.NS) for i in (0, -1))
    return Recording(_part(full, kept), str(source), FRAME, None, joints=result.joints,
                     joint_unit=result.joint_unit, begins=first,
                     events=during(_recorded(result.fingers, 0), first, last))


def _recorded(commands: Sequence[FingerCommand], first: int) -> list[RecordedCommand]:
    """Commands of fingers, with stamps [ns]."""
    return [RecordedCommand(first + round(one.time * bags.NS), *one[1:]) for one in commands]


def _joined(poses: bags.Series, matrices: np.ndarray | None) -> Demonstration:
    columns = [bags.checked_poses(poses)]
    if matrices is not None:
        columns.append(matrices.reshape(len(matrices), -1))
    manifold = tool_manifold(None if matrices is None else matrices.shape[1])
    times = (poses.stamps - poses.stamps[0]) / bags.NS
    try:
        return Demonstration(times, np.hstack(columns), manifold)
    except GdmpError as error:
        raise DataError(f'{poses.bag}, topic {poses.topic}: {error}') from None


def overwrite(bag: Path, demonstration: Demonstration, frame: str, start_ns: int,
              storage: str = 'mcap') -> None:
    """`write`, but replace a bag of this name as soon as the new one is complete."""
    if not bag.exists():
        write(bag, demonstration, frame, start_ns, storage)
        return
    if not (bag / 'metadata.yaml').exists():
        raise DataError(f'{bag}: exists and is not a rosbag2 folder; it is not overwritten')
    fresh = bag.with_name(f'{bag.name}.new')
    shutil.rmtree(fresh, ignore_errors=True)
    write(fresh, demonstration, frame, start_ns, storage)
    shutil.rmtree(bag)
    fresh.rename(bag)
