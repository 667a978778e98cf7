"""Figures of a recorded run: tracking, goal, limits, timing."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.data.runs import lost, Run
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite

#: Between states further apart than this the simulation stood still or was restarted [ns].
STATE_GAP_NS = 5_000_000
#: References published this long after their stamps have stamps of another clock [s].
OTHER_CLOCK_S = 10.0


class Tracking(NamedTuple):
    """
    Distance between the arm and the reference that it followed.

    :ivar states: indices of the states that followed a recorded reference
    :ivar references: indices of these references
    :ivar position: distances [m]
    :ivar rotation: angles [rad]
    """

    states: np.ndarray
    references: np.ndarray
    position: np.ndarray
    rotation: np.ndarray


def tracking(run: Run, begin_ns: int | None = None, end_ns: int | None = None) -> Tracking:
    """
    Compare every measured pose with the reference that was followed.

    :param begin_ns: stamp of the first state; by default all
    :param end_ns: stamp of the last state
    """
    order = np.argsort(run.sequences, kind='stable')
    at = np.minimum(np.searchsorted(run.sequences[order], run.applied), len(order) - 1)
    references = order[at]
    followed = run.sequences[references] == run.applied
    if begin_ns is not None:
        followed &= run.state_stamps >= begin_ns
    if end_ns is not None:
        followed &= run.state_stamps <= end_ns
    states = np.flatnonzero(followed)
    references = references[states]
    desired, measured = run.references[references], run.poses[states]
    return Tracking(states, references,
                    np.linalg.norm(measured[:, :3] - desired[:, :3], axis=1),
                    rotation_angles(measured[:, 3:], desired[:, 3:]))


def stiffness_error(run: Run, tracked: Tracking) -> float:
    """Mean relative difference between applied stiffness and that of the reference."""
    desired = run.reference_stiffness[tracked.references]
    difference = np.linalg.norm(run.stiffness[tracked.states] - desired, axis=1)
    return float(np.mean(difference / np.linalg.norm(desired, axis=1)))


class GoalError(NamedTuple):
    """Distance of arm and applied stiffness from a goal: m, rad, geodesic."""

    position: float
    rotation: float
    stiffness: float


def goal_error(run: Run, when_ns: int, pose: np.ndarray, stiffness: np.ndarray) -> GoalError:
    """
    Compare arm and applied translational stiffness with a goal at a time.

    :param stiffness: shape ``(3, 3)``
    """
    i = min(int(np.searchsorted(run.state_stamps, when_ns)), len(run.state_stamps) - 1)
    applied = run.stiffness[i].reshape(6, 6)[:3, :3].copy()
    return GoalError(float(np.linalg.norm(run.poses[i, :3] - pose[:3])),
                     float(rotation_angles(run.poses[i, 3:], pose[3:])),
                     SymmetricPositiveDefinite(3).distance(applied, stiffness))


class LimitFigures(NamedTuple):
    """
    How close a run came to the limits of the arm.

    :ivar torque: largest, relative to the limit of its joint
    :ivar torque_rate: largest change between neighbouring states [Nm]
    :ivar joint_distance: smallest distance from a joint limit, negative beyond it [rad]
    :ivar joint_speed: largest [rad/s]
    :ivar speed: largest of the tool [m/s]
    :ivar tank_energy: smallest [J]
    """

    torque: float
    torque_rate: float
    joint_distance: float
    joint_speed: float
    speed: float
    tank_energy: float


def limit_figures(run: Run, joints: JointLimits) -> LimitFigures:
    """Compare a run with the limits of the joints."""
    neighbours = np.diff(run.state_stamps) < STATE_GAP_NS
    rate = np.abs(np.diff(run.torques, axis=0))[neighbours]
    beyond = np.maximum(run.joints - joints.upper, joints.lower - run.joints)
    return LimitFigures(
        float((np.abs(run.torques) / joints.torque).max()), float(rate.max(initial=0.0)),
        float(-beyond.max()), float(np.abs(run.velocities).max()),
        float(np.linalg.norm(run.twists[:, :3], axis=1).max()), float(run.tank.min()))


def lateness(run: Run) -> np.ndarray:
    """Time from the stamp of each reference, its deadline, to its publication [s]."""
    return np.asarray((run.published - run.reference_stamps) * 1e-9)


def newly_followed(run: Run) -> np.ndarray:
    """Indices of the states in which the arm first followed a reference."""
    return np.flatnonzero(np.diff(run.applied.astype(np.int64), prepend=0) != 0)


def reference_gaps(run: Run) -> np.ndarray:
    """Time between two references that were followed [s], and stamp of its end [ns], as rows."""
    first = newly_followed(run)
    return np.column_stack([np.diff(run.state_stamps[first]) * 1e-9, run.state_stamps[first[1:]]])


def longest_wait(run: Run) -> int:
    """
    Largest number of consecutive ticks of the arm without a new reference, after the first.

    In ticks, because a busy machine delays the arm too.
    """
    return int(np.diff(newly_followed(run)).max()) - 1


def final_distance(run: Run) -> float:
    """Distance at the end between the arm and the last reference that it followed [m]."""
    # The recording may end between a state and its reference.
    followed = run.applied[np.isin(run.applied, run.sequences)]
    if not len(followed):
        return float('nan')
    at = np.flatnonzero(run.sequences == followed[-1])
    return float(np.linalg.norm(run.poses[-1, :3] - run.references[at[-1], :3]))


def time_to_rest(run: Run, since_ns: int, speed: float = 2e-3) -> float:
    """Time until the tool stays slower than ``speed`` [m/s]; NaN if it does not [s]."""
    after = run.state_stamps >= since_ns
    moving = np.linalg.norm(run.twists[after, :3], axis=1) > speed
    stamps = run.state_stamps[after]
    if not len(stamps) or moving[-1]:
        return float('nan')
    last = int(np.flatnonzero(moving)[-1]) if moving.any() else 0
    return float((stamps[last] - since_ns) * 1e-9)


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values ** 2)))


def summary(run: Run, tracked: Tracking) -> list[tuple[str, str]]:
    """Rows of a table: what was measured, and its value with unit."""
    late = 1e6 * lateness(run)
    same_clock = np.abs(np.median(late)) < 1e6 * OTHER_CLOCK_S
    seconds = np.ptp(run.reference_stamps) * 1e-9
    speed = np.linalg.norm(run.twists[:, :3], axis=1)
    rows = [
        ('duration', f'{np.ptp(run.state_stamps) * 1e-9:.2f} s'),
        ('references', f'{len(run.sequences)}, {len(run.sequences) / max(seconds, 1e-9):.1f} per '
                       'second'),
        ('references lost', f'{lost(run)}'),
        ('lateness p50, p99, max', ', '.join(f'{value:.0f}' for value in (
            *np.percentile(late, [50, 99]), late.max())) + ' µs' if same_clock else
         'not known: the stamps are of another clock'),
        ('largest speed', f'{speed.max():.3f} m/s'),
        ('smallest energy in the tank', f'{run.tank.min():.2f} J'),
    ]
    if len(tracked.states):
        rows.insert(3, ('tracking error, RMS', f'{1e3 * rms(tracked.position):.2f} mm, '
                                               f'{rms(tracked.rotation):.4f} rad'))
        rows.insert(4, ('tracking error, largest', f'{1e3 * tracked.position.max():.2f} mm, '
                                                   f'{tracked.rotation.max():.4f} rad'))
    return rows
