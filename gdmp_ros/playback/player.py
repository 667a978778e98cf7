"""
A skill on pose and stiffness, played tick by tick as an impedance reference.

One thread calls `tick`; requests come from others through slots that are replaced, never queued.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.impedance import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
)
from gdmp_ros.dmp import Rollout, Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds import UnitQuaternion
from gdmp_ros.playback.tool_skill import PlayerSettings, ToolSkill

#: A held reference nearer than this to the measured pose is where a motion starts [m, rad].
NEAR_M, NEAR_RAD = 0.02, 0.1
#: Tempo at least with which a motion takes over from one under way.
LEAST_SPEED = 0.1
#: Durations of a motion to look ahead at most.
MOST_TO_COME = 5
_S3 = UnitQuaternion()


class Player:
    """Plays skills: holds, starts, follows goals, pauses, stops."""

    def __init__(self, skill: Skill, settings: PlayerSettings):
        """:raises DataError: if the skill is not one of pose and stiffness"""
        self._settings = settings
        self.tool = ToolSkill(skill, settings)
        self.refused = 0
        self.last_refusal = ''
        self._rollout: Rollout | None = None
        self._target: np.ndarray | None = None
        self._stopping = False
        self._paused = False
        self._speed = 1.0
        # Slots: written by any thread, taken by `tick`.
        self._next_start: tuple[ToolSkill, Rollout] | None = None
        self._next_hold: np.ndarray | None = None
        self._next_pose: np.ndarray | None = None
        self._next_stiffness: np.ndarray | None = None
        self._next_measured: np.ndarray | None = None
        # The other way round: asked for by any thread, filled by `tick`.
        self._copy_wanted = False
        self._copy: Rollout | None = None

    @property
    def speed_rate(self) -> float:
        """Largest change of the tempo of the motion under way [1/s]."""
        return self._settings.speed_rate

    @property
    def target(self) -> np.ndarray | None:
        """The reference of the last tick, None before there is any."""
        return self._target

    @property
    def rollout(self) -> Rollout | None:
        """The motion under way, or the one whose goal is held."""
        return self._rollout

    @property
    def status(self) -> str:
        """``idle``, ``moving``, ``paused``, ``stopping`` or ``holding``."""
        if self._target is None and self._next_hold is None and self._next_start is None:
            return 'idle'
        if self._next_start is not None:
            return 'moving'
        if self._rollout is None:
            return 'holding'
        if self._stopping:
            return 'stopping'
        if self._paused:
            return 'paused'
        return 'holding' if self._rollout.finished else 'moving'

    def load(self, skill: Skill) -> None:
        """Use another skill from the next start on."""
        self.tool = ToolSkill(skill, self.tool.settings)

    def configure(self, settings: PlayerSettings) -> None:
        """Use other settings from the next start on."""
        self.tool = ToolSkill(self.tool.skill, settings)

    def hold(self, pose: np.ndarray) -> None:
        """Hold ``pose`` (x, y, z, qw, qx, qy, qz) from the next tick on."""
        target = np.zeros(TARGET_SIZE)
        target[POSE:POSE + 7] = pose
        settings = self.tool.settings
        target[STIFFNESS:STIFFNESS + 36] = settings.stiffness.reshape(-1)
        if self.tool.stiffness_size:
            target[STIFFNESS:STIFFNESS + 36] = self._full_stiffness(self.tool.skill.start[7:])
        target[DAMPING_RATIO] = settings.damping_ratio
        self._next_hold = target

    def start(self, measured: np.ndarray | None, goal_pose: np.ndarray | None = None,
              goal_stiffness: np.ndarray | None = None, duration: float | None = None,
              tolerances: tuple[float, float] | None = None) -> None:
        """
        Start the loaded skill from where the robot is, without a step in the reference.

        :param measured: pose of the robot; None starts at the skill's own start
        :param goal_pose: instead of the skill's
        :param goal_stiffness: factor (`ToolSkill.stiffness_factor`) instead of the skill's
        :param tolerances: at the goal [m, rad]
        :raises GdmpError: if the motion is not possible; nothing has changed then
        """
        tool = self.tool
        start, velocity, acceleration = self._where_to_start(tool, measured)
        position, orientation, *stiffness = tool.manifold.split(tool.skill.goal)
        pose = np.concatenate([position, orientation]) if goal_pose is None else goal_pose
        goal = tool.point(pose, goal_stiffness if goal_stiffness is not None
                          else stiffness[0] if stiffness else None)
        # At rest the tempo grows from 0; in motion it begins as a part of what is wanted.
        speed = 0.0 if velocity is None else max(LEAST_SPEED, min(self._speed, 1.0))
        rollout = Rollout(tool.skill, start=start, goal=goal, duration=duration, velocity=velocity,
                          acceleration=acceleration, options=tool.options(speed, tolerances))
        rollout.set_speed(self._speed)
        self._paused = self._stopping = False
        self._next_start = (tool, rollout)

    def goal_pose(self, pose: np.ndarray) -> None:
        """Switch the pose goal at the next tick."""
        self._next_pose = pose

    def goal_stiffness(self, factor: np.ndarray) -> None:
        """Switch the stiffness goal (`ToolSkill.stiffness_factor`) at the next tick."""
        self._next_stiffness = factor

    def observe(self, measured: np.ndarray) -> None:
        """Take the robot's pose into account at the next tick: phase stopping."""
        self._next_measured = measured

    def set_speed(self, scale: float) -> None:
        """
        Change the tempo, now and for motions to come.

        :raises ParameterError: outside 0 … 2
        """
        if self._rollout is not None and not (self._paused or self._stopping):
            self._rollout.set_speed(scale)
        self._speed = scale

    def pause(self, paused: bool) -> None:
        """Come to a smooth stop on the path, or go on."""
        self._paused = paused
        if self._rollout is not None and not self._stopping:
            self._rollout.set_speed(0.0 if paused else self._speed)

    def stop(self) -> None:
        """Come to a smooth stop on the path and hold there."""
        if self._rollout is not None:
            self._stopping = True
            self._rollout.set_speed(0.0)

    def distances(self) -> list[float]:
        """How far each factor is from the goal: m, rad, and geodesic for the stiffness."""
        rollout, target = self._rollout, self._target
        if rollout is None or target is None:
            return []
        manifold = self._playing.manifold
        goal = manifold.split(rollout.goal)
        result = [float(np.linalg.norm(goal[0] - target[:3])),
                  2.0 * _S3.distance(_S3.align(target[3:7], goal[1]), goal[1])]
        if len(goal) > 2:
            size = len(goal[2])
            matrix = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)[:size, :size]
            result.append(manifold.factors[2].distance(np.ascontiguousarray(matrix), goal[2]))
        return result

    def goal(self) -> np.ndarray:
        """Pose goal (x, y, z, qw, qx, qy, qz) of the motion, of the skill before there is one."""
        rollout = self._rollout
        return np.array((self.tool.skill.goal if rollout is None else rollout.goal)[:7])

    def look_ahead(self) -> None:
        """Have the next tick leave a copy of the motion for `to_come`."""
        self._copy_wanted = True

    def to_come(self, count: int) -> np.ndarray | None:
        """
        Poses from the moment of the last copy on, until the motion is over.

        :param count: how many there are in one duration of the motion
        :returns: shape ``(T, 7)``; None without a copy since the last call
        """
        rollout, self._copy = self._copy, None
        if rollout is None:
            return None
        rollout.go_on()
        step = rollout.duration / count
        poses = [rollout.state.point[:7]]
        # A goal that moves slowly, or a tempo that has to grow first, take longer than that.
        while not rollout.finished and len(poses) < MOST_TO_COME * count:
            poses.append(rollout.advance(step).point[:7])
        return np.array(poses)

    def tick(self, dt: float) -> np.ndarray | None:
        """
        Let ``dt`` seconds pass.

        :returns: `TARGET_SIZE` numbers, the same array every time; None while there is nothing to
            hold
        """
        self._take_start()
        rollout, target = self._rollout, self._target
        if rollout is None or target is None:
            return target
        self._take_goal(rollout)
        self._take_measured(rollout)
        if self._copy_wanted:
            self._copy_wanted, self._copy = False, rollout.copy()
        self._playing.fill(rollout.advance(dt), target)
        if self._stopping and rollout.speed == 0.0:
            self._stopping, self._rollout = False, None
            target[TWIST:STIFFNESS] = 0.0
        return target

    def _take_start(self) -> None:
        held, self._next_hold = self._next_hold, None
        if held is not None:
            self._target, self._rollout = held, None
        started, self._next_start = self._next_start, None
        if started is None:
            return
        self._playing, self._rollout = started
        self._settings = self._playing.settings
        if self._target is None:
            self._target = np.zeros(TARGET_SIZE)
            self._target[STIFFNESS:STIFFNESS + 36] = self._settings.stiffness.reshape(-1)
        # With an SPD(3) skill only the translational block moves.
        block = self._target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)
        if self._playing.stiffness_size < 6:
            block[:] = self._settings.stiffness
        self._target[DAMPING_RATIO] = self._settings.damping_ratio

    def _take_goal(self, rollout: Rollout) -> None:
        pose, self._next_pose = self._next_pose, None
        stiffness, self._next_stiffness = self._next_stiffness, None
        if pose is None and stiffness is None:
            return
        position, orientation, *matrix = self._playing.manifold.split(rollout.goal)
        if pose is None:
            pose = np.concatenate([position, orientation])
        if stiffness is None and matrix:
            stiffness = matrix[0]
        try:
            rollout.retarget(self._playing.point(pose, stiffness))
        except GdmpError as error:
            self.refuse(str(error))

    def _take_measured(self, rollout: Rollout) -> None:
        measured, self._next_measured = self._next_measured, None
        if measured is None or self._settings.phase_stopping == 0.0:
            return
        # The stiffness is not measured: what is referred to counts as reached.
        _, _, *stiffness = self._playing.manifold.split(rollout.state.point)
        rollout.observe(self._playing.point(measured, stiffness[0] if stiffness else None))

    def refuse(self, reason: str) -> None:
        """Count something refused and remember why."""
        self.refused += 1
        self.last_refusal = reason

    def _where_to_start(self, tool: ToolSkill, measured: np.ndarray | None
                        ) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray | None]:
        """Where to start; velocity and acceleration of a reference that is moving already."""
        target = self._target
        if target is None or (measured is not None and not _near(target, measured)):
            if measured is None:
                return None, None, None
            return tool.point(measured, self._start_stiffness(tool, None)), None, None
        start = tool.point(target[POSE:POSE + 7].copy(), self._start_stiffness(tool, target))
        speed = target[TWIST:TWIST + 6]
        if np.abs(speed).max() < 1e-6:
            return start, None, None
        velocity, acceleration = np.zeros((2, tool.manifold.tangent_size))
        velocity[:3], velocity[3:6] = speed[:3], 0.5 * speed[3:]
        change = target[ACCELERATION:ACCELERATION + 6]
        acceleration[:3], acceleration[3:6] = change[:3], 0.5 * change[3:]
        return start, velocity, acceleration

    def _start_stiffness(self, tool: ToolSkill, target: np.ndarray | None) -> np.ndarray | None:
        size = tool.stiffness_size
        if not size:
            return None
        if target is None:
            return np.asarray(tool.manifold.split(tool.skill.start)[2])
        matrix = target[STIFFNESS:STIFFNESS + 36].reshape(6, 6)[:size, :size]
        return np.ascontiguousarray(matrix)

    def _full_stiffness(self, factor: np.ndarray) -> np.ndarray:
        full = self.tool.settings.stiffness.copy()
        size = self.tool.stiffness_size
        full[:size, :size] = factor.reshape(size, size)
        return full.reshape(-1)


def _near(target: np.ndarray, measured: np.ndarray) -> bool:
    away = float(np.linalg.norm(target[:3] - measured[:3]))
    turned = 2.0 * _S3.distance(_S3.align(measured[3:7], target[3:7]), target[3:7])
    return away < NEAR_M and turned < NEAR_RAD
