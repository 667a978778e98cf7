"""What stands in the way: random scenes, judged by what MuJoCo finds at every physics step."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from experiments.control_limits import ANYWHERE, diagonal, Found
from experiments.energy_audit import Audit
from gdmp_ros.control.settings import ControllerSettings, LimitSettings
from gdmp_ros.control.surroundings import depths
from gdmp_ros.control.target import POSE, resting_target, STIFFNESS, TWIST
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.volumes import add_volumes, Contact, VolumeBodies
from gdmp_ros.util.profiles import minimum_jerk

#: Links near the elbow and near the wrist, and distance that is kept [m].
LINKS, MARGIN = ('link4', 'link5', 'link6', 'link7', 'hand'), 0.03
#: Scenes are told to the controller this often [s].
TOLD_S = 1.0 / 30.0
#: A volume whose place says that the arm begins in it is drawn again.
FREE_M = 0.02


class Trial(NamedTuple):
    """
    What one scene did.

    :ivar contacts: speeds of the links that were touched when the first was [m/s]
    :ivar least: least distance [m]
    :ivar energy: least content of the tank by the independent book [J]
    :ivar off: distance from the last reference at the end [m]
    """

    contacts: tuple[float, ...]
    least: float
    energy: float
    off: float


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
    return arm.home + shares[:, None] * (there - arm.home)


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
        guard=ANYWHERE, limits=LimitSettings(retreat_speed=retreat)))
    loop.controller.guard.arm()
    bodies, audit = VolumeBodies(arm, scene), Audit(loop)
    loop.controller.surround(scene)
    touched: list[Contact] = []
    least, told = np.inf, 0.0
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
        # Its own speed is that before something pushes it.
        touched = touched or bodies.contacts(before)
        if k % 5 == 0:
            least = min(least, bodies.least())
    pose = loop.arm.measure().pose
    return Trial(tuple(one.speed for one in touched), float(least), float(np.min(audit.content)),
                 float(np.linalg.norm(pose[:3] - references[-1, POSE:POSE + 3])))


def standing(rng: np.random.Generator, count: int) -> list[Found]:
    """Something stands near the path of elbow or wrist."""
    trials = [arm_trial(rng, 0.0) for _ in range(count)]
    return [Found('trials with a contact', sum(bool(one.contacts) for one in trials), 0.0),
            Found('least distance [m]', min(one.least for one in trials), 0.0, True),
            Found('least content of the tank [J]', min(one.energy for one in trials), -0.01,
                  True),
            Found('trials that do not come home', sum(one.off > 0.01 for one in trials),
                  0.02 * count)]


def coming(rng: np.random.Generator, count: int) -> list[Found]:
    """Something comes, with up to 0.3 m/s, while the arm moves."""
    trials = [arm_trial(rng, float(rng.uniform(0.05, 0.3))) for _ in range(count)]
    speeds = [speed for one in trials for speed in one.contacts]
    return [Found('speed of a link when it is touched [m/s]', max(speeds, default=0.0), 0.02),
            Found('least content of the tank [J]', min(one.energy for one in trials), -0.01,
                  True)]


CASES: dict[str, Callable[[np.random.Generator, int], list[Found]]] = {
    'standing': standing, 'coming': coming}


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
