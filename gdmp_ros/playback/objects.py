"""Where the task frames of a motion are: looked up when it begins, followed while it goes on."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from gdmp_ros.choices import SCALES
from gdmp_ros.dmp.frames import nearest_turn
from gdmp_ros.dmp.pose_track import PoseTrack
from gdmp_ros.dmp.sequence import MotionStep, SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.manifolds.poses import POSE_SIZE
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.playback.goal_check import GoalCheck
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.states import Request, State
from gdmp_ros.playback.streamed_skill import Kind
from gdmp_ros.util.settings import setting

#: A stamp that lies further in the future is of another clock [s].
FUTURE_S = 0.1


@dataclass(frozen=True)
class ObjectSettings:
    """Which task frames are looked up, and what is believed of them."""

    objects: tuple[str, ...] = setting(
        ('',), 'task frames of skills that are looked up in /tf when a motion begins, which is '
        'refused if they are not known; the others are where the skill has them')
    moving_objects: tuple[str, ...] = setting(
        ('',), 'task frames that are looked up, too, and followed while the motion goes on')
    object_age: float = setting(
        0.5, 'oldest pose of an object on /tf with which a motion may begin; one that is followed '
        'rests when its newest pose is older. /tf_static does not age', 's', 0.02, 3600.0)
    object_jump: float = setting(
        0.3, 'a pose of an object that is followed and jumps further is refused', 'm', 0.001, 10.0)
    object_turn: float = setting(
        1.5, 'a pose of an object that is followed and turns further at once is refused', 'rad',
        0.01, 3.2)
    object_scale: str = setting(
        'none', 'whether the shape of a motion keeps its size (none), or is scaled with the '
        'distance from start to goal', choices=SCALES)


class Located(NamedTuple):
    """
    Where an object is.

    :ivar pose: in the frame of the references, (7,)
    :ivar stamp_ns: when it was there, by the clock of its source; 0: it is fixed
    :ivar age: time since then [s]
    """

    pose: np.ndarray
    stamp_ns: int = 0
    age: float = 0.0


class ObjectSource(Protocol):
    """Tells where objects are."""

    def catch_up(self) -> None:
        """Read all that has been received; not in a tick."""

    def locate(self, name: str) -> Located:
        """
        Where an object is.

        :raises GdmpError: if that is not known
        """


class NoObjects:
    """Nothing tells where objects are."""

    def catch_up(self) -> None:
        """Nothing is received."""

    def locate(self, name: str) -> Located:
        """:raises ParameterError: always"""
        raise ParameterError(f'object {name}: nothing tells where it is')


@dataclass
class FollowedObject:
    """
    An object that is followed.

    :ivar at: when it was where it was seen last, of the motions [s]
    :ivar pose: the newest one that was used
    :ivar problem: why the newest one was not used; empty if it was
    :ivar rests: whether its frame was told to rest
    """

    at: float
    pose: np.ndarray
    problem: str = ''
    rests: bool = False


@dataclass
class _Known:
    """
    What is known of an object that moves, also between motions.

    :ivar seen: the newest pose that was looked at
    :ivar track: of those that were used; stamps as of the motions
    """

    seen: Located | None = None
    track: PoseTrack = PoseTrack()


#: Objects that a motion follows, by name.
Followed: TypeAlias = dict[str, FollowedObject]


class Objects:
    """
    Places skills where their objects are, and follows those that move.

    :ivar settings: which are looked up
    """

    def __init__(self, settings: ObjectSettings, source: ObjectSource, goals: GoalCheck,
                 refuse: Callable[[str], None]):
        """
        Prepare.

        :param goals: refuses places where the goal cannot be
        :param refuse: called with the reason when a pose is not used
        """
        self.settings = settings
        self._source, self._goals, self._refuse = source, goals, refuse
        self._followed: Followed = {}
        self._known: dict[str, _Known] = {}
        self._motion = 0

    @property
    def names(self) -> set[str]:
        """Names of the objects that are looked up."""
        return {*self.settings.objects, *self.settings.moving_objects} - {''}

    @property
    def lost(self) -> bool:
        """Whether an object that is followed is not seen any more."""
        return any(one.rests for one in self._followed.values())

    def place(self, skill: Skill, time: float, given: Mapping[str, np.ndarray] | None = None
              ) -> tuple[Skill, Followed]:
        """
        Return a skill with its task frames where the objects are, and those that move.

        :param time: that the motions have had [s]
        :param given: poses of objects that are not looked up
        :raises GdmpError: if it is not known where one is, or that is too long ago
        """
        given = given or {}
        self._source.catch_up()
        found = {view.name: self._recent(view.name) for view in skill.views
                 if view.name in self.names and view.name not in given}
        poses = {**{name: one.pose for name, one in found.items()}, **given}
        if poses:
            skill = skill.with_frames(poses, self.settings.object_scale)
        return skill, {name: FollowedObject(time - one.age, one.pose)
                       for name, one in found.items() if name in self.settings.moving_objects}

    def place_steps(self, sequence: SkillSequence, time: float) -> SkillSequence:
        """
        The same for the steps of a sequence, once: they do not follow objects.

        :raises GdmpError: as `place`
        """
        return SkillSequence([
            replace(step, skill=self.place(step.skill, time)[0])
            if isinstance(step, MotionStep) and step.skill.views else step
            for step in sequence.steps], sequence.name)

    def begin(self, followed: Followed, motion: int) -> None:
        """Let a motion follow these objects, and no others, from when it begins."""
        self._followed, self._motion = followed, motion

    def _recent(self, name: str) -> Located:
        found = self._source.locate(name)
        problem = self._age_problem(found)
        if problem:
            raise ParameterError(f'object {name}: {problem}')
        return found

    def _age_problem(self, found: Located) -> str:
        """Why the age of a pose is not believed; empty if it is."""
        if not found.stamp_ns:
            return ''
        if found.age < -FUTURE_S:
            return (f'its stamp lies {-found.age:.3g} s in the future: the clocks of this machine '
                    'and of the one that sees it differ')
        if found.age > self.settings.object_age:
            return (f'its newest pose is {found.age:.3g} s old, expected at most '
                    f'{self.settings.object_age:g} s (object_age)')
        return ''

    def follow(self, player: Player, time: float) -> None:
        """
        Let the motion follow the objects that move.

        :param time: that the motions have had [s]
        """
        for name in {*self.settings.moving_objects} - {'', *self._followed}:
            self._watch(player, name, time)
        if not self._followed or player.motion < self._motion:
            return  # what is known of the player is of the motion before
        if player.motion > self._motion or not player.allows(Request.GOAL):
            self._followed = {}
            return
        ended = (player.state is State.FINISHED
                 and not self._goals.settings.follow_goal_after_end)
        for name, one in list(self._followed.items()):
            if player.goal_switched and name == player.next_tool.skill.views[-1].name:
                del self._followed[name]  # the new goal is another place
            elif ended or player.has_grasped(name):
                player.rest_frame(name)
                del self._followed[name]
            else:
                self._follow(player, name, one, time)

    def _watch(self, player: Player, name: str, time: float) -> None:
        """Find out how an object moves before a motion follows it."""
        known, found = self._look(name)
        if found is not None and not self._age_problem(found):
            self._use(player, name, known, found, time)

    def _look(self, name: str) -> tuple[_Known, Located | None]:
        """What is known of an object, and where it is if that is new."""
        known = self._known.setdefault(name, _Known())
        try:
            found = self._source.locate(name)
        except GdmpError:
            return known, None
        if known.seen is not None and _same(found, known.seen):
            return known, None
        known.seen = found
        return known, found

    @staticmethod
    def _use(player: Player, name: str, known: _Known, found: Located, time: float) -> None:
        """Use a new pose of an object."""
        pose, view, track = found.pose, player.view(name), known.track
        if track.seen and view is not None and view.free_yaw:
            pose = nearest_turn(pose, track.seen[-1].pose)
        known.track = track.with_pose(time - found.age, pose)

    def _follow(self, player: Player, name: str, one: FollowedObject, time: float) -> None:
        known, found = self._look(name)
        if found is not None:
            problem = self._age_problem(found) or self._problem(player, name, one, found)
            if not problem:
                self._use(player, name, known, found, time)
                motion = known.track.motion
                one.at, one.pose, one.rests = known.track.stamp, found.pose, False
                player.move_frame(name, motion[:POSE_SIZE], one.at, motion[POSE_SIZE:])
            elif not one.problem:
                self._refuse(f'object {name}: {problem}; the pose is not used')
            one.problem = problem
        passed = time - one.at
        fixed = known.seen is not None and not known.seen.stamp_ns
        if passed > self.settings.object_age and not fixed and not one.rests:
            player.rest_frame(name)
            one.rests = True
            self._refuse(f'object {name}: no pose that can be used for {passed:.2g} s; its frame '
                         'rests where it was')

    def _problem(self, player: Player, name: str, one: FollowedObject, found: Located) -> str:
        """Why a pose cannot be followed; empty if it can."""
        jump = float(np.linalg.norm(found.pose[:3] - one.pose[:3]))
        turn = float(rotation_angles(found.pose[3:], one.pose[3:]))
        view = player.view(name)
        if jump > self.settings.object_jump:
            return (f'it jumps by {jump:.3g} m, expected at most {self.settings.object_jump:g} m '
                    '(object_jump)')
        if turn > self.settings.object_turn and view is not None and not view.free_yaw:
            return (f'it turns by {turn:.3g} rad at once, expected at most '
                    f'{self.settings.object_turn:g} rad (object_turn)')
        tool = player.next_tool
        if tool.kind is not Kind.TOOL or tool.skill.views[-1].name != name:
            return ''
        goal = tool.place_of(tool.skill.with_frames({name: found.pose}).goal)
        try:
            self._goals.check_workspace(tool, goal)
        except GdmpError as error:
            return str(error)
        return ''


def _same(first: Located, second: Located) -> bool:
    if first.stamp_ns or second.stamp_ns:
        return first.stamp_ns == second.stamp_ns
    return bool(np.array_equal(first.pose, second.pose))
