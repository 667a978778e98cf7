"""Reference guard: decides which references an arm follows, and stops it when they end."""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.control.reference_check import continues, NewestReference, Origin, refusal
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    extrapolate_pose,
    POSE,
    resting_target,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
    WRENCH,
)
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.util.profiles import smoothstep

#: Time for which the acceleration of the last reference is used between two references [s].
ACCELERATION_S = 0.01
#: After `ReferenceGuard.arm` a motion must begin within this time [s].
ARMED_S = 10.0


class ReferenceGuard:
    """
    Turns references, as they arrive, into a target for every tick.

    The arm begins to follow a stream only if a motion begins near the robot, or after `arm`.
    Accepted references are followed, and extrapolated between two of them. When they end, the
    motion slows down and the pose is held. A stream that is followed must not jump.

    :ivar mode: ``HOLD``, ``FOLLOW``, ``GUIDED``, ``IDENTIFY``, ``MOVE`` (see `hold`),
        ``COMPLIANT`` (`comply`) or ``FAULT`` (`fault`)
    :ivar reason: of a stop, of a compliant arm or of a fault; empty if there is none
    """

    def __init__(self, settings: GuardSettings, pose: np.ndarray, damping_ratio: float):
        """
        Hold a pose until the first reference.

        :param pose: (x, y, z, qw, qx, qy, qz)
        """
        self.settings = settings
        self._target = resting_target(pose, damping_ratio=damping_ratio)
        self._offered = NewestReference()
        self.restart(pose)

    def restart(self, pose: np.ndarray) -> None:
        """Hold a pose as after the start; a stream that runs already is not followed."""
        self.refused = 0
        self.last_refusal = self.reason = ''
        self._fresh = self._resumable = False
        self._armed_s = 0.0
        self._age, self._sequence = math.inf, 0
        self._far = ''
        self._last_twist, self._last_wrench = np.zeros(6), np.zeros(TARGET_SIZE - WRENCH)
        self.mode = ArmMode.HOLD
        self._pose, self._twist = pose.copy(), np.zeros(6)
        self.hold(pose)

    @property
    def following(self) -> bool:
        """Whether references are followed."""
        return self.mode is ArmMode.FOLLOW

    @property
    def armed(self) -> bool:
        """Whether a motion is followed wherever it is (`arm`)."""
        return self._armed_s > 0.0

    def offer(self, target: np.ndarray, origin: Origin) -> bool:
        """
        Accept a reference, or count and explain the refusal; the last good one stays valid.

        :param target: `TARGET_SIZE` numbers; the quaternion of an accepted one is normalised here
        :returns: whether it was accepted
        """
        reason = refusal(target, origin, self.settings)
        if reason is None:
            quaternion = target[POSE + 3:POSE + 7]
            quaternion /= math.sqrt(quaternion @ quaternion)
            reason = self._why_not(target, origin)
        if reason is not None:
            if reason:
                self.refuse(reason)
            return False
        self._target[:] = target
        self.mode, self.reason, self._far = ArmMode.FOLLOW, '', ''
        self._fresh = self._resumable = True
        self._armed_s, self._age, self._sequence = 0.0, 0.0, origin.sequence
        return True

    def configure(self, settings: GuardSettings, damping_ratio: float) -> None:
        """Use other settings from now on; the damping ratio only while nothing is followed."""
        self.settings = settings
        if not self.following:
            self._target[DAMPING_RATIO] = damping_ratio

    def refuse(self, reason: str) -> None:
        """Count a reference that is not accepted, and keep the reason."""
        self.refused += 1
        self.last_refusal = reason

    def arm(self) -> None:
        """Follow the motion that is streamed, wherever it is, or one that begins in `ARMED_S`."""
        self._armed_s = ARMED_S
        self._leave_compliance()

    def stop(self, reason: str = '') -> None:
        """Stop smoothly and hold; the reason is kept until a motion begins."""
        self._armed_s, self._resumable = 0.0, False
        self._leave_compliance()
        if self.following:
            self._begin_stop()
        self.reason = reason

    def comply(self, reason: str) -> None:
        """Stop and give way, until `stop`, `arm`, or a motion that begins near the robot."""
        if self.mode is not ArmMode.FAULT:
            self._forget()
            self.mode, self.reason = ArmMode.COMPLIANT, reason

    def fault(self, reason: str) -> None:
        """Hold the measured pose, and follow nothing until `recover`."""
        self.hold(self._pose)
        self.mode, self.reason = ArmMode.FAULT, reason

    def recover(self) -> None:
        """End a fault; the arm goes on holding."""
        if self.mode is ArmMode.FAULT:
            self._forget()
            self.mode, self.reason = ArmMode.HOLD, ''

    def hold(self, pose: np.ndarray, mode: ArmMode = ArmMode.HOLD) -> None:
        """
        Follow nothing, and hold a pose (x, y, z, qw, qx, qy, qz); a fault stays.

        :param mode: why nothing is followed until the next tick
        """
        self._forget()
        self._target[:STIFFNESS] = 0.0
        self._target[WRENCH:] = 0.0
        self._target[POSE:POSE + 7] = pose
        if self.mode not in (ArmMode.FAULT, ArmMode.COMPLIANT):
            self.mode = mode

    def target(self, dt: float, pose: np.ndarray | None = None, twist: np.ndarray | None = None
               ) -> np.ndarray:
        """
        Target of this tick, ``dt`` after the last one.

        :param pose: measured, (x, y, z, qw, qx, qy, qz); None if it is not known
        :param twist: measured [m/s, rad/s]
        :returns: `TARGET_SIZE` numbers, the same array every time
        """
        self.measure(dt, pose, twist)
        if self.mode in (ArmMode.GUIDED, ArmMode.IDENTIFY, ArmMode.MOVE):
            self.mode = ArmMode.HOLD
        if self.following and self._age > self.settings.timeout + 1e-9:
            self._begin_stop()
        if not self.following:
            self._slow_down(dt)
        elif not self._fresh:
            self._extrapolate(dt)
        self._fresh = False
        self._age += dt
        return self._target

    def measure(self, dt: float, pose: np.ndarray | None, twist: np.ndarray | None) -> None:
        """Let ``dt`` pass, and remember where the robot is."""
        self._offered.age += dt
        self._armed_s -= dt
        if pose is not None and twist is not None:
            self._pose, self._twist = pose, twist

    def _why_not(self, target: np.ndarray, origin: Origin) -> str | None:
        """Why a valid reference is not followed; empty if that need not be told."""
        begins, held, ago = self._offered.add(target, origin, self.settings.resume_time)
        if self.mode is ArmMode.FAULT:
            return f'the arm is in a fault ({self.reason}): call ~/recover'
        if self.mode is ArmMode.GUIDED:
            return 'the arm is guided by hand (~/teach)'
        if self.mode is ArmMode.IDENTIFY:
            return 'the friction of the joints is being identified (~/identify_friction)'
        if self.mode is ArmMode.MOVE:
            return 'the joints move to a posture (~/move_joints)'
        if self.following or self._resumes(origin):
            gap = 0.0 if self.following else self._age
            reason = self._out_of_sequence(origin) or self._jump(self._target, target, gap)
            if origin.mode != StreamMode.ENDED or reason is not None:
                return reason
            self.stop()
        if origin.mode != StreamMode.STREAMING:
            return ''
        if self.armed:
            return None
        if begins:
            self._far = (self._distance(target, target[TWIST:TWIST + 6]) if held is None else
                         self._distance(held, np.zeros(6)) or self._jump(held, target, ago) or '')
        elif not self._far:
            self._far = 'the stream began before the arm was ready for it'
        return None if begins and not self._far else (
            f'{self._far}: let a motion begin near the robot, or call ~/arm')

    def _resumes(self, origin: Origin) -> bool:
        """Whether the stream that was followed goes on after a short gap."""
        return (self._resumable and self.mode is ArmMode.HOLD
                and self._age <= self.settings.resume_time
                and continues(origin.sequence, self._sequence))

    def _distance(self, pose: np.ndarray, twist: np.ndarray) -> str:
        """Why the beginning of a motion is too far from the robot; empty if it is not."""
        settings = self.settings
        distance, angle = pose_distance(self._pose, pose)
        slip = twist - self._twist
        for what, value, limit, unit in (
                ('begins', distance, settings.arming_position, 'm from the robot'),
                ('begins', angle, settings.arming_rotation, 'rad from the robot'),
                ('differs by', float(np.linalg.norm(slip[:3])), settings.arming_speed,
                 'm/s from the velocity of the robot'),
                ('differs by', float(np.linalg.norm(slip[3:])), settings.arming_angular_speed,
                 'rad/s from the velocity of the robot')):
            if not value <= limit:
                return f'the motion {what} {value:.3g} {unit}, expected at most {limit:g}'
        return ''

    def _out_of_sequence(self, origin: Origin) -> str | None:
        if continues(origin.sequence, self._sequence):
            return None
        return (f'sequence number {origin.sequence} does not follow {self._sequence}: there is '
                'more than one publisher of references')

    def _jump(self, last: np.ndarray, target: np.ndarray, gap: float) -> str | None:
        """Why a reference does not continue from the last one; after a gap it may be further."""
        settings = self.settings
        distance, angle = pose_distance(last, target)
        for what, value, first, limit, unit in (
                ('position', distance, TWIST, settings.jump_position, 'm'),
                ('rotation', angle, TWIST + 3, settings.jump_rotation, 'rad')):
            if gap:
                limit += gap * max(float(np.linalg.norm(numbers))
                                   for numbers in (target[first:first + 3],
                                                   self._last_twist[first - TWIST:][:3]))
            if not value <= limit:
                return f'the {what} jumps by {value:.3g} {unit}, expected at most {limit:.3g}'
        return None

    def _forget(self) -> None:
        """Follow nothing from now on."""
        self._armed_s, self._resumable = 0.0, False
        self._stop_progress, self._sequence = 1.0, 0

    def _leave_compliance(self) -> None:
        if self.mode is ArmMode.COMPLIANT:
            self.mode, self.reason = ArmMode.HOLD, ''

    def _begin_stop(self) -> None:
        self.mode = ArmMode.HOLD
        self._stop_progress = 0.0
        self._last_twist = self._target[TWIST:TWIST + 6].copy()
        self._last_wrench = self._target[WRENCH:].copy()

    def _extrapolate(self, dt: float) -> None:
        target = self._target
        if self.following and self._age <= ACCELERATION_S:
            target[TWIST:TWIST + 6] += dt * target[ACCELERATION:ACCELERATION + 6]
        else:
            target[ACCELERATION:ACCELERATION + 6] = 0.0
        extrapolate_pose(target, dt, target[POSE:POSE + 7])

    def _slow_down(self, dt: float) -> None:
        """Reduce the last velocity and wrench to zero within the stop time."""
        if self._stop_progress >= 1.0:
            return
        self._stop_progress = min(1.0, self._stop_progress + dt / self.settings.stop_time)
        left = 1.0 - smoothstep(self._stop_progress)
        self._target[TWIST:TWIST + 6] = left * self._last_twist
        self._target[WRENCH:] = left * self._last_wrench
        self._extrapolate(dt)
