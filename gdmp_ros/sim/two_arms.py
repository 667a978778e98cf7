"""Two arms of one simulation, each under its impedance controller, that execute one skill."""
from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.target import POSE, TARGET_SIZE
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.states import Status
from gdmp_ros.playback.streamed_skill import is_of_two_arms
from gdmp_ros.sim.arm import advance, Arm, Extra, PANDA, Robot
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.execution import LONGEST_S
from gdmp_ros.sim.gripper import add_gripper, SimulatedGripper
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plant import change, PlantSettings

#: Time after the motion [s].
REST_S = 1.0
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


class World:
    """
    Pandas with their bases at given poses; `advance` lets time pass for all of them.

    Poses of the tools are those in the world.

    :ivar arms: by their names
    :ivar xml: the model as MJCF
    """

    def __init__(self, bases: Mapping[str, np.ndarray], tools: Sequence[Extra] = (),
                 extras: Sequence[Extra] = (), plant: PlantSettings | None = None):
        """
        Build the simulation.

        :param bases: name of each arm, and the pose of its base (x, y, z, qw, qx, qy, qz)
        :param tools: add to each arm what its controller does not know, such as a gripper
        :param extras: add objects to the world
        :param plant: how the simulated arms differ from the models with which they are controlled
        :raises ParameterError: without arms
        """
        if not bases:
            raise ParameterError('a world needs at least one arm')
        world = _without_arm()
        for name, base in bases.items():
            child = mujoco.MjSpec.from_file(str(PANDA))
            for add in tools:
                add(child)
            world.option.impratio, world.option.cone = child.option.impratio, child.option.cone
            frame = world.worldbody.add_frame(pos=base[:3], quat=base[3:])
            frame.attach_body(child.body('link0'), f'{name}_', '')
        for add in extras:
            add(world)
        self.model = world.compile()
        self.xml = world.to_xml()
        self.data = mujoco.MjData(self.model)
        settings = plant or PlantSettings()
        self.arms = {name: self._arm(name, base, settings) for name, base in bases.items()}
        self.reset()

    def _arm(self, name: str, base: np.ndarray, plant: PlantSettings) -> Arm:
        known = mujoco.MjSpec.from_file(str(PANDA))
        known.body('link0').pos, known.body('link0').quat = base[:3], base[3:]
        model, compiled = self.model, known.compile()
        first = model.joint(f'{name}_joint1')
        count = compiled.nv
        motor = model.actuator(f'{name}_joint1').id
        site = model.site(f'{name}_tcp').id
        joints = slice(int(first.qposadr[0]), int(first.qposadr[0]) + count)
        change(model, site, joints, plant)
        return Arm.among_others(Robot(model, self.data, site, joints, slice(motor, motor + count)),
                                compiled, plant)

    @property
    def period(self) -> float:
        """Time step [s]."""
        return float(self.model.opt.timestep)

    def reset(self) -> None:
        """Put everything where it was at the beginning, the arms at their first keyframe."""
        mujoco.mj_resetData(self.model, self.data)
        for arm in self.arms.values():
            arm.reset()

    def advance(self) -> None:
        """
        Advance by one period.

        :raises DataError: if the simulation is unstable
        """
        advance(self.model, self.data)


def _without_arm() -> mujoco.MjSpec:
    """The world of the built-in Panda: floor, light, camera, options."""
    spec = mujoco.MjSpec.from_file(str(PANDA))
    spec.delete(spec.body('link0'))
    for group in (spec.keys, spec.actuators, spec.sensors):
        for item in list(group):
            spec.delete(item)
    return spec


class Moment(NamedTuple):
    """
    One tick of both arms.

    :ivar reference: poses of both, shape ``(14,)``
    :ivar measured: the same
    :ivar ticks: of both controllers
    """

    reference: np.ndarray
    measured: np.ndarray
    ticks: tuple[Tick, ...]


class TwoArms:
    """
    Both closed loops; the first and second arm of a world are the sides of a skill.

    :ivar player: of the skill that is executed
    """

    def __init__(self, world: World, grippers: bool = False,
                 settings: ControllerSettings | None = None):
        """
        Hold both arms.

        :param grippers: whether the world has them (`gdmp_ros.sim.gripper.add_gripper`)
        :raises DataError: unless the world has two arms
        """
        if len(world.arms) != 2:
            raise DataError(f'the world has {len(world.arms)} arms, expected 2')
        self.world = world
        self.loops = [ClosedLoop(arm, settings, SimulatedGripper(
            world.model, world.data, f'{name}_') if grippers else None)
            for name, arm in world.arms.items()]
        self.player: Player | None = None

    @property
    def poses(self) -> np.ndarray:
        """Measured poses of both tools, shape ``(14,)``."""
        return np.concatenate([loop.arm.measure().pose for loop in self.loops])

    def tick(self) -> tuple[Tick, ...]:
        """Advance both by one period; both measure before either moves."""
        ticks = tuple(loop.act() for loop in self.loops)
        self.world.advance()
        return ticks

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / self.world.period)):
            self.tick()

    def grip(self, force: float) -> None:
        """Let both grippers close with a force [N]."""
        for loop in self.loops:
            if loop.driver.gripper is not None:
                loop.driver.gripper.command(GripperCommand(0.0, force))

    def announce(self, payload: Payload) -> None:
        """Tell both controllers what each arm carries."""
        for loop in self.loops:
            loop.arm.announce(payload)

    def execute(self, skill: Skill, each: Callable[[float, Player], None] = lambda s, player: None,
                rest_s: float = REST_S) -> Iterator[Moment]:
        """
        Execute a skill of two arms from where they are, tick by tick.

        :param each: called before each tick with the progress of the motion
        :param rest_s: time after the motion [s]; the motion lasts at most `LONGEST_S`
        :raises DataError: if it is no skill of two arms
        :raises RefusedError: if an arm does not follow a reference
        """
        if not is_of_two_arms(skill):
            raise DataError(f'the skill is on {skill.manifold!r}, expected the poses of two tools')
        player = self.player = Player(skill, PlayerSettings())
        player.start(self.poses)
        left, period = LONGEST_S, self.world.period
        while left > 0.0:
            rollout = player.rollout
            each(0.0 if rollout is None else rollout.progress, player)
            target = player.tick(period)
            if target is None:
                raise RuntimeError('a motion that was started has no reference')
            parts = target[:TARGET_SIZE], target[TARGET_SIZE:]
            for loop, part in zip(self.loops, parts):
                loop.must_follow(part)
            ticks = self.tick()
            yield Moment(np.concatenate([part[POSE:POSE + 7] for part in parts]),
                         np.concatenate([tick.measurement.pose for tick in ticks]), ticks)
            if player.status is Status.HOLDING:
                left = min(left, rest_s)
            left -= period


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
