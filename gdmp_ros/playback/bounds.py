"""Bounds speed and acceleration of the stream: other controllers follow it without a guard."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.governor import CATCH_UP_S
from gdmp_ros.control.target import (
    ACCELERATION,
    extrapolate_pose,
    POSE,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
)
from gdmp_ros.dmp.layout import FINISHED
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.kernels import kernel, local_numbers
from gdmp_ros.manifolds.linalg import norm
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.playback.channels import COUNT, FIRST, KIND, OF_JOINTS, TARGET
from gdmp_ros.playback.look_ahead import (
    AT,
    largest_tempo,
    look_ahead_of,
    MOST_ACCELERATION,
    MOST_SPEED,
    SIZE,
    SLOW,
)
from gdmp_ros.playback.settings import StreamSettings
from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill

#: Stands for the memory of a roll-out if there is no motion.
NOTHING = np.zeros(FINISHED + 1)
#: Speed at which a bounded stream catches up, as a share of the largest speed.
CATCH_UP_SHARE = 0.3
#: Rounding of a step.
_TOLERANCE = 1.0 + 1e-6
#: Least tempo, and the share of an acceleration that it uses.
_LEAST, _KEPT = 0.02, 0.9
#: Time constant with which the tempo approaches what an arm allows [s].
_ALLOWED_S = 0.2
#: Indices of `StreamBounds.tempos`: that of the next tick, and its rate [1/s]; the largest one
#: that an arm allows, and what of it has been reached.
NEXT, RATE, ALLOWED, REACHED = range(4)


class StreamBounds:
    """
    Bounds references; those of another kind begin another stream.

    A motion that is too fast is slowed down in time, before it is: `tempo` is what the ticks of
    the player are to be multiplied by. All channels stay on their paths then, and two tools that
    belong together stay together. What is left, as a step of the references, is bounded in space.

    :ivar bounded: ticks in which the bounds were active
    :ivar parts: what is bounded (`gdmp_ros.playback.look_ahead.SIZE`); written by
        `bound_in_time_and_space` are:
    :ivar out: the bounded reference; None before there is one
    :ivar work: of its size
    :ivar tempos: see `NEXT`
    :ivar ahead: what follows of the present motion
    """

    def __init__(self, settings: StreamSettings):
        self._settings = settings
        self.out: np.ndarray | None = None
        self.work, self.tempos = np.empty(0), np.array([1.0, 0.0, 1.0, 1.0])
        self._kind, self.parts = Kind.TOOL, np.empty((0, 4))
        self.bounded = 0
        self._rollout: Rollout | None = None
        self.ahead = look_ahead_of(None)

    def configure(self, settings: StreamSettings) -> None:
        """Use other bounds from the next stream on, and from now on if there is one."""
        self._settings = settings
        if len(self.parts):
            self.parts[:, MOST_SPEED:] = [self._limits(size) for size in self.parts[:, SIZE]]

    def reset(self) -> None:
        """The next reference begins a stream."""
        self.out = None
        self.tempos[NEXT], self.tempos[RATE] = 1.0, 0.0
        self.tempos[REACHED] = self.tempos[ALLOWED]

    @property
    def tempo(self) -> float:
        """Part of the time of the next tick that is to pass for the player, at most 1."""
        return float(self.tempos[NEXT])

    def allow(self, tempo: float) -> None:
        """
        Let motions be slower from now on, at a moderate rate; references that rest stay.

        :param tempo: share of the time that may pass for them, 0 … 1
        """
        self.tempos[ALLOWED] = tempo

    def continues(self, skill: StreamedSkill, reference: np.ndarray) -> bool:
        """Whether a reference is one of the stream that is bounded."""
        return (self.out is not None and skill.kind is self._kind
                and len(self.out) == len(reference))

    def follow(self, rollout: Rollout | None) -> None:
        """Use this motion for looking ahead; None if there is no motion."""
        if rollout is not self._rollout:
            self._rollout, self.ahead = rollout, look_ahead_of(rollout)

    def apply(self, skill: StreamedSkill, reference: np.ndarray, dt: float,
              rollout: Rollout | None = None) -> np.ndarray:
        """
        Bound the reference of a tick.

        :param skill: that is played
        :param reference: of a player for which `tempo` of the time has passed; not changed
        :param rollout: whose state it is; None: what follows is not known
        :returns: the same array every time
        """
        out = self.out
        self.follow(rollout)
        if out is None or not self.continues(skill, reference):
            self._kind, self.parts = skill.kind, self._parts_of(skill)
            self.reset()
            self.out, self.work = reference.copy(), reference.copy()
            return self.out
        if dt > 0.0:
            memory = NOTHING if rollout is None else rollout.memory
            self.bounded += bool(bound_in_time_and_space(
                reference, out, skill.table, self.parts, dt, self.work, self.tempos, memory,
                self.ahead))
        return out

    def _limits(self, size: float) -> tuple[float, float]:
        """Largest speed and acceleration of a position (-3), a rotation (3) or a joint (1)."""
        settings = self._settings
        speed, acceleration = ((settings.stream_speed, settings.stream_acceleration) if size < 0
                               else (settings.stream_angular_speed,
                                     settings.stream_angular_acceleration))
        return speed or math.inf, acceleration or math.inf

    def _parts_of(self, skill: StreamedSkill) -> np.ndarray:
        result = []
        for row in skill.table:
            sizes = [1] * row[COUNT] if row[KIND] == OF_JOINTS else [-3, 3]
            at = row[FIRST]
            for size in sizes:
                result.append((size, at, *self._limits(size)))
                at += abs(size)
        return np.array(result)


@kernel
def _velocities_to(target, out, table, way, desired, velocity):
    """Way from bounded references to targets, velocities of the targets, and bounded ones."""
    for row in table:
        at, n, first = row[TARGET], row[COUNT], row[FIRST]
        if row[KIND] == OF_JOINTS:
            for i in range(n):
                way[first + i] = target[at + i] - out[at + i]
                desired[first + i] = target[at + n + i]
                velocity[first + i] = out[at + n + i]
            continue
        for i in range(3):
            way[first + i] = target[at + POSE + i] - out[at + POSE + i]
        rotation_between(out[at + POSE + 3:at + POSE + 7], target[at + POSE + 3:at + POSE + 7],
                         way[first + 3:first + 6])
        for i in range(6):
            desired[first + i] = target[at + TWIST + i]
            velocity[first + i] = out[at + TWIST + i]


@kernel
def bound_in_time_and_space(target, out, table, parts, dt, work, tempo, memory, ahead):
    """
    Scale the velocities of targets by the tempo, choose the next one, and bound what is left.

    :param work: targets; overwritten
    :param tempo: of this tick, as `StreamBounds.tempos`; becomes that of the next one
    :param memory: of the roll-out whose state the targets are, and what follows of it
    :returns: whether the references are bounded
    """
    slowed = tempo[NEXT] < 1.0 or tempo[RATE] != 0.0
    for i in range(target.size):
        work[i] = target[i]
    size = table[-1, FIRST] + table[-1, COUNT]
    velocity, acceleration = local_numbers(size), local_numbers(size)
    for row in table:
        at, n, first = row[TARGET], row[COUNT], row[FIRST]
        speeds, changes = at + TWIST, at + ACCELERATION
        if row[KIND] == OF_JOINTS:
            speeds, changes = at + n, at + 3 * n + 1
        for i in range(n):
            velocity[first + i] = target[speeds + i]
            acceleration[first + i] = target[changes + i]
            if slowed:
                work[speeds + i] = tempo[NEXT] * target[speeds + i]
                work[changes + i] = (tempo[NEXT] ** 2 * target[changes + i]
                                     + tempo[RATE] * target[speeds + i])
    later, rate = largest_tempo(memory, table, parts, tempo[NEXT], tempo[NEXT] * dt, ahead)
    _choose_tempo(velocity, acceleration, parts, dt, tempo, later, rate)
    bounded = _bound(work, out, table, parts, dt)
    return bounded or slowed


@kernel
def _choose_tempo(velocity, acceleration, parts, dt, tempo, later, largest_rate):
    """
    The largest next tempo s with speeds s |v| and accelerations |s² a + s' v| inside the bounds.

    :param tempo: present one, as `StreamBounds.tempos`; changed
    :param later: largest tempo with which what follows keeps the bounds
    :param largest_rate: of the tempo, as long as the present state needs no larger one [1/s]
    """
    present = tempo[NEXT]
    tempo[REACHED] += min(dt / _ALLOWED_S, 1.0) * (tempo[ALLOWED] - tempo[REACHED])
    if abs(tempo[ALLOWED] - tempo[REACHED]) < 1e-6:
        tempo[REACHED] = tempo[ALLOWED]
    most, low = tempo[REACHED], -math.inf
    high = max(min(largest_rate, (later - present) / dt), -largest_rate)
    for part in parts:
        n, at, largest = abs(int(part[SIZE])), int(part[AT]), part[MOST_ACCELERATION]
        v, a = velocity[at:at + n], acceleration[at:at + n]
        speed, along = norm(n, v), 0.0
        if speed > SLOW:
            most = min(most, part[MOST_SPEED] / speed)
            for i in range(n):
                along += v[i] * a[i] / speed
        across = math.sqrt(max(norm(n, a) ** 2 - along ** 2, 0.0))
        if largest == math.inf:
            continue
        if across > 0.0:
            most = min(most, math.sqrt(_KEPT * largest / across))
        if speed <= SLOW:
            if along == 0.0 and norm(n, a) > 0.0:
                most = min(most, math.sqrt(_KEPT * largest / norm(n, a)))
            continue
        # |s² a + s' v|² <= largest²: an interval of s'.
        room = math.sqrt(max(largest ** 2 - (present ** 2 * across) ** 2, 0.0))
        low = max(low, (-present ** 2 * along - room) / speed)
        high = min(high, (-present ** 2 * along + _KEPT * room) / speed)
    rate = max(min(high, (most - present) / dt), low)
    after = min(max(present + rate * dt, _LEAST), 1.0)
    if after > 1.0 - 1e-9:
        after = 1.0
    tempo[RATE] = (after - present) / dt
    tempo[NEXT] = after


@kernel
def _bound(target, out, table, parts, dt):
    """
    Move bounded references towards targets by one tick.

    :param out: the bounded references of the last tick; changed
    :param parts: what is bounded; see `gdmp_ros.playback.look_ahead.SIZE`
    :returns: whether they are bounded now
    """
    size = table[-1, FIRST] + table[-1, COUNT]
    way, desired = local_numbers(size), local_numbers(size)
    velocity, step = local_numbers(size), local_numbers(3)
    _velocities_to(target, out, table, way, desired, velocity)
    free = True
    for part in parts:
        n, at = abs(int(part[SIZE])), int(part[AT])
        speed, acceleration = part[MOST_SPEED], part[MOST_ACCELERATION]
        for i in range(n):
            step[i] = way[at + i] - 0.5 * dt * (velocity[at + i] + desired[at + i])
        free = free and norm(n, step) <= acceleration * dt * dt
        for i in range(n):
            step[i] = desired[at + i] - velocity[at + i]
        free = free and norm(n, step) <= _TOLERANCE * acceleration * dt
        free = free and norm(n, desired[at:at + n]) <= _TOLERANCE * speed
    if free:
        for i in range(out.size):
            out[i] = target[i]
        return False
    # What is left when the targets and the references have gone on for this tick. The rate with
    # which it is closed is the same for all parts, and so is every other factor here: what belongs
    # together stays together.
    rate = 1.0 / CATCH_UP_S
    for part in parts:
        n, at = abs(int(part[SIZE])), int(part[AT])
        speed, acceleration = part[MOST_SPEED], part[MOST_ACCELERATION]
        for i in range(n):
            way[at + i] -= dt * desired[at + i]
        left = norm(n, way[at:at + n])
        if left > 1e-12:
            rate = min(rate, CATCH_UP_SHARE * speed / left, math.sqrt(acceleration / left))
    share = 1.0
    for part in parts:
        n, at = abs(int(part[SIZE])), int(part[AT])
        for i in range(n):
            desired[at + i] += rate * way[at + i]
        fast = norm(n, desired[at:at + n])
        if fast > part[MOST_SPEED]:
            share = min(share, part[MOST_SPEED] / fast)
    change = 1.0
    for part in parts:
        n, at = abs(int(part[SIZE])), int(part[AT])
        for i in range(n):
            step[i] = share * desired[at + i] - velocity[at + i]
        much = norm(n, step)
        if much > part[MOST_ACCELERATION] * dt:
            change = min(change, part[MOST_ACCELERATION] * dt / much)
    for i in range(size):
        way[i] = change * (share * desired[i] - velocity[i])
    _write(target, out, table, way, dt)
    return True


@kernel
def _write(target, out, table, change, dt):
    """Change the velocities of bounded references, and let them move for a tick."""
    for row in table:
        at, n, first = row[TARGET], row[COUNT], row[FIRST]
        if row[KIND] == OF_JOINTS:
            for i in range(n):
                out[at + n + i] += change[first + i]
                out[at + i] += dt * out[at + n + i]
                out[at + 3 * n + 1 + i] = change[first + i] / dt
                out[at + 2 * n + i] = target[at + 2 * n + i]
            out[at + 3 * n] = target[at + 3 * n]
            continue
        for i in range(6):
            out[at + TWIST + i] += change[first + i]
            out[at + ACCELERATION + i] = change[first + i] / dt
        for i in range(at + STIFFNESS, at + TARGET_SIZE):
            out[i] = target[i]
        one = out[at:at + TARGET_SIZE]
        extrapolate_pose(one, dt, one[POSE:POSE + 7])

