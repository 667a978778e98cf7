"""Motions as the page shows them, of skills, takes and recorded runs; their curves over time."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.data import bags, recordings, runs
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.playback.prediction import likely_path
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.streamed_skill import is_of_joints, Kind, StreamedSkill
from gdmp_ros.sim.path_check import DURATIONS
from gdmp_ros.view import style

#: Ellipsoids along a tube.
TUBE = 24
#: Samples of a motion.
SAMPLES = 240
#: Pose of the tool (x, y, z, qw, qx, qy, qz) at positions of the joints [rad].
PoseAt: TypeAlias = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class ShownMotion:
    """
    A motion of the tool.

    :ivar times: [s], from 0 on, shape ``(T,)``
    :ivar poses: (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``
    :ivar stiffness: translational [N/m], shape ``(T, 3, 3)``; None without one
    :ivar joints: positions [rad], shape ``(T, n)``; None where they are not known
    :ivar width: that the gripper was told [m], shape ``(T,)``, NaN before the first command; None
        without commands
    :ivar error: distance from the reference [m, rad], shape ``(T, 2)``; None where nothing was
        followed
    :ivar wrench: external, acting on the tool [N, Nm], shape ``(T, 6)``; None where not known
    :ivar recorded: whether an arm has done it
    """

    times: np.ndarray
    poses: np.ndarray
    stiffness: np.ndarray | None = None
    joints: np.ndarray | None = None
    width: np.ndarray | None = None
    error: np.ndarray | None = None
    wrench: np.ndarray | None = None
    recorded: bool = False

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.times[-1])

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.poses[:, :3], axis=0), axis=1).sum())

    @property
    def speed(self) -> float:
        """Largest speed [m/s]."""
        steps = np.linalg.norm(np.diff(self.poses[:, :3], axis=0), axis=1)
        return float((steps / np.maximum(np.diff(self.times), 1e-9)).max())

    def index(self, time: float) -> int:
        """Number of the sample at a time [s]."""
        return int(np.clip(np.searchsorted(self.times, time), 0, len(self.times) - 1))

    def thinned(self, count: int) -> ShownMotion:
        """At most ``count`` samples of it."""
        kept = _kept(len(self.times), count)
        parts: dict[str, Any] = {name: None if part is None else part[kept] for name, part in (
            ('stiffness', self.stiffness), ('joints', self.joints), ('width', self.width),
            ('error', self.error), ('wrench', self.wrench))}
        return replace(self, times=self.times[kept], poses=self.poses[kept], **parts)

    def gripper_notes(self) -> list[tuple[str, np.ndarray]]:
        """What the gripper is told, and where the tool is then [m]."""
        if self.width is None:
            return []
        known = np.nan_to_num(self.width, nan=-1.0)
        changed = np.flatnonzero(np.diff(known, prepend=-1.0))
        return [(f'gripper to {1e3 * self.width[at]:.0f} mm', self.poses[at, :3])
                for at in changed]

    def curves(self) -> dict[str, Curve]:
        """What is known of it over time, by what it is."""
        seconds = np.maximum(np.diff(self.times), 1e-9)
        turns = Rotation.from_quat(self.poses[:, 3:], scalar_first=True)
        steps = (turns[1:] * turns[:-1].inv()).as_rotvec()
        found = {
            'position': Curve(('x [m]', 'y [m]', 'z [m]'), self.poses[:, :3]),
            'speed': Curve(('speed [m/s]', 'rotation [rad/s]'), _at_samples(np.column_stack([
                np.linalg.norm(np.diff(self.poses[:, :3], axis=0), axis=1) / seconds,
                np.linalg.norm(steps, axis=1) / seconds]))),
            'orientation': Curve(
                ('about x [deg]', 'about y [deg]', 'about z [deg]'),
                np.degrees((turns * turns[0].inv()).as_rotvec()))}
        if self.joints is not None:
            found['joints'] = Curve(tuple(
                f'joint {k} [deg]' for k in range(1, self.joints.shape[1] + 1)),
                np.degrees(self.joints))
        if self.stiffness is not None:
            found['stiffness'] = Curve(
                ('largest [N/m]', 'middle [N/m]', 'smallest [N/m]'),
                np.linalg.eigvalsh(self.stiffness)[:, ::-1])
        if self.width is not None:
            found['gripper'] = Curve(('width [mm]',), 1e3 * self.width[:, None])
        if self.error is not None:
            found['error'] = Curve(('position [mm]', 'rotation [mrad]'), 1e3 * self.error)
        if self.wrench is not None:
            found['force'] = Curve(('x [N]', 'y [N]', 'z [N]'), self.wrench[:, :3])
        return found


class Curve(NamedTuple):
    """
    Numbers over the times of a motion.

    :ivar labels: of the columns, with units
    :ivar values: shape ``(T, k)``; NaN where there is none
    """

    labels: tuple[str, ...]
    values: np.ndarray


def _kept(samples: int, count: int) -> np.ndarray:
    """Numbers of at most ``count`` samples of so many, evenly spread."""
    return np.unique(np.linspace(0, samples - 1, count).round().astype(int))


def _at_samples(between: np.ndarray) -> np.ndarray:
    """Values at the samples, from those between them."""
    before, after = np.vstack([between[:1], between]), np.vstack([between, between[-1:]])
    return np.asarray(0.5 * (before + after))


def check_shown(skill: Skill, joints: Sequence[str]) -> None:
    """
    :param joints: names of the joints of the arm; none: not known yet
    :raises DataError: unless it is a skill of a pose, or of the joints of the arm
    """
    kind = StreamedSkill(skill, PlayerSettings()).kind
    if kind is Kind.TWO_TOOLS:
        raise DataError('the skill is one of two arms: the studio shows one; open the skill of '
                        'each arm instead')
    if kind is Kind.JOINTS and joints and len(skill.start) != len(joints):
        raise DataError(f'the skill is of {len(skill.start)} joints, the arm has {len(joints)}')


def of_skill(skill: Skill, pose_at: PoseAt | None = None) -> ShownMotion:
    """
    The motion of a skill between its own ends; one cycle of a rhythmic one.

    :param pose_at: of the arm, for a skill of its joints
    :raises DataError: if it is one of joints, and there is no arm
    """
    last = skill.duration if skill.rhythmic else DURATIONS * skill.duration
    times = np.linspace(0.0, last, SAMPLES)
    points = skill.rollout().sample(times).points
    width = _widths([(event.progress * skill.duration, event.width) for event in skill.events],
                    times)
    if not is_of_joints(skill):
        return _of_points(times, points, skill.manifold, width)
    if pose_at is None:
        raise DataError('the skill is one of joints: to show it an arm is needed')
    joints = points.reshape(len(times), -1)
    return ShownMotion(times, np.array([pose_at(row) for row in joints]), joints=joints,
                       width=width)


def of_demonstration(demo: Demonstration, pose_at: PoseAt) -> ShownMotion:
    """A demonstrated motion of a tool, or of the joints of an arm."""
    times = demo.times - demo.times[0]
    if not is_of_joints(demo):
        return _of_points(times, demo.points, demo.manifold).thinned(SAMPLES)
    kept = _kept(len(times), SAMPLES)
    joints = demo.points.reshape(len(times), -1)[kept]
    return ShownMotion(times[kept], np.array([pose_at(row) for row in joints]), joints=joints)


def _of_points(times: np.ndarray, points: np.ndarray, manifold: Manifold,
               width: np.ndarray | None = None) -> ShownMotion:
    return ShownMotion(times, points.reshape(len(times), -1)[:, :7],
                       style.stiffness_of(manifold, points), width=width)


def _widths(commands: Sequence[tuple[float, float]], times: np.ndarray) -> np.ndarray | None:
    """
    Width of the gripper at each time; None without commands.

    :param commands: time [s] and width [m] of each, in their order
    """
    if not commands:
        return None
    begins, widths = np.array(commands).T
    at = np.searchsorted(begins, times, side='right') - 1
    return np.where(at < 0, np.nan, widths[np.maximum(at, 0)])


def of_run(bag: Path) -> tuple[ShownMotion, ShownMotion]:
    """
    What was sent and what the arm did, in a recorded run.

    :raises DataError: if the bag has no references and states
    """
    with bags.opened(bag) as reader:
        commands = recordings.commands_in(reader, str(bag))
    return of_states(runs.read(bag), commands)


def of_states(run: runs.Run, commands: Sequence[recordings.RecordedCommand] = ()
              ) -> tuple[ShownMotion, ShownMotion]:
    """What was sent and what the arm did; see `of_run`."""
    first = run.state_stamps[0]
    times = 1e-9 * (run.state_stamps - first)
    blocks = run.stiffness.reshape(-1, 6, 6)[:, :3, :3]
    tracked = runs.tracking(run)
    error = np.full((len(times), 2), np.nan)
    error[tracked.states] = np.column_stack([tracked.position, tracked.rotation])
    width = _widths([(1e-9 * (command.stamp - first), command.width) for command in commands],
                    times)
    done = ShownMotion(times, run.poses, blocks, run.joints, width, error, run.wrenches, True)
    sent = ShownMotion(1e-9 * (run.reference_stamps - first), run.references)
    # Enough for a slider; the report shows every tick.
    return sent.thinned(10 * SAMPLES), done.thinned(10 * SAMPLES)


def tube(skill: Skill) -> tuple[np.ndarray, np.ndarray] | None:
    """
    How takes vary around a skill (`gdmp_ros.playback.prediction.likely_path`).

    None for a skill of a single take, of joints, and with via points, which no take showed.
    """
    if skill.distribution is None or skill.via or is_of_joints(skill):
        return None
    return likely_path(skill, skill.start[:7], skill.goal[:7], TUBE)
