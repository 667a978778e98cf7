"""
What references are of: of the tool's pose, or of the joints.

A kind knows what the numbers of its targets mean; the guard (`gdmp_ros.control.guard`) decides by
it which streams are followed.
"""
from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from gdmp_ros.control.joint_target import joint_target_size, MOST_STIFFNESS, resting_joints
from gdmp_ros.control.reference_check import (
    invalid_target,
    is_invalid_for_joints,
    LARGEST_DAMPING_RATIO,
    LARGEST_RATE,
)
from gdmp_ros.control.settings import GuardSettings
from gdmp_ros.control.target import (
    DAMPING_RATIO,
    POSE,
    resting_target,
    TWIST,
)
from gdmp_ros.manifolds.quaternion import normalize, pose_distance

#: Stiffness with which the joints are held before the first reference of the joints [Nm/rad].
HOLD_JOINT_STIFFNESS = 200.0
#: The first references of a motion may be lost for this time [s].
LOST_S = 0.2


class MeasuredMotion(NamedTuple):
    """
    Where the robot is.

    :ivar pose: of the tool (x, y, z, qw, qx, qy, qz)
    :ivar twist: of the tool [m/s, rad/s]
    :ivar position: of the joints [rad]; empty if it is not known
    :ivar velocity: of the joints [rad/s]
    """

    pose: np.ndarray
    twist: np.ndarray
    position: np.ndarray = np.empty(0)
    velocity: np.ndarray = np.empty(0)


class ReferenceKind(Protocol):
    """
    One kind of references.

    :ivar target: the newest target; `gdmp_ros.control.stream` moves it on
    """

    target: np.ndarray

    def invalid(self, target: np.ndarray) -> str | None:
        """Why a target cannot be followed at all; None if it can. What must be is normalised."""

    def place(self, target: np.ndarray) -> np.ndarray:
        """Copy of the part of a target that says where it is."""

    def far(self, place: np.ndarray, target: np.ndarray | None, robot: MeasuredMotion,
            settings: GuardSettings) -> str:
        """
        Why the beginning of a motion is too far from the robot; empty if it is not.

        :param place: where it begins
        :param target: with its velocity; None at rest
        """

    def jump(self, last: np.ndarray, target: np.ndarray, gap: float, settings: GuardSettings
             ) -> str | None:
        """
        Why a target does not continue from the last place; None if it does.

        In a gap a motion may have gone on as before. One that begins in it may have gone half the
        way of its velocity, for at most `LOST_S`.

        :param last: where the last one was: a target; or a place at rest
        :param gap: time in between in which there were no references [s]
        """

    def damp(self, ratio: float) -> None:
        """Use a damping ratio while nothing is followed."""


class PoseReferences:
    """References of the tool's pose: `TARGET_SIZE` numbers."""

    def __init__(self, pose: np.ndarray, damping_ratio: float, stopped: np.ndarray):
        """:param stopped: twist with which the target began to come to rest [m/s, rad/s]"""
        self.target = resting_target(pose, damping_ratio=damping_ratio)
        self._stopped = stopped

    def invalid(self, target: np.ndarray) -> str | None:
        """Why a target cannot be followed at all; None if it can. What must be is normalised."""
        reason = invalid_target(target)
        if reason is None:
            normalize(target[POSE + 3:POSE + 7])
        return reason

    def place(self, target: np.ndarray) -> np.ndarray:
        """Copy of the part of a target that says where it is."""
        return target[POSE:POSE + 7].copy()

    def far(self, place: np.ndarray, target: np.ndarray | None, robot: MeasuredMotion,
            settings: GuardSettings) -> str:
        """Why the beginning of a motion is too far from the robot; empty if it is not."""
        distance, angle = pose_distance(robot.pose, place)
        slip = (0.0 if target is None else target[TWIST:TWIST + 6]) - robot.twist
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

    def jump(self, last: np.ndarray, target: np.ndarray, gap: float, settings: GuardSettings
             ) -> str | None:
        """Why a target does not continue from the last place; None if it does."""
        distance, angle = pose_distance(last, target)
        for what, value, first, limit, unit in (
                ('position', distance, TWIST, settings.jump_position, 'm'),
                ('rotation', angle, TWIST + 3, settings.jump_rotation, 'rad')):
            if len(last) == len(target):
                limit += gap * float(np.linalg.norm(self._stopped[first - TWIST:][:3]))
            else:
                limit += 0.5 * min(gap, LOST_S) * float(np.linalg.norm(target[first:first + 3]))
            if not value <= limit:
                return f'the {what} jumps by {value:.3g} {unit}, expected at most {limit:.3g}'
        return None

    def damp(self, ratio: float) -> None:
        """Use a damping ratio while nothing is followed."""
        self.target[DAMPING_RATIO] = ratio


class JointReferences:
    """References of n joints: `joint_target_size` numbers."""

    def __init__(self, joints: int, damping_ratio: float, stopped: np.ndarray):
        """:param stopped: velocities with which the target began to come to rest [rad/s]"""
        self.target = resting_joints(np.zeros(joints), np.full(joints, HOLD_JOINT_STIFFNESS),
                                     damping_ratio)
        self._n, self._stopped = joints, stopped

    def invalid(self, target: np.ndarray) -> str | None:
        """Why a target cannot be followed at all; None if it can. What must be is normalised."""
        n = self._n
        if len(target) != joint_target_size(n):
            return (f'a reference of {(len(target) - 1) // 3} joints, the arm has {n}' if n else
                    'references of the joints are not followed')
        velocity, stiffness, ratio = target[n:2 * n], target[2 * n:3 * n], target[-1]
        if not is_invalid_for_joints(target):
            return None
        if not np.isfinite(target).all():
            return 'a number of a joint is NaN or infinite'
        if not np.abs(velocity).max() <= LARGEST_RATE:
            return (f'the velocity of a joint is {np.abs(velocity).max():.3g} rad/s, expected at '
                    f'most {LARGEST_RATE:g}')
        if not (stiffness.min() > 0.0 and stiffness.max() <= MOST_STIFFNESS):
            wrong = stiffness.min() if not stiffness.min() > 0.0 else stiffness.max()
            return (f'the stiffness of a joint is {wrong:.3g} Nm/rad, expected more than 0, at '
                    f'most {MOST_STIFFNESS:g}')
        return f'damping ratio is {ratio:.3g}, expected 0 to {LARGEST_DAMPING_RATIO:g}'

    def place(self, target: np.ndarray) -> np.ndarray:
        """Copy of the part of a target that says where it is."""
        return target[:self._n].copy()

    def far(self, place: np.ndarray, target: np.ndarray | None, robot: MeasuredMotion,
            settings: GuardSettings) -> str:
        """Why the beginning of a motion is too far from the robot; empty if it is not."""
        n = self._n
        distance = np.abs(robot.position - place)
        slip = np.abs((0.0 if target is None else target[n:2 * n]) - robot.velocity)
        for what, values, limit, unit in (
                ('begins', distance, settings.arming_joints, 'rad from the robot'),
                ('differs by', slip, settings.arming_angular_speed,
                 'rad/s from the velocity of the robot')):
            if not values.max() <= limit:
                joint = int(np.argmax(values)) + 1
                return (f'the motion of joint {joint} {what} {values.max():.3g} {unit}, expected '
                        f'at most {limit:g}')
        return ''

    def jump(self, last: np.ndarray, target: np.ndarray, gap: float, settings: GuardSettings
             ) -> str | None:
        """Why a target does not continue from the last place; None if it does."""
        n = self._n
        step = np.abs(target[:n] - last[:n])
        if len(last) == len(target):
            way = gap * float(np.abs(self._stopped).max(initial=0.0))
        else:
            way = 0.5 * min(gap, LOST_S) * float(np.abs(target[n:2 * n]).max(initial=0.0))
        limit = settings.jump_joints + way
        if step.max() <= limit:
            return None
        return (f'joint {int(np.argmax(step)) + 1} jumps by {step.max():.3g} rad, expected at '
                f'most {limit:.3g}')

    def damp(self, ratio: float) -> None:
        """Use a damping ratio while nothing is followed."""
        self.target[-1] = ratio
