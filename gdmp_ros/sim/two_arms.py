"""Two arms of one simulation, each under its impedance controller, that execute one skill."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.target import POSE, TARGET_SIZE
from gdmp_ros.control.tick import Tick
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.playback.pair_skill import is_of_two_arms
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.player_settings import PlayerSettings
from gdmp_ros.playback.requests import Status
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.execution import LONGEST_S
from gdmp_ros.sim.gripper import SimulatedGripper
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.world import World

#: Time after the motion [s].
REST_S = 1.0


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
            if loop.gripper is not None:
                loop.gripper.command(GripperCommand(0.0, force))

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
