"""What can be changed of a motion while it is executed: its goals, amplitude and frequency."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.options import check_range, MAX_AMPLITUDE, MAX_SPEED
from gdmp_ros.errors import ManifoldError, ParameterError
from gdmp_ros.manifolds.poses import moved_on, POSE_SIZE
from gdmp_ros.playback.goal_check import GoalCheck
from gdmp_ros.playback.goal_tracker import GoalTracker
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.states import Request, State
from gdmp_ros.playback.streamed_skill import Kind


class LaterGoal(NamedTuple):
    """
    A goal that was asked for with the start of a motion, for later.

    :ivar time: from which it holds, of the motions [s]
    :ivar place: of the skill (`GoalCheck.place_for`)
    """

    time: float
    place: np.ndarray


class MotionCommands:
    """
    Checks commands for the motion that is executed, and passes them to the player.

    :ivar later: goal of the present motion whose time has not come; a newer one replaces it
    """

    def __init__(self, goals: GoalCheck, loaded: Callable[[], Player],
                 refuse: Callable[[str], None]):
        """
        Prepare.

        :param loaded: returns the player, or raises a `ParameterError` without a skill
        :param refuse: called with the reason when a goal is not followed any more
        """
        self._goals, self._loaded, self._refuse = goals, loaded, refuse
        self._tracker = GoalTracker()
        self.later: LaterGoal | None = None

    def begin(self, later: LaterGoal | None = None) -> None:
        """Forget the goal of the motion before; ``later`` is one of the new motion."""
        self._tracker.reset()
        self.later = later

    def pass_time(self, now: float, time: float, player: Player) -> None:
        """
        Use the goal whose time has come; let one rest whose poses have ended, or that moves out.

        :param now: of the clock of the ticks [s]
        :param time: that the motions have had [s]
        """
        later = self.later
        if later is not None and not player.allows(Request.GOAL):
            self.later = None
        elif later is not None and time >= later.time:
            if player.playing.kind is Kind.TWO_TOOLS:
                player.go_to(later.place[:POSE_SIZE], side=0)
            else:
                player.go_to(later.place)
            self.later = None
        if player.playing.kind is not Kind.TOOL or not player.allows(Request.GOAL):
            return
        ended = self._tracker.expired(now)
        if ended is not None:
            player.go_to(ended.pose)
            return
        present = self._tracker.present(now)
        if present is None:
            return
        try:
            self._goals.settings.check_goal(present.pose)
        except ManifoldError as error:
            self._refuse(f'the goal that moves on rests: {error}')
            self._tracker.reset()
            player.go_to(self._goals.settings.inside(present.pose))

    def goal_pose(self, pose: np.ndarray, now: float, age: float = 0.0, side: int = 0) -> None:
        """
        Switch the pose goal; one that keeps moving is followed with its velocity.

        With two arms the other tool follows the couplings.

        :param now: of the clock of the ticks [s]
        :param age: time since the goal was there [s]
        :param side: of two arms: 0 or 1
        :raises GdmpError: if it lies outside the workspace, or no skill is being executed
        """
        player = self._executing()
        place = self._goals.place_for(player.playing, pose, player.goal, side)
        self.later = None
        if player.playing.kind is Kind.TWO_TOOLS:
            player.go_to(pose, side=side)
            return
        if player.playing.kind is Kind.JOINTS:
            player.go_to(place)
            return
        goal = self._tracker.update(pose, now - age, now)
        player.go_to(goal.pose, goal.twist)

    def moving_goal(self, pose: np.ndarray, twist: np.ndarray, now: float, age: float = 0.0
                    ) -> None:
        """
        Switch the pose goal to one that moves on with a given twist.

        It rests when there is no other one in time (`StreamSettings.moving_goal_timeout`), or at
        the border of the workspace.

        :param twist: linear and angular velocity [m/s, rad/s], not faster than the stream may be
        :param now: of the clock of the ticks [s]
        :param age: time since the goal was there [s]
        :raises GdmpError: as `goal_pose`, or if a number is not finite
        """
        player = self._executing()
        self._goals.settings.check_goal(pose)
        if not np.isfinite(twist).all():
            raise ManifoldError('the twist of the goal has a NaN or infinite number')
        if player.playing.kind is not Kind.TOOL:
            raise ManifoldError(f'a skill of {player.playing.kind.value} does not follow a goal '
                                'that moves on')
        self._goals.settings.check_twist(twist)
        self.later = None
        present = moved_on(pose, twist, age)
        self._tracker.follow(present, twist, now, self._goals.settings.moving_goal_timeout)
        player.go_to(present, twist)

    def goal_stiffness(self, numbers: Sequence[float]) -> None:
        """
        Switch the stiffness goal.

        :raises GdmpError: if it does not fit the skill, or no skill is being executed
        """
        player = self._executing()
        player.goal_stiffness(player.tool.stiffness_factor(numbers))

    def amplitude(self, amplitude: float) -> None:
        """
        Change the amplitude of a rhythmic motion: 1 as demonstrated, 0 ends it at its centre.

        :raises ParameterError: outside 0 … 2, or if no rhythmic skill is being executed
        """
        self._rhythmic().set_amplitude(check_range('amplitude', amplitude, 0.0, MAX_AMPLITUDE))

    def frequency(self, frequency: float) -> None:
        """
        Change the frequency of a rhythmic motion.

        :param frequency: 0 to twice the demonstrated one [Hz]
        :raises ParameterError: for another number, or if no rhythmic skill is being executed
        """
        player = self._rhythmic()
        check_range('frequency', frequency, 0.0, MAX_SPEED / player.period)
        player.set_frequency(frequency)

    def _executing(self) -> Player:
        player = self._loaded()
        player.check(Request.GOAL)
        if player.state is State.FINISHED and not self._goals.settings.follow_goal_after_end:
            raise ParameterError('the motion has ended; start a motion, or set '
                                 'follow_goal_after_end')
        return player

    def _rhythmic(self) -> Player:
        player = self._loaded()
        player.check(Request.AMPLITUDE)
        if not player.playing.skill.rhythmic:
            raise ParameterError('the skill that is being executed is not rhythmic')
        return player
