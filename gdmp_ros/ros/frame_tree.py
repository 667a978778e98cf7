"""Frames that are fixed to each other or move, as /tf tells them: where one is in another."""
from __future__ import annotations

from collections import deque
from typing import NamedTuple, Protocol

import numpy as np

from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.poses import compose, IDENTITY, inverse
from gdmp_ros.manifolds.quaternion import UnitQuaternion

NS = 1_000_000_000
#: How long transforms are remembered [s].
MEMORY_S = 10.0
#: Frames in a chain, to find loops.
LONGEST_CHAIN = 1000
_SPHERE = UnitQuaternion()


class FrameError(GdmpError):
    """It is not known where a frame is, at that time or at all."""


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
        up, down = self._chain(frame), self._chain(base)
        common = next((name for name in up if name in down), None)
        if common is None:
            known = ', '.join(sorted({*self._fixed, *self._moving})) or 'none'
            raise FrameError(f'frame {frame!r} is not connected to {base!r}; known frames: '
                             f'{known}')
        up, down = up[:up.index(common)], down[:down.index(common)]
        at = stamp_ns or min((self._moving[name][-1].stamp_ns for name in (*up, *down)
                              if name in self._moving), default=0)
        return compose(inverse(self._along(down, at)), self._along(up, at))

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
        k = int(np.searchsorted([one.stamp_ns for one in past], stamp_ns))
        after = past[k]
        if after.stamp_ns == stamp_ns:
            return after.pose
        before = past[k - 1]
        t = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
        turn = _SPHERE.geodesic(before.pose[3:], _SPHERE.align(after.pose[3:], before.pose[3:]), t)
        return np.concatenate([before.pose[:3] + t * (after.pose[:3] - before.pose[:3]), turn])
