"""What a user works on: takes, skills, and the changes of one skill. No page and no robot."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import re
from typing import NamedTuple

import numpy as np

from gdmp_ros.choices import SEQUENCES
from gdmp_ros.data import bags, episodes, recordings, runs, takes
from gdmp_ros.data.columns import Import
from gdmp_ros.data.recordings import Recording
from gdmp_ros.data.sequences import read_sequence
from gdmp_ros.data.skills import LearnedSkill, LearningSettings, skill_from_bags
from gdmp_ros.dmp.changes import joints_in_order
from gdmp_ros.dmp.options import SHORTEST_DURATION
from gdmp_ros.dmp.sequence import MotionStep, SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.dmp.via import through
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.learning.correction import correction, FollowedMotion, Push
from gdmp_ros.playback.streamed_skill import is_of_joints
from gdmp_ros.scene import read_scene, Scene
from gdmp_ros.scene.scene import MAX_BYTES
from gdmp_ros.studio.commands import Changes
from gdmp_ros.studio.motion import check_shown, of_run, ShownMotion
from gdmp_ros.studio.recent import RecentFiles
from gdmp_ros.util.files import read_text, write_bytes

#: Most messages on a topic of a bag.
LARGEST = 600_000


@dataclass
class Take:
    """
    A recorded demonstration.

    :ivar used: whether a skill is learned from it
    """

    path: Path
    recording: Recording
    used: bool = True

    @property
    def of_joints(self) -> bool:
        """Whether it has positions of joints only."""
        return is_of_joints(self.recording.demonstration)


class Opened(NamedTuple):
    """
    A file or folder that was opened.

    :ivar kind: what it is
    :ivar skill: its name in the workbench; empty if it is no skill
    """

    kind: str
    skill: str = ''


def check_free(path: Path, replace_file: bool) -> None:
    """:raises DataError: if a file exists that is not to be replaced"""
    if path.exists() and not replace_file:
        raise DataError(f'{path}: exists already; tick "replace an existing file", or use '
                        'another name')


class Workbench:
    """
    Takes and skills, and the changes of the chosen skill.

    :ivar takes: in their order
    :ivar skills: by name
    :ivar runs: what was sent and what the arm did, by name of the bag
    :ivar sequences: by name of the file
    :ivar scene: what stands around the arm
    :ivar recent: what was opened last, in other studios too
    :ivar joints: names of the joints of the arm; empty before there is one (`serve`)
    :ivar chosen: name of the skill that is changed; empty without one
    :ivar changes: of that skill
    """

    def __init__(self, reading: Import | None = None) -> None:
        """:param reading: what is said about takes in files of other programs"""
        self._reading = reading or Import()
        self.recent = RecentFiles()
        self.takes: list[Take] = []
        self.skills: dict[str, Skill] = {}
        self.runs: dict[str, tuple[ShownMotion, ShownMotion]] = {}
        self.sequences: dict[str, SkillSequence] = {}
        self.scene = Scene()
        self.joints: Sequence[str] = ()
        self.chosen = ''
        self.changes = self._saved = Changes()
        self._past: list[Changes] = []
        self._undone: list[Changes] = []

    def serve(self, joints: Sequence[str]) -> None:
        """
        Work on skills of an arm from now on.

        :param joints: names of its joints
        :raises DataError: if a skill is not one of this arm
        """
        self.joints = list(joints)
        self.skills = {name: self._checked(skill) for name, skill in self.skills.items()}

    def _checked(self, skill: Skill) -> Skill:
        """A skill with the joints of the arm in their order; refused if it cannot be shown."""
        result = joints_in_order(skill, self.joints) if self.joints else skill
        check_shown(result, self.joints)
        return result

    def open_skill(self, path: Path) -> str:
        """
        Load a skill file, and choose the first.

        :returns: its name
        :raises DataError: if it cannot be loaded, or is neither one of a pose nor of the joints
        """
        return self.add(path.stem, Skill.load(path))

    def open_sequence(self, path: Path) -> None:
        """
        Read a sequence file; its skills can be seen and changed like others.

        :raises DataError: if it cannot be read, or a skill is neither one of a pose nor of the
            joints
        """
        sequence = read_sequence(path.absolute())
        names: dict[Skill, str] = {}
        for step in sequence.steps:
            if isinstance(step, MotionStep):
                names.setdefault(step.skill, step.name)
        for skill, name in names.items():
            self.add(name, skill)
        self.sequences[str(path) if path.name in self.sequences else path.name] = sequence

    def add(self, name: str, skill: Skill) -> str:
        """
        Add a skill; choose it if it is the first. Returns its name, which is free.

        :raises DataError: if it is neither one of a pose nor of the joints of the arm
        """
        skill = self._checked(skill)
        free, number = name, 1
        while free in self.skills:
            number += 1
            free = f'{name} ({number})'
        self.skills[free] = skill
        if not self.chosen:
            self.choose(free)
        return free

    def choose(self, name: str) -> None:
        """Change another skill from now on; changes that were not saved are lost."""
        self.chosen, self.changes, self._saved = name, Changes(), Changes()
        self._past, self._undone = [], []

    def remember(self, before: Changes) -> None:
        """Let `undo` go back to these changes, which were there before the last one."""
        if before != self.changes:
            self._past.append(before)
            self._undone.clear()

    def undo(self) -> None:
        """
        Take the last change back.

        :raises DataError: if there is none
        """
        self._go(self._past, self._undone, 'undo')

    def redo(self) -> None:
        """
        Make the last change that was taken back again.

        :raises DataError: if there is none
        """
        self._go(self._undone, self._past, 'redo')

    def _go(self, where: list[Changes], back: list[Changes], what: str) -> None:
        if not where:
            raise DataError(f'there is nothing to {what}')
        back.append(self.changes)
        self.changes = where.pop()

    def open(self, source: Path) -> Opened:
        """
        Open a skill, a sequence, a scene, a take, a folder of takes, or a recorded run.

        :raises DataError: if it cannot be read
        """
        if not source.exists():
            raise DataError(f'{source}: there is no such file or folder')
        result = self._open(source)
        self.recent.add(source)
        return result

    def receive(self, name: str, content: bytes, replace_file: bool = False) -> Opened:
        """
        Keep a file that a browser has sent in the present folder, and open it.

        :param name: of the file; its folder, on another machine, does not count
        :raises DataError: if there is a file of this name already, it cannot be written, or it
            cannot be read; nothing is kept then
        """
        path = Path(Path(name).name)
        if path.is_dir():
            raise DataError(f'{name!r}: expected the name of a file')
        check_free(path, replace_file)
        if not content:
            raise DataError(f'{name}: the file is empty')
        old = path.read_bytes() if path.exists() else None
        try:
            write_bytes(path, content)
        except OSError as error:
            raise DataError(f'{path}: cannot write: {error.strerror}') from None
        try:
            return self.open(path)
        except GdmpError:
            if old is None:
                path.unlink()
            else:
                write_bytes(path, old)
            raise

    def _open(self, source: Path) -> Opened:
        if source.suffix == '.json' and not source.is_dir():
            name = self.open_skill(source)
            return Opened(f'skill {name}', name)
        if source.suffix in SEQUENCES and not source.is_dir():
            if is_scene(source):
                self.scene = read_scene(source)
                return Opened(f'scene with {len(self.scene)} volumes')
            self.open_sequence(source)
            return Opened(f'sequence {source.name}')
        found = takes.bags_in(source)
        for bag in found:
            if not episodes.is_foreign(bag) and _is_run(bag):
                self.runs[bag.name] = of_run(bag)
            else:
                self.open_take(bag)
        return Opened(f'{len(found)} recording{"s" if len(found) != 1 else ""}')

    def open_take(self, path: Path) -> Take:
        """
        Read a take: poses of the tool, or positions of the joints if it has no poses.

        :raises DataError: naming bag, topic, sample and reason
        """
        kinds = set() if episodes.is_foreign(path) else {
            kind for _, kind, _ in bags.topics(path)}
        if self._reading.joints is None and bags.JOINTS in kinds and not kinds & {
                *bags.POSES, bags.TRANSFORMS}:
            recording = recordings.read_joints(path, '', self._reading)
        else:
            recording = recordings.read(path, settings=self._reading)
        take = Take(path, recording)
        self.takes.append(take)
        return take

    def label(self, take: Take) -> str:
        """Name of a take, with its folder where names repeat."""
        same = [item for item in self.takes if item.path.name == take.path.name]
        return take.path.name if len(same) == 1 else str(take.path)

    def drop(self, take: Take) -> Path:
        """
        Put a take aside, where nothing is learned from it; returns its new path.

        :raises DataError: if it is an episode of a file, or cannot be moved
        """
        if episodes.is_foreign(take.path):
            raise DataError(f'{take.path}: an episode of a file stays there: untick it instead')
        moved = takes.drop(take.path.parent, take.path.name)
        self.takes.remove(take)
        return moved

    def learning(self, settings: LearningSettings) -> Callable[[], LearnedSkill]:
        """
        Learning from the takes that are used, for a thread of its own; see `take_in`.

        :raises DataError: if there are none
        """
        used = [take.path for take in self.takes if take.used]
        if not used:
            raise DataError('no take is used: record one, or tick one')
        if any(take.of_joints for take in self.takes if take.used):
            settings = replace(settings, joint_topic=settings.joint_topic or '')

        def learned() -> LearnedSkill:
            result = skill_from_bags(used, replace(settings, source=self._reading))
            self._checked(result.skill)
            return result
        return learned

    def take_in(self, learned: LearnedSkill) -> str:
        """Add a skill that has been learned, and choose it; returns its name."""
        count = len(learned.demonstrations)
        name = self.add(f'learned from {count} take{"s" if count > 1 else ""}', learned.skill)
        self.choose(name)
        return name

    def comparison(self) -> list[takes.ComparedTake]:
        """Each take compared with the others; empty with fewer than two."""
        if len(self.takes) < 2 or len({take.of_joints for take in self.takes}) > 1:
            return []
        return takes.compare([take.recording for take in self.takes])

    @property
    def skill(self) -> Skill:
        """
        The chosen skill without changes.

        :raises DataError: without one
        """
        if not self.chosen:
            raise DataError('there is no skill yet: learn one from takes, or open a file')
        return self.skills[self.chosen]

    def edited(self) -> Skill:
        """
        The chosen skill with the changes.

        :raises GdmpError: if a via point cannot be met
        """
        changes = self.changes
        skill = (self.skill, *changes.corrections)[-1]
        if changes.objects:
            skill = skill.with_frames(changes.objects)
        if changes.duration is not None:
            skill = replace(skill, duration=max(changes.duration, SHORTEST_DURATION))
        if changes.start is not None or changes.goal is not None:
            skill = skill.between(*(None if pose is None else _with_pose(point, pose)
                                    for point, pose in ((skill.start, changes.start),
                                                        (skill.goal, changes.goal))))
        if changes.via:
            points = [(s, _with_pose(skill.goal, position))
                      for s, position in sorted(changes.via.items())]
            skill = through(skill, points, ['joints' if is_of_joints(skill) else 'position'])
        return skill

    def add_via(self, progress: float, position: np.ndarray) -> None:
        """
        Let the changed skill pass through a position [m], or a posture [rad].

        :raises GdmpError: if it cannot; nothing has changed then
        """
        before = dict(self.changes.via)
        self.changes.via[progress] = np.asarray(position, dtype=float)
        try:
            self.edited()
        except Exception:
            self.changes.via = before
            raise

    def correct(self, followed: FollowedMotion) -> list[Push]:
        """
        Correct the chosen skill where the arm was pushed.

        :raises GdmpError: if there is no push, or the skill cannot be corrected
        """
        result = correction((self.skill, *self.changes.corrections)[-1], followed)
        self.changes.corrections += (result.primitive,)
        return result.pushes

    def undo_correction(self) -> None:
        """
        Take the last correction back.

        :raises DataError: if there is none
        """
        if not self.changes.corrections:
            raise DataError('there is no correction to undo')
        self.changes.corrections = self.changes.corrections[:-1]

    @property
    def unsaved(self) -> bool:
        """Whether there are changes that were not saved."""
        return bool(self.changes) and self.changes != self._saved

    def save(self, path: Path) -> None:
        """
        Write the changed skill as a file.

        :raises DataError: if it cannot be written
        """
        try:
            path.absolute().parent.mkdir(parents=True, exist_ok=True)
            self.edited().save(path)
            self._saved = self.changes.copy()
        except OSError as error:
            raise DataError(f'{path}: cannot write: {error.strerror}') from None


def _with_pose(point: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """A point with another pose, another position, or another posture."""
    result = np.array(point, dtype=float)
    result[:len(pose)] = pose
    return result


def is_scene(path: Path) -> bool:
    """Whether a YAML file is a scene, and not a sequence."""
    text = read_text(path, 'scene', MAX_BYTES)
    return re.search(r'^volumes\s*:', text, re.MULTILINE) is not None


def _is_run(bag: Path) -> bool:
    """Whether a bag has references and states of an arm; refused if it is too long."""
    result = bags.topics(bag)
    for topic, _, count in result:
        if count > LARGEST:
            raise DataError(f'{bag}: topic {topic} has {count} messages, the studio opens bags '
                            f'with at most {LARGEST} on a topic (10 min at 1 kHz): cut it, or '
                            'see it with gdmp show')
    return all(runs.streams(result))


def opened(sources: Sequence[Path], step: Callable[[], object] = lambda: None,
           reading: Import | None = None) -> Workbench:
    """
    Open skill files, sequence files, takes, folders of takes, and recorded runs.

    :param step: called after each source
    :param reading: as for `Workbench`
    :raises DataError: naming what cannot be read
    """
    bench = Workbench(reading)
    for source in sources:
        bench.open(source)
        step()
    return bench
