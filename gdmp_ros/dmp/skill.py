"""`Skill`: a movement primitive with everything that users do with it."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math
from pathlib import Path
from typing import Any

import numpy as np

from gdmp_ros.dmp import changes
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.distribution import Distribution
from gdmp_ros.dmp.primitive import CYCLE_ALPHA_G, Gains, GripperEvent, Primitive, Trajectory
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill_file import (
    parse_primitive,
    primitive_text,
    read_primitive,
    write_primitive,
)
from gdmp_ros.dmp.via import through, warn_of_cost
from gdmp_ros.errors import ParameterError

#: Most samples of `Skill.reproduce`.
MOST_SAMPLES = 10_000_000


class Skill(Primitive):
    """
    A movement primitive that can be learned, executed, changed, saved and loaded.

    Its data and their units are those of `gdmp_ros.dmp.primitive.Primitive`.
    """

    @classmethod
    def learn(cls, demonstrations: Demonstration | Sequence[Demonstration],
              n_basis: int | str = 60, alpha_z: float = 60.0, alpha_x: float = 4.6052,
              connection: str = 'parallel', *, alpha_g: float = 8.0, tolerance: float = 1e-4,
              smoothing: float | None = None, regularization: float = 0.0, split: bool = True,
              fit: str = 'output', end: str | None = None, align: bool = True,
              demonstration_weights: Sequence[float] | None = None,
              contexts: Mapping[str, Sequence[float]] | Sequence[Sequence[float]] | None = None,
              start_frame: str | None = None, goal_frame: str | None = None,
              free_yaw: Sequence[str] = (), grasp_at: float | None = None,
              provenance: Mapping[str, Any] | None = None) -> Skill:
        """
        Learn from one demonstration or several, each with its own start, goal and duration.

        Stamps may be irregular and have gaps. Where a demonstration meets the cut locus of its
        goal, the motion is split automatically (`gdmp_ros.dmp.segments`).

        Where all demonstrations have task frames (`Demonstration.frames`), the motion is learned
        in each of them, and how much each frame matters along the motion: ``Rollout(skill,
        frames=…)`` then does it where the objects are (`gdmp_ros.learning.frames_fit`).

        :param n_basis: number of basis functions, at least 2; ``'auto'`` for the smallest that
            meets ``tolerance`` or, with ``fit='output'``, that cross-validation finds as good as
            any, for each factor by its own span
        :param connection: ``parallel`` or ``published``
        :param tolerance: for ``'auto'``: mean geodesic error / span of the reproduction; with
            ``fit='forcing'`` and several demonstrations, between it and that of very many basis
            functions. If it cannot be met, the best is returned with a `GdmpWarning`
        :param smoothing: cut-off [Hz] of `Demonstration.smoothed`, before the fit; None does not
            smooth. ``fit='output'`` chooses the smoothness itself and rarely needs it
        :param regularization: ridge added to the normal equations, as a fraction of their
            diagonal: 1e-3 to 1e-1 for noisy or few samples; for ``fit='forcing'`` only, ignored
            with a `GdmpWarning` otherwise
        :param split: False refuses a demonstration through the cut locus instead
        :param fit: ``output`` fits the motion, so that noise of recorded demonstrations does not
            decide how it begins; ``forcing`` fits the forcing term, as in [GDMP]
        :param end: ``rest`` at the goal, or ``moving`` as demonstrated; by default ``rest`` with
            ``fit='output'`` and ``moving`` with ``fit='forcing'``
        :param align: warp the time of several demonstrations, so that the same progress is the
            same moment of the motion (`gdmp_ros.learning.alignment`); with ``fit='output'`` only
        :param demonstration_weights: how much each demonstration counts, above 0; alike by
            default, whatever their numbers of samples; with ``fit='output'`` only
        :param contexts: numbers that describe the situation of each demonstration, such as the
            height of an object: a name and one number for each demonstration, or rows of shape
            ``(demonstrations, m)``; with ``fit='output'`` only, see `Distribution.condition`
        :param start_frame: task frame that the motion leaves; by default ``start``, else the first
        :param goal_frame: task frame in which it ends; by default ``goal``, else the last
        :param free_yaw: task frames of objects that are symmetric about their z axis: the turn
            about it that is nearest to what was shown is taken
        :param grasp_at: progress at which the tool grasps the object of the start frame: until
            then that frame alone counts. Of an object that was tracked while it was carried it is
            found
        :raises ParameterError: if a setting is out of range, or does not fit the others
        :raises DataError: without demonstrations, if their manifolds differ, if one lasts less
            than 50 ms, or if there are too few for their contexts
        :raises CutLocusError: if samples are so coarse that neighbours are opposite each other;
            with ``split=False``, if a demonstration meets the cut locus of its goal

        Source: [GDMP] eqs. (20), (21).
        """
        # Here, and below, this package uses a higher one: see docs/design.md.
        from gdmp_ros.learning.fit import FitSettings, FrameSettings, learn
        settings = FitSettings(Gains(alpha_z, alpha_x, alpha_g), connection, smoothing,
                               regularization, split, dict(provenance or {}), fit, end, align,
                               demonstration_weights, contexts)
        return learn(demonstrations, n_basis, settings, tolerance,
                     FrameSettings(start_frame, goal_frame, tuple(free_yaw), grasp_at))

    @classmethod
    def learn_rhythmic(cls, demonstrations: Demonstration | Sequence[Demonstration],
                       period: float | None = None, n_basis: int | str = 'auto',
                       alpha_z: float = 60.0, *, alpha_g: float = CYCLE_ALPHA_G,
                       tolerance: float = 1e-4, smoothing: float | None = None,
                       demonstration_weights: Sequence[float] | None = None,
                       provenance: Mapping[str, Any] | None = None) -> Skill:
        """
        Learn a motion that repeats a cycle: wiping, stirring, polishing.

        A demonstration shows two cycles or more; their durations may vary. What is not part of the
        cycles at its ends, such as the way to the first one, is left out.

        :param period: [s]; found by itself by default. With it, one cycle is enough
        :param n_basis: number of basis functions, at least 4; ``'auto'`` for the smallest that
            describes the cycle within ``tolerance``
        :param alpha_z: gain, per cycle
        :param alpha_g: how fast centre and amplitude change: ``1 - e^(-alpha_g)`` in one cycle; a
            larger gain needs more acceleration at entry and exit
        :param tolerance: for ``'auto'``: error / span that is good enough
        :param smoothing: cut-off [Hz] of `Demonstration.smoothed`; rarely needed
        :param demonstration_weights: how much each demonstration counts; alike by default
        :raises ParameterError: if a setting is out of range
        :raises DataError: if a demonstration has no period, or is shorter than one cycle
        :raises CutLocusError: if the cycle meets the cut locus of its centre: it cannot turn all
            the way round
        """
        from gdmp_ros.learning.fit import FitSettings, learn_cycle
        settings = FitSettings(Gains(alpha_z, alpha_g=alpha_g), 'parallel', smoothing,
                               provenance=dict(provenance or {}),
                               demonstration_weights=demonstration_weights)
        return learn_cycle(demonstrations, n_basis, settings, tolerance, period).primitive

    @property
    def distribution(self) -> Distribution | None:
        """
        How the demonstrated motions vary around this one: samples, tubes, conditions.

        None if there was only one demonstration, or with ``fit='forcing'``.
        """
        return None if self.variation is None else Distribution(self, self.variation)

    def in_context(self, context: Mapping[str, float] | Sequence[float]) -> Skill:
        """
        Return the skill for a context; see `Distribution.condition`.

        :param context: as given to `learn`; itself for an empty one
        :raises ParameterError: if it was learned without contexts, or with others
        """
        if not len(context):
            return self
        if self.distribution is None:
            raise ParameterError('context: the skill was learned without contexts')
        return self.distribution.condition(context=context)

    between = changes.between
    joined = staticmethod(changes.joined)
    coupled = changes.coupled
    related = changes.related
    with_frames = changes.with_frames

    def through(self, points: Sequence[tuple[float, np.ndarray]],
                factors: Sequence[str] | None = None) -> Skill:
        """
        Return a skill that also passes through via points.

        Via points of earlier calls are kept. Points that make the largest acceleration more than
        twice as large are reported with a `GdmpWarning`.

        :param points: progress s (0 to 1; s = 0.5 is half of the duration) and point of each
        :param factors: names of the factors that have to pass; all by default
        :raises ParameterError: see `gdmp_ros.dmp.via.through`
        """
        changed = through(self, points, factors)
        warn_of_cost(self, changed)
        return changed

    def with_events(self, events: Sequence[GripperEvent]) -> Skill:
        """
        Return the same motion with other commands for a gripper.

        :raises ParameterError: if a number is out of range, or they are not in order
        """
        return replace(self, events=tuple(events))

    def rollout(self, **options: Any) -> Rollout:
        """Begin a motion: `gdmp_ros.dmp.Rollout` with this skill."""
        return Rollout(self, **options)

    def reproduce(self, dt: float) -> Trajectory:
        """
        Roll out from start to goal.

        :param dt: spacing of the samples [s]; the last sample is at the duration
        :raises ParameterError: if ``dt`` is not positive
        """
        if not (isinstance(dt, (int, float, np.number))
                and self.duration / MOST_SAMPLES <= dt < math.inf):
            raise ParameterError(f'dt is {dt!r} s, expected a number from '
                                 f'{self.duration / MOST_SAMPLES:g}')
        dt = float(dt)
        count = math.floor(self.duration / dt - 1e-9) + 1
        times = np.append(dt * np.arange(count), self.duration)
        return self.rollout().sample(times)

    def save(self, path: str | Path) -> None:
        """Write a skill file (JSON, ``docs/skill_file.md``), replacing an old one whole."""
        write_primitive(self, Path(path))

    @classmethod
    def load(cls, path: str | Path) -> Skill:
        """
        Read a skill file; its roll-outs are bit-identical to the saved skill's.

        :raises DataError: if the file is missing, damaged or of an unknown version
        """
        return read_primitive(Path(path), cls)

    def text(self) -> str:
        """Return what `save` writes, for instance to send it to another machine."""
        return primitive_text(self)

    @classmethod
    def parse(cls, text: str, name: str = 'skill') -> Skill:
        """
        Make a skill of the contents of a skill file.

        :param name: of the file, for errors
        :raises DataError: as `load`
        """
        return parse_primitive(text, name, cls)
