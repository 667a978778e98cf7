"""Motions as the page shows them: poses over time, with the stiffness."""
from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gdmp_ros.data import runs
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.product import Product
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.prediction import likely_path
from gdmp_ros.playback.tool_skill import ToolSkill
from gdmp_ros.sim.skill_check import DURATIONS

#: Ellipsoids along a tube.
TUBE = 24
#: Samples of a motion.
SAMPLES = 240


@dataclass(frozen=True)
class ShownMotion:
    """
    A motion of the tool.

    :ivar times: [s], from 0 on, shape ``(T,)``
    :ivar poses: (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``
    :ivar stiffness: translational [N/m], shape ``(T, 3, 3)``; None without one
    :ivar joints: positions [rad], shape ``(T, n)``; None where they were not recorded
    """

    times: np.ndarray
    poses: np.ndarray
    stiffness: np.ndarray | None = None
    joints: np.ndarray | None = None

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
        kept = np.unique(np.linspace(0, len(self.times) - 1, count).round().astype(int))
        return ShownMotion(self.times[kept], self.poses[kept], *(
            None if part is None else part[kept] for part in (self.stiffness, self.joints)))


def check_shown(skill: Skill) -> None:
    """:raises DataError: unless it is a skill of a pose"""
    ToolSkill(skill, PlayerSettings())


def of_skill(skill: Skill) -> ShownMotion:
    """The motion of a skill of a pose between its own ends; one cycle of a rhythmic one."""
    last = skill.duration if skill.rhythmic else DURATIONS * skill.duration
    times = np.linspace(0.0, last, SAMPLES)
    return _of_points(times, skill.rollout().sample(times).points, skill.manifold)


def of_demonstration(shown: Demonstration) -> ShownMotion:
    """A demonstrated motion."""
    return _of_points(shown.times - shown.times[0], shown.points, shown.manifold).thinned(SAMPLES)


def _of_points(times: np.ndarray, points: np.ndarray, manifold: object) -> ShownMotion:
    flat = points.reshape(len(times), -1)
    motion = ShownMotion(times, flat[:, :7])
    names = manifold.names if isinstance(manifold, Product) else ()
    if 'stiffness' not in names or not isinstance(manifold, Product):
        return motion
    at = names.index('stiffness')
    matrices = np.array([manifold.split(point)[at][:3, :3] for point in points])
    return replace(motion, stiffness=matrices)


def of_run(bag: Path) -> tuple[ShownMotion, ShownMotion]:
    """
    What was sent and what the arm did, in a recorded run.

    :raises DataError: if the bag has no references and states
    """
    run = runs.read(bag)
    first = run.state_stamps[0]
    blocks = run.stiffness.reshape(-1, 6, 6)[:, :3, :3]
    done = ShownMotion(1e-9 * (run.state_stamps - first), run.poses, blocks, run.joints)
    sent = ShownMotion(1e-9 * (run.reference_stamps - first), run.references)
    # Enough for a slider; the report shows every tick.
    return sent.thinned(10 * SAMPLES), done.thinned(10 * SAMPLES)


def tube(skill: Skill) -> tuple[np.ndarray, np.ndarray] | None:
    """
    How takes vary around a skill (`gdmp_ros.playback.prediction.likely_path`).

    None for a skill of a single take, and with via points, which no take showed.
    """
    if skill.distribution is None or skill.via:
        return None
    return likely_path(skill, skill.start[:7], skill.goal[:7], TUBE)
