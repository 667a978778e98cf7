"""
RoboTasks9: real kinesthetic demonstrations of a Franka, several takes of each task.

A task is an ``.npy`` file with takes × samples × (x, y, z [cm], qw, qx, qy, qz). It has no time.

Source: Auddy, Hollenstein, Saveriano, Rodriguez-Sanchez, Piater 2023.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.poses import tool_manifold

#: Duration that is assumed [s].
DURATION = 5.0
_METRES = 0.01


def files(folder: Path) -> list[Path]:
    """
    Files of the tasks in a folder.

    :raises DataError: if there are none
    """
    result = sorted(folder.glob('*.npy'))
    if not result:
        raise DataError(f'{folder}: no task of RoboTasks9 (.npy)')
    return result


def takes(path: Path) -> list[Demonstration]:
    """
    Takes of a task on R³ × S³, with consistent signs.

    :raises DataError: if the file is no array of takes
    """
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise DataError(f'{path}: cannot be read: {error}') from None
    if array.ndim != 3 or array.shape[2] != 7 or array.shape[1] < 3:
        raise DataError(f'{path}: shape is {array.shape}, expected (takes, samples, 7)')
    points = np.array(array, dtype=np.float64)
    points[:, :, :3] *= _METRES
    points[:, :, 3:] /= np.linalg.norm(points[:, :, 3:], axis=2, keepdims=True)
    times = np.linspace(0.0, DURATION, array.shape[1])
    demos = [Demonstration(times, point, tool_manifold(None)) for point in points]
    return [demo.aligned(demos[0].points[0]) for demo in demos]
