"""The shape of what an arm carries at its end, for ways of the tool around volumes."""
from __future__ import annotations

import numpy as np

from gdmp_ros.manifolds.poses import compose, inverse
from gdmp_ros.scene.route import Tool
from gdmp_ros.sim.arm import Arm


def tool_of(arm: Arm) -> Tool:
    """Return the capsules behind the last joint of an arm, in the frame of its tool."""
    last, back = len(arm.home), inverse(arm.end_pose)
    rows = [row for row in arm.shape.capsules if row[0] == last]
    still = [1.0, 0.0, 0.0, 0.0]
    return Tool(np.array([[*compose(back, np.array([*row[1:4], *still]))[:3],
                           *compose(back, np.array([*row[4:7], *still]))[:3], row[7]]
                          for row in rows]).reshape(-1, 7))
