"""A recorded run, made without nodes."""
import numpy as np

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.data.runs import Run

NS = 1_000_000_000
#: Stamp of the first reference and state [ns].
BEGIN_NS = 1_700_000_000 * NS


def recorded_run(count=2000):
    """A motion of 1 s; no references from 1.2 s to 1.5 s; one limit is exceeded twice."""
    t = 1e-3 * np.arange(count)
    poses = np.column_stack([0.4 + 0.1 * np.minimum(t, 1.0), 0.1 * np.sin(t), 0.5 + 0 * t,
                             1 + 0 * t, 0 * t, 0 * t, 0 * t])
    stamps = BEGIN_NS + (t * NS).round().astype(np.int64)
    kept = (t < 1.2) | (t >= 1.5)
    limited = np.zeros((count, len(LIMITS)))
    limited[100:150, 2], limited[900:1000, 2] = 0.4, 1.5
    stiffness = np.tile(np.diag([400.0] * 3 + [30.0] * 3).reshape(-1), (count, 1))
    sequences = 7_000_000 + np.arange(count, dtype=np.uint64)
    twists = np.zeros((count, 6))
    twists[t < 1.0, 0] = 0.1
    away = poses.copy()
    away[:, 2] += 0.003
    return Run(reference_stamps=stamps[kept], published=stamps[kept] + 50_000,
               sequences=sequences[kept], references=poses[kept],
               reference_stiffness=stiffness[kept], moving=(t < 1.0)[kept], state_stamps=stamps,
               applied=sequences[np.where(kept, np.arange(count), 1199)], poses=away,
               stiffness=stiffness, twists=twists, joints=np.zeros((count, 7)),
               velocities=np.zeros((count, 7)), torques=np.zeros((count, 7)),
               tank=5.0 - 0.5 * t, limited=limited, modes=np.zeros(int(kept.sum())),
               arm_modes=np.zeros(count), ticks=np.arange(count), wrenches=np.zeros((count, 6)),
               joint_references=np.full((count, 7), np.nan), goal_stamps=stamps[::100],
               goals=np.where(t[::100, None] < 0.45, poses[-1], poses[0]))
