"""
Independent bookkeeping of energy; it shares no code with the controller.

The motors' work is that of the torque that acted. What of it is neither potential energy of
gravity nor energy of the spring must have come from the tank.
"""
from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.control.measurement import Tick
from gdmp_ros.sim.closed_loop import ClosedLoop


def potential(pose: np.ndarray, target: np.ndarray, clips: tuple[float, float] = (0.1, 0.5),
              largest: tuple[float, float] = (60.0, 15.0)) -> float:
    """Energy of the spring [J]: quadratic, and beyond its bound linear in the elastic norm."""
    stiffness = target[19:55].reshape(6, 6)
    turn = (Rotation.from_quat(np.roll(target[3:7], -1))
            * Rotation.from_quat(np.roll(pose[3:7], -1)).inv())
    shift, rotation = target[:3] - pose[:3], turn.as_rotvec()
    corner = stiffness[3:, 3:]
    coupling = np.linalg.solve(corner, stiffness[3:, :3])
    upper = stiffness[:3, :3] - stiffness[:3, 3:] @ coupling
    rest = rotation + coupling @ shift
    total = 0.0
    for matrix, error, clip, force in ((upper, shift, clips[0], largest[0]),
                                       (corner, rest, clips[1], largest[1])):
        root = np.sqrt(np.linalg.eigvalsh(matrix)[-1])
        bound, square = min(clip * root, force / root), error @ matrix @ error
        total += (0.5 * square if square <= bound ** 2
                  else bound * np.sqrt(square) - 0.5 * bound ** 2)
    return total


def joint_potential(position: np.ndarray, target: np.ndarray, clip: float = 0.2) -> float:
    """
    Energy of the springs of the joints [J].

    Quadratic, and beyond the clip linear in the error.
    """
    n = len(position)
    error = np.abs(target[:n] - position)
    return float(np.sum(target[2 * n:3 * n] * np.where(
        error <= clip, 0.5 * error ** 2, clip * error - 0.5 * clip ** 2)))


class Audit:
    """
    The content of the tank from what was seen of the robot.

    :ivar content: in each tick [J]
    """

    def __init__(self, loop: ClosedLoop):
        self.loop, self.content = loop, [loop.controller.tank.energy]
        self._first: float | None = None
        self._work = 0.0

    def tick(self) -> Tick:
        """Let the loop tick, and account for the tick before."""
        arm, loop = self.loop.arm, self.loop
        pose, velocity = self.pose(), arm.data.qvel.copy()
        position = arm.data.qpos.copy()
        mujoco.mj_energyPos(arm.model, arm.data)
        gravity = float(arm.data.energy[0])
        result = loop.tick()
        reference = loop.controller.reference
        level = gravity - (potential(pose, reference) if len(reference) > 3 * len(position) + 1
                           else joint_potential(position, reference))
        if self._first is None:
            self._first = level
        self.content.append(self.content[0] - self._work + level - self._first)
        applied = arm.data.actuator_force.copy()
        self._work += 0.5 * arm.period * float(applied @ (velocity + arm.data.qvel))
        return result

    def pose(self) -> np.ndarray:
        """Pose of the tool in the simulation."""
        site, pose = self.loop.arm.data.site('tcp'), np.zeros(7)
        pose[:3] = site.xpos
        mujoco.mju_mat2Quat(pose[3:], site.xmat)
        return pose
