"""
Plays a skill of pose and stiffness tick by tick, as references for an impedance controller.

One thread calls `Player.tick`. Requests may come from any thread: they wait in one queue, and the
next tick carries them out in the order in which they came.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.target import ACCELERATION, DAMPING_RATIO, POSE, STIFFNESS, TWIST
from gdmp_ros.dmp.options import check_range, MAX_SPEED
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
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
from gdmp_ros.playback.tool_skill import is_near, PlayerSettings, ToolSkill

#: Smallest initial tempo of a motion that takes over from another one.
LEAST_SPEED = 0.1
_AT_REST = 1e-6  # m/s, rad/s
# Looked up once: this is done in every tick.
MOVING, PAUSED, STOPPING, HOLDING = (Status.MOVING, Status.PAUSED, Status.STOPPING,
                                     Status.HOLDING)


class Player:
    """
    Holds, starts, follows goals, pauses and stops.

    :ivar tool: the skill and settings of the next start
    :ivar motion: number of the motion that was started last (see `start`), 0 before the first
    """

    def __init__(self, skill: Skill, settings: PlayerSettings, refusals: Refusals | None = None):
        """
        Prepare to play a skill.

        :param refusals: counts requests that turn out to be impossible
        :raises DataError: if the skill is not one of pose and stiffness
        """
        self.tool = self._playing = ToolSkill(skill, settings)
        self.refusals = refusals or Refusals()
        self.motion = self._started = 0
        self._requests = Requests(self.refusals)
        self._status, self._speed = Status.IDLE, 1.0
        self._rollout: Rollout | None = None
        self._target: np.ndarray | None = None
        self._goal: np.ndarray | None = None
        self._goal_twist: np.ndarray | None = None
        self._numbers = np.empty(0)
        self._measured: np.ndarray | None = None
        self._copy_wanted = False
        self._copy: Rollout | None = None

    @property
    def status(self) -> Status:
        """What the player does, as if the waiting requests had been carried out."""
        return self._requests.status_after(self._status)

    @property
    def stops_phase(self) -> bool:
        """Whether the present motion uses the measured pose (`observe`)."""
        return self._playing.settings.phase_stopping > 0.0

    @property
    def speed_rate(self) -> float:
        """Largest rate of change of the tempo of the present motion [1/s]."""
        return self._playing.settings.speed_rate

    @property
    def target(self) -> np.ndarray | None:
        """The reference of the last tick; None before the first one."""
        return self._target

    @property
    def rollout(self) -> Rollout | None:
        """The present motion, also while its goal is held; only to be read."""
        return self._rollout

    @property
    def goal(self) -> np.ndarray:
        """Pose goal (x, y, z, qw, qx, qy, qz) of the motion; of the skill before there is one."""
        goal = self._present_goal()
        return np.array((self.tool.skill.goal if goal is None else goal)[:7])

    def load(self, skill: Skill) -> None:
        """Use another skill from the next start on."""
        self.tool = ToolSkill(skill, self.tool.settings)

    def configure(self, settings: PlayerSettings) -> None:
        """Use other settings from the next start on."""
        self.tool = ToolSkill(self.tool.skill, settings)

    def hold(self, pose: np.ndarray) -> None:
        """Hold ``pose`` (x, y, z, qw, qx, qy, qz)."""
        target = self.tool.first_target(pose)
        self._requests.add(lambda: self._hold(target), AFTER_HOLD)

    def start(self, measured: np.ndarray | None, goal_pose: np.ndarray | None = None,
              goal_stiffness: np.ndarray | None = None, duration: float | None = None,
              tolerances: tuple[float, float] | None = None) -> int:
        """
        Start the loaded skill where the robot is, without a step in the reference.

        :param measured: pose of the robot; None starts at the start of the skill
        :param goal_pose: instead of that of the skill
        :param goal_stiffness: factor (`ToolSkill.stiffness_factor`) instead of that of the skill
        :param duration: instead of that of the skill [s]
        :param tolerances: at the goal [m, rad]
        :returns: number of the motion; `motion` has it as soon as the motion has begun
        :raises GdmpError: if the motion is not possible; nothing has changed then
        """
        tool = self.tool
        position, orientation, *stiffness = tool.manifold.split(tool.skill.goal)
        pose = np.concatenate([position, orientation]) if goal_pose is None else goal_pose
        if goal_stiffness is None and stiffness:
            goal_stiffness = stiffness[0]
        # Prepared and validated here; the tick only chooses the start, from the newest reference.
        rollout = Rollout(tool.skill, start=tool.start_at(measured), duration=duration,
                          goal=tool.point(pose, goal_stiffness),
                          options=tool.options(0.0, tolerances))
        number = self._started + 1
        self._requests.add(lambda: self._begin(tool, rollout, measured, number), AFTER_START)
        self._started = number
        return number

    def goal_pose(self, pose: np.ndarray, twist: np.ndarray | None = None) -> None:
        """
        Switch the pose goal.

        :param twist: with which it moves on, linear and angular [m/s, rad/s]; None if it rests
        """
        self._requests.add(lambda: self._retarget(pose, None, twist), UNCHANGED)

    def goal_stiffness(self, factor: np.ndarray) -> None:
        """Switch the stiffness goal (`ToolSkill.stiffness_factor`)."""
        self._requests.add(lambda: self._retarget(None, factor, self._goal_twist), UNCHANGED)

    def set_speed(self, scale: float) -> None:
        """
        Change the tempo of this motion and of the next ones.

        :raises ParameterError: outside 0 … 2
        """
        check_range('speed', scale, 0.0, MAX_SPEED)
        self._requests.add(lambda: self._set_speed(scale), UNCHANGED)

    def pause(self, paused: bool) -> None:
        """Come to a smooth stop on the path, or continue."""
        self._requests.add(lambda: self._pause(paused), AFTER_PAUSE if paused else AFTER_RESUME)

    def stop(self) -> None:
        """Come to a smooth stop on the path and hold there."""
        self._requests.add(self._stop, AFTER_STOP)

    def observe(self, measured: np.ndarray) -> None:
        """Use the measured pose for phase stopping at the next tick."""
        self._measured = measured

    def distances(self) -> list[float]:
        """Distance of each factor from the goal: m, rad, and geodesic for the stiffness."""
        target, goal = self._target, self._present_goal()
        if self._rollout is None or target is None or goal is None:
            return []
        return self._playing.distances(target, goal)

    def _present_goal(self) -> np.ndarray | None:
        rollout = self._rollout
        return self._goal if rollout is None or self._goal_twist is None else rollout.goal

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

        :returns: `gdmp_ros.control.target.TARGET_SIZE` numbers, valid until the next tick; None
            while there is nothing to hold
        """
        if self._requests.waiting:
            self._requests.carry_out()
        rollout, target = self._rollout, self._target
        if rollout is None or target is None:
            return target
        if self._measured is not None:
            self._stop_phase(rollout)
        if self._copy_wanted:
            self._copy_wanted, self._copy = False, rollout.copy()
        self._playing.advance(rollout, dt, self._numbers, target)
        if self._status is STOPPING:
            if rollout.speed == 0.0:
                self._status, self._rollout = HOLDING, None
                target[TWIST:STIFFNESS] = 0.0
        elif self._status is not PAUSED:
            self._status = HOLDING if rollout.finished else MOVING
        return target

    # What follows runs inside a tick.

    def _hold(self, target: np.ndarray) -> None:
        self._target, self._rollout, self._goal, self._goal_twist = target, None, None, None
        self._status = HOLDING

    def _begin(self, tool: ToolSkill, rollout: Rollout, measured: np.ndarray | None,
               number: int) -> None:
        try:
            target = self._begin_at(tool, rollout, measured)
        except GdmpError:
            self._rollout = None
            self._status = Status.IDLE if self._target is None else HOLDING
            raise
        else:
            rollout.set_speed(self._speed)
            self._playing, self._rollout, self._target = tool, rollout, target
            self._goal, self._goal_twist, self._status = rollout.goal, None, MOVING
            self._numbers = np.empty(rollout.state_size)
        finally:
            # Set last: a thread that reads the new number then also reads the new motion.
            self.motion = number

    def _begin_at(self, tool: ToolSkill, rollout: Rollout, measured: np.ndarray | None
                  ) -> np.ndarray:
        """Begin at the measured pose, or at the present reference; returns the target to fill."""
        target = self._target
        if target is None or (measured is not None and not is_near(target, measured)):
            rollout.begin(tool.start_at(measured), speed=0.0)
            return tool.first_target(tool.skill.start[:7])
        self._continue(tool, rollout, target)
        if tool.stiffness_size < 6:
            # With SPD(3) the skill changes the translational block only.
            block = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
            block[:] = tool.settings.stiffness_matrix
        target[DAMPING_RATIO] = tool.settings.damping_ratio
        return target

    def _continue(self, tool: ToolSkill, rollout: Rollout, target: np.ndarray) -> None:
        """Begin with the position, velocity and acceleration of the present reference."""
        start = tool.point(target[POSE:POSE + 7].copy(), tool.stiffness_of(target))
        if np.abs(target[TWIST:TWIST + 6]).max() < _AT_REST:
            rollout.begin(start, speed=0.0)
            return
        rollout.begin(start, tool.tangent_of(target, TWIST), tool.tangent_of(target, ACCELERATION),
                      max(LEAST_SPEED, min(self._speed, 1.0)))

    def _retarget(self, pose: np.ndarray | None, stiffness: np.ndarray | None,
                  twist: np.ndarray | None) -> None:
        rollout = self._rollout
        if rollout is None:
            return
        position, orientation, *matrix = self._playing.manifold.split(rollout.goal)
        if pose is None:
            pose = np.concatenate([position, orientation])
        if stiffness is None and matrix:
            stiffness = matrix[0]
        velocity = None if twist is None else self._playing.tangent_of_twist(twist)
        rollout.retarget(self._playing.point(pose, stiffness), velocity)
        self._goal, self._goal_twist = rollout.goal, twist

    def _set_speed(self, scale: float) -> None:
        self._speed = scale
        if self._rollout is not None and self._status in (MOVING, HOLDING):
            self._rollout.set_speed(scale)

    def _pause(self, paused: bool) -> None:
        before, after = (MOVING, PAUSED) if paused else (PAUSED, MOVING)
        if self._rollout is not None and self._status is before:
            self._status = after
            self._rollout.set_speed(0.0 if paused else self._speed)

    def _stop(self) -> None:
        if self._rollout is not None:
            self._status = STOPPING
            self._rollout.set_speed(0.0)

    def _stop_phase(self, rollout: Rollout) -> None:
        measured, self._measured = self._measured, None
        if measured is None or not self.stops_phase:
            return
        # The stiffness is not measured: that of the reference is taken.
        _, _, *stiffness = self._playing.manifold.split(rollout.state.point)
        rollout.observe(self._playing.point(measured, stiffness[0] if stiffness else None))
