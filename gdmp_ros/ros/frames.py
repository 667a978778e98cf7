"""Poses in the frame of the robot's base, by what /tf and /tf_static tell."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import threading
from typing import Any, NamedTuple, Protocol

from geometry_msgs.msg import TransformStamped
import numpy as np
from rclpy.time import Time
from tf2_msgs.msg import TFMessage

from gdmp_ros.data.bags import ns_of
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.poses import compose, IDENTITY, inverse, turned
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import checked_numbers, stamped_transform, transform_numbers
from gdmp_ros.ros.middleware import deserialized

NS = 1_000_000_000
#: How long transforms are remembered [s].
MEMORY_S = 10.0
#: What is told once waits this long for the transform of its frame [s].
PATIENCE_S = 0.5
#: Most errors of failed waits that are remembered.
MOST_IN_VAIN = 20
#: Frames in a chain, to find loops.
LONGEST_CHAIN = 1000
_SPHERE = UnitQuaternion()
#: Messages on /tf that are kept: ten seconds of an arm.
DEPTH = 1000
#: Messages that are read at once where time matters; one takes 0.1 ms.
AT_ONCE = 30
_AUTHORITY = 'gdmp_ros'


class FrameError(GdmpError):
    """It is not known where a frame is, at that time or at all."""


class Waiting:
    """
    What is told once, and waits for its frame; in its order.

    What was waited for in vain is not waited for again: the others would come late.
    """

    def __init__(self, now: Callable[[], float], refuse: Callable[[str], None]):
        """
        Begin empty.

        :param now: gives the time [s]
        :param refuse: called with the reason for what is not taken
        """
        self._now, self._refuse = now, refuse
        self._rows = deque[tuple[Callable[[float], None], float]]()
        self._in_vain = deque[str](maxlen=MOST_IN_VAIN)

    def add(self, take: Callable[[float], None]) -> None:
        """
        Take something now, or when its frame is known.

        :param take: called with the time at which it came [s]; raises a `FrameError` before its
            frame is known, and another `GdmpError` to refuse it
        """
        self._rows.append((take, self._now()))
        self.look()

    def look(self) -> None:
        """Take what can be taken."""
        while self._rows:
            take, came = self._rows[0]
            try:
                take(came)
            except GdmpError as error:
                reason = str(error)
                if isinstance(error, FrameError) and reason not in self._in_vain:
                    if self._now() < came + PATIENCE_S:
                        return
                    self._in_vain.append(reason)
                self._refuse(reason)
            self._rows.popleft()


class Transform(NamedTuple):
    """
    Where a frame is in its parent.

    :ivar pose: of the child in the parent (x, y, z, qw, qx, qy, qz)
    :ivar stamp_ns: time
    """

    parent: str
    child: str
    pose: np.ndarray
    stamp_ns: int


class Frames(Protocol):
    """Where frames are; `FrameTree`, or tf2 where the system has it."""

    def add(self, transform: Transform, fixed: bool) -> None:
        """Remember a transform."""

    def pose_of(self, frame: str, base: str, stamp_ns: int) -> np.ndarray:
        """
        Pose of a frame in another one.

        :param stamp_ns: time; 0: the latest at which it is known
        :raises FrameError: if it is not known
        """

    def newest(self, frame: str, base: str) -> tuple[np.ndarray, int]:
        """
        Newest pose of a frame in another one, and the latest time at which it is known [ns].

        :returns: with the time 0 if all transforms between them are fixed
        :raises FrameError: if it is not known
        """


class FrameTree:
    """Transforms of the last `MEMORY_S`, interpolated in between; any thread may use it."""

    def __init__(self) -> None:
        self._fixed: dict[str, Transform] = {}
        self._moving: dict[str, deque[Transform]] = {}

    def add(self, transform: Transform, fixed: bool) -> None:
        """Remember a transform; one that goes back in time begins anew."""
        child = transform.child
        if fixed:
            self._moving.pop(child, None)
            self._fixed[child] = transform
            return
        self._fixed.pop(child, None)
        past = self._moving.setdefault(child, deque())
        if past and (past[-1].parent != transform.parent
                     or transform.stamp_ns < past[-1].stamp_ns):
            past.clear()
        past.append(transform)
        while transform.stamp_ns - past[0].stamp_ns > MEMORY_S * NS:
            past.popleft()

    def pose_of(self, frame: str, base: str, stamp_ns: int) -> np.ndarray:
        """Pose of a frame in another one; see `Frames`."""
        if not stamp_ns:
            return self.newest(frame, base)[0]
        up, down = self._ways(frame, base)
        return self._between(up, down, stamp_ns)

    def newest(self, frame: str, base: str) -> tuple[np.ndarray, int]:
        """Newest pose of a frame in another one; see `Frames`."""
        up, down = self._ways(frame, base)
        at = min((self._moving[name][-1].stamp_ns for name in (*up, *down)
                  if name in self._moving), default=0)
        return self._between(up, down, at), at

    def _between(self, up: list[str], down: list[str], stamp_ns: int) -> np.ndarray:
        return compose(inverse(self._along(down, stamp_ns)), self._along(up, stamp_ns))

    def _ways(self, frame: str, base: str) -> tuple[list[str], list[str]]:
        """Frames whose transforms lead from a frame, and from the base, to a common parent."""
        up, down = self._chain(frame), self._chain(base)
        common = next((name for name in up if name in down), None)
        if common is None:
            known = ', '.join(sorted({*self._fixed, *self._moving})) or 'none'
            raise FrameError(f'frame {frame!r} is not connected to {base!r}; known frames: '
                             f'{known}')
        return up[:up.index(common)], down[:down.index(common)]

    def _chain(self, frame: str) -> list[str]:
        """A frame, its parent and so on."""
        chain = [frame]
        while (link := self._newest(chain[-1])) is not None:
            chain.append(link.parent)
            if len(chain) > LONGEST_CHAIN:
                raise FrameError(f'frame {frame!r}: its parents form a loop')
        return chain

    def _newest(self, child: str) -> Transform | None:
        moving = self._moving.get(child)
        return moving[-1] if moving else self._fixed.get(child)

    def _along(self, chain: list[str], stamp_ns: int) -> np.ndarray:
        """Pose of the first frame of a chain in the parent of its last one."""
        pose = IDENTITY
        for name in chain:
            pose = compose(self._at(name, stamp_ns), pose)
        return pose

    def _at(self, child: str, stamp_ns: int) -> np.ndarray:
        fixed = self._fixed.get(child)
        if fixed is not None:
            return fixed.pose
        past = list(self._moving[child])
        first, last = past[0].stamp_ns, past[-1].stamp_ns
        if not first <= stamp_ns <= last:
            late = max(stamp_ns - last, first - stamp_ns) / NS
            side = 'newest' if stamp_ns > last else 'oldest'
            raise FrameError(f'the {side} transform of {child!r} is {late:.3g} s '
                             f'{"before" if side == "newest" else "after"} the stamp')
        k = int(np.searchsorted([item.stamp_ns for item in past], stamp_ns))
        after = past[k]
        if after.stamp_ns == stamp_ns:
            return after.pose
        before = past[k - 1]
        t = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
        turn = _SPHERE.geodesic(before.pose[3:], _SPHERE.align(after.pose[3:], before.pose[3:]), t)
        return np.concatenate([before.pose[:3] + t * (after.pose[:3] - before.pose[:3]), turn])


try:
    import tf2_py
except ImportError:  # it has no wheel
    tf2_py = None


class Tf2Frames:
    """Frames in the buffer of tf2."""

    def __init__(self) -> None:
        self._buffer: Any = tf2_py.BufferCore()

    def add(self, transform: Transform, fixed: bool) -> None:
        """Remember a transform."""
        message = stamped_transform(transform.parent, transform.child, transform.pose,
                                    Time(nanoseconds=transform.stamp_ns).to_msg())
        (self._buffer.set_transform_static if fixed else self._buffer.set_transform)(
            message, _AUTHORITY)

    def pose_of(self, frame: str, base: str, stamp_ns: int) -> np.ndarray:
        """Pose of a frame in another one; see `Frames`."""
        return transform_numbers(self._found(frame, base, stamp_ns).transform)

    def newest(self, frame: str, base: str) -> tuple[np.ndarray, int]:
        """Newest pose of a frame in another one; see `Frames`."""
        found = self._found(frame, base, 0)
        return transform_numbers(found.transform), ns_of(found.header.stamp)

    def _found(self, frame: str, base: str, stamp_ns: int) -> Any:
        try:
            return self._buffer.lookup_transform_core(base, frame, Time(nanoseconds=stamp_ns))
        except tf2_py.TransformException as error:
            raise FrameError(str(error)) from None


def new_frames() -> Frames:
    """The buffer of tf2 where the system has it, otherwise ours."""
    return FrameTree() if tf2_py is None else Tf2Frames()


class BaseFrame:
    """
    The frame of a robot's base, and where others are in it.

    Messages on /tf are kept as they come, and read from the first pose in another frame on. Any
    thread may use it.
    """

    def __init__(self, node: ManagedNode, name: str, late: bool = False):
        """
        Subscribe.

        :param name: ``frame_id`` of the base
        :param late: subscribe when the first frame is looked up, which is not known then
        """
        self.name, self._node = name, node
        self._frames, self._wanted = new_frames(), False
        self._lock = threading.Lock()
        self._inputs: list[tuple[Any, bool]] = []
        self._unread: deque[tuple[bytes, bool]] = deque()
        if not late:
            self._subscribe()

    def _subscribe(self) -> None:
        node = self._node
        self._inputs = [
            (node.add_sensor(TFMessage, '/tf', DEPTH), False),
            (node.add_subscription(TFMessage, '/tf_static', None, DEPTH, late=True), True)]
        node.add_report(self._listen)

    def pose(self, message: Any) -> np.ndarray:
        """
        Pose of a stamped message in the base (x, y, z, qw, qx, qy, qz).

        :raises FrameError: if its frame is not known, now or at its stamp
        :raises ManifoldError: if it is no pose
        """
        numbers = checked_numbers(message.pose)
        place = self.place_of(message.header)
        return numbers if place is None else compose(place, numbers)

    def transformed(self, message: TransformStamped) -> np.ndarray:
        """
        Pose in the base of the child of a stamped transform; see `pose`.

        :raises FrameError: as `pose`
        :raises ManifoldError: if it is no rigid motion
        """
        numbers = transform_numbers(message.transform)
        place = self.place_of(message.header)
        return numbers if place is None else compose(place, numbers)

    def listen(self) -> None:
        """Read transforms from now on, before a pose in another frame comes."""
        self._wanted = True

    def catch_up(self) -> None:
        """Read all transforms that have been received; not in a tick."""
        with self._lock:
            self._collect()
            self._read()

    def newest(self, frame: str) -> tuple[np.ndarray, int]:
        """
        Newest pose of a frame in the base, and when it was there [ns]; 0: it is fixed.

        :raises FrameError: if it is not known
        """
        if frame == self.name:
            return IDENTITY.copy(), 0
        with self._reading(frame):
            return self._frames.newest(frame, self.name)

    def moving(self, message: Any, twist: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Pose of a stamped message, as `pose`, and its twist, in the base.

        :param twist: in its frame [m/s, rad/s]; that frame itself is taken to rest
        """
        numbers, place = checked_numbers(message.pose), self.place_of(message.header)
        if place is None:
            return numbers, twist.copy()
        return compose(place, numbers), turned(place, twist)

    def place_of(self, header: Any) -> np.ndarray | None:
        """
        Pose of the frame of a message in the base; None for the base itself.

        :raises FrameError: as `pose`
        """
        if header.frame_id == self.name:
            return None
        if not header.frame_id:
            raise FrameError(f"the frame is '', expected {self.name!r} or one that /tf connects "
                             'to it')
        with self._reading(header.frame_id):
            return self._frames.pose_of(header.frame_id, self.name,
                                        ns_of(header.stamp))

    @contextmanager
    def _reading(self, frame: str) -> Iterator[None]:
        """Read what has come, and look a frame up."""
        self._wanted = True
        with self._lock:
            if not self._inputs:
                self._subscribe()
            self._collect()
            if len(self._unread) > AT_ONCE:
                raise FrameError(f'frame {frame!r}: /tf is being read')
            self._read()
            yield

    def knows(self, header: Any) -> bool:
        """Whether `place_of` would find the frame of a message."""
        try:
            self.place_of(header)
        except FrameError:
            return False
        return True

    def _listen(self) -> None:
        with self._lock:
            self._collect()
            if self._wanted:
                self._read()

    def _collect(self) -> None:
        """Take the messages that have come, without reading them."""
        for subscription, fixed in self._inputs:
            while (received := subscription.take()) is not None:
                self._unread.append((received.data, fixed))
        while not self._wanted and len(self._unread) > DEPTH:
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        """Forget the oldest message of a frame that moves; fixed frames are sent once."""
        for k, (_, fixed) in enumerate(self._unread):
            if not fixed:
                del self._unread[k]
                return
        self._unread.popleft()

    def _read(self) -> None:
        while self._unread:
            data, fixed = self._unread.popleft()
            try:
                transforms = deserialized(data, TFMessage).transforms
            except GdmpError:
                continue
            for transform in transforms:
                try:
                    pose = transform_numbers(transform.transform)
                except GdmpError:
                    continue  # as tf2: what is no transform is left out
                stamp = transform.header.stamp
                self._frames.add(Transform(transform.header.frame_id.lstrip('/'),
                                           transform.child_frame_id.lstrip('/'), pose,
                                           ns_of(stamp)), fixed)
