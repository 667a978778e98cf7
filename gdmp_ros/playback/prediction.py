"""The rest of a motion, computed ahead."""
from __future__ import annotations

import numpy as np

from gdmp_ros.dmp.rollout import Rollout

#: A prediction ends after this many durations of the motion.
LONGEST = 5


def predicted_poses(rollout: Rollout, count: int) -> np.ndarray:
    """
    Poses from the present moment to the end of a motion.

    :param rollout: of pose and stiffness; is advanced
    :param count: how many there are in one duration of the motion
    :returns: shape ``(T, 7)``
    """
    rollout.resume()
    step = rollout.duration / count
    poses = [rollout.state.point[:7]]
    # A goal that moves slowly, or a tempo that has to grow first, take longer than that.
    while not rollout.finished and len(poses) < LONGEST * count:
        poses.append(rollout.advance(step).point[:7])
    return np.array(poses)
