"""Reference guard: decides which references an arm follows, and stops it when they end."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.arm_states import ArmStates, Request, State
from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.control.reference_check import (
    continues,
    is_on_time,
    NewestReference,
    Origin,
    refusal,
)
from gdmp_ros.control.reference_kinds import (
    JointReferences,
    MeasuredMotion,
    PoseReferences,
    ReferenceKind,
)
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.util.profiles import smoothstep

#: Reason of a stop because the stream has ended without saying so.
NO_REFERENCE = 'no reference for'
#: After `ReferenceGuard.arm` a motion must begin within this time [s].
ARMED_S = 10.0
#: The usual delay of references is the mean of about so many, and of none before a gap [s].
DELAY_SHARE, DELAY_GAP_S = 0.02, 0.05
#: A reference that is further from its usual time is followed as it is [s].
LARGEST_SHIFT_S = 0.02


class ReferenceGuard:
    """
    Turns references, as they arrive, into a target for every tick: of the tool or of the joints.

    The arm begins to follow a stream only if a motion begins near the robot, or after `arm`.
    Accepted references are followed, and extrapolated between two of them. When they end, the
    motion slows down and the pose is held. A stream that is followed must not jump.

    :ivar states: of the arm
    """

    def __init__(self, settings: GuardSettings, pose: np.ndarray, damping_ratio: float,
                 joints: int = 0, states: ArmStates | None = None):
        """
        Hold a pose until the first reference.

        :param pose: (x, y, z, qw, qx, qy, qz)
        :param joints: number of joints, if references of the joints may be followed
        :param states: of the arm; by default of one that does nothing but follow
        """
        self.settings = settings
        self.states = states or ArmStates()
        self.states.watchers.append(self._entered)
        self._tool = PoseReferences(pose, damping_ratio)
        self._joints = JointReferences(joints, damping_ratio)
        self._kind: ReferenceKind = self._tool
        self.forget_stream()
        self.restart(MeasuredMotion(pose.copy(), np.zeros(6)))

    def restart(self, robot: MeasuredMotion) -> None:
        """Hold the robot as after the start; a stream that runs already is not followed."""
        self.states.refused, self.states.last_refusal = 0, ''
        self._fresh = self._resumable = False
        self._armed_s = 0.0
        self._age, self._sequence, self._delay = math.inf, 0, 0.0
        # Sequence number of the last reference that was on time.
        self._on_time = 0
        self._far = ''
        self._stop_progress = 1.0
        self.states.take(Request.ACTIVATE)
        self._robot = robot
        self.hold(robot.pose)

    def forget_stream(self) -> None:
        """Take the next reference for the first one of its stream."""
        self._offered = NewestReference()

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
        return self._kind is self._joints

    @property
    def armed(self) -> bool:
        """Whether a motion is followed wherever it is (`arm`)."""
        return self._armed_s > 0.0

    def offer(self, target: np.ndarray, origin: Origin) -> bool:
        """
        Accept a reference, or count and explain the refusal; the last good one stays valid.

        :param target: `TARGET_SIZE` numbers, or those of `gdmp_ros.control.joint_target`; the
            quaternion of an accepted one is normalised here
        :returns: whether it was accepted
        """
        kind = self._kind_of(target)
        known = self._on_time > 0 and continues(origin.sequence, self._on_time)
        reason = refusal(origin, self.settings, known)
        if is_on_time(origin, self.settings):
            self._on_time = origin.sequence
        if reason is None:
            reason = kind.invalid(target)
        if reason is None:
            reason = self._why_not(kind, target, origin)
        if reason is not None:
            if reason:
                self.refuse(reason)
            return False
        self._even_out(kind, target, origin.age)
        self._kind, self._far = kind, ''
        self.states.take(_request(origin))
        self._fresh = self._resumable = True
        self._armed_s, self._age, self._sequence = 0.0, 0.0, origin.sequence
        return True

    def observe(self, target: np.ndarray, origin: Origin) -> None:
        """Remember a reference that is not followed: its stream runs already."""
        kind = self._kind_of(target)
        if kind.invalid(target) is None:
            self._offered.add(kind, kind.place(target), origin, self.settings.resume_time)

    def _kind_of(self, target: np.ndarray) -> ReferenceKind:
        return self._tool if len(target) == TARGET_SIZE else self._joints

    def _even_out(self, kind: ReferenceKind, target: np.ndarray, age: float) -> None:
        """
        Use a reference; one later, or earlier, than usual is moved to where it would be now.

        Otherwise one that was delayed by a millisecond would be a step of the motion.
        """
        kind.target[:] = target
        if not self.following or self._age > DELAY_GAP_S:
            self._delay = age
        shift = age - self._delay
        self._delay += DELAY_SHARE * shift
        if 0.0 < abs(shift) <= LARGEST_SHIFT_S:
            kind.extrapolate(shift, 0.0)

    def configure(self, settings: GuardSettings, damping_ratio: float) -> None:
        """Use other settings from now on; the damping ratio only while nothing is followed."""
        self.settings = settings
        if not self.following:
            self._tool.damp(damping_ratio)
            self._joints.damp(damping_ratio)

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
        self._armed_s = ARMED_S

    def stop(self, reason: str = '') -> None:
        """Stop smoothly and hold; the reason is kept until a motion begins."""
        self._armed_s, self._resumable = 0.0, False
        self.states.take(Request.STOP, reason)

    def fault(self, reason: str) -> None:
        """Hold the measured pose, and follow nothing until the fault has ended."""
        self.states.take(Request.FAILURE, reason)

    def _entered(self, before: State) -> None:
        """The state of the arm has changed, or not."""
        state = self.states.state
        if state is before:
            return
        if state is State.FAULT:
            self.hold(self._robot.pose)
        elif before.follows and state is State.STOPPING:
            self._stop_progress, self._resumable = 0.0, False
            self._kind.begin_stop()
            if self.states.then is not State.HOLDING:
                self._armed_s = 0.0
        elif not (state.follows or before is State.STOPPING and state is State.HOLDING):
            self._forget()

    def hold(self, pose: np.ndarray) -> None:
        """Follow nothing, and hold a pose (x, y, z, qw, qx, qy, qz)."""
        self._forget()
        self._kind = self._tool
        self._tool.rest_at(self._robot._replace(pose=pose))

    def target(self, dt: float, robot: MeasuredMotion | None = None) -> np.ndarray:
        """
        Target of this tick, ``dt`` after the last one.

        :param robot: where it is; None if that is not known
        :returns: `TARGET_SIZE` numbers, or those of the joints if `in_joints`; the same array
            every time
        """
        self.measure(dt, robot)
        if self.following and self._age > self.settings.timeout + 1e-9:
            self.states.take(Request.LOST, f'{NO_REFERENCE} {self.settings.timeout:g} s')
            self._resumable = True
        if not self.following:
            self._slow_down(dt)
        elif not self._fresh:
            self._kind.extrapolate(dt, self._age)
        self._fresh = False
        self._age += dt
        return self._kind.target

    def measure(self, dt: float, robot: MeasuredMotion | None) -> None:
        """Let ``dt`` pass, and remember where the robot is."""
        self._offered.age += dt
        self._armed_s -= dt
        if robot is not None:
            self._robot = robot

    def _why_not(self, kind: ReferenceKind, target: np.ndarray, origin: Origin) -> str | None:
        """Why a valid reference is not followed; empty if that need not be told."""
        place, settings = kind.place(target), self.settings
        begins, held, ago = self._offered.add(kind, place, origin, settings.resume_time)
        # A stream that rests asks for nothing.
        busy = self.states.refusal(_request(origin))
        if busy is not None:
            return busy
        same = kind is self._kind
        if self.following or (same and self._resumes(origin)):
            gap = 0.0 if self.following else self._age
            reason = self._out_of_sequence(origin)
            if reason is None and same:
                reason = kind.jump(kind.target, target, gap, settings)
            if reason is not None or (same and origin.mode != StreamMode.ENDED):
                return reason
            if same:
                self._resumable = False
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
        return (self._resumable and self.states.state in (State.STOPPING, State.HOLDING)
                and self._age <= self.settings.resume_time
                and continues(origin.sequence, self._sequence))

    def _out_of_sequence(self, origin: Origin) -> str | None:
        if continues(origin.sequence, self._sequence):
            return None
        return (f'sequence number {origin.sequence} does not follow {self._sequence}: there is '
                'more than one publisher of references')

    def _forget(self) -> None:
        """Follow nothing from now on."""
        self._armed_s, self._resumable = 0.0, False
        self._stop_progress, self._sequence = 1.0, 0

    def _slow_down(self, dt: float) -> None:
        """Reduce the last velocity and wrench to zero within the stop time."""
        if self._stop_progress >= 1.0:
            return
        self._stop_progress = min(1.0, self._stop_progress + dt / self.settings.stop_time)
        left = 1.0 - smoothstep(self._stop_progress)
        self._kind.slow_down(left, dt)
        if self._stop_progress >= 1.0 and self.states.state is State.STOPPING:
            self.states.take(Request.ARRIVED)


def _request(origin: Origin) -> Request:
    return Request.MOTION if origin.mode == StreamMode.STREAMING else Request.REST
