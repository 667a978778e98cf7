"""
The film of the first page, from recorded runs.

Each clip is drawn from a bag: of a take that a hand has shown, or of a run. Nothing is drawn that
the bag does not have. The bags stay beside the film.
"""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.demo import clutter
from gdmp_ros.demo.recorded import RecordedWorld
from gdmp_ros.demo.run import run_demo
from gdmp_ros.demo.tasks import run_task
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.gripper import add_gripper
from gdmp_ros.sim.replay import Replay
from gdmp_ros.sim.scenes import pick_and_place
from gdmp_ros.sim.volumes import add_volumes
from gdmp_ros.view.films import join

#: Time between two pictures of the film [s].
PICTURE_S = 0.1
_FAR = np.array([0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0])


class Clip(NamedTuple):
    """
    A part of the film.

    :ivar bag: in the folder
    :ivar begin: of the part, from the start of the bag on [s]; negative: from its end back
    :ivar seconds: of the bag
    :ivar speed: of the clip
    :ivar caption: below the pictures
    :ivar objects: frames on /tf that are seen
    """

    bag: str
    begin: float
    seconds: float
    speed: float
    caption: str
    objects: tuple[str, ...] = ()


CLIPS = {
    'teach': Clip('clutter/takes/take_001', 0.5, 9.5, 1.0, 'a hand shows a task once', ('cube',)),
    'switch': Clip('letter/run', 0.3, 14.0, 1.0,
                   'a learned letter; its goal is switched on the way'),
    'where': Clip('objects/run', -23.0, 10.5, 1.0,
                  'shown once, done where the object stands', ('hole',)),
    'follow': Clip('objects/run', -11.5, 11.0, 1.0,
                   'here the object moves while the arm goes there', ('hole',)),
    'clutter': Clip('clutter/run', 0.5, 14.0, 1.0,
                    'the task, led around objects; one is pushed into the way', ('cube',))}


def _thing(name: str, kind: str, size: Sequence[float]) -> Volume:
    return Volume(name, kind, tuple(size), _FAR)


def _world(name: str) -> Arm:
    """The arm with what is to be seen."""
    if name == 'teach':
        return Arm(extras=[add_gripper, pick_and_place])
    if name == 'clutter':
        return clutter.world()
    thing = (_thing('goal', 'sphere', (0.015,)) if name == 'switch'
             else _thing('hole', 'box', (0.12, 0.12, 0.03)))
    return Arm(extras=[add_volumes(Scene([thing]), free=True)])


def record(folder: Path) -> None:
    """Execute everything that is filmed."""
    run_demo(folder / 'letter', 'GShape', ArmChoice())
    for task in ('objects', 'clutter'):
        run_task(task, folder / task, ArmChoice())


def draw(folder: Path) -> dict[str, Any]:
    """
    Draw the clips and the film.

    :returns: durations of the clips [s]
    """
    made, durations = [], {}
    for name, clip in CLIPS.items():
        recorded = RecordedWorld(folder / clip.bag, clip.objects)
        first, last = recorded.state_stamps[[0, -1]]
        begin = (last if clip.begin < 0.0 else first) + round(clip.begin * NS)
        stamps = np.arange(begin, min(begin + round(clip.seconds * NS), last),
                           round(clip.speed * PICTURE_S * NS))
        target = folder / f'{name}.webp'
        recorded.film(target, Replay(_world(name)), PICTURE_S, stamps, clip.caption)
        made.append(target)
        durations[name] = PICTURE_S * len(stamps)
    for target, width in ((folder / 'film.mp4', 640), (folder / 'film.webp', 480)):
        join(target, made, PICTURE_S, width)
        print(f'wrote {target}')
    return durations
