"""
Plays a skill tick by tick, as references for an impedance controller.

One thread calls `Player.tick`. Requests may come from any thread: they wait in one queue, and the
next tick carries them out in the order in which they came.
"""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gdmp_ros.control.modes import StreamMode
from gdmp_ros.dmp.options import check_range, MAX_SPEED
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.reference_source import ReferenceSource
from gdmp_ros.playback.refusals import Refusals
from gdmp_ros.playback.requests import (
    AFTER_HOLD,
    AFTER_PAUSE,
    AFTER_RESUME,
    AFTER_START,
    AFTER_STOP,
    Requests,
    Status,
    UNCHANGED,
)
from gdmp_ros.playback.streamed import streamed
from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill


class Player:
    """
    Holds, starts, follows goals, pauses and stops.

    :ivar tool: the skill and settings of the next start
    """

    def __init__(self, skill: Skill, settings: PlayerSettings, refusals: Refusals | None = None):
        """
        Prepare to play a skill.

        :param refusals: counts requests that turn out to be impossible
        :raises DataError: if the skill is neither one of a pose nor of joints
        """
        self.tool = streamed(skill, settings)
        self.refusals = refusals or Refusals()
        self._source, self._started = ReferenceSource(self.tool, self.refusals.add), 0
        self._requests = Requests(self.refusals)
        self._measured: tuple[np.ndarray, Kind] | None = None
        self._copy_wanted = False
        self._copy: Rollout | None = None

    @property
    def status(self) -> Status:
        """What the player does, as if the waiting requests had been carried out."""
        return self._requests.status_after(self._source.status)

    @property
    def motion(self) -> int:
        """Number of the motion that was begun last (see `start`), 0 before the first."""
        return self._source.motion

    @property
    def mode(self) -> StreamMode:
        """What the stream of references says of itself."""
        return self._source.mode

    @property
    def stops_phase(self) -> bool:
        """Whether the present motion uses the measured pose (`observe`)."""
        return self._source.playing.settings.phase_stopping > 0.0

    @property
    def speed_rate(self) -> float:
        """Largest rate of change of the tempo of the present motion [1/s]."""
        return self._source.playing.settings.speed_rate

    @property
    def target(self) -> np.ndarray | None:
        """The reference of the last tick; None before the first one."""
        return self._source.target

    @property
    def rollout(self) -> Rollout | None:
        """The present motion, also while its goal is held; only to be read."""
        return self._source.rollout

    @property
    def playing(self) -> StreamedSkill:
        """Skill and settings of the present motion."""
        return self._source.playing

    @property
    def joints(self) -> int:
        """Number of the joints of which the references are; 0: they are of the tool."""
        playing = self._source.playing
        return playing.manifold.point_size if playing.kind is Kind.JOINTS else 0

    @property
    def period(self) -> float:
        """Duration of the present motion at tempo 1, of the skill before there is one [s]."""
        rollout = self._source.rollout
        return self._source.playing.skill.duration if rollout is None else rollout.duration

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints of the next start's skill; empty if it does not tell them."""
        return list(self.tool.skill.provenance.get('joints', ()))

    @property
    def goal(self) -> np.ndarray:
        """Goal of the motion, of the skill before there is one: a pose or a posture."""
        goal = self._present_goal()
        if goal is None:
            return self.tool.place_of(self.tool.skill.goal)
        return self._source.playing.place_of(goal)

    @property
    def place(self) -> np.ndarray | None:
        """Where the reference of the last tick is."""
        target = self._source.target
        return None if target is None else self._source.playing.place_in(target)

    def load(self, skill: Skill) -> None:
        """Use another skill from the next start on."""
        self.tool = streamed(skill, self.tool.settings)

    def configure(self, settings: PlayerSettings) -> None:
        """Use other settings from the next start on."""
        self.tool = streamed(self.tool.skill, settings)

    def forget(self) -> None:
        """Stream nothing until there is something to hold; only while no tick is made."""
        self._source.hold(None)

    def hold(self, place: np.ndarray) -> None:
        """Hold a pose (x, y, z, qw, qx, qy, qz), or positions of the joints."""
        tool = self.tool
        target = tool.first_target(place)
        self._requests.add(lambda: self._source.hold(target, tool), AFTER_HOLD)

    def start(self, measured: np.ndarray | None, goal_place: np.ndarray | None = None,
              goal_stiffness: np.ndarray | None = None, duration: float | None = None,
              tolerances: tuple[float, float] | None = None, cycles: float | None = None) -> int:
        """
        Start the loaded skill where the robot is, without a step in the reference.

        :param measured: where the robot is; None starts at the start of the skill
        :param goal_place: instead of that of the skill
        :param goal_stiffness: factor (`ToolSkill.stiffness_factor`) instead of that of the skill
        :param duration: instead of that of the skill [s]
        :param tolerances: at the goal [m, rad]
        :param cycles: of a rhythmic skill, before it comes to rest at its centre; None: until its
            amplitude is 0
        :returns: number of the motion; `motion` has it as soon as the motion has begun
        :raises GdmpError: if the motion is not possible; nothing has changed then
        """
        tool = self.tool
        # Prepared and validated here; the tick only chooses the start, from the newest reference.
        rollout = Rollout(tool.skill, start=tool.start_at(measured), duration=duration,
                          goal=tool.changed(tool.skill.goal, goal_place, goal_stiffness),
                          options=tool.options(0.0, tolerances))
        return self.begin(tool, rollout, measured, cycles)

    def begin(self, tool: StreamedSkill, rollout: Rollout, measured: np.ndarray | None,
              cycles: float | None = None, still: Callable[[], bool] = lambda: True) -> int:
        """
        Begin a motion that has been prepared.

        :param rollout: of the skill of ``tool``
        :param measured: where the robot is; None where the reference is, or at the skill's start
        :param cycles: see `start`
        :param still: asked by the tick; nothing happens if it is not wanted any more
        :returns: number of the motion
        """
        number = self._started + 1

        def begin() -> None:
            if still():
                self._source.begin(tool, rollout, measured, number, cycles)
        self._requests.add(begin, AFTER_START)
        self._started = number
        return number

    def go_to(self, place: np.ndarray, twist: np.ndarray | None = None) -> None:
        """
        Switch the goal.

        :param place: pose, positions of the joints, or poses of two tools
        :param twist: with which it moves on, linear and angular [m/s, rad/s]; None if it rests
        """
        self._requests.add(lambda: self._source.retarget(place, None, twist), UNCHANGED)

    def goal_stiffness(self, factor: np.ndarray) -> None:
        """Switch the stiffness goal (`ToolSkill.stiffness_factor`)."""
        source = self._source
        self._requests.add(lambda: source.retarget(None, factor, source.goal_twist), UNCHANGED)

    def set_speed(self, scale: float) -> None:
        """
        Change the tempo of this motion and of the next ones.

        :raises ParameterError: outside 0 … 2
        """
        check_range('speed', scale, 0.0, MAX_SPEED)
        self._requests.add(lambda: self._source.set_speed(scale), UNCHANGED)

    def set_amplitude(self, amplitude: float) -> None:
        """Change the amplitude of a rhythmic motion (`Rollout.set_amplitude`)."""
        self._requests.add(lambda: self._source.set_amplitude(amplitude), UNCHANGED)

    def set_frequency(self, frequency: float) -> None:
        """Change the frequency of this rhythmic motion [Hz]; the tempo of others stays."""
        self._requests.add(lambda: self._source.set_frequency(frequency), UNCHANGED)

    def pause(self, paused: bool) -> None:
        """Come to a smooth stop on the path, or continue."""
        self._requests.add(lambda: self._source.pause(paused),
                           AFTER_PAUSE if paused else AFTER_RESUME)

    def wait(self, waits: bool) -> None:
        """Stop on the path until something else has happened, or go on; the status stays."""
        self._requests.add(lambda: self._source.wait(waits), UNCHANGED)

    def stop(self) -> None:
        """Come to a smooth stop on the path and hold there."""
        self._requests.add(self._source.stop, AFTER_STOP)

    def observe(self, measured: np.ndarray) -> None:
        """Use where the robot is for phase stopping at the next tick."""
        self._measured = measured, self._source.playing.kind

    def distances(self) -> list[float]:
        """Distance of each factor from the goal: m, rad, and geodesic for the stiffness."""
        target, goal = self._source.target, self._present_goal()
        if self._source.rollout is None or target is None or goal is None:
            return []
        return self._source.playing.distances(target, goal)

    def _present_goal(self) -> np.ndarray | None:
        rollout, source = self._source.rollout, self._source
        return source.goal if rollout is None or source.goal_twist is None else rollout.goal

    def request_copy(self) -> None:
        """Let the next tick copy the motion for `taken_copy`."""
        self._copy_wanted = True

    def taken_copy(self) -> Rollout | None:
        """Copy of the motion (`request_copy`), once; None without one."""
        rollout, self._copy = self._copy, None
        return rollout

    def tick(self, dt: float) -> np.ndarray | None:
        """
        Carry out the requests, and let ``dt`` seconds pass.

        :returns: numbers of the target, valid until the next tick; None while there is nothing to
            hold
        """
        if self._requests.waiting:
            self._requests.carry_out()
        rollout = self._source.rollout
        if rollout is not None:
            measured, self._measured = self._measured, None
            # Not if a motion of the other kind has begun since.
            if measured is not None and measured[1] is self._source.playing.kind:
                self._source.observe(measured[0])
            if self._copy_wanted:
                self._copy_wanted, self._copy = False, rollout.copy()
        return self._source.tick(dt)
