"""Task frames of a roll-out: where they are measured, and how the motion follows."""
from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import numpy as np

from gdmp_ros.dmp.frames import actions_of, nearest_turn, placed, poses_of
from gdmp_ros.dmp.fusion import (
    FRAME_ROW,
    Fusion,
    fusion_size,
    fusion_view,
    MOVES,
    OFFSET,
    pose_at,
    RATE,
    SINCE,
    STAMP,
    TURNS_QUATERNION,
    TURNS_ROTATION,
    TWIST,
    write_goal,
)
from gdmp_ros.dmp.initial import finite_tangent, initialise, new_memory, Start
from gdmp_ros.dmp.layout import Motion, parts
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.pose_track import offset_from, PoseTrack
from gdmp_ros.dmp.primitive import Primitive, State
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.poses import compose, IDENTITY, POSE_SIZE
from gdmp_ros.manifolds.quaternion import (
    multiply_conjugate,
    rotate,
)
from gdmp_ros.util.numeric import numbers

#: Rate at which an offset of a frame fades [1/s]: a faster one costs more acceleration.
FADE_RATE = 3.5
#: Progress at which the offset of a start elsewhere has faded out, unless an object is grasped
#: before; one that is grasped earlier than the second number leaves no time.
START_FADES, EARLIEST_FADE = 0.7, 0.1
#: Half of the time of a difference, as a part of the duration, and at most [s].
_SHORT, _SHORTEST = 1e-5, 1e-4
#: Time of differences of where a frame is [s].
_MOMENT = 1e-4
#: How far a motion is looked ahead (`gdmp_ros.playback.look_ahead`) [s].
_SOON_S = 0.2
#: Iterations that match an initial velocity and acceleration.
_MATCHES = 6
#: A frame that is slower rests: its twist is noise [m/s, rad/s].
SLOW = np.array([0.005, 0.03])


class TaskFrames:
    """
    The task frames of one roll-out.

    :ivar memory: of the roll-out, with the fusion and the motions in the frames
    """

    def __init__(self, skill: Primitive, options: Options):
        """Make the memory."""
        self._skill = skill
        self._dimension, self._actions = actions_of(skill.manifold)
        self._names = [view.name for view in skill.views]
        self._seen: dict[str, PoseTrack] = {}
        self._fades = START_FADES
        own = new_memory(skill, options)
        sizes, knots = parts(own).sizes, len(skill.views[0].shares)
        sizes.views, sizes.own = len(skill.views), len(own)
        size: Any = fusion_size
        fusion = np.zeros(size.py_func(sizes, knots))
        fusion[0] = knots
        views = [new_memory(view.skill, options) for view in skill.views]
        sizes.total = len(own) + len(fusion) + sum(map(len, views))
        self.bind(np.concatenate([own, fusion, *views]))

    def bind(self, memory: np.ndarray) -> None:
        """Use another memory with the same content."""
        self.memory = memory
        self._motion: Motion = parts(memory)
        view: Any = fusion_view
        sizes = self._motion.sizes
        self._fusion: Fusion = view.py_func(memory, sizes)
        size: Any = fusion_size
        at = sizes.own + size.py_func(sizes, int(self._fusion.settings[0]))
        self._views: list[Motion] = []
        for _ in self._names:
            self._views.append(parts(memory[at:]))
            at += self._views[-1].sizes.total

    def copy(self, memory: np.ndarray) -> TaskFrames:
        """The same for a copy of the memory."""
        result = object.__new__(TaskFrames)
        result.__dict__.update(self.__dict__)
        result.bind(memory)
        return result

    def begin(self, options: Options, goal: np.ndarray | None, duration: float, start: Start,
              advance: Callable[[], State]) -> None:
        """
        Write everything as it is at the beginning; see `gdmp_ros.dmp.initial.initialise`.

        :param goal: point at which the goal's frame puts the end of the motion; None for that of
            the frames
        :param advance: evaluates the present state
        """
        skill, fusion = self._skill, self._fusion
        plain = Start(speed=start.speed)
        initialise(self._motion, skill, options, skill.goal, duration, plain)
        for motion, view in zip(self._views, skill.views):
            initialise(motion, view.skill, options, view.skill.goal, duration, plain)
        self._seen = {}
        fusion.settings[1:] = self._dimension, 0.0, min(_SHORT * duration, _SHORTEST)
        fusion.actions[:] = self._actions
        fusion.shares[:] = np.stack([view.shares for view in skill.views], axis=1).ravel()
        fusion.goals[:] = np.concatenate([view.skill.goal.ravel() for view in skill.views])
        for number, view in enumerate(skill.views):
            self._row(number)[:] = 0.0
            self._row(number)[:POSE_SIZE] = view.pose
        self._choose_signs()
        if goal is not None:
            self._row(len(self._names) - 1)[:POSE_SIZE] = self.pose_of_goal(goal)
            self._choose_signs()
        if start.point is not None or start.velocity is not None:
            self._begin_elsewhere(start, advance)
        elif start.acceleration is not None:
            raise ParameterError('an initial acceleration needs an initial velocity')

    def _row(self, number: int) -> np.ndarray:
        rows: np.ndarray = self._fusion.frames
        return rows[number * FRAME_ROW:(number + 1) * FRAME_ROW]

    def _choose_signs(self) -> None:
        """Choose ±q of each frame's orientations, once: near those of the first frame."""
        manifold, views = self._skill.manifold, self._skill.views
        signs = self._fusion.signs.reshape(len(views), -1)
        signs[:] = 1.0
        ends = [placed(manifold, self._row(number)[:POSE_SIZE],
                       np.array([view.skill.start, view.skill.goal])).reshape(2, -1)
                for number, view in enumerate(views)]
        for number in range(1, len(views)):
            for factor in np.flatnonzero(self._actions == TURNS_QUATERNION):
                part = manifold.point_slices[factor]
                likeness = sum(float(first[part] @ other[part])
                               for first, other in zip(ends[0], ends[number]))
                signs[number, factor] = -1.0 if likeness < 0.0 else 1.0

    def _begin_elsewhere(self, start: Start, advance: Callable[[], State]) -> None:
        """Write the offset of a start that is not the fused one, or of another velocity."""
        manifold, scalars = self._skill.manifold, self._motion.scalars
        state = advance()
        point = (state.point if start.point is None
                 else manifold.align(start.point, state.point))
        home = manifold.frame(state.point)
        self._fusion.home[:] = home
        self._fades = min([START_FADES, *(
            view.grasped for view in self._skill.views
            if view.grasped is not None and view.grasped >= EARLIEST_FADE)])
        self._fusion.settings[2] = self._fades
        terms = np.zeros((3, manifold.tangent_size))  # offset and derivatives by s
        terms[0] = manifold.log_in_frame(home, point)[0]
        self._write_fade(terms)
        if start.velocity is None:
            return
        if not scalars.speed > 0.0:
            raise ParameterError('an initial velocity needs an initial speed above 0')
        wanted = [finite_tangent(manifold, f'initial {name}', np.zeros(manifold.tangent_size)
                                 if given is None else given)
                  for name, given in (('velocity', start.velocity),
                                      ('acceleration', start.acceleration))]
        carried = manifold.transport_frame(home, terms[0])
        rate = scalars.speed / scalars.duration
        for _ in range(_MATCHES):
            state = advance()
            missing = [manifold.to_frame(carried, want - have)
                       for want, have in zip(wanted, (state.velocity, state.acceleration))]
            terms[1] += missing[0] / rate
            terms[2] += missing[1] / rate ** 2
            self._write_fade(terms)

    def _write_fade(self, terms: np.ndarray) -> None:
        """Write the polynomial of fifth order from these derivatives by s to rest at 0."""
        first = terms[0]
        second, third = self._fades * terms[1], 0.5 * self._fades ** 2 * terms[2]
        self._fusion.fade[:] = np.concatenate([
            first, second, third, -10.0 * first - 6.0 * second - 3.0 * third,
            15.0 * first + 8.0 * second + 3.0 * third, -6.0 * first - 3.0 * second - third])

    def measure(self, name: str, pose: Any, twist: Any = None, stamp: float | None = None) -> None:
        """
        Take a measurement of a frame; see `gdmp_ros.dmp.Rollout.move_frame`.

        :raises ParameterError: if it is none; nothing has changed then
        """
        number, now = self._number(name), float(self._motion.scalars.time)
        measured = poses_of(name, pose, self._dimension)
        given = None if twist is None else self._twist(name, twist)
        at = now if stamp is None else stamp
        if not (isinstance(at, (int, float, np.number)) and math.isfinite(at) and at <= now + 1.0):
            raise ParameterError(f'frame {name}: stamp is {at!r} s, expected a time of the '
                                 f'roll-out, now {now:.6g} s')
        self._take(number, measured, given, float(at), now)

    def _take(self, number: int, measured: np.ndarray, twist: np.ndarray | None, at: float,
              now: float) -> None:
        """Take a measurement, unless a newer one is known or the tool holds the object."""
        view, row = self._skill.views[number], self._row(number)
        if view.grasped is not None and self._motion.scalars.progress >= view.grasped:
            self._rest(number)
            return
        track = self._seen.get(view.name)
        if track is not None and at < track.stamp:
            return
        if view.free_yaw:
            expected = _where(row, at, offset=False)
            measured = nearest_turn(measured, expected)
            if twist is not None:
                twist[3:] -= (twist[3:] @ _axis(measured)) * _axis(measured)
        self._use(number, measured, twist, at, now)

    def rest(self, name: str) -> None:
        """Let a frame rest; see `gdmp_ros.dmp.Rollout.rest_frame`."""
        self._rest(self._number(name))

    def _rest(self, number: int) -> None:
        row, now = self._row(number), float(self._motion.scalars.time)
        if row[TWIST:TWIST + 6].any():
            self._aim(number, np.concatenate([_where(row, now, offset=False), np.zeros(6)]),
                      now, now)

    def _number(self, name: str) -> int:
        if name not in self._names:
            raise ParameterError(f'frame {name!r}: the skill has no such frame, expected one of '
                                 f'{", ".join(self._names)}')
        return self._names.index(name)

    @property
    def are_moving(self) -> bool:
        """Whether a frame moves on: faster than the noise of a measurement."""
        twists = np.array([self._row(k)[TWIST:TWIST + 6] for k in range(len(self._names))])
        return bool((np.linalg.norm(twists.reshape(-1, 2, 3), axis=2) > SLOW).any())

    def _use(self, number: int, measured: np.ndarray, twist: np.ndarray | None, at: float,
             now: float) -> None:
        """Use a measured pose as it is."""
        name = self._names[number]
        measured[3:] *= -1.0 if measured[3:] @ self._row(number)[3:POSE_SIZE] < 0.0 else 1.0
        track = self._seen.get(name, PoseTrack()).with_pose(at, measured)
        self._seen = {**self._seen, name: track}
        target = track.motion if twist is None else np.concatenate([measured, twist])
        self._aim(number, target, at, now)

    def _twist(self, name: str, given: Any) -> np.ndarray:
        twist = numbers(f'twist of frame {name}', given)
        if self._dimension == 2 and twist.shape == (3,):
            twist = np.array([twist[0], twist[1], 0.0, 0.0, 0.0, twist[2]])
        if twist.shape != (6,) or not np.isfinite(twist).all():
            raise ParameterError(f'twist of frame {name}: expected 6 finite numbers (velocity of '
                                 f'the origin, angular velocity), got {given!r}')
        return twist

    def _aim(self, number: int, target: np.ndarray, stamp: float, now: float) -> None:
        """Let a frame go on from where it is, smoothly, to a pose that moves with a twist."""
        row = self._row(number)
        moments = now + np.array([-_MOMENT, 0.0, _MOMENT])
        before = [_where(row, moment) for moment in moments]
        expected, later = (_where(row, time, offset=False) for time in (now, now + _SOON_S))
        row[:TWIST + 6], row[STAMP], row[RATE] = target, stamp, 0.0
        if row[3:POSE_SIZE] @ expected[3:] < 0.0:
            row[3:POSE_SIZE] *= -1.0
        offsets = np.array([offset_from(_where(row, moment), old)
                            for moment, old in zip(moments, before)])
        first = offsets[1]
        slope = (offsets[2] - offsets[0]) / (2.0 * _MOMENT)
        bend = (offsets[2] - 2.0 * first + offsets[0]) / _MOMENT ** 2
        second = slope + FADE_RATE * first
        third = 0.5 * (bend + 2.0 * FADE_RATE * second - FADE_RATE ** 2 * first)
        row[OFFSET:OFFSET + 18] = np.concatenate([first, second, third])
        row[SINCE], row[RATE] = now, FADE_RATE
        scalars = self._motion.scalars
        soon = offset_from(_where(row, now + _SOON_S, offset=False), later)
        if (np.abs(soon) > self._tolerances()).any():
            scalars.switched_at = scalars.progress  # what was computed ahead is no longer true
        jump = offset_from(_where(row, now, offset=False), expected)
        if (np.abs(jump) > self._tolerances()).any():
            scalars.finished = scalars.not_settled = 0
            scalars.settle_by = max(scalars.settle_by, scalars.progress + 1.0
                                    + 10.0 / (FADE_RATE * scalars.duration))

    def _tolerances(self) -> np.ndarray:
        """How far a frame may jump beside a motion that has finished."""
        tolerances = self._motion.tolerances
        return np.repeat([tolerances[self._actions == MOVES].min(initial=math.inf),
                          tolerances[self._actions != MOVES].min(initial=math.inf)], 3)

    def pose_of_goal(self, goal: np.ndarray) -> np.ndarray:
        """
        Where the goal's frame has to be for a goal.

        :raises ParameterError: if no pose of the frame gives this goal
        """
        manifold, view = self._skill.manifold, self._skill.views[-1]
        if not (view.shares[-1] == 1.0).all():
            raise ParameterError(f'the goal is not that of frame {view.name} alone: move the '
                                 'frames, not the goal')
        wanted, own = _split(manifold, goal), _split(manifold, view.skill.goal)
        pose = np.array(self._row(len(self._names) - 1)[:POSE_SIZE])
        turning = np.flatnonzero((self._actions == TURNS_QUATERNION)
                                 | (self._actions == TURNS_ROTATION))
        for i in turning[:1]:
            pose[3:] = _rotation_between(self._dimension, own[i], wanted[i])
        for i in np.flatnonzero(self._actions == MOVES)[:1]:
            turned = compose(np.concatenate([np.zeros(3), pose[3:]]), _position(own[i]))
            pose[:3] = _position(wanted[i])[:3] - turned[:3]
        return pose

    def retarget(self, goal: np.ndarray, velocity: np.ndarray | None) -> None:
        """Move the goal's frame to where its motion ends at a goal."""
        pose, twist = self.pose_of_goal(goal), np.zeros(6)
        if velocity is not None:
            manifold = self._skill.manifold
            for i in np.flatnonzero(self._actions == TURNS_QUATERNION)[:1]:
                twist[3:] = 2.0 * velocity[manifold.tangent_slices[i]]
            for i in np.flatnonzero(self._actions == MOVES)[:1]:
                part = velocity[manifold.tangent_slices[i]]
                twist[:len(part)] = part
                at = _position(_split(manifold, goal)[i])[:3]
                twist[:3] -= np.cross(twist[3:], at - pose[:3])
        name, now = self._names[-1], float(self._motion.scalars.time)
        self._seen = {key: one for key, one in self._seen.items() if key != name}
        self._use(len(self._names) - 1, pose, twist, now, now)

    def goal(self) -> np.ndarray:
        """The fused goal, flat."""
        point = np.empty(self._skill.manifold.point_size)
        write_goal(self.memory, point)
        return point

    def poses(self) -> dict[str, np.ndarray]:
        """Where the motion has the frames now, shape (7,) each."""
        now = float(self._motion.scalars.time)
        return {name: _where(self._row(i), now) for i, name in enumerate(self._names)}


def _where(row: np.ndarray, time: float, offset: bool = True) -> np.ndarray:
    pose = np.empty(POSE_SIZE)
    pose_at(row, time, int(offset), pose)
    return pose


def _axis(pose: np.ndarray) -> np.ndarray:
    """The z axis of a pose."""
    axis = np.empty(3)
    rotate(pose[3:], np.array([0.0, 0.0, 1.0]), axis)
    return axis


def _split(manifold: Manifold, point: np.ndarray) -> list[np.ndarray]:
    """The points of the factors."""
    flat = point.reshape(-1)
    return [flat[part].reshape(factor.point_shape)
            for factor, part in zip(manifold.factors, manifold.point_slices)]


def _position(point: np.ndarray) -> np.ndarray:
    """A position, of the plane too, as a pose that is not turned."""
    result = IDENTITY.copy()
    result[:len(point)] = point
    return result


def _rotation_between(dimension: int, own: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The quaternion that turns an orientation in the frame to one in the base."""
    if own.ndim == 1:
        turn = np.empty(4)
        multiply_conjugate(np.ascontiguousarray(wanted), np.array(own), turn)
        return turn
    return poses_of('goal', (wanted @ own.T, np.zeros(dimension)), dimension)[3:]
