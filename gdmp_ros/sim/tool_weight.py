"""Weight of what hangs at the sensor of an arm, from postures in which the arm rested."""
from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.weight import GRAVITY
from gdmp_ros.data import bags
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.poses import compose, inverse
from gdmp_ros.manifolds.quaternion import rotate
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.names import indices_of

#: An arm rests if no joint moves further than this within this time [rad, s]; the beginning of
#: each rest, in which the sensor settles, is left out [s].
STILL_RAD, REST_S, SETTLES_S = 0.002, 1.0, 0.3
#: Fewest postures, and the least spread of the direction of the weight: its smallest deviation
#: from the mean along any axis, of a unit vector.
FEWEST, LEAST_SPREAD = 4, 0.1


class ToolWeight(NamedTuple):
    """
    What hangs at a sensor.

    :ivar mass: [kg]
    :ivar center: of it, in the frame of the tool site [m], shape ``(3,)``
    :ivar bias: of the sensor, in its frame [N, Nm], shape ``(6,)``
    :ivar force: largest force that is left unexplained in a posture [N]
    :ivar torque: the same of the torque [Nm]
    :ivar postures: in which the arm rested
    """

    mass: float
    center: np.ndarray
    bias: np.ndarray
    force: float
    torque: float
    postures: int


def weigh(bag: str | Path, arm: Arm, sensor: np.ndarray, joints: str, wrench: str) -> ToolWeight:
    """
    Find the weight in a recording of an arm that rested in several postures.

    :param sensor: pose of the sensor in the frame of the last joint
    :param joints: topic of a JointState
    :param wrench: topic of a WrenchStamped: what acts on the sensor from the side of the tool
    :raises DataError: if there are too few postures, or they do not turn the tool enough
    """
    with bags.opened(bag) as reader:
        states = bags.series_in(reader, bag, joints, bags.JOINTS)
        felt = bags.series_in(reader, bag, wrench, bags.WRENCH)
    positions = states.values[:, indices_of(arm.names, states.names, 'joint')]
    seconds = (states.stamps - states.stamps[0]) / bags.NS
    times = (felt.stamps - states.stamps[0]) / bags.NS
    turned, measured = [], []
    for first, last in _rests(seconds, positions):
        inside = (times > first + SETTLES_S) & (times < last)
        if inside.any():
            at = positions[(seconds >= first) & (seconds <= last)].mean(axis=0)
            pose = arm.chain.pose_at(at, sensor)
            down = np.empty(3)
            rotate(pose[3:] * [1.0, -1.0, -1.0, -1.0], np.array([0.0, 0.0, -GRAVITY]), down)
            turned.append(down)
            measured.append(felt.values[inside].mean(axis=0))
    return solved(str(bag), np.array(turned).reshape(-1, 3), np.array(measured).reshape(-1, 6),
                  compose(inverse(sensor), arm.end_pose))


def solved(where: str, gravity: np.ndarray, wrenches: np.ndarray, site: np.ndarray) -> ToolWeight:
    """
    Solve for mass, centre and bias.

    :param where: of the recording, for messages
    :param gravity: in the frame of the sensor, for each posture, shape ``(N, 3)`` [m/s²]
    :param wrenches: shape ``(N, 6)``
    :param site: pose of the tool site in the frame of the sensor
    :raises DataError: see `weigh`
    """
    count = len(gravity)
    if count < FEWEST:
        raise DataError(f'{where}: the arm rested for {REST_S:g} s in {count} postures, expected '
                        f'at least {FEWEST}')
    spread = float(np.sqrt(np.linalg.eigvalsh(np.cov(gravity.T / 9.81, bias=True))[0]))
    if spread < LEAST_SPREAD:
        raise DataError(f'{where}: the tool is turned too little between the postures (spread '
                        f'{spread:.2g}, expected {LEAST_SPREAD:g}): point it down, to the side, '
                        'forwards and up')
    design, right = np.zeros((6 * count, 10)), wrenches.reshape(-1)
    for k, down in enumerate(gravity):
        force, torque = design[6 * k:6 * k + 3], design[6 * k + 3:6 * k + 6]
        force[:, 0], force[:, 4:7] = down, np.eye(3)
        # c × m g = -g × (m c)
        torque[:, 1:4] = -np.array([[0.0, -down[2], down[1]], [down[2], 0.0, -down[0]],
                                    [-down[1], down[0], 0.0]])
        torque[:, 7:10] = np.eye(3)
    found = np.linalg.lstsq(design, right, rcond=None)[0]
    left = np.abs((design @ found - right).reshape(-1, 2, 3)).max(axis=(0, 2))
    mass = float(found[0])
    if mass <= 0.0:
        raise DataError(f'{where}: the weight comes out as {mass:.3g} kg: the sensor measures the '
                        'opposite of what acts on it from the side of the tool')
    center = np.concatenate([found[1:4] / mass, [1.0, 0.0, 0.0, 0.0]])
    return ToolWeight(mass, compose(inverse(site), center)[:3], found[4:10], float(left[0]),
                      float(left[1]), count)


def _rests(times: np.ndarray, positions: np.ndarray) -> list[tuple[float, float]]:
    """When the arm rested: begin and end of each time."""
    result, first = [], 0
    for k in range(1, len(times) + 1):
        if k == len(times) or np.abs(positions[k] - positions[first]).max() > STILL_RAD:
            if times[k - 1] - times[first] >= REST_S:
                result.append((float(times[first]), float(times[k - 1])))
            first = k
    return result
