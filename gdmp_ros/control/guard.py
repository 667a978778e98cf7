"""Reference guard: decides which references an arm follows, and stops it when they end."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control import stream
from gdmp_ros.control.arm_states import ArmStates, Request, State
from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.control.reference_check import continues, is_on_time, Origin, refusal
from gdmp_ros.control.reference_kinds import (
    JointReferences,
    MeasuredMotion,
    PoseReferences,
    ReferenceKind,
)
from gdmp_ros.control.settings import GuardSettings, LimitSettings
from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.kernels import records_at
from gdmp_ros.manifolds.quaternion import pose_distance

#: Reason of a stop because the stream has ended without saying so.
NO_REFERENCE = 'no reference for'
#: After `ReferenceGuard.arm` a motion must begin within this time [s].
ARMED_S = 10.0
#: A stream may be this many times as fast as the arm, which is then slowed down behind it.
HEADROOM = 2.0
_LIMITS = LimitSettings()


class ReferenceGuard:
    """
    Turns references, as they arrive, into a target for every tick: of the tool or of the joints.

    The arm begins to follow a stream only if a motion begins near the robot, or after `arm`.
    Accepted references are followed, and extrapolated between two of them. When they end, the
    motion slows down and the pose is held. A stream that is followed must not jump.

    :ivar states: of the arm
    :ivar numbers: what it knows of its streams (`gdmp_ros.control.stream.STREAM`)
    :ivar held: where the newest reference was, if it was at rest
    """

    def __init__(self, settings: GuardSettings, pose: np.ndarray, damping_ratio: float,
                 joints: int = 0, states: ArmStates | None = None,
                 limits: LimitSettings = _LIMITS):
        """
        Hold a pose until the first reference.

        :param pose: (x, y, z, qw, qx, qy, qz)
        :param joints: number of joints, if references of the joints may be followed
        :param limits: of the arm
        :param states: of the arm; by default of one that does nothing but follow
        """
        self.numbers = stream.blank(joints)
        stopped = stream.newest(self.numbers)
        self._stream = records_at(self.numbers, 0, 1, stream.STREAM)[0]
        self.held = np.zeros(max(7, joints))
        self._use(settings, limits)
        self.states = states or ArmStates()
        self.states.watchers.append(self._entered)
        self._stream.state, self._stream.noted = stream.number_of(self.states.state), 1.0
        self._tool = PoseReferences(pose, damping_ratio, stopped.stopped[:6])
        self._joints = JointReferences(joints, damping_ratio, stopped.stopped_joints)
        self.forget_stream()
        self.restart(MeasuredMotion(pose.copy(), np.zeros(6)))

    def restart(self, robot: MeasuredMotion) -> None:
        """Hold the robot as after the start; a stream that runs already is not followed."""
        self.states.refused, self.states.last_refusal = 0, ''
        known = self._stream
        known.fresh = known.resumable = known.armed = 0.0
        known.age, known.sequence, known.delay = math.inf, 0.0, 0.0
        known.on_time, known.stop_progress = 0.0, 1.0
        self._far, self._distrusted = '', False
        self.states.take(Request.ACTIVATE)
        self._robot = robot
        self.hold(robot.pose)

    def forget_stream(self) -> None:
        """Take the next reference for the first one of its stream."""
        known = self._stream
        known.offered_mode, known.offered_sequence = StreamMode.ENDED, 0.0
        known.offered_age, known.offered_rests = math.inf, 0.0

    @property
    def following(self) -> bool:
        """Whether references are followed."""
        return self.states.state.follows

    @property
    def mode(self) -> ArmMode:
        """What the arm does, as it is reported."""
        return self.states.state.mode

    @property
    def in_joints(self) -> bool:
        """Whether the target is one of the joints (`gdmp_ros.control.joint_target`)."""
        return bool(self._stream.of_joints)

    @property
    def _kind(self) -> ReferenceKind:
        """What the target is of."""
        return self._joints if self.in_joints else self._tool

    @property
    def armed(self) -> bool:
        """Whether a motion is followed wherever it is (`arm`)."""
        return bool(self._stream.armed > 0.0)

    @property
    def targets(self) -> tuple[np.ndarray, np.ndarray]:
        """The targets of the tool and of the joints: the same arrays every time."""
        return self._tool.target, self._joints.target

    def offer(self, target: np.ndarray, origin: Origin) -> bool:
        """
        Accept a reference, or count and explain the refusal; the last good one stays valid.

        :param target: `TARGET_SIZE` numbers, or those of `gdmp_ros.control.joint_target`; the
            quaternion of an accepted one is normalised here
        :returns: whether it was accepted
        """
        kind, known, age = self._kind_of(target), self._stream, float(origin.age)
        if origin.frame == self.settings.frame:
            done = stream.go_on(self.numbers, kind.target, self.held, target, age,
                                float(origin.stamp), float(origin.sequence),
                                float(origin.mode))
            if done != stream.OTHER:
                return bool(done == stream.FOLLOWED)
        clocks_agree = known.on_time > 0.0 and _continues(origin, known.on_time)
        reason = refusal(origin, self.settings, clocks_agree)
        if is_on_time(origin, self.settings):
            known.on_time = origin.sequence
        if reason is None:
            reason = kind.invalid(target)
        if reason is None:
            reason = self._why_not(kind, target, origin)
        if reason is not None:
            if reason:
                self.refuse(reason)
            return False
        begins = not self.following
        known.of_joints = float(kind is self._joints)
        stream.use(self.numbers, kind.target, target, age, float(origin.stamp),
                   float(origin.sequence), begins)
        self._far = ''
        self.states.take(_request(origin))
        return True

    def observe(self, target: np.ndarray, origin: Origin) -> None:
        """Remember a reference that is not followed: its stream runs already."""
        kind = self._kind_of(target)
        if kind.invalid(target) is None:
            self._remember(kind, kind.place(target), origin)

    def _kind_of(self, target: np.ndarray) -> ReferenceKind:
        return self._tool if len(target) == TARGET_SIZE else self._joints

    def _remember(self, kind: ReferenceKind, place: np.ndarray, origin: Origin
                  ) -> tuple[bool, np.ndarray | None, float]:
        """
        Remember the newest reference; it tells where a motion begins.

        :param place: where it is
        :returns: whether a motion begins with it; where the same stream rested before, if it did,
            and how long ago: the first references of a motion may be lost
        """
        known, of_joints = self._stream, float(kind is self._joints)
        same = (known.offered_age <= self.settings.resume_time
                and _continues(origin, known.offered_sequence)
                and known.offered_of_joints == of_joints)
        begins = (origin.mode == StreamMode.STREAMING
                  and not (same and known.offered_mode == StreamMode.STREAMING))
        rested = (begins, self.held[:len(place)].copy() if same and known.offered_rests else None,
                  known.offered_age)
        stream.remember(self.numbers, float(origin.mode), float(origin.sequence), of_joints)
        if origin.mode == StreamMode.HOLDING:
            self.held[:len(place)] = place
        return rested

    def configure(self, settings: GuardSettings, limits: LimitSettings, damping_ratio: float
                  ) -> None:
        """Use other settings from now on; the damping ratio only while nothing is followed."""
        self._use(settings, limits)
        if not self.following:
            self._tool.damp(damping_ratio)
            self._joints.damp(damping_ratio)

    def _use(self, settings: GuardSettings, limits: LimitSettings) -> None:
        self.settings, known = settings, self._stream
        known.timeout, known.stamp_tolerance = settings.timeout, settings.stamp_tolerance
        known.stop_time = settings.stop_time
        known.jump_position, known.jump_rotation = settings.jump_position, settings.jump_rotation
        known.jump_joints = settings.jump_joints
        known.fastest, known.fastest_turn = (HEADROOM * limits.speed,
                                             HEADROOM * limits.angular_speed)

    def refuse(self, reason: str) -> None:
        """Count a reference that is not accepted, and keep the reason."""
        self.states.refuse(reason)

    @property
    def refused(self) -> int:
        """Number of references that were not accepted."""
        return self.states.refused

    @property
    def last_refusal(self) -> str:
        """Why the last one was not."""
        return self.states.last_refusal

    @property
    def reason(self) -> str:
        """Reason of a stop, of giving way or of a fault; empty if there is none."""
        return self.states.reason

    def arm(self) -> None:
        """
        Follow the motion that is streamed, wherever it is, or one that begins in `ARMED_S`.

        :raises ParameterError: if the arm does something else
        """
        self.states.take(Request.ARM)
        self._stream.armed = ARMED_S

    def stop(self, reason: str = '') -> None:
        """Stop smoothly and hold; the reason is kept until a motion begins."""
        self._stream.armed = self._stream.resumable = 0.0
        self.states.take(Request.STOP, reason)

    def fault(self, reason: str) -> None:
        """Hold the measured pose, and follow nothing until the fault has ended."""
        self.states.take(Request.FAILURE, reason)

    def _entered(self, before: State) -> None:
        """The state of the arm has changed, or not."""
        state, known = self.states.state, self._stream
        stops = known.noted and before.follows and state is State.STOPPING
        known.state, known.noted = stream.number_of(state), 1.0
        if state is before:
            return
        if state is State.FAULT:
            self.hold(self._robot.pose)
        elif before.follows and state is State.STOPPING:
            if stops:
                stream.begin_stop(self.numbers, self._tool.target, self._joints.target)
            if self.states.then is not State.HOLDING:
                known.armed = 0.0
        elif not (state.follows or before is State.STOPPING and state is State.HOLDING):
            self._forget()

    def hold(self, pose: np.ndarray) -> None:
        """Follow nothing, and hold a pose (x, y, z, qw, qx, qy, qz)."""
        self._forget()
        stream.rest_at(self.numbers, self._tool.target, pose)

    def target(self, dt: float, robot: MeasuredMotion | None = None) -> np.ndarray:
        """
        Target of this tick, ``dt`` after the last one.

        :param robot: where it is; None if that is not known
        :returns: `TARGET_SIZE` numbers, or those of the joints if `in_joints`; the same array
            every time
        """
        self.measure(dt, robot)
        stream.advance(self.numbers, self._tool.target, self._joints.target, dt)
        self.settle()
        return self._kind.target

    def settle(self) -> None:
        """Know that what was followed is lost, or rests after a stop."""
        known = self._stream
        if not known.noted:
            self.states.take(Request.LOST, f'{NO_REFERENCE} {self.settings.timeout:g} s')
            known.resumable = 1.0
        if self.states.state is State.STOPPING and known.stop_progress >= 1.0:
            self.states.take(Request.ARRIVED)

    def measure(self, dt: float, robot: MeasuredMotion | None) -> None:
        """Let ``dt`` pass, and remember where the robot is."""
        stream.elapse(self.numbers, dt)
        if robot is not None:
            self._robot = robot

    def _why_not(self, kind: ReferenceKind, target: np.ndarray, origin: Origin) -> str | None:
        """Why a valid reference is not followed; empty if that need not be told."""
        place, settings = kind.place(target), self.settings
        begins, held, ago = self._remember(kind, place, origin)
        # A stream that rests asks for nothing.
        busy = self.states.refusal(_request(origin))
        if busy is not None:
            return busy
        same = kind is self._kind
        if self.following or (same and self._resumes(origin)):
            gap = 0.0 if self.following else self._stream.age
            reason = self._out_of_sequence(origin)
            if reason is None and same:
                reason = self._jump(kind, place, target, gap)
            if reason is not None or (same and origin.mode != StreamMode.ENDED):
                return reason
            if same:
                self._stream.resumable = 0.0
                self.states.take(Request.LOST)
        if origin.mode != StreamMode.STREAMING:
            return ''
        if self.armed:
            return None
        if begins:
            self._far = (kind.far(place, target, self._robot, settings) if held is None else
                         kind.far(held, None, self._robot, settings)
                         or kind.jump(held, target, ago, settings) or '')
        elif not self._far:
            self._far = 'the stream began before the arm was ready for it'
        return None if begins and not self._far else (
            f'{self._far}: let a motion begin near the robot, or call ~/arm')

    def _resumes(self, origin: Origin) -> bool:
        """Whether the stream that was followed goes on after a short gap."""
        known = self._stream
        return bool(known.resumable and self.states.state in (State.STOPPING, State.HOLDING)
                    and known.age <= self.settings.resume_time
                    and _continues(origin, known.sequence))

    def _out_of_sequence(self, origin: Origin) -> str | None:
        last = self._stream.sequence
        if _continues(origin, last):
            return None
        return (f'sequence number {origin.sequence} does not follow {last:.0f}: there is '
                'more than one publisher of references')

    def _jump(self, kind: ReferenceKind, place: np.ndarray, target: np.ndarray, gap: float
              ) -> str | None:
        """Why a reference does not go on from the last one; None if it does."""
        if not self.following or kind is not self._tool:
            return kind.jump(kind.target, target, gap, self.settings)
        # As it came: the target has gone on since then, and late references come one by one.
        ways = pose_distance(stream.newest(self.numbers).place, place)
        for what, way, limit, unit in zip(('position', 'rotation'), ways,
                                          stream.allowance(self.numbers), ('m', 'rad')):
            if not way <= limit:
                return f'the {what} jumps by {way:.3g} {unit}, expected at most {limit:.3g}'
        return None

    def look(self) -> None:
        """Say once that the twists of a stream are not those of its poses."""
        newest = stream.newest(self.numbers)
        distrusted = self.following and bool((newest.distrusted > 0.0).any())
        if distrusted and not self._distrusted and newest.twist.any():
            self.refuse('the twist of the references is not that of their poses, and is not used: '
                        f'they are {1e3 * np.linalg.norm(newest.apart[:3]):.1f} mm and '
                        f'{np.linalg.norm(newest.apart[3:]):.3f} rad apart')
        self._distrusted = distrusted

    def _forget(self) -> None:
        """Follow nothing from now on."""
        known = self._stream
        known.armed = known.resumable = known.sequence = 0.0
        known.stop_progress = 1.0


def _continues(origin: Origin, last: float) -> bool:
    """Whether a reference continues a stream."""
    return bool(continues(float(origin.sequence), last))


def _request(origin: Origin) -> Request:
    return Request.MOTION if origin.mode == StreamMode.STREAMING else Request.REST
