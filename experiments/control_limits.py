"""
Control at its limits: joints, walls, targets out of reach, wrong twists, and energy.

Each case is tried on the model itself (``clean``) and on a robot that is not the model (``real``:
dry friction, other rotors, a delay, noise). The mechanical stops of the joints are taken away:
what keeps a joint in its range is the controller.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
import math
from typing import Any, NamedTuple

import mujoco
import numpy as np

from experiments import position_trial
from experiments.energy_audit import Audit, potential
from gdmp_ros.control.admittance import DAMPING_SHARE
from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.own_body import clearances, KEEP
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.servo import AHEAD_ACCELERATION, ServoState
from gdmp_ros.control.settings import (
    ControllerSettings,
    FrictionSettings,
    GuardSettings,
    LimitSettings,
    TankSettings,
)
from gdmp_ros.control.target import resting_target
from gdmp_ros.data import lasa
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import RefusedError
from gdmp_ros.manifolds.quaternion import pose_distance, rotate_by_vector
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plant import PlantSettings, REAL
from gdmp_ros.sim.servo_arm import PositionLoop, ServoArm
from gdmp_ros.util.profiles import minimum_jerk

DT = 1e-3
PLANTS = {'clean': None, 'real': REAL}
#: A guard that follows a stream from anywhere to anywhere.
ANYWHERE = GuardSettings(jump_position=10.0, jump_rotation=10.0, arming_position=10.0,
                         arming_rotation=10.0, arming_speed=100.0, arming_angular_speed=100.0)
#: What friction that is not quite compensated may do at the tool [N].
SLACK_N = 5.0
#: How exactly the delay of an arm is measured [s].
DELAY_S = 1e-3
#: A target counts as reached within these distances of the governed reference [m, rad].
REACHED = (0.002, 0.01)
#: A tank may be empty, but for what a tick and a delay leave open [J].
LEAST_ENERGY = -0.01


class Found(NamedTuple):
    """A number that was measured, and what is asked of it: at most, or at least."""

    name: str
    measured: float
    asked: float
    at_least: bool = False

    @property
    def holds(self) -> bool:
        """Whether it is as asked."""
        return bool(self.measured >= self.asked if self.at_least else self.measured <= self.asked)


def make(plant: str, robot: PlantSettings | None = None, **settings: Any) -> ClosedLoop:
    """
    Return a closed loop without mechanical stops.

    :param robot: instead of that of the plant
    :param settings: of the controller
    """
    changed = robot or PLANTS[plant]
    friction = FrictionSettings(dry=(changed.dry_friction if changed else 0.0,))
    loop = ClosedLoop(Arm(plant=changed), ControllerSettings(
        **{'friction': friction, 'guard': ANYWHERE, **settings}))
    loop.arm.model.jnt_limited[:] = 0
    loop.controller.guard.arm()
    return loop


def diagonal(stiffness: float) -> np.ndarray:
    """Stiffness of the tool [N/m, Nm/rad]."""
    return np.diag([stiffness] * 3 + [stiffness / 20.0] * 3)


class Watch:
    """Looks at every tick: how far joints and reference are beyond their limits, and how fast."""

    def __init__(self, loop: ClosedLoop, wall: float = 0.0):
        """:param wall: height of the lowest wall [m]"""
        self.loop, self._wall = loop, wall
        self.beyond = self.below = self.sunk = self.fastest = 0.0
        self.least = math.inf

    def tick(self, target: np.ndarray | None = None) -> None:
        """One tick, with a reference."""
        loop = self.loop
        if target is not None:
            loop.must_follow(target)
        tick = loop.tick()
        q = tick.measurement.position
        self.beyond = max(self.beyond, float(np.maximum(loop.joints.lower - q,
                                                        q - loop.joints.upper).max()))
        reference = loop.controller.reference
        height = (loop.arm.chain.pose_at(reference[:len(q)], loop.arm.end_pose) if tick.joints
                  is not None else reference)[2]
        self.below = max(self.below, self._wall - float(height))
        self.sunk = max(self.sunk, self._wall - float(tick.measurement.pose[2]))
        self.fastest = max(self.fastest, float(np.linalg.norm(tick.twist[:3])))
        self.least = min(self.least, tick.tank)


#: Height of the lowest wall, above the floor: the controller has to keep it alone [m].
WALL = 0.05
#: References that a wall pushes into the limit of joint 4, and that are too close for it.
WAYS = (((-0.2, 0.0, -0.5), 6.0), ((-0.25, 0.0, -0.45), 3.0), ((0.15, 0.0, 0.05), 2.2),
        ((0.15, 0.0, 0.05), 0.6))


def joints_at_the_wall(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """Straight references into the floor, behind the base and too close to it."""
    beyond, below, sunk = 0.0, 0.0, 0.0
    for goal, seconds in WAYS:
        for stiffness in (400.0, 2000.0):
            loop = make(plant, limits=LimitSettings(workspace_min=(-1.0, -1.0, WALL)))
            watch, pose = Watch(loop, WALL), loop.arm.measure().pose
            start, way = pose[:3].copy(), np.array(goal) - pose[:3]
            target = resting_target(pose, diagonal(stiffness))
            ends = round(seconds / DT)
            parts = minimum_jerk(np.minimum(np.arange(ends + 2000) / ends, 1.0))
            rates = np.gradient(parts, DT)
            for part, rate in zip(parts, rates):
                given = target.copy()
                given[:3], given[7:10] = start + part * way, rate * way
                watch.tick(given)
            beyond, below = max(beyond, watch.beyond), max(below, watch.below)
            sunk = max(sunk, watch.sunk - SLACK_N / stiffness)
    return [Found('joint beyond its range [rad]', beyond, 0.01),
            Found('governed reference beyond a wall [m]', below, 0.001),
            Found(f'tool beyond a wall, less {SLACK_N:g} N / K [m]', sunk, 0.003)]


def go(loop: ClosedLoop, pose: np.ndarray, seconds: float) -> tuple[float, float]:
    """Ask for a pose; when it was reached, and when a limit was named [s], or inf."""
    target, named = resting_target(pose, diagonal(800.0)), math.inf
    for k in range(round(4 * seconds)):
        loop.follow_all(np.tile(target, (250, 1)))
        away = pose_distance(loop.controller.reference[:7], pose)
        if away[0] < REACHED[0] and away[1] < REACHED[1]:
            return 0.25 * (k + 1), named
        if loop.controller.blocked:
            named = min(named, 0.25 * (k + 1))
    return math.inf, named


def postures(loop: ClosedLoop, rng: np.random.Generator, count: int, spread: float
             ) -> list[np.ndarray]:
    """
    Postures with the tool in the workspace, and no parts of the arm too near to each other.

    :param spread: largest distance of a joint from home [rad]; inf: anywhere in its range
    """
    arm, found = loop.arm, list[np.ndarray]()
    margin = 1.2 * LimitSettings().joint_margin
    low, high = arm.limits.lower + margin, arm.limits.upper - margin
    while len(found) < count:
        posture = rng.uniform(np.maximum(low, arm.home - spread),
                              np.minimum(high, arm.home + spread))
        place = arm.chain.pose_at(posture, arm.end_pose)[:3]
        if (place[2] > 0.02 and np.abs(place).max() < 0.99
                and clearances(arm.chain, arm.shape, posture).min() > KEEP):
            found.append(posture)
    return found


def targets(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """Targets at postures near home and far from it, and back: reached, or a limit is named."""
    loop = make(plant)
    home, limits = loop.arm.measure().pose.copy(), LimitSettings()
    reached, silent, late, lost = 0, 0, 0.0, 0
    near = postures(loop, rng, count, 0.8)
    for at, posture in enumerate(near + postures(loop, rng, count, math.inf)):
        loop.reset()
        loop.controller.guard.arm()
        pose = loop.arm.chain.pose_at(posture, loop.arm.end_pose)
        way = pose_distance(home, pose)
        free = max(way[0] / limits.catch_up_speed, way[1] / limits.catch_up_angular_speed)
        time, named = go(loop, pose, 20.0)
        if at < count:
            reached += math.isfinite(time)
            late = max(late, min(time, named) / (free + 0.5))
        elif not math.isfinite(time):
            silent += not math.isfinite(named)
        lost += not math.isfinite(go(loop, home, 30.0)[0])
    return [Found('targets near home that are reached', reached, count, True),
            Found('time for them, of that of a free arm and 0.5 s', late, 1.2),
            Found('targets far from home that are not reached, and no limit is named', silent, 0),
            Found('ways home that are not', lost, count // 100)]


def half_turns(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """A step of the orientation by half a turn: reached, or the limit is named."""
    silent = 0
    for axis in np.eye(3):
        loop = make(plant)
        pose = loop.arm.measure().pose.copy()
        rotate_by_vector(pose[3:].copy(), 3.1 * axis, pose[3:])
        time, named = go(loop, pose, 15.0)
        silent += not (math.isfinite(time) or math.isfinite(named))
    return [Found('half turns that are neither reached nor explained', silent, 0)]


def circle(home: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """A place and a velocity on a circle of 0.1 m at 0.5 Hz, which begins within 1 s."""
    t, rate = k * DT, math.pi
    ramp = min(t, 1.0)
    angle = rate * (0.5 * ramp ** 2 + max(t - 1.0, 0.0))
    place = home.copy()
    place[:3] += 0.1 * np.array([math.cos(angle) - 1.0, math.sin(angle), 0.0])
    return place, 0.1 * rate * ramp * np.array([-math.sin(angle), math.cos(angle), 0.0])


def _follow_claims(plant: str, moves: bool, claim: Callable[[np.ndarray], np.ndarray]) -> float:
    """Largest distance of the tool from poses whose stream claims a velocity [m]."""
    loop = make(plant, guard=GuardSettings())
    home, away = loop.arm.measure().pose.copy(), 0.0
    for k in range(2000):
        place, velocity = circle(home, k) if moves else (home, np.zeros(3))
        target = resting_target(place)
        target[7:10] = claim(velocity) if k > 200 else velocity
        loop.controller.guard.offer(target, Origin('panda_link0', 0.0, k + 1))
        tick = loop.tick()
        away = max(away, float(np.linalg.norm(tick.measurement.pose[:3] - place[:3])))
    return away


def wrong_twists(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """Twists that are not those of the poses of their stream."""
    usual = {moves: _follow_claims(plant, moves, np.zeros_like) for moves in (False, True)}
    worst = max(_follow_claims(plant, moves, claim) - usual[moves] for moves, claim in (
        (False, lambda v: np.array([1.0, 0.0, 0.0])), (True, lambda v: -v),
        (True, lambda v: 3.0 * v), (True, lambda v: np.array([-v[1], v[0], v[2]]))))
    return [Found('further away than without a twist [m]', worst, 0.002)]


def settings_at_rest(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """Another setting moves no arm that rests; a small share of the torque drops nothing."""
    moved, slack = 0.0, SLACK_N / 400.0 if PLANTS[plant] else 0.0
    for changes in ({'workspace_max': (0.2, 1.0, 1.3)}, {'joint_margin': 1.0},
                    {'joint_margin': 1.0, 'joint_repulsion': 50.0}, {'torque_share': 0.2},
                    {'torque_share': 0.01}):
        loop = make(plant)
        for _ in range(2000):
            before = loop.tick().measurement.pose.copy()
        loop.controller.configure(ControllerSettings(
            guard=ANYWHERE, friction=loop.controller.settings.friction,
            limits=LimitSettings(**changes)))
        for _ in range(1500):
            pose = loop.tick().measurement.pose
            moved = max(moved, float(np.linalg.norm(pose[:3] - before[:3])))
    return [Found('motion of the tool [m]', moved, 0.001 + slack)]


def speeds(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """Speed of the tool: of a motion of the joints, and of a hand of 40 N, at 0.25 m/s."""
    slow = LimitSettings(tool_speed=0.25)
    loop = make(plant, limits=slow)
    watch = Watch(loop)
    loop.move(PostureMotion(loop.joints, (loop.arm.home + [0.8, -0.5, -0.6, 0.6, 0.3, 0.5, 0.5]
                                          )[None], 2.0))
    while loop.moves_joints:
        watch.tick()
    guided = make(plant, limits=slow)
    guided.do(Request.GUIDE)
    pulled = Watch(guided)
    for k in range(4000):
        turn = math.pi * k * DT
        guided.arm.push(np.array([40.0 * math.sin(turn), 40.0 * math.cos(turn), 0, 0, 0, 0]))
        pulled.tick()
    return [Found('of a motion of the joints, of the limit', watch.fastest / 0.25, 1.05),
            Found('of a hand, of the limit', pulled.fastest / 0.25, 1.1)]


def streams(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """
    Random streams of poses: slow, fast, beyond the reach, behind the base, with gaps and jumps.
    """
    beyond, fastest, silent, lost, least = 0.0, 0.0, 0.0, 0, math.inf
    loop, limits = make(plant), LimitSettings()
    home = loop.arm.measure().pose.copy()
    for _ in range(count):
        loop.reset()
        loop.controller.guard.arm()
        watch, target = Watch(loop), resting_target(home, diagonal(float(10.0 ** rng.uniform(
            1.3, 3.48))))
        goal, spent, place = home[:3].copy(), 0, home[:3].copy()
        speed = float(10.0 ** rng.uniform(-1.3, 0.3))
        silent_from, wrong = (rng.integers(0, 5000) if rng.random() < 0.3 else 10_000,
                              rng.normal(size=6) * (rng.random() < 0.3))
        turned = home[3:].copy()
        for k in range(5000):
            if spent == 0:
                goal = rng.uniform([-1.0, -1.0, -0.3], [1.2, 1.0, 1.3])
                rotate_by_vector(home[3:].copy(), rng.normal(size=3), turned)
                spent = int(rng.integers(300, 2500))
                if rng.random() < 0.2:
                    place = goal.copy()  # a jump
            spent -= 1
            step = goal - place
            left = float(np.linalg.norm(step))
            velocity = step / max(left, 1e-9) * min(speed, left / DT)
            place = place + DT * velocity
            target[:3], target[3:7], target[7:13] = place, turned, wrong
            target[7:10] += velocity
            # A gap of 0.2 s: the arm stops, and goes on.
            if not silent_from <= k < silent_from + 200:
                loop.controller.guard.offer(target.copy(), Origin('panda_link0', 0.0, k + 1))
            watch.tick()
        target[:7], target[7:13] = home, 0.0
        while loop.states.state is State.STOPPING:
            watch.tick()
        loop.controller.guard.arm()
        stood, quiet = loop.controller.reference[:7], 0.0
        for k in range(5000, 35_000):
            loop.controller.guard.offer(target.copy(), Origin('panda_link0', 0.0, k + 1))
            watch.tick()
            away = pose_distance(loop.controller.reference[:7], home)
            if away[0] < 0.02 and away[1] < 0.1:
                break
            made = pose_distance(loop.controller.reference[:7], stood)
            quiet += DT
            if made[0] > 0.01 or made[1] > 0.05 or loop.controller.blocked:
                stood, quiet = loop.controller.reference[:7], 0.0
            silent = max(silent, quiet)
        lost += k == 34_999 and not loop.controller.blocked
        beyond, fastest = max(beyond, watch.beyond), max(fastest, watch.fastest)
        least = min(least, watch.least)
    return [Found('joint beyond its range [rad]', beyond, 0.01),
            Found('speed of the tool [m/s]', fastest, 1.05 * limits.tool_speed),
            Found('least energy in the tank [J]', least, LEAST_ENERGY, True),
            Found('reference rests away from home, and no limit is named [s]', silent, 5.0),
            Found('ways home that take more than 30 s, and no limit is named', lost, count // 100)]


def joint_streams(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """Random streams of joints: near and far, slow and fast, beyond the range, soft and stiff."""
    beyond, fastest, least, below, limits = 0.0, 0.0, math.inf, 0.0, LimitSettings()
    anywhere = replace(ANYWHERE, jump_joints=10.0, arming_joints=10.0)
    for _ in range(count):
        # Also with little energy, of which none comes back.
        loop = make(plant, guard=anywhere, tank=TankSettings(
            energy=float(10.0 ** rng.uniform(-1.0, 0.7)),
            recharge_power=float(rng.choice([0.0, 2.5]))))
        home, low, high = loop.arm.home, loop.joints.lower, loop.joints.upper
        watch, place = Watch(loop), home.copy()
        goal, spent, speed = home.copy(), 0, float(10.0 ** rng.uniform(-1.0, 0.5))
        stiffness = 10.0 ** rng.uniform(0.5, 3.2, len(home))
        for k in range(8000):
            if spent == 0:
                goal = rng.uniform(low - 0.1, high + 0.1) if k < 5000 else home.copy()
                spent = int(rng.integers(300, 2500)) if k < 5000 else 10_000
                if rng.random() < 0.3:
                    stiffness = 10.0 ** rng.uniform(0.5, 3.2, len(home))
            spent -= 1
            step = goal - place
            rate = step / max(float(np.abs(step).max()), 1e-9) * min(
                speed, float(np.abs(step).max()) / DT)
            place = place + DT * rate
            watch.tick(np.concatenate([place, rate, stiffness, [0.7]]))
            if k == 5000:
                spent = 0
        beyond, fastest = max(beyond, watch.beyond), max(fastest, watch.fastest)
        least, below = min(least, watch.least), max(below, watch.below)
    return [Found('joint beyond its range [rad]', beyond, 0.01),
            Found('speed of the tool [m/s]', fastest, 1.05 * limits.tool_speed),
            Found('reference beyond a wall [m]', below, 0.001),
            Found('least energy in the tank [J]', least, LEAST_ENERGY, True)]


#: Poses of the tool, from home, on whose way the arm would go through itself: in the base,
#: behind it, and in the shoulder [m].
INSIDE = ((-0.3, 0.0, -0.45), (-0.45, 0.05, -0.35), (-0.28, 0.0, -0.2))


def own_body(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """Targets inside the arm's own body: it stops before, says so, and comes home again."""
    loop, nearest, kept, unnamed, lost = make(plant), math.inf, math.inf, 0, 0
    arm, body = loop.arm, loop.arm.shape
    home = arm.measure().pose.copy()
    for step in INSIDE:
        loop.reset()
        loop.controller.guard.arm()
        target, named = resting_target(home, diagonal(800.0)), False
        for k in range(6000):
            target[:3] = home[:3] + minimum_jerk(np.array([min(k / 2000.0, 1.0)])) * step
            loop.must_follow(target)
            here = loop.tick().measurement.position
            named = named or 'itself' in loop.controller.blocked
            if k % 10 == 0:
                nearest = min(nearest, clearances(arm.chain, body, here).min())
                kept = min(kept, clearances(arm.chain, body,
                                            loop.controller.memory.governed).min())
        unnamed += not named
        lost += not math.isfinite(go(loop, home, 30.0)[0])
    return [Found('distance of parts of the reference [m]', kept, KEEP - 0.001, True),
            Found('distance of parts of the arm [m]', nearest, 0.5 * KEEP, True),
            Found('targets for which the own body is not named', unnamed, 0),
            Found('ways home that are not', lost, 0)]


def hand_guiding(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """A payload that is announced wrongly: refused, or the tool stays near where it was left."""
    taken, drift = 0, 0.0
    known = FrictionSettings(dry=(REAL.dry_friction if PLANTS[plant] else 0.0,))
    for there, announced in ((1.0, 0.0), (0.0, 1.0), (0.2, 0.0)):
        robot = replace(PLANTS[plant] or PlantSettings(), payload=there)
        loop = ClosedLoop(Arm(plant=robot), ControllerSettings(guard=ANYWHERE, friction=known))
        if announced:
            loop.do(Request.PAYLOAD, Payload(announced))
        for _ in range(4000):
            loop.tick()
        try:
            loop.do(Request.GUIDE)
        except RefusedError:
            taken += there == 0.2
            continue
        taken += there != 0.2
        before = loop.tick().measurement.pose[:3].copy()
        for _ in range(2500):
            pose = loop.tick().measurement.pose
        drift = max(drift, float(np.linalg.norm(pose[:3] - before)))
    return [Found('wrong payloads that are accepted, right ones that are not', taken, 0),
            Found('drift within 2.5 s with 0.2 kg unknown [m]', drift, 0.03)]


def _circling(home: np.ndarray, k: int, stiffness: float) -> np.ndarray:
    """Target on the circle, with its acceleration."""
    place, velocity = circle(home, k)
    target = resting_target(place, diagonal(stiffness))
    target[7:10] = velocity
    target[13:16] = (circle(home, k + 1)[1] - circle(home, max(k - 1, 0))[1]) / (2.0 * DT)
    return target


def plain_work(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """With the usual tank: a circle of 0.1 m at 0.5 Hz, and large moves there and back."""
    loop = make(plant)
    home, away, off = loop.arm.measure().pose.copy(), 0.0, 0.0
    for k in range(10_000):
        target = _circling(home, k, 800.0)
        loop.must_follow(target)
        tick = loop.tick()
        away = max(away, float(np.linalg.norm(tick.measurement.pose[:3] - target[:3])))
    parts = minimum_jerk(np.concatenate([np.arange(1500), np.arange(1500, 0, -1),
                                         np.zeros(1000)]) / 1500)
    for way in ([0.25, 0.25, 0.0], [0.0, -0.4, 0.2], [-0.1, 0.3, 0.3], [0.2, 0.0, -0.4]):
        loop = make(plant)
        for part, rate in zip(parts, np.gradient(parts, DT)):
            target = resting_target(home, diagonal(800.0))
            target[:3] += part * np.array(way)
            target[7:10] = rate * np.array(way)
            loop.must_follow(target)
            tick = loop.tick()
        off = max(off, float(np.linalg.norm(tick.measurement.pose[:3] - home[:3])))
    return [Found('off a circle at 0.31 m/s [m]', away, 0.004),
            Found('off, 1 s after a large move [m]', off, 0.004)]


#: The masses of another arm, of which the controller knows nothing.
FOREIGN = {'clean': PlantSettings(model='fr3', armature=0.1),
           'real': PlantSettings(model='fr3', armature=0.1, dry_friction=1.1, delay=0.002)}


def _off_letter(loop: ClosedLoop, skill: Skill, stiffness: float) -> float:
    """Root mean square distance of the tool from the references of a letter [m]."""
    squares = []
    for target in position_trial.played(skill, loop.arm.measure().pose, diagonal(stiffness), DT):
        loop.must_follow(target)
        away = loop.tick().measurement.pose[:3] - target[:3]
        squares.append(float(away @ away))
    return math.sqrt(float(np.mean(squares)))


def foreign_masses(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """A letter on a robot with other masses: with the weight that was identified, and without."""
    def controlled(**settings: Any) -> ClosedLoop:
        return make(plant, FOREIGN[plant], tank=TankSettings(delay=0.003), **settings)
    loop = controlled(friction=FrictionSettings())
    motion = FrictionIdentification(loop.joints, loop.arm.chain)
    loop.move(motion)
    while loop.moves_joints:
        loop.tick()
    found, skill = motion.result(), Skill.learn(lasa.robot_demonstrations('GShape')[0])
    friction = FrictionSettings(viscous=tuple(found.viscous), dry=tuple(found.dry))
    weight = tuple(found.moments.ravel())
    return [Found(f'letter at {stiffness:g} N/m with the weight, of that without',
                  _off_letter(controlled(friction=friction, weight_moments=weight), skill,
                              stiffness)
                  / _off_letter(controlled(friction=friction), skill, stiffness), 0.5)
            for stiffness in (200.0, 400.0, 800.0)]


def less_friction(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """
    A robot with 20 % less dry friction than was identified, on the circle, and pushed by a hand.

    Robot, spring and tank together may only lose energy, but for what the hand gives; what
    gravity gives, the motors take.
    """
    known, worst = REAL.dry_friction, 0.0
    real = replace(REAL if PLANTS[plant] else PlantSettings(), dry_friction=0.8 * known)
    loop = ClosedLoop(Arm(plant=real), ControllerSettings(
        guard=ANYWHERE, friction=FrictionSettings(dry=(known,)),
        tank=TankSettings(energy=5.0, capacity=100.0, recharge_power=0.0)))
    loop.controller.guard.arm()
    arm, home, audit = loop.arm, loop.arm.measure().pose.copy(), Audit(loop)
    least, given = math.inf, 0.0
    for k in range(10_000):
        push = np.zeros(6)
        if k > 6000:
            push[:3] = 15.0 * np.array([math.sin(0.004 * k), math.cos(0.004 * k), 0.0])
        arm.push(push)
        loop.must_follow(_circling(home, min(k, 6000), 800.0) if k < 6000
                         else resting_target(circle(home, 6000)[0], diagonal(800.0)))
        tick = audit.tick()
        given += DT * float(push @ tick.twist)
        mujoco.mj_energyVel(arm.model, arm.data)
        total = (float(arm.data.energy[1]) + potential(audit.pose(), loop.controller.reference)
                 + loop.controller.tank.energy - given)
        least = min(least, total)
        worst = max(worst, float(total - least))
    return [Found('energy that came from nowhere [J]', worst, 0.01)]


#: A hard table below the tool: distance [m], friction, and the speed of the tool at which half of
#: the friction acts [m/s].
TABLE, TABLE_FRICTION, CREEP = 0.03, 0.2, 0.005


def _touch(arm: Arm, top: float) -> float:
    """Let a table push the tool that is in it; the force upwards [N]."""
    force = np.zeros(6)
    force[2], velocity = position_trial.table_force(arm, top)
    if force[2] > 0.0:
        along = velocity[:2]
        force[:2] = -TABLE_FRICTION * force[2] * along / (np.linalg.norm(along) + CREEP)
    arm.push(force)
    return float(force[2])


def hard_contact(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """A table of 30 kN/m that dissipates hardly anything: touched at 50 mm/s, then slid along."""
    robot = replace(REAL, delay=0.002) if PLANTS[plant] else None
    lost, spread = 0, 0.0
    for stiffness in (200.0, 400.0, 800.0):
        loop = make(plant, robot, tank=TankSettings(delay=0.003))
        home, forces = loop.arm.measure().pose.copy(), list[float]()
        target, top = resting_target(home, diagonal(stiffness)), home[2] - TABLE
        for k in range(5000):
            down, aside = k * DT < 0.8, k * DT > 3.0
            target[9], target[8] = -0.05 * down, 0.1 * aside
            target[:3] += DT * target[7:10]
            forces.append(_touch(loop.arm, top))
            loop.must_follow(target)
            loop.tick()
        touched = np.array(forces) > 0.0
        later = touched[int(np.argmax(touched)) + 500:]
        lost += int((~later[1:] & later[:-1]).sum())
        spread = max(spread, float(np.std(forces[3300:])))
    return [Found('contact lost later than 0.5 s after the first touch', lost, 0),
            Found('standard deviation of the force while sliding at 0.1 m/s [N]', spread, 4.0)]


def position_arm(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """An arm that takes positions, with a delay of 8 ms (clean) or 36 ms: free, and on a table."""
    slow, depth = bool(PLANTS[plant]), position_trial.DEPTH
    hard = position_trial.TABLE_STIFFNESS
    settings = position_trial.SLOW if slow else position_trial.FAST
    speeds = (0.005, 0.01) if slow else (0.005, 0.05)
    peak, away, apart, off, pushed, strongest = 0.0, 0, 0.0, 0.0, 0.0, 0.0
    for stiffness in (300.0, 800.0):
        for references in (position_trial.circle, position_trial.letter):
            trial = position_trial.Trial(settings)
            way = references(trial.pose, stiffness)
            errors = np.linalg.norm(trial.follow(way)[:, :3] - way[:, :3], axis=1)
            off = max(off, float(np.sqrt(np.mean(errors ** 2))))
        # The delay of this one has been measured.
        pushed = max(pushed, abs(position_trial.push(trial, stiffness) - 1.0))
        for speed in speeds:
            trial = position_trial.Trial(settings)
            forces = position_trial.press(trial, stiffness, speed)
            damping = DAMPING_SHARE * hard * trial.driver.delay
            peak = max(peak, forces.max() / (stiffness * depth + damping * speed))
            if stiffness == 300.0:
                strongest = max(strongest, float(forces.max()))
            away += position_trial.lost(forces)
            rest = stiffness * depth * hard / (stiffness + hard)
            apart = max(apart, abs(forces[-150:].mean() / rest - 1.0))
    book = position_trial.given(position_trial.Trial(
        settings, TankSettings(recharge_power=0.0)), rng)
    return [Found('circle, and letter with its goal switched: position, RMS [m]', off, 0.002),
            Found('displacement by a hand of 20 N after 3 D/K, relative error', pushed, 0.1),
            Found('energy given to the table beyond what the tank paid [J]', book, 0.01),
            *([] if slow else [Found('largest force at 300 N/m [N]', strongest, 35.0)]),
            Found('peak at first contact, over K e + D v', peak, 1.4),
            Found('cycles without contact later than 0.5 s after the first touch', away, 0),
            Found('mean force on the table, relative error', apart, 0.1)]


#: Where no UR5e can be, or only by passing a singular posture: behind the base, out of reach,
#: inside its own body [m].
NOWHERE = ((-0.5, 0.1, 0.4), (1.3, 0.2, 0.4), (0.05, 0.05, 0.3))
#: Straight above the base, where singular postures meet [m].
ABOVE = (0.0, 0.1, 1.3)


def _approach(loop: PositionLoop, home: np.ndarray, place: tuple[float, ...], ticks: int
              ) -> Iterator[int]:
    """Send the tool from home to a place in 3 s, and let it stay there; a number for each tick."""
    target = resting_target(home, diagonal(800.0))
    for k in range(ticks):
        share = minimum_jerk(np.array([min(k / 1500.0, 1.0)]))
        target[:3] = home[:3] + share * (np.array(place) - home[:3])
        loop.must_follow(target)
        loop.tick()
        yield k


def _goes_astray(loop: PositionLoop) -> bool:
    """Whether an arm of which a joint is not where its command leads goes on, or says nothing."""
    read, away = loop.servo.read, np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0])

    def read_wrongly() -> ServoState:
        state = read()
        return state._replace(position=state.position + away)
    loop.servo.read = read_wrongly  # type: ignore[method-assign]
    for _ in range(20):
        loop.tick()
    return not (loop.states.state is State.FAULT and 'joint 3' in loop.states.reason)


def position_arm_limits(plant: str, rng: np.random.Generator, count: int) -> list[Found]:
    """An arm that takes positions, sent where it cannot be: its limits hold, and it comes home."""
    def new() -> PositionLoop:
        return PositionLoop(
            ServoArm('ur5e', position_trial.SLOW if PLANTS[plant] else position_trial.FAST),
            ControllerSettings(guard=ANYWHERE))
    loop = new()
    servo = loop.servo
    arm, body, joints, limits = servo.arm, servo.arm.shape, loop.joints, LimitSettings()
    fastest, sent = joints.fastest(limits.joint_speed), loop.driver.servo.command
    beyond, fast, near, unnamed, lost = -math.inf, 0.0, math.inf, 0, 0
    home = arm.site_pose('tcp')
    for place in NOWHERE:
        named = False
        for k in _approach(loop, home, place, 5000):
            named = named or bool(loop.controller.blocked)
            beyond = max(beyond, float(np.maximum(joints.lower - sent[0],
                                                  sent[0] - joints.upper).max()))
            fast = max(fast, float((np.abs(arm.data.qvel[:len(fastest)]) / fastest).max()))
            if k % 10 == 0:
                near = min(near, float(clearances(arm.chain, body, arm.data.qpos[:6]).min()))
        away = np.linalg.norm(arm.site_pose('tcp')[:3] - place)
        unnamed += not (named or away < 0.01)
        for _ in range(15000):
            loop.must_follow(resting_target(home, diagonal(800.0)))
            loop.tick()
            if pose_distance(arm.site_pose('tcp'), home)[0] < 0.005:
                break
        else:
            lost += 1
    above = new()
    names = {above.controller.blocked for _ in _approach(above, home, ABOVE, 3000)}
    return [Found('joint positions beyond their limits [rad]', beyond, 0.0),
            Found('singular postures that are not named', 'a singularity' not in names, 0),
            Found('following errors that do not stop it, naming the joint', _goes_astray(new()),
                  0),
            # What is sent ahead of the arm comes on top.
            Found('joint speed, of the largest', fast,
                  1.0 + AHEAD_ACCELERATION * (loop.driver.delay + DELAY_S) / float(fastest.min())),
            Found('distance of parts of the arm [m]', near, 0.5 * KEEP, True),
            Found('places that are not reached, and no limit is named', unnamed, 0),
            Found('ways home that are not', lost, 0)]


#: By name: what is tried on a plant, with a generator and the number of draws of random cases.
CASES: dict[str, Callable[[str, np.random.Generator, int], list[Found]]] = {
    'joints-at-the-wall': joints_at_the_wall, 'targets': targets, 'half-turns': half_turns,
    'wrong-twists': wrong_twists, 'settings-at-rest': settings_at_rest, 'speeds': speeds,
    'plain-work': plain_work, 'foreign-masses': foreign_masses, 'less-friction': less_friction,
    'hard-contact': hard_contact, 'own-body': own_body, 'hand-guiding': hand_guiding,
    'position-arm': position_arm, 'position-arm-limits': position_arm_limits,
    'streams': streams, 'joint-streams': joint_streams}


def rows(task: tuple[str, str, int]) -> list[dict[str, Any]]:
    """
    Try a case on a plant.

    :param task: case, plant, and the number of draws of random cases
    :returns: for each number ``case``, ``plant``, ``asked``, ``measured``, ``holds``
    """
    case, plant, count = task
    rng = np.random.default_rng(list(case.encode()))
    return [{'case': f'{case}: {one.name}', 'plant': plant,
             'asked': f'{"at least" if one.at_least else "at most"} {one.asked:g}',
             'measured': float(one.measured), 'holds': one.holds}
            for one in CASES[case](plant, rng, count)]
