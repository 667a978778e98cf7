"""Skills learned from bags, and earlier versions of a skill file."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from dataclasses import replace as replaced
import os
from pathlib import Path
import shutil
from typing import Any, NamedTuple

from gdmp_ros.data import episodes, recordings
from gdmp_ros.data.columns import Import
from gdmp_ros.data.objects import with_objects
from gdmp_ros.data.recordings import common_events
from gdmp_ros.data.takes import read_numbers
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.primitive import CYCLE_ALPHA_G, Gains, GripperEvent
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.learning.frames_fit import LATEST_GRASP


@dataclass(frozen=True)
class LearningSettings:
    """
    How a skill is learned; the names are those of `Skill.learn` and of `recordings`.

    :ivar stiffness: source of the stiffness, one of `gdmp_ros.choices.STIFFNESSES`
    :ivar wrench_topic: topic of a wrench that is played back too; empty for none
    :ivar joint_topic: topic of a JointState of which a skill of the joints is learned; empty for
        the only one; None for a skill of the tool
    :ivar frame: frame that the poses must have; empty for any
    :ivar weights: how much each demonstration counts; None for alike
    :ivar alpha_g: goal gain; None for that of `Skill.learn` or `Skill.learn_rhythmic`
    :ivar contexts: table of the takes (`gdmp_ros.data.takes`); None without contexts
    :ivar rhythmic: learn a motion that repeats a cycle
    :ivar period: of the cycle [s]; None to find it
    :ivar objects: names of task frames, in the transforms of the bags; ``NAME=/topic``: on a topic
    :ivar object_table: poses of more of them in each take (`gdmp_ros.data.objects.read_poses`)
    :ivar moving: those of them that move while they are shown
    :ivar ends: the frames of start and goal; None for those of `Skill.learn`
    :ivar free_yaw: task frames of objects that are symmetric about their z axis
    :ivar source: what is said about files of other programs
    """

    n_basis: int | str = 'auto'
    connection: str = 'parallel'
    tolerance: float = 1e-4
    smoothing: float | None = None
    regularization: float = 0.0
    alpha_g: float | None = None
    stiffness: str = 'auto'
    k_min: float = 200.0
    k_max: float = 800.0
    pose_topic: str = ''
    stiffness_topic: str = ''
    wrench_topic: str = ''
    joint_topic: str | None = None
    frame: str = ''
    fit: str = 'output'
    end: str | None = None
    weights: tuple[float, ...] | None = None
    rhythmic: bool = False
    period: float | None = None
    contexts: Path | None = None
    objects: tuple[str, ...] = ()
    object_table: Path | None = None
    moving: tuple[str, ...] = ()
    ends: tuple[str | None, str | None] = (None, None)
    free_yaw: tuple[str, ...] = ()
    source: Import = field(default_factory=Import)

    @property
    def goal_gain(self) -> float:
        """The goal gain; that of its kind of skill by default."""
        if self.alpha_g is not None:
            return self.alpha_g
        return CYCLE_ALPHA_G if self.rhythmic else Gains.alpha_g

    def __post_init__(self) -> None:
        if self.period is not None and not self.rhythmic:
            raise ParameterError('a period belongs to a rhythmic skill')
        if self.rhythmic and (self.connection != 'parallel' or self.fit != 'output'
                              or self.end is not None or self.regularization):
            raise ParameterError('connection, fit, end and regularization are for skills that '
                                 'end, not for rhythmic ones')
        if self.rhythmic and self.contexts is not None:
            raise ParameterError('contexts are not for rhythmic skills')
        if self.rhythmic and self.stiffness == 'variance':
            raise ParameterError('stiffness from the variance of takes is not for rhythmic '
                                 'skills: record the stiffness, or learn without it')


class LearnedSkill(NamedTuple):
    """
    A skill and what it was learned from.

    :ivar stiffness: source of the stiffness
    """

    skill: Skill
    demonstrations: list[Demonstration]
    stiffness: str


def skill_from_bags(bags: Sequence[str | Path], settings: LearningSettings,
                    step: Callable[[], object] = lambda: None) -> LearnedSkill:
    """
    Learn one skill from all bags.

    :param step: called after each bag that has been read
    :raises GdmpError: if a bag is refused, the frames differ, or nothing can be learned
    """
    contexts = None if settings.contexts is None else read_numbers(
        settings.contexts, [Path(bag).name for bag in bags])
    takes = []
    for bag in bags:
        takes.append(_read(bag, settings))
        step()
    among = bool(settings.objects or settings.object_table)
    if settings.joint_topic is not None:
        demonstrations, source = _of_the_same_joints(takes), 'none'
    else:
        _check_frames(takes, settings.frame)
        stiffness = settings.stiffness
        if settings.rhythmic and stiffness == 'auto' and not all(
                take.demonstration.manifold.point_size > 7 for take in takes):
            stiffness = 'none'
        if among:
            stiffness = _stiffness_among_objects(stiffness, takes)
        demonstrations, source = recordings.with_stiffness(takes, stiffness, settings.k_min,
                                                           settings.k_max)
        demonstrations = recordings.with_wrench(takes, demonstrations)
        if among:
            demonstrations = with_objects(takes, demonstrations, settings.objects,
                                          settings.moving, settings.object_table,
                                          settings.source)
    provenance = {'demonstrations': [str(bag) for bag in bags], 'frame': takes[0].frame,
                  'stiffness': source,
                  **_of_joints(takes[0])}
    if settings.rhythmic:
        return LearnedSkill(_cycle(demonstrations, settings, provenance), demonstrations, source)
    events = common_events([take.demonstration for take in takes], [take.bag for take in takes],
                           [take.events for take in takes])
    skill = Skill.learn(demonstrations, settings.n_basis, connection=settings.connection,
                        tolerance=settings.tolerance, smoothing=settings.smoothing,
                        regularization=settings.regularization,
                        alpha_g=settings.goal_gain, fit=settings.fit, end=settings.end,
                        demonstration_weights=settings.weights, contexts=contexts,
                        start_frame=settings.ends[0], goal_frame=settings.ends[1],
                        free_yaw=settings.free_yaw, grasp_at=_grasp_at(events) if among else None,
                        provenance=provenance)
    return LearnedSkill(skill.with_events(events), demonstrations, source)


def _grasp_at(events: Sequence[GripperEvent]) -> float | None:
    """Progress at which the gripper first holds something; None without, or at the end."""
    return next((event.progress for event in events
                 if event.force > 0.0 and event.progress <= LATEST_GRASP), None)


def _stiffness_among_objects(stiffness: str, takes: Sequence[recordings.Recording]) -> str:
    """
    Source of the stiffness of takes among objects, which vary because the objects do.

    :raises ParameterError: for the variance of the takes
    """
    if stiffness == 'variance':
        raise ParameterError('stiffness from variance: not with task frames: the takes vary where '
                             'the objects do, not where the motion may')
    if stiffness == 'auto' and not any(take.demonstration.manifold.point_size > 7
                                       for take in takes):
        return 'none'
    return stiffness


def _cycle(demos: list[Demonstration], settings: LearningSettings, provenance: dict[str, Any]
           ) -> Skill:
    return Skill.learn_rhythmic(demos, settings.period, settings.n_basis,
                                alpha_g=settings.goal_gain, tolerance=settings.tolerance,
                                smoothing=settings.smoothing,
                                demonstration_weights=settings.weights, provenance=provenance)


def _read(bag: str | Path, settings: LearningSettings) -> recordings.Recording:
    if settings.joint_topic is not None:
        return recordings.read_joints(bag, settings.joint_topic, settings.source)
    columns = tuple(name.partition('=')[2] or name for name in settings.objects)
    return recordings.read(bag, settings.pose_topic, settings.stiffness_topic,
                           settings.wrench_topic, replaced(settings.source, objects=columns))


def _of_joints(take: recordings.Recording) -> dict[str, Any]:
    """What is kept of the joints, so that their motion can be written as it was recorded."""
    if not take.joints:
        return {}
    return {'joints': list(take.joints), 'joint_unit': take.joint_unit,
            **episodes.described(Path(take.bag))}


def _of_the_same_joints(takes: Sequence[recordings.Recording]) -> list[Demonstration]:
    for take in takes:
        if take.joints != takes[0].joints:
            raise DataError(f'{take.bag}: the joints are {", ".join(take.joints)}, expected those '
                            f'of {takes[0].bag}: {", ".join(takes[0].joints)}')
        if take.joint_unit != takes[0].joint_unit:
            raise DataError(f'{take.bag}: a unit of its joints is {take.joint_unit:.4g} rad, '
                            f'expected {takes[0].joint_unit:.4g} rad as in {takes[0].bag}: say '
                            'with --units what they are')
    return [take.demonstration for take in takes]


def _check_frames(takes: Sequence[recordings.Recording], expected: str) -> None:
    for take in takes:
        if expected and take.frame != expected:
            raise DataError(f'{take.bag}: poses are in frame {take.frame!r}, '
                            f'expected {expected!r}')
    frames = sorted({take.frame for take in takes})
    if len(frames) > 1:
        raise DataError(f'the demonstrations are in different frames: {", ".join(frames)}')


def history_of(path: Path) -> Path:
    """Folder with the earlier versions of a skill file."""
    return path.with_name(f'{path.name}.history')


def versions(path: Path) -> list[Path]:
    """Earlier versions, the oldest first."""
    return sorted(history_of(path).glob('[0-9][0-9][0-9][0-9].json'))


def replace(path: Path, skill: Skill) -> None:
    """
    Write a skill in place of a file; the file becomes an earlier version.

    :raises DataError: if it cannot be written; the file stays
    """
    earlier = versions(path)
    number = int(earlier[-1].stem) + 1 if earlier else 1
    kept = history_of(path) / f'{number:04d}.json'
    try:
        kept.parent.mkdir(exist_ok=True)
        shutil.copyfile(path, kept)
    except OSError as error:
        raise DataError(f'{kept}: cannot keep the earlier version: {error.strerror}') from None
    try:
        skill.save(path)
    except DataError:
        kept.unlink()
        raise


def undo(path: Path) -> None:
    """
    Bring the last earlier version back, byte by byte.

    :raises DataError: if there is none
    """
    earlier = versions(path)
    if not earlier:
        raise DataError(f'{path}: there is no earlier version to go back to')
    try:
        os.replace(earlier[-1], path)
        if len(earlier) == 1:
            history_of(path).rmdir()
    except OSError as error:
        raise DataError(f'{path}: cannot bring {earlier[-1]} back: {error.strerror}') from None
