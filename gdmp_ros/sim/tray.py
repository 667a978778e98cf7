"""A tray with a ball on it, for two arms to carry."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.manifolds.poses import compose
from gdmp_ros.sim.arm import Arm, Extra
from gdmp_ros.sim.gripper import add_gripper
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plant import PlantSettings
from gdmp_ros.sim.two_arms import TwoArms
from gdmp_ros.sim.world import World

#: Names of the arms, and the distance of their bases from the middle [m].
SIDES, APART = ('left', 'right'), 0.28
#: Tray: half size, half thickness, height of its rim [m], mass [kg].
HALF, THIN, RIM, MASS = (0.12, 0.2), 0.003, 0.006, 0.4
#: Handles: upright plates between tray and fingers, half size [m].
HANDLE = (0.03, 0.008, 0.03)
#: Ball: radius [m] and mass [kg].
BALL, BALL_MASS = 0.015, 0.05
#: Tray below the tools when they hold its handles [m].
BELOW = 0.035
#: Force of each gripper [N]; time in which it closes, and the arms take over the weight [s].
GRIP, CLOSE_S = 40.0, 1.0
_BOX = mujoco.mjtGeom.mjGEOM_BOX
#: Everything collides with tray and ball.
_SOLID = {'contype': 3, 'conaffinity': 3}
_WOOD, _DARK, _RED = [0.72, 0.58, 0.42, 1.0], [0.3, 0.3, 0.32, 1.0], [0.85, 0.2, 0.15, 1.0]


def grasp(side: str) -> np.ndarray:
    """Pose of a tool in the frame of the tray, pointing down between tool and handle."""
    sign = 1.0 if side == SIDES[0] else -1.0
    return np.array([0.0, sign * APART, BELOW, 0.0, 1.0, 0.0, 0.0])


def bases() -> dict[str, np.ndarray]:
    """Poses of the bases of the arms in the world."""
    return {side: np.array([0.0, grasp(side)[1], 0.0, 1.0, 0.0, 0.0, 0.0]) for side in SIDES}


def tool_poses(tray: np.ndarray) -> np.ndarray:
    """Poses of both tools that hold the tray at a pose, shape ``(14,)``."""
    return np.concatenate([compose(tray, grasp(side)) for side in SIDES])


def add_tray(pose: np.ndarray) -> Extra:
    """Return what adds a tray with a ball, on a stand, to a world (`World`)."""
    def add(spec: mujoco.MjSpec) -> None:
        below = 0.5 * (pose[2] - THIN)
        spec.worldbody.add_geom(name='stand', type=_BOX, size=[0.06, 0.1, below], rgba=_WOOD,
                                pos=[pose[0], pose[1], below], **_SOLID)
        tray = spec.worldbody.add_body(name='tray', pos=pose[:3], quat=pose[3:])
        tray.add_freejoint()
        tray.mass, tray.explicitinertial, tray.ipos = MASS, True, [0.0, 0.0, 0.0]
        tray.inertia = [MASS * (2 * HALF[1]) ** 2 / 12.0 * 1.5, MASS * (2 * HALF[0]) ** 2 / 12.0,
                        MASS * 4.0 * (HALF[0] ** 2 + HALF[1] ** 2) / 12.0]
        tray.add_geom(name='tray', type=_BOX, size=[*HALF, THIN], rgba=_WOOD, **_SOLID)
        for axis in (0, 1):
            for sign in (-1.0, 1.0):
                size, at = np.array([*HALF, RIM / 2]), np.array([0.0, 0.0, RIM / 2])
                size[axis], at[axis] = THIN, sign * (HALF[axis] + THIN)
                tray.add_geom(type=_BOX, size=size, pos=at, rgba=_WOOD, **_SOLID)
        for side in SIDES:
            at, out = grasp(side)[:3], 1.0 if side == SIDES[0] else -1.0
            tray.add_geom(type=_BOX, size=HANDLE, pos=[0.0, at[1], at[2] - 0.01], rgba=_DARK,
                          friction=[1.5, 0.05, 1e-3], condim=4, solref=[0.004, 1.0], **_SOLID)
            # The bar between tray and handle.
            reach = 0.5 * (APART - HALF[1])
            tray.add_geom(type=_BOX, size=[HANDLE[0], reach, THIN],
                          pos=[0.0, out * (HALF[1] + reach), 0.0], rgba=_DARK,
                          **_SOLID)
        ball = spec.worldbody.add_body(name='ball', pos=pose[:3] + [0.0, 0.0, THIN + BALL + 1e-4])
        ball.add_freejoint()
        ball.mass, ball.explicitinertial = BALL_MASS, True
        ball.ipos, ball.inertia = [0.0, 0.0, 0.0], [0.4 * BALL_MASS * BALL ** 2] * 3
        ball.add_geom(name='ball', type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0.0, 0.0],
                      rgba=_RED, friction=[0.6, 0.005, 2e-4], condim=6,
                      solref=[0.005, 1.0], **_SOLID)
    return add


def pose_on_stand() -> np.ndarray:
    """Pose of the tray between the tools in their first posture."""
    arm = Arm()
    tool = arm.pose_at(arm.home)
    return np.array([tool[0], 0.0, tool[2] - BELOW, 1.0, 0.0, 0.0, 0.0])


def hold_tray(plant: PlantSettings | None = None) -> TwoArms:
    """Two arms that have gripped the tray on its stand, and know their share of its weight."""
    arms = TwoArms(World(bases(), [add_gripper], [add_tray(pose_on_stand())], plant), True)
    arms.grip(GRIP)
    arms.wait(CLOSE_S)
    arms.announce(Payload(0.5 * (MASS + BALL_MASS)))
    arms.wait(CLOSE_S)
    return arms


def ball_is_on_tray(world: World) -> bool:
    """Whether the ball is above the tray, within its rim."""
    at, turn = world.data.body('tray').xpos, world.data.body('tray').xmat.reshape(3, 3)
    x, y, z = turn.T @ (world.data.body('ball').xpos - at)
    return bool(abs(x) < HALF[0] and abs(y) < HALF[1] and 0.0 < z < 3.0 * BALL)


def tilt(world: World) -> float:
    """Angle of the tray from level [rad]."""
    return float(np.arccos(np.clip(world.data.body('tray').xmat[8], -1.0, 1.0)))
