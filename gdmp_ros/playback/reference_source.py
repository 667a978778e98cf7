"""The reference of every tick: at rest, on the way to the robot, or of a motion."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.playback.requests import Status
from gdmp_ros.playback.streamed_skill import StreamedSkill, Way

#: Smallest initial tempo of a motion that takes over from another one.
LEAST_SPEED = 0.1
# Looked up once: this is done in every tick.
MOVING, PAUSED, STOPPING, HOLDING = Status.MOVING, Status.PAUSED, Status.STOPPING, Status.HOLDING


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

    def __init__(self, tool: StreamedSkill, refuse: Callable[[str], None]):
        """:param refuse: called with the reason if a motion that had to wait is not possible"""
        self._refuse = refuse
        self.playing = tool
        self.status, self.motion = Status.IDLE, 0
        self.rollout: Rollout | None = None
        self.target: np.ndarray | None = None
        self.goal: np.ndarray | None = None
        self.goal_twist: np.ndarray | None = None
        self._speed, self._waits = 1.0, False
        # Tempo of the present motion only, and cycles after which it ends; None for neither.
        self._own_speed: float | None = None
        self._cycles: float | None = None
        # Whether the reference has a wrench that no motion asks for any more.
        self._releases = False
        self._numbers = np.empty(0)
        self._approach: Way | None = None
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

        :returns: numbers of the target, valid until the next tick; None while there is nothing to
            hold
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
            if self._cycles is not None and rollout.progress >= self._cycles:
                self._cycles = None
                rollout.set_amplitude(0.0)
            if self.status is STOPPING:
                if rollout.speed == 0.0:
                    self.status, self.rollout, self._releases = HOLDING, None, True
                    self.playing.stop(target)
                    self._do_then()
            elif self.status is not PAUSED:
                self.status = HOLDING if rollout.finished else MOVING
        if self._releases:
            self._releases = self.playing.release(target, dt)
        return target

    def hold(self, target: np.ndarray | None, tool: StreamedSkill | None = None) -> None:
        """
        Hold a reference at rest; None: nothing.

        :param tool: what the reference is of, if that is not as before
        """
        if tool is not None:
            self.playing = tool
        self.target, self.rollout, self.goal, self.goal_twist = target, None, None, None
        self.status, self._approach = Status.IDLE if target is None else HOLDING, None
        self._then = []

    def begin(self, tool: StreamedSkill, rollout: Rollout, measured: np.ndarray | None,
              number: int, cycles: float | None = None) -> None:
        """
        Begin a motion at the robot, or where the reference is if it moves or is near the robot.

        :param rollout: of the skill; begun here
        :param number: of the motion
        :param cycles: of a rhythmic motion, before it comes to rest at its centre
        :raises GdmpError: if it cannot begin there; the reference rests then
        """
        self._approach = None
        if tool.kind is not self.playing.kind:
            try:
                self._change_kind()
            except GdmpError:
                self.motion = number
                raise
        if self.status is STOPPING and self._is_far(measured):
            # The robot does not follow: come to rest first, then go there.
            self._then = [lambda: self.begin(tool, rollout, measured, number, cycles)]
            return
        if self._approaches(measured):
            self._then = [lambda: self._begin(tool, rollout, None, cycles)]
            self.rollout, self.status, self._releases = None, MOVING, True
        else:
            try:
                self._begin(tool, rollout, measured, cycles)
            except GdmpError:
                self.motion = number
                raise
        # Set last: a thread that reads the new number then also reads the new motion.
        self.motion = number

    def _change_kind(self) -> None:
        """
        The next motion is of another kind than the present reference.

        :raises ParameterError: if it moves
        """
        if self.status not in (Status.IDLE, HOLDING):
            raise ParameterError(f'a motion of {self.playing.kind.value} is being executed: stop '
                                 'it first')
        # The motion begins where the robot is.
        self.hold(None)

    def retarget(self, place: np.ndarray | None, stiffness: np.ndarray | None,
                 twist: np.ndarray | None) -> None:
        """Switch the goal of the motion."""
        if self._approach is not None:
            self._then.append(lambda: self.retarget(place, stiffness, twist))
        rollout = self.rollout
        if rollout is None:
            return
        velocity = None if twist is None else self.playing.tangent_of_twist(twist)
        rollout.retarget(self.playing.changed(rollout.goal, place, stiffness), velocity)
        self.goal, self.goal_twist = rollout.goal, twist

    def set_speed(self, scale: float) -> None:
        """Change the tempo of this motion and of the next ones."""
        self._speed, self._own_speed = scale, None
        if self.rollout is not None and self.status in (MOVING, HOLDING):
            self.rollout.set_speed(self._tempo)

    def pause(self, paused: bool) -> None:
        """Come to a smooth stop on the path, or continue."""
        before, after = (MOVING, PAUSED) if paused else (PAUSED, MOVING)
        if self.rollout is not None and self.status is before:
            self.status = after
            self.rollout.set_speed(0.0 if paused else self._tempo)

    def wait(self, waits: bool) -> None:
        """Come to a smooth stop on the path until something else has happened, or go on."""
        self._waits = waits
        if self.rollout is not None and self.status is MOVING:
            self.rollout.set_speed(self._tempo)

    def set_frequency(self, frequency: float) -> None:
        """Change the frequency of this motion [Hz]."""
        if self._then:
            self._then.append(lambda: self.set_frequency(frequency))
        elif self.rollout is not None:
            if self.status in (MOVING, HOLDING) and not self._waits:
                self.rollout.set_frequency(frequency)
            self._own_speed = frequency * self.rollout.duration

    def set_amplitude(self, amplitude: float) -> None:
        """Change the amplitude of this motion."""
        if self._then:
            self._then.append(lambda: self.set_amplitude(amplitude))
        elif self.rollout is not None:
            self.rollout.set_amplitude(amplitude)

    @property
    def _tempo(self) -> float:
        """Tempo that is wanted now."""
        target = self._speed if self._own_speed is None else self._own_speed
        return 0.0 if self._waits else target

    def stop(self) -> None:
        """Come to a smooth stop on the path and hold there."""
        if self._approach is not None and self.target is not None:
            self._approach, self.status = None, HOLDING
            self.playing.stop(self.target)
        self._then = []
        if self.rollout is not None:
            self.status = STOPPING
            self.rollout.set_speed(0.0)

    def observe(self, measured: np.ndarray) -> None:
        """Use where the robot is for phase stopping."""
        if self.rollout is None or not self.playing.settings.phase_stopping:
            return
        # Stiffness and wrench are not measured: those of the reference are taken.
        self.rollout.observe(self.playing.changed(self.rollout.state.point, measured))

    def _approaches(self, measured: np.ndarray | None) -> bool:
        """Go to the robot first, if it is far from a reference that rests."""
        in_motion = self.rollout is not None and self.status is not HOLDING
        if measured is None or self.target is None or in_motion or not self._is_far(measured):
            return False
        self._approach = self.playing.approach(self.target, measured)
        return True

    def _is_far(self, measured: np.ndarray | None) -> bool:
        return (measured is not None and self.target is not None
                and not self.playing.is_near(self.target, measured))

    def _do_then(self) -> None:
        then, self._then = self._then, []
        for item in then:
            try:
                item()
            except GdmpError as error:
                self._refuse(str(error))

    def _begin(self, tool: StreamedSkill, rollout: Rollout, measured: np.ndarray | None,
               cycles: float | None) -> None:
        try:
            target = self._begin_at(tool, rollout, measured)
        except GdmpError:
            self.rollout = None
            self.status = Status.IDLE if self.target is None else HOLDING
            raise
        self._waits, self._own_speed, self._cycles = False, None, cycles
        rollout.set_speed(self._speed)
        self.playing, self.rollout, self.target = tool, rollout, target
        self.goal, self.goal_twist, self.status = rollout.goal, None, MOVING
        self._numbers = np.empty(rollout.state_size)

    def _begin_at(self, tool: StreamedSkill, rollout: Rollout, measured: np.ndarray | None
                  ) -> np.ndarray:
        """Begin at the present reference, or where the robot is; returns the target to fill."""
        target = self.target
        if target is None:
            rollout.begin(tool.start_at(measured), speed=0.0)
            target = tool.first_target(tool.place_of(tool.skill.start))
        else:
            self._continue(tool, rollout, target)
        self._releases = tool.releases
        tool.take_over(target)
        return target

    def _continue(self, tool: StreamedSkill, rollout: Rollout, target: np.ndarray) -> None:
        """Begin with the position, velocity and acceleration of the present reference."""
        start, motion = tool.point_of(target), tool.motion_of(target)
        if motion is None:
            rollout.begin(start, speed=0.0)
        else:
            rollout.begin(start, *motion, max(LEAST_SPEED, min(self._speed, 1.0)))
