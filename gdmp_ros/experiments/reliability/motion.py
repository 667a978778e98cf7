"""Whether a recorded arm stayed inside its limits, and what of the recording is missing."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.data.runs import Run
from gdmp_ros.experiments.reliability.outcome import Outcome
from gdmp_ros.sim.arm import Arm

#: States further apart are not neighbours: the simulation was started anew, or stood still [ns].
GAP_NS = 5_000_000
#: A measured speed may exceed the reference's limit by this: the arm swings.
SWING = 1.1


def judge(run: Run, outcome: Outcome, limits: LimitSettings | None = None) -> None:
    """Torque, its rate, joints and their speed, speed of the tool, energy of the tank."""
    limits = limits or LimitSettings()
    arm = Arm().limits
    near = np.diff(run.state_stamps) < GAP_NS
    rate = np.abs(np.diff(run.torques, axis=0))[near]
    over = np.maximum(run.joints - arm.upper, arm.lower - run.joints).max()
    outcome.need('torque [share of the limit]', float((np.abs(run.torques) / arm.torque).max()),
                 lambda v: v <= 1.0)
    outcome.need('torque rate [Nm per tick]', float(rate.max()),
                 lambda v: v <= limits.torque_rate + 1e-9)
    outcome.need('distance to joint limits [rad]', float(-over), lambda v: v >= 0.0)
    outcome.need('joint speed [rad/s]', float(np.abs(run.velocities).max()),
                 lambda v: v <= limits.joint_speed)
    outcome.need('speed [m/s]', float(np.linalg.norm(run.twists[:, :3], axis=1).max()),
                 lambda v: v <= SWING * limits.speed)
    outcome.need('least energy in the tank [J]', float(run.tank.min()), lambda v: v >= -0.05)


def begun(run: Run) -> np.ndarray:
    """Indices of the states in which the arm first followed a reference."""
    return np.flatnonzero(np.diff(run.applied.astype(np.int64), prepend=0) != 0)


def gaps(run: Run) -> np.ndarray:
    """Times between two references that were followed, and when each ended [s, ns]."""
    first = begun(run)
    ends = run.state_stamps[first[1:]]
    return np.column_stack([np.diff(run.state_stamps[first]) * 1e-9, ends])


def most_ticks_unled(run: Run) -> int:
    """
    Most ticks of the arm in a row that brought it no reference, once it had one.

    Ticks, not time: a machine with too much to do keeps the arm waiting as well.
    """
    return int(np.diff(begun(run)).max()) - 1


def behind(run: Run) -> float:
    """Distance at the end between the arm and the last reference that it followed [m]."""
    # A state may be recorded while its reference has just missed the end of the recording.
    followed = run.applied[np.isin(run.applied, run.sequences)]
    if not len(followed):
        return float('nan')
    at = np.flatnonzero(run.sequences == followed[-1])
    return float(np.linalg.norm(run.poses[-1, :3] - run.references[at[-1], :3]))


def at_rest(run: Run, since_ns: int, speed: float = 2e-3) -> float:
    """Seconds from a time until the tool stays slower than ``speed`` [m/s]; NaN if it does not."""
    after = run.state_stamps >= since_ns
    moving = np.linalg.norm(run.twists[after, :3], axis=1) > speed
    stamps = run.state_stamps[after]
    if not len(stamps) or moving[-1]:
        return float('nan')
    last = int(np.flatnonzero(moving)[-1]) if moving.any() else 0
    return float((stamps[last] - since_ns) * 1e-9)
