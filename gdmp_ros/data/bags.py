"""
Reading and writing rosbag2 recordings (sqlite3 and MCAP), with or without ROS installed.

ROS 1 bags, single storage files and those of a recorder that was killed are read too.
"""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import shutil
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
import uuid
import warnings

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap, StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from scipy.spatial.transform import Rotation, Slerp

from gdmp_ros import choices
from gdmp_ros.control import target as layout
from gdmp_ros.control.reference_check import QUATERNION_TOLERANCE
from gdmp_ros.data.columns import usable
from gdmp_ros.data.tables import SUFFIXES
from gdmp_ros.errors import DataError, GdmpError, GdmpWarning
from gdmp_ros.manifolds.poses import compose, IDENTITY
from gdmp_ros.util.names import indices_of

POSE = 'geometry_msgs/msg/PoseStamped'
ARRAY = 'std_msgs/msg/Float64MultiArray'
REFERENCE = 'gdmp_msgs/msg/Reference'
JOINTS = 'sensor_msgs/msg/JointState'
WRENCH = 'geometry_msgs/msg/WrenchStamped'
GRIPPER = 'gdmp_msgs/msg/GripperCommand'
#: Its fields, as msg_defs/msg/GripperCommand.msg has them: people without ROS write it too.
GRIPPER_FIELDS = 'std_msgs/Header header\nfloat64 width\nfloat64 force\nfloat64 speed\n'
TRANSFORM, TRANSFORMS = 'geometry_msgs/msg/TransformStamped', 'tf2_msgs/msg/TFMessage'
#: Types that hold a pose; of a path that was recorded the last one counts.
PATH = 'nav_msgs/msg/Path'
POSES = (POSE, REFERENCE, TRANSFORM, PATH, 'nav_msgs/msg/Odometry',
         'geometry_msgs/msg/PoseWithCovarianceStamped', 'geometry_msgs/msg/Pose')
#: Storage files of rosbag2, and the magic bytes of one of them.
STORAGE_SUFFIXES, _MCAP = ('.mcap', '.db3'), b'\x89MCAP0\r\n'
#: Files that are bags, that of ROS 1 among them.
FILES = (*STORAGE_SUFFIXES, '.bag')
NS = 1_000_000_000
#: Largest number of unused bytes at the end of a message: four for each of its sequences.
MOST_UNUSED = 32


def ns_of(stamp: Any) -> int:
    """Nanoseconds of a stamp."""
    return int(stamp.sec * NS + stamp.nanosec)


def pose_numbers(pose: Any) -> list[float]:
    """(x, y, z, qw, qx, qy, qz) of a pose."""
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]


def transform_numbers(transform: Any) -> list[float]:
    """(x, y, z, qw, qx, qy, qz) of a transform."""
    p, q = transform.translation, transform.rotation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]


def vector_numbers(first: Any, second: Any) -> list[float]:
    """Six numbers of two vectors, as of a twist or a wrench."""
    return [first.x, first.y, first.z, second.x, second.y, second.z]


def reference_target(message: Any) -> np.ndarray:
    """The numbers of a reference as a target (`gdmp_ros.control.target`)."""
    target = np.zeros(layout.TARGET_SIZE)
    target[layout.POSE:layout.TWIST] = pose_numbers(message.pose)
    target[layout.TWIST:layout.ACCELERATION] = vector_numbers(
        message.twist.linear, message.twist.angular)
    target[layout.ACCELERATION:layout.STIFFNESS] = vector_numbers(
        message.acceleration.linear, message.acceleration.angular)
    target[layout.STIFFNESS:layout.DAMPING_RATIO] = message.stiffness
    target[layout.DAMPING_RATIO] = message.damping_ratio
    target[layout.WRENCH:layout.WRENCH_GAIN] = vector_numbers(
        message.wrench.force, message.wrench.torque)
    target[layout.WRENCH_GAIN:] = message.wrench_gain
    return target


def joint_target(message: Any) -> np.ndarray:
    """
    The numbers of a reference of the joints (`gdmp_ros.control.joint_target`).

    :raises DataError: if there are not as many velocities and stiffnesses as positions
    """
    joints = message.joints[0]
    parts = joints.position, joints.velocity, joints.stiffness
    counts = [len(part) for part in parts]
    if len(set(counts)) > 1:
        raise DataError('a reference of the joints has {} positions, {} velocities and {} '
                        'stiffnesses, expected as many of each'.format(*counts))
    return np.concatenate([*parts, [message.damping_ratio]])


def joint_positions(message: Any, names: Sequence[str] = ()) -> np.ndarray:
    """
    Positions of a JointState [rad].

    :param names: of the joints that are wanted, in their order; by default all as they come
    :raises DataError: if one is missing or there twice, or a number is not finite
    """
    position = np.array(message.position, float)
    if names:
        chosen = indices_of(names, message.name, 'joint')
        if len(message.position) != len(message.name):
            raise DataError(f'{len(message.position)} positions for {len(message.name)} names of '
                            'joints')
        position = position[chosen]
    if not np.isfinite(position).all():
        raise DataError('a position of a joint is NaN or infinite')
    return position


class Series(NamedTuple):
    """
    One topic of a bag as numbers.

    :ivar stamps: header stamps, or bag times [ns] without them, int64, shape ``(T,)``
    :ivar values: shape ``(T, k)``; a pose is (x, y, z, qw, qx, qy, qz)
    :ivar frame: ``frame_id`` of the first message, empty if the type has none
    :ivar names: of the values, if the messages have names: those of joints
    """

    bag: str
    topic: str
    stamps: np.ndarray
    values: np.ndarray
    frame: str
    names: tuple[str, ...] = ()

    def where(self, sample: int) -> str:
        """Name a sample for a message to the user."""
        seconds = (self.stamps[sample] - self.stamps[0]) / NS
        return f'{self.bag}, topic {self.topic}, sample {sample}, t = {seconds:.3f} s'


_DECODERS: dict[str, Callable[[Any], list[float]]] = {
    POSE: lambda message: pose_numbers(message.pose),
    TRANSFORM: lambda message: transform_numbers(message.transform),
    'nav_msgs/msg/Odometry': lambda message: pose_numbers(message.pose.pose),
    'geometry_msgs/msg/PoseWithCovarianceStamped': lambda message: pose_numbers(
        message.pose.pose),
    'geometry_msgs/msg/Pose': pose_numbers,
    ARRAY: lambda message: list(message.data),
    REFERENCE: lambda message: [*pose_numbers(message.pose), *message.stiffness],
    JOINTS: lambda message: list(message.position),
    WRENCH: lambda message: vector_numbers(message.wrench.force, message.wrench.torque),
}


@contextmanager
def opened(path: str | Path) -> Iterator[AnyReader]:
    """Open a bag; every problem with the file becomes a `DataError` that names it."""
    path = Path(path)
    if not path.exists():
        raise DataError(f'{path}: no such bag')
    if not path.is_dir() and path.suffix not in FILES:
        raise DataError(f'{path}: format not read; use a rosbag2 folder or a file that ends in '
                        f'{", ".join((*FILES, *SUFFIXES))}')
    try:
        with TemporaryDirectory(prefix='gdmp-bag-') as folder, AnyReader(
                _files(path, Path(folder)),
                default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            yield reader
    except GdmpError:
        raise
    except Exception as error:  # rosbags passes on errors of sqlite3, struct, zstd, yaml …
        raise DataError(f'{path}: damaged or not a rosbag2 recording '
                        f'({type(error).__name__}: {error})') from None


def _files(path: Path, folder: Path) -> list[Path]:
    """
    What to open: a bag, or its storage files if it has no description.

    :param folder: for what has to be made
    :raises DataError: if it has neither
    """
    if not path.is_dir():
        return [_complete(path, folder)]
    if (path / 'metadata.yaml').exists():
        if path.suffix != '.bag':
            return [path]
        # The name would make it a bag of ROS 1.
        named = folder / 'bag'
        named.symlink_to(path.absolute())
        return [named]
    files = sorted(item for item in path.iterdir() if item.suffix in STORAGE_SUFFIXES)
    if not files:
        raise DataError(f'{path}: a folder without metadata.yaml: it is no rosbag2 recording')
    warnings.warn(f'{path}: there is no metadata.yaml: its storage files are read', GdmpWarning,
                  stacklevel=5)
    return [_complete(file, folder) for file in files]


def _complete(path: Path, folder: Path) -> Path:
    """The file, or a copy without the incomplete end of an MCAP whose recorder was killed."""
    if path.suffix != '.mcap':
        return path
    with path.open('rb') as file:
        begin = file.read(len(_MCAP))
        file.seek(-min(len(_MCAP), path.stat().st_size), os.SEEK_END)
        if begin != _MCAP or file.read() == _MCAP:
            return path
    data = path.read_bytes()
    at = ends = len(_MCAP)
    while at + 9 <= len(data):
        at += 9 + int.from_bytes(data[at + 1:at + 9], 'little')
        if at <= len(data):
            ends = at
    repaired = folder / path.name
    footer = b'\x02' + (20).to_bytes(8, 'little') + bytes(20)
    repaired.write_bytes(data[:ends] + footer + _MCAP)
    warnings.warn(f'{path}: the recorder was killed: what is complete is read', GdmpWarning,
                  stacklevel=6)
    return repaired


def _definition(schema: Any) -> MessageDefinition:
    """Definition of the messages of a channel; none if it is not one of ROS."""
    try:
        return _definition_of_rosbags(schema)
    except KeyError:
        return MessageDefinition(MessageDefinitionFormat.NONE, '')


# rosbags refuses a whole file because of one channel with JSON in it.
_definition_of_rosbags = storage_mcap.get_msgdef
storage_mcap.get_msgdef = _definition


def message_of(reader: AnyReader, connection: Connection, raw: bytes) -> Any:
    """
    Deserialise a message of an open bag.

    :raises AnyReaderError: if it is damaged
    """
    try:
        return reader.deserialize(raw, connection.msgtype)
    except AnyReaderError as error:
        # Fast DDS reserves space for the alignment of the elements of an empty sequence, does not
        # use it, and sends it at the end: rosbags takes more than three bytes there for damage.
        for unused in range(4, MOST_UNUSED + 1, 4):
            with suppress(AnyReaderError):
                return reader.deserialize(raw[:-unused], connection.msgtype)
        raise error


def topics(path: str | Path) -> list[tuple[str, str, int]]:
    """Topic, type and message count of everything in a bag."""
    with opened(path) as reader:
        return topics_in(reader)


def topics_in(reader: AnyReader) -> list[tuple[str, str, int]]:
    """Topic, type and message count of everything in an open bag."""
    return sorted((c.topic, c.msgtype, c.msgcount) for c in reader.connections)


def series_in(reader: AnyReader, path: str | Path, topic: str, *kinds: str,
              drop_bad: bool = False) -> Series:
    """
    Read a topic of an open bag as numbers.

    :param kinds: message types that are accepted; by default any known type
    :param drop_bad: leave out samples with a NaN, or whose stamps do not increase; it is told
    :raises DataError: on a missing topic, a wrong type, several frames, and on bad samples
    """
    connections = [c for c in reader.connections if c.topic == topic]
    known = ', '.join(sorted(c.topic for c in reader.connections)) or 'none'
    if not connections:
        raise DataError(f'{path}: no topic {topic}; the bag has {known}')
    allowed = kinds or tuple(_DECODERS)
    for connection in connections:
        if connection.msgtype not in allowed:
            raise DataError(f'{path}: topic {topic} is of type {connection.msgtype}, expected '
                            f'{" or ".join(allowed)}')
    return _checked(_decode(reader, connections, str(path), topic), drop_bad)


class _Sample(NamedTuple):
    """A message as numbers; the stamp is 0 without one."""

    stamp: int
    bag_time: int
    row: list[float]
    frame: str
    names: tuple[str, ...]


def _samples(reader: AnyReader, connections: list[Connection]) -> Iterator[_Sample]:
    messages: Iterable[tuple[Connection, int, bytes]] = reader.messages(connections)
    if connections[0].msgtype == PATH:
        messages = deque(messages, maxlen=1)
    for connection, bag_time, raw in messages:
        message = message_of(reader, connection, raw)
        kind = POSE if connection.msgtype == PATH else connection.msgtype
        for item in message.poses if connection.msgtype == PATH else (message,):
            header = getattr(item, 'header', None)
            yield _Sample(0 if header is None else ns_of(header.stamp),
                          bag_time, _DECODERS[kind](item),
                          '' if header is None else header.frame_id,
                          tuple(getattr(item, 'name', ())))


def _decode(reader: AnyReader, connections: list[Connection], bag: str, topic: str) -> Series:
    samples = list(_samples(reader, connections))
    if not samples:
        raise DataError(f'{bag}: topic {topic} has no messages')
    frames = sorted({sample.frame for sample in samples if sample.frame}) or ['']
    if len(frames) > 1:
        raise DataError(f'{bag}, topic {topic}: the frames are {", ".join(map(repr, frames))}, '
                        'expected one: are there several publishers?')
    # An arm and its gripper may publish the same topic.
    names = max(sorted({sample.names for sample in samples}), key=len)
    others = {sample.names for sample in samples if len(sample.names) == len(names)} - {names}
    if others:
        raise DataError(f'{bag}, topic {topic}: the names are {", ".join(names)}, and those of '
                        f'others {", ".join(others.pop())}: are there several publishers?')
    samples = [sample for sample in samples if sample.names == names]
    lengths = [len(sample.row) for sample in samples]
    if len(set(lengths)) > 1:
        at = next(i for i, length in enumerate(lengths) if length != lengths[0])
        raise DataError(f'{bag}, topic {topic}, sample {at}: {lengths[at]} numbers, the samples '
                        f'before have {lengths[0]}')
    # A simulated clock begins at 0.
    stamped = any(sample.stamp for sample in samples)
    return Series(bag, topic, np.array([sample.stamp if stamped else sample.bag_time
                                        for sample in samples], dtype=np.int64),
                  np.array([sample.row for sample in samples], dtype=float), frames[0], names)


def _checked(series: Series, drop_bad: bool) -> Series:
    """
    The series, without samples that are there twice, and without bad ones if they are dropped.

    :raises DataError: naming the first bad one otherwise
    """
    # A publisher may repeat the last state while the robot is silent.
    repeated = np.zeros(len(series.stamps), dtype=bool)
    repeated[1:] = (np.diff(series.stamps) == 0) & (
        series.values[1:] == series.values[:-1]).all(axis=1)
    given, index = series, np.flatnonzero(~repeated)
    series = given._replace(stamps=given.stamps[index], values=given.values[index])
    finite = np.isfinite(series.values).all(axis=1)
    if drop_bad:
        seconds = (series.stamps - series.stamps[0]) / NS
        _, good = usable(seconds, series.values)
        if not good.all():
            warnings.warn(f'{series.bag}, topic {series.topic}: {int((~good).sum())} of '
                          f'{len(good)} samples are left out, the first at t = '
                          f'{seconds[int(np.argmin(good))]:.3f} s', GdmpWarning, stacklevel=4)
        return series._replace(stamps=series.stamps[good], values=series.values[good])
    if not finite.all():
        at = int(index[np.argmin(finite)])
        raise DataError(f'{given.where(at)}: a number is NaN or infinite '
                        f'({int((~finite).sum())} samples are bad: --drop-bad leaves them out)')
    backward = np.diff(series.stamps) <= 0
    if backward.any():
        at = int(np.argmax(backward)) + 1
        raise DataError(f'{given.where(int(index[at]))}: the stamp does not increase: it is '
                        f'{(series.stamps[at - 1] - series.stamps[at]) / NS:.6f} s before the '
                        'previous one (--drop-bad leaves such samples out)')
    return series


class _Edge(NamedTuple):
    """Transforms of a frame: the frame it is given in, and at stamps [ns] the numbers."""

    parent: str
    stamps: list[int]
    rows: list[list[float]]


def transforms_in(reader: AnyReader, path: str | Path, tool: str, base: str,
                  drop_bad: bool = False) -> Series:
    """
    Poses of a frame in another one, from the transforms of an open bag.

    Between them are any number of frames; their transforms are interpolated at the stamps of the
    one that was recorded most often.

    :raises DataError: if the frames are not connected; naming those that there are
    """
    edges: dict[str, _Edge] = {}
    connections = [c for c in reader.connections if c.msgtype == TRANSFORMS]
    for connection, _, raw in reader.messages(connections) if connections else ():
        for item in message_of(reader, connection, raw).transforms:
            stamp = ns_of(item.header.stamp)
            edge = edges.setdefault(item.child_frame_id.lstrip('/'), _Edge(
                item.header.frame_id.lstrip('/'), [], []))
            if not edge.stamps or stamp > edge.stamps[-1]:
                edge.stamps.append(stamp)
                edge.rows.append(transform_numbers(item.transform))
    chain: list[_Edge] = []
    at = tool.lstrip('/')
    while at != base.lstrip('/'):
        if at not in edges or len(chain) > len(edges):
            known = sorted({*edges, *(edge.parent for edge in edges.values())})
            raise DataError(f'{path}: no transforms lead from {tool} to {base}; the frames are '
                            f'{", ".join(known) or "none"}')
        chain.append(edges[at])
        at = edges[at].parent
    stamps = np.array(max((edge.stamps for edge in chain), key=len, default=[0]), dtype=np.int64)
    poses = np.tile(IDENTITY, (len(stamps), 1))
    for edge in chain:
        placed = transforms_at(np.array(edge.stamps, dtype=np.int64), np.array(edge.rows), stamps)
        poses = np.array([compose(outer, inner) for outer, inner in zip(placed, poses)])
    return _checked(Series(str(path), f'/tf, {tool} in {base}', stamps, poses, base), drop_bad)


def transforms_at(known: np.ndarray, rows: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """Transforms at stamps: between those that are known, or the first or last one."""
    if len(known) == 1:
        return np.repeat(rows, len(stamps), axis=0)
    seconds = (known - known[0]) / NS
    at = np.clip((stamps - known[0]) / NS, 0.0, seconds[-1])
    turned = Slerp(seconds, Rotation.from_quat(np.roll(rows[:, 3:], -1, axis=1)))(at)
    return np.column_stack([*(np.interp(at, seconds, column) for column in rows[:, :3].T),
                            np.roll(turned.as_quat(), 1, axis=1)])


def frames_in(reader: AnyReader) -> list[str]:
    """Frames of the transforms of an open bag."""
    result: set[str] = set()
    connections = [c for c in reader.connections if c.msgtype == TRANSFORMS]
    for connection, _, raw in reader.messages(connections) if connections else ():
        for item in message_of(reader, connection, raw).transforms:
            result |= {item.child_frame_id, item.header.frame_id}
    return sorted(result)


def checked_poses(series: Series) -> np.ndarray:
    """Poses (x, y, z, qw, qx, qy, qz), normalised; a quaternion far from unit norm is an error."""
    poses = series.values[:, :7].copy()
    norms = np.linalg.norm(poses[:, 3:], axis=1)
    off = np.abs(norms - 1.0) > QUATERNION_TOLERANCE
    if off.any():
        at = int(np.argmax(np.abs(norms - 1.0)))
        raise DataError(f'{series.where(at)}: quaternion norm is {norms[at]:.6g}, expected 1 '
                        f'within {QUATERNION_TOLERANCE:g} ({int(off.sum())} samples are bad)')
    poses[:, 3:] /= norms[:, None]
    return poses


class BagWriter:
    """
    Write a rosbag2 folder; it gets its name when it is complete.

    Use it as a context manager: after an exception no file is left.
    """

    def __init__(self, path: str | Path, storage: str = 'mcap'):
        """:param storage: ``mcap`` or ``sqlite3``"""
        if storage not in choices.STORAGES:
            raise DataError(f'bag storage is {storage!r}, expected one of '
                            f'{", ".join(choices.STORAGES)}')
        self.path = Path(path)
        if self.path.exists():
            raise DataError(f'{self.path}: exists already; remove it or choose another name')
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._storage = storage
        self._partial = self.path.with_name(f'.{self.path.name}.{uuid.uuid4().hex[:8]}.partial')
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> BagWriter:
        return self.open()

    def __exit__(self, kind: object, value: object, trace: object) -> None:
        self.close(keep=kind is None)

    def open(self) -> BagWriter:
        """Begin to write, without a context manager."""
        self._writer = Writer(self._partial, version=9,
                              storage_plugin=StoragePlugin[self._storage.upper()])
        self._writer.open()
        return self

    def close(self, keep: bool = True) -> None:
        """Give the bag its name, or delete it."""
        try:
            self._writer.close()
            if keep:
                self._name_files()
                os.replace(self._partial, self.path)
        finally:
            shutil.rmtree(self._partial, ignore_errors=True)

    def _name_files(self) -> None:
        """Name the data file after the bag, as ``ros2 bag record`` does."""
        metadata = self._partial / 'metadata.yaml'
        text = metadata.read_text()
        for data in list(self._partial.iterdir()):
            if data.name.startswith(self._partial.name):
                name = data.name.replace(self._partial.name, self.path.name)
                text = text.replace(data.name, name)
                data.rename(self._partial / name)
        metadata.write_text(text)

    def raw(self, topic: str, msgtype: str, stamp_ns: int, data: bytes,
            definition: str | None = None, digest: str | None = None) -> None:
        """
        Write a serialised message.

        :param definition: text of the message definition, for types outside common interfaces
        """
        if topic not in self._connections:
            extra: dict[str, Any] = {'typestore': self._store}
            if definition is not None:
                extra = {'msgdef': definition, 'rihs01': digest}
            self._connections[topic] = self._writer.add_connection(topic, msgtype, **extra)
        self._writer.write(self._connections[topic], stamp_ns, data)

    def pose(self, topic: str, stamp_ns: int, pose: Sequence[float], frame: str,
             bag_ns: int | None = None) -> None:
        """
        Write a PoseStamped from (x, y, z, qw, qx, qy, qz).

        :param bag_ns: time of arrival; by default its stamp
        """
        x, y, z, qw, qx, qy, qz = (float(v) for v in pose)
        types = self._store.types
        message = types[POSE](
            header=self._header(stamp_ns, frame),
            pose=types['geometry_msgs/msg/Pose'](
                position=types['geometry_msgs/msg/Point'](x=x, y=y, z=z),
                orientation=types['geometry_msgs/msg/Quaternion'](x=qx, y=qy, z=qz, w=qw)))
        self.raw(topic, POSE, stamp_ns if bag_ns is None else bag_ns,
                 bytes(self._store.serialize_cdr(message, POSE)))

    def matrix(self, topic: str, stamp_ns: int, matrix: np.ndarray) -> None:
        """Write a square matrix as a Float64MultiArray, row-major, with labelled dimensions."""
        m, types = len(matrix), self._store.types
        dimension = types['std_msgs/msg/MultiArrayDimension']
        layout = types['std_msgs/msg/MultiArrayLayout'](
            dim=[dimension(label='rows', size=m, stride=m * m),
                 dimension(label='columns', size=m, stride=m)], data_offset=0)
        message = types[ARRAY](layout=layout, data=np.ascontiguousarray(matrix).reshape(-1))
        self.raw(topic, ARRAY, stamp_ns, bytes(self._store.serialize_cdr(message, ARRAY)))

    def joints(self, topic: str, stamp_ns: int, names: Sequence[str], position: Sequence[float],
               frame: str = '') -> None:
        """Write a JointState with positions [rad]."""
        empty = np.empty(0)
        message = self._store.types[JOINTS](
            header=self._header(stamp_ns, frame), name=list(names),
            position=np.asarray(position, dtype=float), velocity=empty, effort=empty)
        self.raw(topic, JOINTS, stamp_ns, bytes(self._store.serialize_cdr(message, JOINTS)))

    def wrench(self, topic: str, stamp_ns: int, wrench: Sequence[float], frame: str) -> None:
        """Write a WrenchStamped from (fx, fy, fz, tx, ty, tz) [N, Nm]."""
        types, numbers = self._store.types, [float(v) for v in wrench]
        vector = types['geometry_msgs/msg/Vector3']
        message = types[WRENCH](
            header=self._header(stamp_ns, frame),
            wrench=types['geometry_msgs/msg/Wrench'](force=vector(*numbers[:3]),
                                                     torque=vector(*numbers[3:])))
        self.raw(topic, WRENCH, stamp_ns, bytes(self._store.serialize_cdr(message, WRENCH)))

    def gripper(self, topic: str, stamp_ns: int, width: float, force: float, speed: float
                ) -> None:
        """Write a command for a gripper [m, N, m/s]."""
        if GRIPPER not in self._store.types:
            self._store.register(get_types_from_msg(GRIPPER_FIELDS, GRIPPER))
        message = self._store.types[GRIPPER](header=self._header(stamp_ns, ''), width=width,
                                             force=force, speed=speed)
        text, _ = self._store.generate_msgdef(GRIPPER, ros_version=2)
        self.raw(topic, GRIPPER, stamp_ns, bytes(self._store.serialize_cdr(message, GRIPPER)),
                 text, self._store.hash_rihs01(GRIPPER))

    def _header(self, stamp_ns: int, frame: str) -> Any:
        types = self._store.types
        stamp = types['builtin_interfaces/msg/Time'](sec=int(stamp_ns // NS),
                                                     nanosec=int(stamp_ns % NS))
        return types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)
