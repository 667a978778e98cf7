"""The last motion of a recorded run, as corrections need it."""
from __future__ import annotations

import numpy as np

from gdmp_ros.data.run_analysis import tracking
from gdmp_ros.data.runs import Run
from gdmp_ros.errors import DataError
from gdmp_ros.learning.correction import FollowedMotion

#: Status of the server during a motion.
_MOVING = ('moving', 'paused')
#: States of the arm that are used: one in so many.
_EVERY = 10


def followed_motion(run: Run) -> FollowedMotion:
    """
    The last motion of a run of the nodes.

    :raises DataError: if the server's state was not recorded, or the arm followed no motion
    """
    moving = np.array([status in _MOVING for status in run.statuses], dtype=bool)
    if not moving.any():
        raise DataError('the run has no motion of a trajectory server: record its topic '
                        '~/state too')
    last = int(np.flatnonzero(moving)[-1])
    rest = np.flatnonzero(~moving[:last])
    first = int(rest[-1]) + 1 if len(rest) else 0
    stamps, progress = run.goal_stamps[first:last + 1], run.progress[first:last + 1]
    found = tracking(run, int(stamps[0]), int(stamps[-1]))
    states, references = found.states[::_EVERY], found.references[::_EVERY]
    # Differences of stamps are exact; stamps as numbers with a decimal point are not.
    at = np.interp(run.state_stamps[states] - stamps[0], stamps - stamps[0], progress)
    return FollowedMotion(at, run.references[references], run.poses[states])
