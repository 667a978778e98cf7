"""Whether an arm can follow a path: reach, limits of joints and speed, singular, collisions."""
from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from gdmp_ros.control.own_body import carried_capsules
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.control.singularity import singular_value
from gdmp_ros.control.surroundings import depths
from gdmp_ros.dmp.changes import joints_in_order
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ManifoldError, ParameterError
from gdmp_ros.manifolds.quaternion import rotation_angles, rotation_between
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill
from gdmp_ros.scene.route import Tool
from gdmp_ros.scene.scene import Scene
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.chain import joints_before, NEIGHBOURS
from gdmp_ros.sim.tool_shape import tool_frames, tool_of

#: A pose is reached if the tool comes this close [m, rad].
REACHED_M, REACHED_RAD = 3e-3, 0.02
#: Postures from which the search begins, and steps of each.
STARTS, STEPS = 60, 100
#: Squared damping of the least squares: least, and share of the squared error.
DAMPING, DAMPING_SHARE = 1e-6, 0.01
#: Largest step of a joint [rad].
LARGEST_STEP = 0.3
#: A joint that is nearer than this to its limit counts as at its limit [rad].
AT_LIMIT_RAD = 0.02
#: Links that are nearer than this to each other or to the floor count as touching [m].
TOUCHING_M = 0.005
#: Distances of links are measured up to here [m].
_FAR_M = 0.2
#: Postures from which the first one is searched.
_STARTS = 15
#: A motion is checked, and shown, for this many of its durations: a changed goal is reached after
#: the first one.
DURATIONS = 1.2
#: Poses of a motion that are checked.
POSES = 200


class Reach:
    """Inverse kinematics of one arm; a call takes some milliseconds."""

    def __init__(self, arm: Arm, tool: str = 'tcp'):
        """:param tool: name of the site that is to reach"""
        self._arm = arm
        self._model, self._data = arm.model, mujoco.MjData(arm.model)
        self._site = arm.model.site(tool).id
        finite = np.isfinite(arm.limits.lower) & np.isfinite(arm.limits.upper)
        self._lower = np.where(finite, arm.limits.lower, -np.pi)
        self._upper = np.where(finite, arm.limits.upper, np.pi)
        self._limited = finite
        self._first = np.clip(arm.data.qpos, self._lower, self._upper)

    def problem(self, pose: np.ndarray) -> str:
        """
        Why the arm cannot reach a pose; empty if it can.

        :param pose: (x, y, z, qw, qx, qy, qz) of the tool in the base frame
        """
        return self._reached(pose, self._first)[1]

    def problem_of_joints(self, position: np.ndarray) -> str:
        """Why positions are not within the limits of the joints; empty if they are [rad]."""
        try:
            self._arm.limits.check(position)
        except ParameterError as error:
            return str(error)
        return ''

    def posture(self, pose: np.ndarray, near: np.ndarray, starts: int = STARTS) -> np.ndarray:
        """
        Positions of the joints with which the tool is at a pose [rad].

        :param near: where the search begins: of several postures one near to it is found first
        :param starts: postures from which it is searched before it counts as out of reach
        :raises ManifoldError: if the arm does not reach it
        """
        result, problem = self._reached(pose, near, starts)
        if problem:
            raise ManifoldError(problem)
        return result

    def towards(self, pose: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, float, float]:
        """
        Come as near to a pose as one search from a posture does; for paths, sample by sample.

        :param near: where the search begins [rad]
        :returns: positions of the joints [rad], and how far the tool is from the pose [m, rad]
        """
        return self._search(np.clip(near, self._lower, self._upper), pose)

    def pose_at(self, position: np.ndarray) -> np.ndarray:
        """Pose of the tool (x, y, z, qw, qx, qy, qz) at positions of the joints [rad]."""
        return self._arm.pose_at(position)

    def _reached(self, pose: np.ndarray, first: np.ndarray, starts: int = STARTS
                 ) -> tuple[np.ndarray, str]:
        """The first posture that reaches a pose, and why there is none."""
        best, random = (np.inf, np.inf), np.random.default_rng(0)
        for start in range(starts):
            q, *offset = self._search(
                (first if start == 0 else random.uniform(self._lower, self._upper)).copy(), pose)
            best = min(best, (offset[0], offset[1]), key=lambda item: item[0] + 0.3 * item[1])
            if best[0] <= REACHED_M and best[1] <= REACHED_RAD:
                return q, ''
        return first, (f'within its joint limits the arm comes within {1e3 * best[0]:.0f} mm and '
                       f'{best[1]:.2f} rad of ({pose[0]:.3f}, {pose[1]:.3f}, {pose[2]:.3f}) m')

    def _search(self, q: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Improve a posture; the last one that was tried, and its distance and angle."""
        model, data, n = self._model, self._data, len(q)
        jacobian, error, measured = np.zeros((6, n)), np.zeros(6), np.empty(7)
        for _ in range(STEPS):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            measured[:3] = data.site_xpos[self._site]
            mujoco.mju_mat2Quat(measured[3:], data.site_xmat[self._site])
            error[:3] = pose[:3] - measured[:3]
            rotation_between(measured[3:], pose[3:], error[3:])
            if (np.abs(error[:3]).max() < 0.1 * REACHED_M
                    and np.abs(error[3:]).max() < 0.1 * REACHED_RAD):
                break
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._site)
            damping = DAMPING + DAMPING_SHARE * float(error @ error)
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping * np.eye(6), error)
            step *= min(1.0, LARGEST_STEP / max(np.abs(step).max(), 1e-12))
            q = np.where(self._limited, np.clip(q + step, self._lower, self._upper), q + step)
        return (data.qpos.copy(), float(np.linalg.norm(error[:3])),
                float(rotation_angles(measured[3:], pose[3:])))


class Margin(NamedTuple):
    """
    What must not become small along a path.

    :ivar label: what it is, with its unit
    :ivar values: one for each pose
    :ivar least: below this the path cannot be followed
    """

    label: str
    values: np.ndarray
    least: float


@dataclass(frozen=True)
class PathCheck:
    """
    What happens along a path, one row for each pose.

    :ivar times: [s], shape ``(T,)``
    :ivar postures: with which the arm follows it [rad], shape ``(T, n)``
    :ivar away: how far the tool stays from the pose [m, rad], shape ``(T, 2)``
    :ivar margin: distance of the nearest joint limit [rad]
    :ivar joint: number of that joint, from 0 on
    :ivar singular: smallest singular value of the Jacobian (rotations times 0.3 m) [m]
    :ivar clearance: smallest distance between links that are no neighbours, or to the floor [m]
    :ivar speed: of the tool [m/s]
    :ivar acceleration: of the tool [m/s²]
    :ivar scene: distance from what is around the arm, less its margin [m]; inf without a scene
    :ivar near: which link and volume that is
    """

    times: np.ndarray
    postures: np.ndarray
    away: np.ndarray
    margin: np.ndarray
    joint: np.ndarray
    singular: np.ndarray
    clearance: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    scene: np.ndarray
    near: tuple[str, ...]

    @property
    def unreached(self) -> np.ndarray:
        """Whether the tool stays away from a pose."""
        return (self.away[:, 0] > REACHED_M) | (self.away[:, 1] > REACHED_RAD)

    @property
    def wrong(self) -> np.ndarray:
        """Whether a pose cannot be followed, for any reason."""
        limits = LimitSettings()
        return np.asarray(self.unreached | (self.speed > limits.speed)
                          | (self.acceleration > limits.acceleration) | np.any([
                              margin.values < margin.least for margin in self.margins], axis=0))

    @property
    def margins(self) -> tuple[Margin, ...]:
        """How near the arm comes to its limits."""
        return (Margin('nearest joint limit [rad]', self.margin, AT_LIMIT_RAD),
                Margin('smallest singular value [m]', self.singular,
                       LimitSettings().singularity_stop),
                Margin('distance of links [m]', self.clearance, TOUCHING_M),
                *([Margin('distance from the scene, less its margin [m]', self.scene, 0.0)]
                  if np.isfinite(self.scene).any() else []))

    def problems(self) -> list[str]:
        """Why the arm cannot follow the path, one line for each reason; empty if it can."""
        result = []
        times, stop = self.times, LimitSettings().singularity_stop

        def first(wrong: np.ndarray) -> str:
            at = times[wrong]
            return f'from {at[0]:.2f} to {at[-1]:.2f} s'
        if self.unreached.any():
            worst = int(np.argmax(self.away[:, 0] + 0.3 * self.away[:, 1]))
            result.append(f'out of reach {first(self.unreached)}: the tool stays up to '
                          f'{1e3 * self.away[worst, 0]:.0f} mm and {self.away[worst, 1]:.2f} rad '
                          f'away, most at {times[worst]:.2f} s')
        near = (self.margin < AT_LIMIT_RAD) & ~self.unreached
        if near.any():
            joints = ', '.join(str(item + 1) for item in np.unique(self.joint[near]))
            result.append(f'joint {joints} at its limit {first(near)}')
        singular = self.singular < stop
        if singular.any():
            result.append(f'singular {first(singular)}: smallest singular value '
                          f'{self.singular.min():.3f} m, the reference stops at {stop:g} m')
        touching = self.clearance < TOUCHING_M
        if touching.any():
            result.append(f'the arm touches itself or the floor {first(touching)}')
        for what in dict.fromkeys(name for name, left in zip(self.near, self.scene)
                                  if left < 0.0):
            inside = np.array([name == what for name in self.near]) & (self.scene < 0.0)
            result.append(f'{what} are up to {-1e3 * self.scene[inside].min():.0f} mm inside the '
                          f'margin {first(inside)}')
        limits = LimitSettings()
        for what, values, limit, unit in (
                ('speed', self.speed, limits.speed, 'm/s'),
                ('acceleration', self.acceleration, limits.acceleration, 'm/s²')):
            if (values > limit).any():
                result.append(f'too fast {first(values > limit)}: the {what} of the tool is up to '
                              f'{values.max():.3g} {unit}, the reference is limited to '
                              f'{limit:g} {unit}')
        return result


class PathChecker:
    """Follows paths with one arm, pose by pose, without dynamics."""

    def __init__(self, arm: Arm, tool: str = 'tcp', scene: Scene | None = None):
        """
        Prepare.

        :param arm: is moved
        :param tool: name of the site that follows the path
        :param scene: around the arm, in the frame of its base
        :raises DataError: if the scene does not fit the arm
        """
        self._arm, self._reach = arm, Reach(arm, tool)
        self._pairs = _pairs(arm.model)
        self.surround(scene or Scene())

    def surround(self, scene: Scene) -> None:
        """
        Check with another scene from now on.

        :raises DataError: if it does not fit the arm; the one before stays
        """
        arm, shape = self._arm, self._arm.shape.with_load()
        carried_capsules(scene.carried, arm.end_pose, len(arm.home), shape.capsules)
        self._volumes = scene.packed(shape.bits)
        self.scene, self._shape = scene, shape

    @property
    def tool(self) -> Tool:
        """Shape of the tool."""
        return tool_of(self._arm)

    def tool_frames(self, frame: str) -> dict[str, np.ndarray]:
        """Frames that move with the tool; see `gdmp_ros.sim.tool_shape.tool_frames`."""
        return tool_frames(self._arm, frame)

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints of the arm."""
        return list(self._arm.names)

    def check(self, times: np.ndarray, poses: np.ndarray,
              posture: np.ndarray | None = None) -> PathCheck:
        """
        Follow a path; each posture is searched from the one before.

        :param times: of the poses [s]
        :param poses: (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``
        :param posture: with which the arm comes to the first pose is searched from here [rad];
            by default the home posture
        """
        reach = self._reach
        near = self._arm.home if posture is None else posture
        with suppress(ManifoldError):  # `away` tells how far it comes then
            near = reach.posture(poses[0], near, _STARTS)
        postures, offset = [], []
        for pose in poses:
            near, *distance = reach.towards(pose, near)
            postures.append(near)
            offset.append(distance)
        return self._at(times, np.array(postures), np.array(offset))

    def check_postures(self, times: np.ndarray, postures: np.ndarray) -> PathCheck:
        """
        Check a path of the joints.

        :param postures: [rad], shape ``(T, n)``
        :raises DataError: if the arm has another number of joints
        """
        count = len(self._arm.names)
        if postures.shape[1] != count:
            raise DataError(f'the path is of {postures.shape[1]} joints, the arm has {count}')
        return self._at(times, postures, np.zeros((len(postures), 2)))

    def position(self, posture: np.ndarray) -> np.ndarray:
        """Position of the tool in a posture [m]."""
        return self._reach.pose_at(posture)[:3]

    def _at(self, times: np.ndarray, postures: np.ndarray, offset: np.ndarray) -> PathCheck:
        arm, direction = self._arm, np.empty(6)
        margin, joint, singular, clearance, positions = [], [], [], [], []
        around = [self._from_scene(posture) for posture in postures]
        for posture in postures:
            arm.reset(posture)
            to_limit = np.minimum(posture - arm.limits.lower, arm.limits.upper - posture)
            joint.append(int(np.argmin(to_limit)))
            margin.append(float(to_limit.min()))
            measured = arm.measure()
            positions.append(measured.pose[:3].copy())
            singular.append(singular_value(measured.jacobian, direction))
            clearance.append(self._clearance())
        velocities, accelerations = _derivatives(np.asarray(times), np.array(positions))
        return PathCheck(np.asarray(times), postures, offset, np.array(margin), np.array(joint),
                         np.array(singular), np.array(clearance),
                         np.linalg.norm(velocities, axis=1), np.linalg.norm(accelerations, axis=1),
                         np.array([left for left, _ in around]),
                         tuple(names for _, names in around))

    def _from_scene(self, posture: np.ndarray) -> tuple[float, str]:
        """Distance from the nearest volume, less its margin [m], and the names."""
        if not len(self._volumes):
            return np.inf, ''
        shape = self._shape
        deep = depths(self._arm.chain, shape, posture, self._volumes)
        volume, link = np.unravel_index(int(np.argmax(deep)), deep.shape)
        return -float(deep[volume, link]), f'{shape.links[link]} and {self.scene.names[volume]}'

    def _clearance(self) -> float:
        model, data = self._arm.model, self._arm.data
        return min((mujoco.mj_geomDistance(model, data, first, second, _FAR_M, None)
                    for first, second in self._pairs), default=_FAR_M)


def _derivatives(times: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and accelerations along a path; 0 of a single pose."""
    if len(times) < 2:
        return np.zeros_like(positions), np.zeros_like(positions)
    velocities = np.gradient(positions, times, axis=0)
    return velocities, np.gradient(velocities, times, axis=0)


def _pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Geoms whose distance matters: of bodies that are no neighbours, and of the floor."""
    order = joints_before(model)
    arm = [i for i in range(model.ngeom) if model.geom_bodyid[i] != 0]
    world = [i for i in range(model.ngeom)
             if model.geom_bodyid[i] == 0 and model.geom_contype[i] != 0]
    pairs = [(a, b) for k, a in enumerate(arm) for b in arm[k + 1:]
             if abs(order[model.geom_bodyid[a]] - order[model.geom_bodyid[b]]) > NEIGHBOURS]
    # The first links stand on the floor.
    return pairs + [(a, b) for a in arm for b in world
                    if order[model.geom_bodyid[a]] > NEIGHBOURS]


def check_skill(skill: Skill, checker: PathChecker, poses: int = POSES
                ) -> tuple[PathCheck, np.ndarray]:
    """
    Check the motion of a skill between its own ends.

    :returns: what was found, and the positions of the tool [m], shape ``(poses, 3)``
    :raises DataError: if it is neither a skill of a pose nor of as many joints as the arm has
    """
    skill = joints_in_order(skill, checker.joint_names)
    tool = StreamedSkill(skill, PlayerSettings())
    if tool.kind is Kind.TWO_TOOLS:
        raise DataError('the skill is one of two arms: check the skill of each, in the frame of '
                        'its own base')
    times = np.linspace(0.0, DURATIONS * skill.duration, poses)
    points = skill.rollout().sample(times).points.reshape(len(times), -1)
    if tool.kind is Kind.TOOL:
        return checker.check(times, points[:, :7]), points[:, :3]
    result = checker.check_postures(times, points)
    return result, np.array([checker.position(posture) for posture in points])
