"""What the recorded bag says: losses, tracking, the switched goal, limits."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gdmp_ros.data.runs import Run
from gdmp_ros.manifolds import SymmetricPositiveDefinite

#: Largest change of a joint torque per 1 ms tick [Nm].
TORQUE_RATE = 1.0


def lost(run: Run) -> int:
    """References published between the first and the last recorded one, and not recorded."""
    return int(run.sequences[-1] - run.sequences[0] + 1 - len(np.unique(run.sequences)))


def rotation_angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Rotation angles between quaternions (wxyz), row by row [rad]."""
    dot = np.abs(np.sum(a * b, axis=1))
    cross = np.linalg.norm(a - b * np.sign(np.sum(a * b, axis=1))[:, None], axis=1)
    # From the chord where it is short: arccos loses half the digits there.
    return np.asarray(np.where(dot > 0.9, 4.0 * np.arcsin(np.clip(0.5 * cross, 0.0, 1.0)),
                               2.0 * np.arccos(np.clip(dot, 0.0, 1.0))))


@dataclass(frozen=True)
class Errors:
    """Position [m] and rotation [rad] error over time since the motion began [s]."""

    times: np.ndarray
    position: np.ndarray
    rotation: np.ndarray


def tracking_errors(run: Run, ends_ns: int) -> Errors:
    """Measured against the reference of the same stamp, from the first motion to ``ends_ns``."""
    begins = run.reference_stamps[int(np.argmax(run.moving))]
    inside = (run.state_stamps >= begins) & (run.state_stamps <= ends_ns)
    stamps = run.state_stamps[inside]
    wanted = np.column_stack([np.interp(stamps, run.reference_stamps, column)
                              for column in run.references.T])
    wanted[:, 3:] /= np.linalg.norm(wanted[:, 3:], axis=1, keepdims=True)
    measured = run.poses[inside]
    return Errors((stamps - begins) * 1e-9,
                  np.linalg.norm(measured[:, :3] - wanted[:, :3], axis=1),
                  rotation_angles(measured[:, 3:], wanted[:, 3:]))


def tracking(run: Run, ends_ns: int) -> dict[str, float]:
    """Figures of `tracking_errors` and of the applied stiffness against the reference's."""
    errors = tracking_errors(run, ends_ns)
    at = np.searchsorted(run.sequences, run.applied)
    known = (run.applied > 0) & (at < len(run.sequences))
    wanted = run.reference_stiffness[at[known]]
    difference = np.linalg.norm(run.stiffness[known] - wanted, axis=1)
    return {'position_rmse_m': _rms(errors.position), 'rotation_rmse_rad': _rms(errors.rotation),
            'position_max_m': float(errors.position.max()),
            'rotation_max_rad': float(errors.rotation.max()),
            'stiffness_rel_error': float(np.mean(difference / np.linalg.norm(wanted, axis=1)))}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values ** 2)))


def at_goal(run: Run, when_ns: int, pose: np.ndarray, stiffness: np.ndarray) -> dict[str, float]:
    """Arm and applied stiffness against a goal at a time."""
    i = min(int(np.searchsorted(run.state_stamps, when_ns)), len(run.state_stamps) - 1)
    applied = run.stiffness[i].reshape(6, 6)[:3, :3].copy()
    return {'final_position_error_m': float(np.linalg.norm(run.poses[i, :3] - pose[:3])),
            'final_rotation_error_rad': float(rotation_angles(run.poses[i:i + 1, 3:],
                                                              pose[None, 3:])[0]),
            'final_stiffness_distance': SymmetricPositiveDefinite(3).distance(applied, stiffness)}


def limits(run: Run, lower: np.ndarray, upper: np.ndarray, torque: np.ndarray) -> dict[str, bool]:
    """Whether torque, torque rate and joint positions stayed inside their limits."""
    change = np.abs(np.diff(run.torques, axis=0))
    return {'torque_ok': bool((np.abs(run.torques) <= torque).all()),
            'torque_rate_ok': bool((change <= TORQUE_RATE + 1e-9).all()),
            'joint_ok': bool(((run.joints >= lower) & (run.joints <= upper)).all())}
