"""What can be changed of a motion while it is executed: its goals, amplitude and frequency."""
from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gdmp_ros.dmp.options import check_range, MAX_AMPLITUDE, MAX_SPEED
from gdmp_ros.errors import ManifoldError, ParameterError
from gdmp_ros.playback.goal_check import GoalCheck
from gdmp_ros.playback.goal_tracker import GoalTracker, moved_on
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.states import Request, State
from gdmp_ros.playback.streamed_skill import Kind


class MotionCommands:
    """Checks commands for the motion that is executed, and passes them to the player."""

    def __init__(self, goals: GoalCheck, loaded: Callable[[], Player],
                 refuse: Callable[[str], None]):
        """
        Prepare.

        :param loaded: returns the player, or raises a `ParameterError` without a skill
        :param refuse: called with the reason when a goal is not followed any more
        """
        self._goals, self._loaded, self._refuse = goals, loaded, refuse
        self._tracker = GoalTracker()

    def begin(self) -> None:
        """Forget the goal of the motion before."""
        self._tracker.reset()

    def pass_time(self, now: float, player: Player) -> None:
        """
        Let the goal rest whose poses have ended, or that moves out of the workspace.

        :param now: of the clock of the ticks [s]
        """
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
