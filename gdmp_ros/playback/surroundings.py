"""What is around the tool of a server: motions are led around it, and bend around what moves."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from gdmp_ros.dmp.sequence import MotionStep, SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.learning.detour import detour, leads_around
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.playback.streamed_skill import StreamedSkill
from gdmp_ros.scene.distance import distances
from gdmp_ros.scene.route import Tool
from gdmp_ros.scene.scene import Scene
from gdmp_ros.scene.volume import Volume

#: A volume that has moved further than this since a motion began is bent around [m].
MOVED_M = 0.01
#: Parts of a mesh or of a cloud do if they reach this far beyond what was known [m]: two cells.
PART_M = 0.05
_CORNERS = np.stack(np.meshgrid(*3 * [[-1.0, 1.0]]), axis=-1).reshape(-1, 3)
#: What is further from the tool point than this is no part of the ball around it [m].
TOOL_M = 0.15


Motion = TypeVar('Motion', Skill, SkillSequence)


@dataclass(frozen=True)
class Led(Generic[Motion]):
    """
    A motion with a path around what is in its way.

    :ivar motion: what is executed; the motion itself if nothing is in its way
    :ivar scene: what it has been led around; None if it cannot be led
    """

    motion: Motion
    scene: Scene | None = None


class Surroundings:
    """
    The scene of a server.

    :ivar scene: present one, in the frame of the motions
    :ivar tool: its shape; None: motions are not led around anything
    """

    def __init__(self, tool: Tool | None = None):
        self.scene, self.tool = Scene(), tool
        self._known = Scene()

    def led(self, skill: Skill, start: np.ndarray | None, goal: np.ndarray | None) -> Led[Skill]:
        """
        Return what is executed instead of a skill; `begin` follows if it begins.

        :param start: where it begins; None for the skill's
        :param goal: the same of its goal
        :raises BlockedError: if there is no way
        """
        if self.tool is None or not leads_around(skill):
            return Led(skill)
        scene = self.scene.copy()
        if not len(scene.names):
            return Led(skill, scene)
        return Led(detour(skill, scene, self.tool, start=start, goal=goal).skill, scene)

    def led_steps(self, sequence: SkillSequence, first: int, place: np.ndarray | None,
                  settings: PlayerSettings) -> Led[SkillSequence]:
        """
        The same for the motions of a sequence.

        :param first: index of the step that it begins with
        :param place: where that begins; None for the start of the first skill
        """
        steps, scenes = list(sequence.steps), list[Scene | None]()
        for index, step in enumerate(steps):
            if index < first or not isinstance(step, MotionStep):
                continue
            skill, tool = step.skill, StreamedSkill(step.skill, settings)
            start = None if place is None else tool.changed(skill.start, place)
            led = self.led(skill, start, step.goal)
            scenes.append(led.scene)
            if led.motion is not skill:
                longer = led.motion.duration / skill.duration
                steps[index] = replace(step, skill=led.motion, goal=None, duration=(
                    None if step.duration is None else step.duration * longer))
            place = tool.place_of(skill.goal if step.goal is None else step.goal)
        # If one of the motions cannot be led, all of them bend.
        known = None if None in scenes else self.scene.copy()
        return Led(SkillSequence(steps, sequence.name), known)

    def begin(self, led: Led[Any]) -> Scene:
        """
        Begin a motion.

        :returns: what it bends around, as `moved`
        """
        self._known = Scene() if led.scene is None else led.scene
        return self.moved

    @property
    def moved(self) -> Scene:
        """
        What the motion is not led around, because it has come or moved since or because the motion
        cannot be led, and the tool may not touch.
        """
        may = set() if self.tool is None else self.tool.links
        return Scene([volume for volume in self.scene.around
                      if not may.intersection(volume.allowed) and self._is_new(volume)],
                     self.scene.margin)

    def _is_new(self, volume: Volume) -> bool:
        """Whether a volume has come, or moved."""
        if '#' in volume.name:
            # A part is cut in another way from time to time: new is what covers other places.
            corners = np.array([compose(volume.pose, np.array([*corner, 1.0, 0.0, 0.0, 0.0]))[:3]
                                for corner in volume.half * _CORNERS])
            return bool(distances(self._known.packed(), corners).max() > PART_M)
        known = next((one for one in self._known if one.name == volume.name), None)
        return (known is None or volume.kind != known.kind
                or bool(np.abs(volume.pose[:3] - known.pose[:3]).max() > MOVED_M))

    @property
    def radius(self) -> float:
        """Radius of a ball around the tool point in which the tool is, near the point [m]."""
        if self.tool is None:
            return 0.0
        far = [float(np.linalg.norm(0.5 * (row[:3] + row[3:6]))) + float(row[6])
               for row in self.tool.capsules]
        return max((reach for reach in far if reach < TOOL_M), default=0.0)
