"""
Three tasks with objects, shown in a few situations and executed in others on the simulated arm.

A peg goes out of a rack into a turned hole, 1 mm wider on each side; a spout is held over a cup
and tilted; a cube is picked from the floor and placed in a box. The objects are moved and turned
in every situation; the takes go between them as hands do, each with another arc. A skill with task
frames is compared with one that only gets the goal.
"""
from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.poses import compose, tool_manifold
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.execution import execute, Execution
from gdmp_ros.sim.gripper import add_gripper, SimulatedGripper
from gdmp_ros.sim.scenes import (
    cube_and_box,
    CUBE_EDGE,
    peg_and_holes,
    PEG_BELOW,
    PEG_HALF_LENGTH,
    PLACE,
)
from gdmp_ros.util.profiles import minimum_jerk

#: Objects are moved by up to this [m], turned about the vertical and tilted [rad].
REACH, YAW, TILT = 0.15, 0.5 * np.pi, np.radians(20.0)
DURATION, SAMPLES = 10.0, 500
#: Samples of a way and their noise [m, rad], as of a hand that is measured.
NOISE = 2e-4
#: Peg: clearance on each side and depth [m].
CLEARANCE, DEPTH = 0.001, 0.02
#: Stiffness along and about the axes of the tool [N/m, Nm/rad].
STIFFNESS = (1200.0, 1200.0, 1200.0, 60.0, 60.0, 60.0)
#: Spout in the tool [m]; how near the axis of the cup it has to stay, and the tilt to be [m, rad].
SPOUT, NEAR, SAME_TILT = np.array([0.08, 0.0, 0.0]), 0.015, 0.15
#: Tilt of the tool at which something pours, and that of the shown one [rad].
POURS, SHOWN_TILT = 0.6, 1.0
_MANIFOLD = tool_manifold(6)
_DOWN = Rotation.from_quat([0.0, 1.0, 0.0, 0.0], scalar_first=True)


class Situation(NamedTuple):
    """Poses of the two objects."""

    start: np.ndarray
    goal: np.ndarray


def situation(rng: np.random.Generator, places: tuple[np.ndarray, np.ndarray]) -> Situation:
    """Draw poses of the objects around their usual places [m]."""
    poses = []
    for place, share in zip(places, (0.3, 1.0)):
        turn = Rotation.from_euler('z', share * rng.uniform(-YAW, YAW)) * Rotation.from_rotvec(
            share * TILT * rng.uniform(0.0, 1.0) * _across(rng))
        offset = share * rng.uniform(-REACH, REACH, 3) * [1.0, 1.0, 0.3]
        poses.append(np.concatenate([place + offset, turn.as_quat(scalar_first=True)]))
    return Situation(*poses)


def _across(rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


class Task(NamedTuple):
    """
    A task.

    :ivar situation: draws where the objects are
    :ivar shown: makes a take in a situation
    :ivar arm: makes the arm with the objects
    :ivar succeeded: judges an execution, with the arm as it is then
    :ivar events: commands for the gripper
    """

    situation: Callable[[np.random.Generator], Situation]
    shown: Callable[[Situation, np.random.Generator], Demonstration]
    arm: Callable[[Situation], Arm]
    succeeded: Callable[[Situation, Execution, Arm], bool]
    events: tuple[GripperEvent, ...] = ()

    @property
    def grasp_at(self) -> float | None:
        """Progress at which something is grasped; None if nothing is."""
        return next((event.progress for event in self.events if event.force > 0.0), None)


def _way(points: list[tuple[float, np.ndarray]], situation: Situation, rng: np.random.Generator
         ) -> Demonstration:
    """
    A take through poses of the tool at moments of its duration, with a hand's arc between.

    :param points: s and pose in the base
    """
    from scipy.interpolate import PchipInterpolator
    from scipy.spatial.transform import Slerp
    s = np.linspace(0.0, 1.0, SAMPLES)
    moments = np.array([at for at, _ in points])
    poses = np.array([pose for _, pose in points])
    path = PchipInterpolator(moments, poses[:, :3])(s)
    turns = Rotation.from_quat(poses[:, 3:], scalar_first=True)
    eased = np.interp(s, moments, np.arange(len(moments)))
    eased = np.floor(eased) + minimum_jerk(eased - np.floor(eased))
    orientation = Slerp(np.arange(len(moments)), turns)(np.minimum(eased, len(moments) - 1.0))
    arc = np.sin(np.pi * np.clip((s - 0.25) / 0.4, 0.0, 1.0)) ** 2
    path += arc[:, None] * rng.normal(0.0, 0.02, 3) + rng.normal(0.0, NOISE, path.shape)
    flat = np.hstack([path, orientation.as_quat(scalar_first=True),
                      np.tile(np.diag(STIFFNESS).reshape(-1), (SAMPLES, 1))])
    return Demonstration(DURATION * s, flat, _MANIFOLD, frames={
        'start': situation.start, 'goal': situation.goal})


def _tool(frame: np.ndarray, height: float, turn: Rotation | None = None,
          offset: np.ndarray | None = None) -> np.ndarray:
    """Pose of the tool above an object, pointing down at it."""
    orientation = _DOWN if turn is None else turn * _DOWN
    place = np.array([0.0, 0.0, height]) + (0.0 if offset is None else offset)
    return compose(frame, np.concatenate([place, orientation.as_quat(scalar_first=True)]))


#: Height of the tool above the top of a hole with the tip of the peg there [m].
_TIP = PEG_BELOW + PEG_HALF_LENGTH


def _peg_shown(where: Situation, rng: np.random.Generator) -> Demonstration:
    deep = _tool(where.goal, _TIP - DEPTH - 0.004)
    return _way([(0.0, _tool(where.start, _TIP + 0.02)), (0.2, _tool(where.start, _TIP + 0.10)),
                 (0.7, _tool(where.goal, _TIP + 0.06)), (0.88, _tool(where.goal, _TIP + 0.012)),
                 (0.98, deep), (1.0, deep)], where, rng)


def _peg_arm(where: Situation) -> Arm:
    return Arm(peg_and_holes([where.goal], CLEARANCE))


def _peg_in(where: Situation, done: Execution, arm: Arm) -> bool:
    turn = Rotation.from_quat(where.goal[3:], scalar_first=True)
    tool = turn.inv().apply(done.measured[-1, :3] - where.goal[:3])
    return bool(tool[2] < _TIP - DEPTH and np.linalg.norm(tool[:2]) < 2.0 * CLEARANCE)


def _pouring_shown(where: Situation, rng: np.random.Generator) -> Demonstration:
    tilt = Rotation.from_euler('y', SHOWN_TILT)
    over = np.array([0.0, 0.0, 0.12])
    held = _DOWN.apply(SPOUT)
    points = [(0.0, _tool(where.start, 0.12)), (0.2, _tool(where.start, 0.2)),
              (0.75, _tool(where.goal, 0.0, None, over - held))]
    for at, share in ((0.82, 0.25), (0.87, 0.5), (0.92, 0.75), (0.97, 1.0), (1.0, 1.0)):
        turn = Rotation.from_rotvec(share * tilt.as_rotvec())
        points.append((at, _tool(where.goal, 0.0, turn, over - turn.apply(held))))
    return _way(points, where, rng)


def _poured(where: Situation, done: Execution, arm: Arm) -> bool:
    turns = Rotation.from_quat(done.measured[:, 3:], scalar_first=True)
    spout = done.measured[:, :3] + turns.apply(SPOUT)
    cup = Rotation.from_quat(where.goal[3:], scalar_first=True)
    inside = cup.inv().apply(spout - where.goal[:3])
    shown = cup * Rotation.from_euler('y', SHOWN_TILT) * _DOWN
    upright = turns.apply([0.0, 0.0, -1.0])[:, 2]
    tilted = np.arccos(np.clip(upright, -1.0, 1.0)) > POURS
    away = np.linalg.norm(inside[:, :2], axis=1) > NEAR
    off = float((shown.inv() * turns[-1]).magnitude())
    return bool(not (tilted & away).any() and off < SAME_TILT and not away[-1])


#: Height of the centre of the cube on the floor, and of the tool there [m].
_LYING = 0.5 * CUBE_EDGE
#: Where the cube and the box usually are [m].
_CUBE, _BOX = np.array([0.45, -0.25, _LYING]), np.array([0.45, 0.25, 0.0])


def _on_the_floor(rng: np.random.Generator) -> Situation:
    """Draw a cube and a box that are moved and turned on the floor."""
    poses = []
    for place in (_CUBE, _BOX):
        offset = np.append(rng.uniform(-REACH, REACH, 2), 0.0)
        turn = Rotation.from_euler('z', rng.uniform(-YAW, YAW))
        poses.append(np.concatenate([place + offset, turn.as_quat(scalar_first=True)]))
    return Situation(*poses)


def _pick_shown(where: Situation, rng: np.random.Generator) -> Demonstration:
    held = _tool(where.start, 0.0)
    return _way([(0.0, _tool(where.start, 0.25)), (0.2, _tool(where.start, 0.1)), (0.35, held),
                 (0.45, held), (0.55, _tool(where.start, 0.2)), (0.8, _tool(where.goal, 0.25)),
                 (0.97, _tool(where.goal, 0.06)), (1.0, _tool(where.goal, 0.06))], where, rng)


def _pick_arm(where: Situation) -> Arm:
    return Arm(extras=[add_gripper, lambda spec: cube_and_box(spec, where.start, where.goal)])


def _placed(where: Situation, done: Execution, arm: Arm) -> bool:
    """Whether the cube lies in the box."""
    cube = arm.data.body('cube').xpos
    inside = Rotation.from_quat(where.goal[3:], scalar_first=True).inv().apply(
        cube - where.goal[:3])
    return bool((np.abs(inside[:2]) < PLACE.half).all() and inside[2] < PLACE.height)


_DRAWN = partial(situation, places=(np.array([0.45, -0.25, 0.25]), np.array([0.5, 0.1, 0.2])))
TASKS = {
    'peg': Task(_DRAWN, _peg_shown, _peg_arm, _peg_in),
    'pouring': Task(_DRAWN, _pouring_shown, lambda where: Arm(), _poured),
    'pick': Task(_on_the_floor, _pick_shown, _pick_arm, _placed,
                 (GripperEvent(0.36, 0.0, 20.0, 0.1), GripperEvent(1.0, 0.08, 0.0, 0.1)))}


def attempt(task: Task, skill: Skill, where: Situation) -> bool:
    """Execute a skill in a situation; an arm that cannot follow has failed."""
    arm = task.arm(where)
    gripper = SimulatedGripper(arm.model, arm.data) if task.events else None
    try:
        done = execute(skill.with_events(task.events), arm, gripper=gripper)
        return task.succeeded(where, done, arm)
    except GdmpError:
        return False


#: What is compared.
SKILLS = 'five_takes', 'one_take', 'without_frames'


def measure(name: str, count: int, seed: int, step: Callable[[], None]) -> dict[str, Any]:
    """
    Share of held-out situations in which a skill succeeds, for each of `SKILLS`.

    The one without frames goes from the start to the goal of the situation, as they are with
    frames.

    :param step: is called after each execution
    """
    task, rng = TASKS[name], np.random.default_rng(seed)
    takes = [task.shown(where, rng) for where in (task.situation(rng) for _ in range(5))]
    held_out = [task.situation(rng) for _ in range(count)]
    plain = Skill.learn(Demonstration(takes[0].times, takes[0].points, _MANIFOLD))
    five, one = (Skill.learn(shown, grasp_at=task.grasp_at) for shown in (takes, takes[0]))
    done = dict.fromkeys(SKILLS, 0)
    for where in held_out:
        here = one.with_frames(where._asdict())
        for kind, skill in zip(SKILLS, (five.with_frames(where._asdict()), here,
                                        plain.between(here.start, here.goal))):
            done[kind] += attempt(task, skill, where)
            step()
    return {'situations': count, **{kind: found / count for kind, found in done.items()}}
