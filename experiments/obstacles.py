"""What stands in the way: random scenes, judged by what MuJoCo finds at every physics step."""
from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any, NamedTuple

import mujoco
import numpy as np

from experiments.control_limits import ANYWHERE, diagonal, Found
from experiments.energy_audit import Audit
from gdmp_ros.control.settings import (
    ControllerSettings,
    FrictionSettings,
    LimitSettings,
    TankSettings,
)
from gdmp_ros.control.surroundings import depths
from gdmp_ros.control.target import POSE, resting_target, STIFFNESS, TWIST
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ManifoldError
from gdmp_ros.learning.detour import BlockedError, detour
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.scene.route import clearances, Grid, Tool
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.path_check import Reach
from gdmp_ros.sim.tool_shape import tool_of
from gdmp_ros.sim.volumes import add_volumes, Contact, VolumeBodies
from gdmp_ros.util.profiles import minimum_jerk

#: Links near the elbow and near the wrist, and distance that is kept [m].
LINKS, MARGIN = ('link4', 'link5', 'link6', 'link7', 'hand'), 0.03
#: Scenes are told to the controller this often [s].
TOLD_S = 1.0 / 30.0
#: Without a refill, and credit for friction, so that the book is that of the motors alone.
TANK = TankSettings(energy=50.0, capacity=100.0, recharge_power=0.0)
#: Speed at which an arm may go away [m/s].
RETREAT = 0.3
#: Whether it has room: motions that are tried, for how long [s], and how finely [s].
ROOM_DRAWS, ROOM_S, ROOM_STEP_S = 3000, 3.0, 0.02
#: A step is timed this often.
STEP_ROUNDS = 60
#: A volume whose place says that the arm begins in it is drawn again.
FREE_M = 0.02


class Trial(NamedTuple):
    """
    What one scene did.

    :ivar contacts: speeds of the links that were touched when the first was [m/s]
    :ivar least: least distance [m]
    :ivar energy: least of what the tank has by an independent book, less what it believes [J]
    :ivar off: distance from the last reference at the end [m]
    :ivar met: posture when something came within the margin, and where that was then; None if
        nothing did
    """

    contacts: tuple[float, ...]
    least: float
    energy: float
    off: float
    met: tuple[np.ndarray, Volume] | None


def motion(arm: Arm, rng: np.random.Generator) -> np.ndarray:
    """Postures from home to a random one and back, at 1 kHz, shape (T, n)."""
    while True:
        there = np.clip(arm.home + rng.uniform(-0.8, 0.8, len(arm.home)),
                        arm.limits.lower + 0.2, arm.limits.upper - 0.2)
        pose = arm.pose_at(there)
        if pose[2] > 0.15 and np.linalg.norm(pose[:3] - arm.pose_at(arm.home)[:3]) > 0.2:
            break
    blend = minimum_jerk(np.linspace(0.0, 1.0, 2500))
    shares = np.concatenate([blend, blend[::-1], np.zeros(500)])
    return np.asarray(arm.home + shares[:, None] * (there - arm.home))


def stream(arm: Arm, postures: np.ndarray, stiffness: float) -> np.ndarray:
    """References of the tool along postures."""
    poses = np.array([arm.pose_at(posture) for posture in postures])
    references = np.array([resting_target(pose) for pose in poses])
    references[:, STIFFNESS:STIFFNESS + 36] = diagonal(stiffness).ravel()
    references[:, TWIST:TWIST + 3] = np.gradient(poses[:, :3], 1e-3, axis=0)
    turn = np.empty(3)
    for k in range(1, len(poses)):
        rotation_between(poses[k - 1, 3:], poses[k, 3:], turn)
        references[k, TWIST + 3:TWIST + 6] = turn / 1e-3
    return references


def _volume(rng: np.random.Generator, place: np.ndarray) -> Volume:
    kind = rng.choice(['sphere', 'box', 'capsule'])
    size = {'sphere': (rng.uniform(0.03, 0.08),), 'box': tuple(rng.uniform(0.05, 0.2, 3)),
            'capsule': (rng.uniform(0.02, 0.05), rng.uniform(0.1, 0.4))}[str(kind)]
    turn = rng.normal(size=4)
    return Volume('obstacle', str(kind), size,
                  np.concatenate([place, turn / np.linalg.norm(turn)]))


def _place_of(arm: Arm, posture: np.ndarray, link: str) -> np.ndarray:
    """Middle of a link [m]."""
    arm.reset(posture)
    body = arm.model.body(link).id
    return np.array(arm.data.xipos[body])


def in_the_way(arm: Arm, postures: np.ndarray, rng: np.random.Generator, speed: float
               ) -> Volume:
    """
    Something near the elbow or the wrist that the motion meets, or that comes to meet it.

    :param speed: with which it comes [m/s]; 0: it stands
    """
    while True:
        k = int(rng.integers(800, 2500))
        place = _place_of(arm, postures[k], str(rng.choice(LINKS)))
        place = place + rng.normal(0.0, 0.05, 3)
        volume = _volume(rng, place)
        if speed:
            way = rng.normal(size=3)
            way /= np.linalg.norm(way)
            # It would be at its place when the arm is there.
            volume = volume.at(np.concatenate([place - speed * 1e-3 * k * way, volume.pose[3:]]),
                               np.concatenate([speed * way, np.zeros(3)]))
        scene = Scene([volume], MARGIN)
        deep = depths(arm.chain, arm.shape, arm.home, scene.packed(arm.shape.bits))
        if deep.max() < -FREE_M:
            return volume


def _moved(volume: Volume, dt: float) -> Volume:
    pose = volume.pose.copy()
    pose[:3] += dt * volume.twist[:3]
    return volume.at(pose, volume.twist)


def arm_trial(rng: np.random.Generator, speed: float, retreat: float = 0.0) -> Trial:
    """
    Let an arm move, and something be in its way.

    :param speed: with which it comes [m/s]; 0: it stands
    :param retreat: speed at which the arm goes away [m/s]
    """
    plain = Arm()
    postures = motion(plain, rng)
    references = stream(plain, postures, float(rng.choice([300.0, 1000.0])))
    volume = in_the_way(plain, postures, rng, speed)
    return follow(references, volume, retreat)


def follow(references: np.ndarray, volume: Volume, retreat: float) -> Trial:
    """Follow references beside a volume."""
    scene = Scene([volume], MARGIN)
    arm = Arm(extras=[add_volumes(scene)])
    loop = ClosedLoop(arm, ControllerSettings(
        guard=ANYWHERE, limits=LimitSettings(retreat_speed=retreat), tank=TANK,
        friction=FrictionSettings(credit=0.0)))
    loop.controller.guard.arm()
    bodies, audit = VolumeBodies(arm, scene), Audit(loop)
    loop.controller.surround(scene)
    touched: list[Contact] = []
    met: tuple[np.ndarray, Volume] | None = None
    least, told, book = np.inf, 0.0, [0.0]
    for k, reference in enumerate(references):
        if volume.twist.any():
            volume = _moved(volume, 1e-3)
            bodies.put(volume)
            told += 1e-3
            if told >= TOLD_S:
                told = 0.0
                loop.controller.surround(Scene([volume], MARGIN))
        loop.must_follow(reference)
        before = arm.data.qvel.copy()
        audit.tick()
        book.append(audit.content[-1] - loop.controller.tank.energy)
        # Its own speed is that before something pushes it.
        touched = touched or bodies.contacts(before)
        if k % 5 == 0:
            least = min(least, bodies.least())
            if met is None and least < MARGIN:
                met = loop.arm.measure().position.copy(), volume
    pose = loop.arm.measure().pose
    return Trial(tuple(one.speed for one in touched), float(least), float(np.min(book)),
                 float(np.linalg.norm(pose[:3] - references[-1, POSE:POSE + 3])), met)


def has_room(posture: np.ndarray, volume: Volume, speed: float, rng: np.random.Generator) -> bool:
    """
    Whether an arm can go away from something that comes, by a straight motion of its joints.

    :param speed: of its tool [m/s]
    """
    scene = Scene([volume])
    arm = Arm(extras=[add_volumes(scene)])
    bodies, fastest = VolumeBodies(arm, scene), arm.limits.speed
    start = arm.pose_at(posture)[:3]
    times = np.arange(0.0, ROOM_S, ROOM_STEP_S)
    for _ in range(ROOM_DRAWS):
        there = np.clip(posture + rng.uniform(-1.5, 1.5, len(posture)), arm.limits.lower,
                        arm.limits.upper)
        needed = max(float(np.max(np.abs(there - posture) / fastest)),
                     float(np.linalg.norm(arm.pose_at(there)[:3] - start)) / speed)
        for passed in times:
            share = min(passed / needed, 1.0)
            arm.data.qpos[:len(posture)] = posture + share * (there - posture)
            bodies.put(_moved(volume, passed))
            mujoco.mj_fwdPosition(arm.model, arm.data)
            if bodies.contacts():
                break
        else:
            return True
    return False


def _book(trials: list[Trial]) -> Found:
    return Found('what the tank has, less what it believes [J]',
                 min(one.energy for one in trials), -0.01, True)


def standing(rng: np.random.Generator, count: int) -> list[Found]:
    """Something stands near the path of elbow or wrist."""
    trials = [arm_trial(rng, 0.0) for _ in range(count)]
    return [Found('trials with a contact', sum(bool(one.contacts) for one in trials), 0.0),
            Found('least distance [m]', min(one.least for one in trials), 0.0, True),
            _book(trials),
            Found('trials that do not come home', sum(one.off > 0.01 for one in trials),
                  0.02 * count)]


def coming(rng: np.random.Generator, count: int) -> list[Found]:
    """Something comes, with up to 0.3 m/s, while the arm moves."""
    trials = [arm_trial(rng, float(rng.uniform(0.05, 0.3))) for _ in range(count)]
    speeds = [speed for one in trials for speed in one.contacts]
    return [Found('speed of a link when it is touched [m/s]', max(speeds, default=0.0), 0.02),
            _book(trials)]


class ToolTrial(NamedTuple):
    """
    What a skill that leads around something did.

    :ivar exists: whether a search on the grid finds a way with two margins
    :ivar named: what it was refused with; empty if it was executed
    :ivar off: distance from the goal at the end [m]
    :ivar least: least distance of the arm from the scene [m]
    :ivar contacts: ticks in which something touched
    :ivar acceleration: largest of the reference [m/s²]
    :ivar seconds: that it took to decide
    """

    exists: bool
    named: str
    off: float
    least: float
    contacts: int
    acceleration: float
    seconds: float


#: Margin of the scenes for the tool, and stiffness with which they are executed.
TOOL_MARGIN, TOOL_STIFFNESS = 0.02, 1000.0
_DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def line(start: np.ndarray, goal: np.ndarray, bow: np.ndarray) -> Skill:
    """A skill of the tool, pointing down, from one position to another."""
    times = np.linspace(0.0, 3.0, 300)
    blend = minimum_jerk(times / 3.0)[:, None]
    positions = start + blend * (goal - start) + np.sin(np.pi * blend) * bow
    return Skill.learn(Demonstration(times, np.column_stack(
        [positions, np.tile(_DOWN, (300, 1))]), tool_manifold(None)))


def random_scene(rng: np.random.Generator, tool: Tool) -> tuple[Skill, Scene]:
    """A skill, and 1 to 8 volumes of which one blocks its path by 20 mm or more."""
    while True:
        start, goal = rng.uniform([0.35, -0.35, 0.15], [0.6, 0.35, 0.45], (2, 3))
        if np.linalg.norm(start - goal) < 0.25:
            continue
        skill = line(start, goal, rng.normal(0.0, 0.04, 3))
        path = skill.rollout().sample(np.linspace(0.0, 3.0, 101)).points[:, :3]
        volumes = []
        for k in range(int(rng.integers(1, 9))):
            place = path[int(rng.integers(30, 70))] + rng.normal(0.0, 0.02 if k == 0 else 0.15, 3)
            one = _volume(rng, place)
            volumes.append(Volume(f'volume {k}', one.kind, one.size, one.pose))
        scene = Scene(volumes, TOOL_MARGIN)
        left, _ = clearances(scene.packed(), tool, path, _DOWN, 0.0)
        if min(left[0], left[-1]) > 2.0 * TOOL_MARGIN and left.min() < -0.02 and _begins_free(
                skill, scene):
            return skill, scene


def _begins_free(skill: Skill, scene: Scene) -> bool:
    """Whether the whole arm is outside the margins at both ends of a skill."""
    arm = Arm()
    reach = Reach(arm)
    try:
        postures = [reach.posture(point, arm.home) for point in (skill.start, skill.goal)]
    except ManifoldError:
        return False
    return all(depths(arm.chain, arm.shape, posture, scene.packed(arm.shape.bits)).max() < 0.0
               for posture in postures)


def head_on(rng: np.random.Generator, tool: Tool) -> tuple[Skill, Scene]:
    """A wall straight across the path, low enough to pass above or beside it."""
    height, turn = rng.uniform(0.1, 0.3), rng.uniform(-0.3, 0.3)
    wall = Volume('wall', 'box', (0.3, 0.03, height), np.array(
        [0.5, 0.0, 0.5 * height, np.cos(turn), 0.0, 0.0, np.sin(turn)]))
    return line(np.array([0.5, -0.3, 0.2]), np.array([0.5, 0.3, 0.2]), np.zeros(3)), Scene(
        [wall], TOOL_MARGIN)


def trap(rng: np.random.Generator, tool: Tool) -> tuple[Skill, Scene]:
    """A U of three walls that is open towards the start: to bend is not enough."""
    height, depth = rng.uniform(0.1, 0.25), rng.uniform(0.08, 0.15)
    walls = [Volume(name, 'box', size, np.array([x, y, 0.5 * height, 1.0, 0.0, 0.0, 0.0]))
             for name, size, x, y in (
                 ('back', (0.36, 0.03, height), 0.5, 0.05),
                 ('left', (0.03, depth, height), 0.335, 0.05 - 0.5 * depth),
                 ('right', (0.03, depth, height), 0.665, 0.05 - 0.5 * depth))]
    return line(np.array([0.5, -0.3, 0.15]), np.array([0.5, 0.3, 0.15]), np.zeros(3)), Scene(
        walls, TOOL_MARGIN)


def tool_trial(skill: Skill, scene: Scene) -> ToolTrial:
    """Lead a skill around a scene, and execute it on the arm."""
    arm = Arm(extras=[add_volumes(scene)])
    tool = tool_of(arm)
    path = skill.rollout().sample(np.linspace(0.0, 3.0, 101)).points[:, :3]
    exists = Grid(scene.packed(), tool, path, _DOWN, 2.0, 0.0).shortest(
        path[0], path[-1]) is not None
    begun = time.perf_counter()
    try:
        found = detour(skill, scene, tool)
    except BlockedError as error:
        return ToolTrial(exists, str(error), np.inf, np.inf, 0, 0.0, time.perf_counter() - begun)
    seconds = time.perf_counter() - begun
    loop = ClosedLoop(arm, ControllerSettings(guard=ANYWHERE))
    try:
        loop.reset(Reach(Arm()).posture(skill.start, arm.home))
    except ManifoldError:
        return ToolTrial(False, 'the start is out of reach', np.inf, np.inf, 0, 0.0, seconds)
    loop.controller.guard.arm()
    loop.controller.surround(scene)
    bodies, rollout = VolumeBodies(arm, scene), found.skill.rollout()
    reference, least, contacts, fastest = resting_target(skill.start), np.inf, 0, 0.0
    reference[STIFFNESS:STIFFNESS + 36] = diagonal(TOOL_STIFFNESS).ravel()
    for k in range(round(1e3 * (found.skill.duration + 1.5))):
        state = rollout.advance(1e-3)
        reference[:7], reference[TWIST:TWIST + 3] = state.point, state.velocity[:3]
        fastest = max(fastest, float(np.linalg.norm(state.acceleration[:3])))
        loop.must_follow(reference)
        loop.tick()
        contacts += bool(bodies.contacts())
        if k % 10 == 0:
            least = min(least, bodies.least())
    return ToolTrial(exists, '', float(np.linalg.norm(
        loop.arm.measure().pose[:3] - skill.goal[:3])), float(least), contacts, fastest, seconds)


def _of_tool(draw: Callable[[np.random.Generator, Tool], tuple[Skill, Scene]]
             ) -> Callable[[np.random.Generator, int], list[Found]]:
    def case(rng: np.random.Generator, count: int) -> list[Found]:
        tool = tool_of(Arm())
        trials = [tool_trial(*draw(rng, tool)) for _ in range(count)]
        possible = [one for one in trials if one.exists]
        reached = [one for one in possible if not one.named and one.off < 0.005]
        executed = [one for one in trials if not one.named]
        return [
            Found('share that reaches its goal where there is a way',
                  len(reached) / max(len(possible), 1), 0.98, True),
            Found('trials with a contact', sum(one.contacts > 0 for one in executed), 0.0),
            Found('least distance [m]', min((one.least for one in executed), default=np.inf),
                  TOOL_MARGIN, True),
            Found('time to decide [s]', max(one.seconds for one in trials), 2.0),
            Found('acceleration of the reference [m/s^2]',
                  max((one.acceleration for one in executed), default=0.0),
                  LimitSettings().acceleration)]
    return case


def at_rest(rng: np.random.Generator, count: int) -> list[Found]:
    """Something is put inside the margin of an arm at rest: it stays as it is."""
    moved, speed = 0.0, 0.0
    for _ in range(count):
        loop = ClosedLoop(Arm())
        arm, home = loop.arm, loop.arm.measure().pose
        for _ in range(300):
            loop.tick()
        place = _place_of(Arm(), arm.home, str(rng.choice(LINKS)))
        volume = _volume(rng, place + rng.normal(0.0, 0.1, 3))
        loop.controller.surround(Scene([volume], MARGIN))
        for _ in range(2000):
            loop.tick()
        moved = max(moved, float(np.linalg.norm(arm.measure().pose[:3] - home[:3])))
        speed = max(speed, float(np.abs(arm.data.qvel).max()))
    return [Found('the tool moves by [m]', moved, 1e-3),
            Found('speed of a joint at the end [rad/s]', speed, 1e-3)]


def retreating(rng: np.random.Generator, count: int) -> list[Found]:
    """Something comes with up to 0.1 m/s, and the arm may go away."""
    trials = [arm_trial(rng, float(rng.uniform(0.05, 0.1)), RETREAT) for _ in range(count)]
    caught = [one for one in trials if one.contacts]
    room = sum(one.met is not None and has_room(*one.met, RETREAT, rng) for one in caught)
    return [Found(f'trials with a contact where there was room (touched: {len(caught)})', room,
                  0.0)]


def step(rng: np.random.Generator, count: int) -> list[Found]:
    """Time of a step with eight volumes of a kind around the path / without."""
    skill = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), np.zeros(3))
    scenes = {'nothing': Scene()}
    for kind, size in (('sphere', (0.05,)), ('box', (0.1, 0.1, 0.1)), ('capsule', (0.03, 0.2)),
                       ('plane', ())):
        volumes = []
        for k in range(8):
            turn = rng.normal(size=4)
            place = np.array([0.4 + rng.choice([-0.15, 0.15]), 0.6 * (k / 7.0 - 0.5), 0.3])
            volumes.append(Volume(f'{k}', kind, size, np.concatenate(
                [place, turn / np.linalg.norm(turn)])))
        scenes[kind] = Scene(volumes)
    # In turns: a machine is not equally fast all the time.
    best = dict.fromkeys(scenes, np.inf)
    for _ in range(STEP_ROUNDS):
        for kind, scene in scenes.items():
            best[kind] = min(best[kind], _step_time(skill, scene))
    return [Found(f'eight of a kind ({kind})', best[kind] / best['nothing'], 1.5)
            for kind in scenes if kind != 'nothing']


def _step_time(skill: Skill, scene: Scene) -> float:
    """Time of the steps of a motion [s]."""
    rollout = Rollout(skill)
    rollout.set_obstacles(scene)
    state = np.empty(rollout.state_size)
    begun = time.perf_counter()
    for _ in range(round(skill.duration / 1e-3)):
        rollout.advance_to(1e-3, state)
    return time.perf_counter() - begun


CASES: dict[str, Callable[[np.random.Generator, int], list[Found]]] = {
    'random': _of_tool(random_scene), 'head-on': _of_tool(head_on), 'trap': _of_tool(trap),
    'standing': standing, 'coming': coming, 'retreating': retreating, 'at-rest': at_rest,
    'step': step}


def rows(task: tuple[str, int]) -> list[dict[str, Any]]:
    """
    Try a case.

    :param task: case, and the number of draws
    :returns: for each number ``case``, ``asked``, ``measured``, ``holds``
    """
    case, count = task
    rng = np.random.default_rng(list(case.encode()))
    return [{'case': f'{case}: {one.name}',
             'asked': f'{"at least" if one.at_least else "at most"} {one.asked:g}',
             'measured': float(one.measured), 'holds': one.holds}
            for one in CASES[case](rng, count)]
