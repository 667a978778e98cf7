"""The shape of what an arm carries at its end, for ways of the tool around volumes."""
from __future__ import annotations

import numpy as np

from gdmp_ros.manifolds.poses import compose, inverse
from gdmp_ros.scene.route import Tool
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.urdf import LinkFrames, links_of


def tool_of(arm: Arm) -> Tool:
    """Return the capsules behind the last joint of an arm, in the frame of its tool."""
    last, back = len(arm.home), inverse(arm.end_pose)
    rows = [row for row in arm.shape.capsules if row[0] == last]
    still = [1.0, 0.0, 0.0, 0.0]
    return Tool(np.array([[*compose(back, np.array([*row[1:4], *still]))[:3],
                           *compose(back, np.array([*row[4:7], *still]))[:3], row[7], row[8]]
                          for row in rows]).reshape(-1, 8), arm.shape.with_load().bits)


def tool_frames(arm: Arm, frame: str) -> dict[str, np.ndarray]:
    """
    Poses, in the tool, of the frames of the description that move with it.

    :param frame: ``frame_id`` of the base
    """
    site, model = arm.site, arm.model
    here = inverse(np.concatenate([model.site_pos[site], model.site_quat[site]]))
    found = {links_of(arm, frame).bodies[arm.tool_body]: here}
    rest = LinkFrames(arm, frame).fixed
    while True:
        # Some are further from the tool, others are its parents.
        new = {child: compose(found[parent], pose) for parent, child, pose in rest
               if parent in found and child not in found}
        new |= {parent: compose(found[child], inverse(pose)) for parent, child, pose in rest
                if child in found and parent not in found}
        if not new:
            return found
        found |= new
