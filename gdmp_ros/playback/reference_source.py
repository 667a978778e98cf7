"""The reference of every tick: at rest, on the way to the robot, or of a motion."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    STIFFNESS,
    TWIST,
    WRENCH,
    WRENCH_GAIN,
)
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.errors import GdmpError
from gdmp_ros.playback.approach import Approach
from gdmp_ros.playback.requests import Status
from gdmp_ros.playback.tool_skill import is_near, ToolSkill

#: Smallest initial tempo of a motion that takes over from another one.
LEAST_SPEED = 0.1
_AT_REST = 1e-6  # m/s, rad/s
#: A wrench that nothing asks for any more decreases with this time constant [s], to this [N, Nm].
RELEASE_S, RELEASED = 0.1, 1e-3
# Looked up once: this is done in every tick.
MOVING, PAUSED, STOPPING, HOLDING = (Status.MOVING, Status.PAUSED, Status.STOPPING,
                                     Status.HOLDING)


class ReferenceSource:
    """
    What a player does, tick by tick; only one thread changes it.

    :ivar playing: skill and settings of the present motion
    :ivar rollout: the present motion, also while its goal is held
    :ivar target: the reference of the last tick; None before the first one
    :ivar goal: point where the motion ends; where it was set, if it moves on
    :ivar goal_twist: with which the goal moves on; None if it rests
    :ivar motion: number of the motion that was begun last
    """

    def __init__(self, tool: ToolSkill, refuse: Callable[[str], None]):
        """:param refuse: called with the reason if a motion that had to wait is not possible"""
        self._refuse = refuse
        self.playing = tool
        self.status, self.motion = Status.IDLE, 0
        self.rollout: Rollout | None = None
        self.target: np.ndarray | None = None
        self.goal: np.ndarray | None = None
        self.goal_twist: np.ndarray | None = None
        self._speed = 1.0
        # Whether the reference has a wrench that no motion asks for any more.
        self._releases = False
        self._numbers = np.empty(0)
        self._approach: Approach | None = None
        self._then: list[Callable[[], None]] = []

    @property
    def mode(self) -> StreamMode:
        """What the stream of references says of itself: an arm begins to follow motions only."""
        rests = self.status is HOLDING and self.goal_twist is None
        holds = rests or self._approach is not None or self.target is None
        return StreamMode.HOLDING if holds else StreamMode.STREAMING

    def tick(self, dt: float) -> np.ndarray | None:
        """
        Let ``dt`` seconds pass.

        :returns: `gdmp_ros.control.target.TARGET_SIZE` numbers, valid until the next tick; None
            while there is nothing to hold
        """
        rollout, target = self.rollout, self.target
        if target is None:
            return None
        if self._approach is not None:
            if self._approach.advance(dt, target):
                self._approach = None
                self._do_then()
        elif rollout is not None:
            self.playing.advance(rollout, dt, self._numbers, target)
            if self.status is STOPPING:
                if rollout.speed == 0.0:
                    self.status, self.rollout, self._releases = HOLDING, None, True
                    target[TWIST:STIFFNESS] = 0.0
                    self._do_then()
            elif self.status is not PAUSED:
                self.status = HOLDING if rollout.finished else MOVING
        if self._releases:
            self._releases = _release(target, dt)
        return target

    def hold(self, target: np.ndarray | None) -> None:
        """Hold a reference at rest; None: nothing."""
        self.target, self.rollout, self.goal, self.goal_twist = target, None, None, None
        self.status, self._approach = Status.IDLE if target is None else HOLDING, None
        self._then = []

    def begin(self, tool: ToolSkill, rollout: Rollout, measured: np.ndarray | None, number: int
              ) -> None:
        """
        Begin a motion at the robot, or where the reference is if it moves or is near the robot.

        :param rollout: of the skill; begun here
        :param number: of the motion
        :raises GdmpError: if it cannot begin there; the reference rests then
        """
        self._approach = None
        if self.status is STOPPING and self._is_far(measured):
            # The robot does not follow: come to rest first, then go there.
            self._then = [lambda: self.begin(tool, rollout, measured, number)]
            return
        if self._approaches(measured):
            self._then = [lambda: self._begin(tool, rollout, None)]
            self.rollout, self.status, self._releases = None, MOVING, True
        else:
            try:
                self._begin(tool, rollout, measured)
            except GdmpError:
                self.motion = number
                raise
        # Set last: a thread that reads the new number then also reads the new motion.
        self.motion = number

    def retarget(self, pose: np.ndarray | None, stiffness: np.ndarray | None,
                 twist: np.ndarray | None) -> None:
        """Switch the goal of the motion."""
        if self._approach is not None:
            self._then.append(lambda: self.retarget(pose, stiffness, twist))
        rollout = self.rollout
        if rollout is None:
            return
        velocity = None if twist is None else self.playing.tangent_of_twist(twist)
        rollout.retarget(self.playing.changed(rollout.goal, pose, stiffness), velocity)
        self.goal, self.goal_twist = rollout.goal, twist

    def set_speed(self, scale: float) -> None:
        """Change the tempo of this motion and of the next ones."""
        self._speed = scale
        if self.rollout is not None and self.status in (MOVING, HOLDING):
            self.rollout.set_speed(scale)

    def pause(self, paused: bool) -> None:
        """Come to a smooth stop on the path, or continue."""
        before, after = (MOVING, PAUSED) if paused else (PAUSED, MOVING)
        if self.rollout is not None and self.status is before:
            self.status = after
            self.rollout.set_speed(0.0 if paused else self._speed)

    def stop(self) -> None:
        """Come to a smooth stop on the path and hold there."""
        if self._approach is not None and self.target is not None:
            self._approach, self.status = None, HOLDING
            self.target[TWIST:STIFFNESS] = 0.0
        self._then = []
        if self.rollout is not None:
            self.status = STOPPING
            self.rollout.set_speed(0.0)

    def observe(self, measured: np.ndarray) -> None:
        """Use the measured pose for phase stopping."""
        if self.rollout is None or not self.playing.settings.phase_stopping:
            return
        # Stiffness and wrench are not measured: those of the reference are taken.
        self.rollout.observe(self.playing.changed(self.rollout.state.point, measured))

    def _approaches(self, measured: np.ndarray | None) -> bool:
        """Go to the robot first, if it is far from a reference that rests."""
        in_motion = self.rollout is not None and self.status is not HOLDING
        if measured is None or self.target is None or in_motion or not self._is_far(measured):
            return False
        self._approach = Approach(self.target, measured)
        return True

    def _is_far(self, measured: np.ndarray | None) -> bool:
        return (measured is not None and self.target is not None
                and not is_near(self.target, measured))

    def _do_then(self) -> None:
        then, self._then = self._then, []
        for one in then:
            try:
                one()
            except GdmpError as error:
                self._refuse(str(error))

    def _begin(self, tool: ToolSkill, rollout: Rollout, measured: np.ndarray | None) -> None:
        try:
            target = self._begin_at(tool, rollout, measured)
        except GdmpError:
            self.rollout = None
            self.status = Status.IDLE if self.target is None else HOLDING
            raise
        rollout.set_speed(self._speed)
        self.playing, self.rollout, self.target = tool, rollout, target
        self.goal, self.goal_twist, self.status = rollout.goal, None, MOVING
        self._numbers = np.empty(rollout.state_size)

    def _begin_at(self, tool: ToolSkill, rollout: Rollout, measured: np.ndarray | None
                  ) -> np.ndarray:
        """Begin at the present reference, or where the robot is; returns the target to fill."""
        target = self.target
        if target is None:
            rollout.begin(tool.start_at(measured), speed=0.0)
            target = tool.first_target(tool.skill.start[:7])
        else:
            self._continue(tool, rollout, target)
            if tool.stiffness_size < 6:
                # With SPD(3) the skill changes the translational block only.
                block = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
                block[:] = tool.settings.stiffness_matrix
        self._releases = not tool.has_wrench
        target[DAMPING_RATIO] = tool.settings.damping_ratio
        target[WRENCH_GAIN:] = tool.settings.wrench_gain if tool.has_wrench else 0.0
        return target

    def _continue(self, tool: ToolSkill, rollout: Rollout, target: np.ndarray) -> None:
        """Begin with the position, velocity and acceleration of the present reference."""
        start = tool.point_of(target)
        if np.abs(target[TWIST:TWIST + 6]).max() < _AT_REST:
            rollout.begin(start, speed=0.0)
            return
        rollout.begin(start, tool.tangent_of(target, TWIST), tool.tangent_of(target, ACCELERATION),
                      max(LEAST_SPEED, min(self._speed, 1.0)))


def _release(target: np.ndarray, dt: float) -> bool:
    """Let the wrench of a reference decrease; whether there is some left."""
    wrench = target[WRENCH:WRENCH + 6]
    wrench *= max(1.0 - dt / RELEASE_S, 0.0)
    if np.abs(wrench).max() > RELEASED:
        return True
    target[WRENCH:] = 0.0
    return False
