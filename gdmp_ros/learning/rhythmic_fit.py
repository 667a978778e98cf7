"""From recordings that repeat a cycle to a rhythmic primitive."""
from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.dmp.demonstration import as_list, Demonstration
from gdmp_ros.dmp.forcing import periodic_basis, periodic_design
from gdmp_ros.dmp.options import check_range, SHORTEST_DURATION
from gdmp_ros.dmp.primitive import Gains, MIN_STEPS
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.learning.cycles import coordinates, CycleFit, FittedCycle, thinned
from gdmp_ros.learning.preparation import check_tolerance, FitSettings, prepared, warn_tolerance
from gdmp_ros.learning.regression import Series
from gdmp_ros.manifolds import Manifold
from gdmp_ros.util.parallel import one_thread

#: Numbers of basis functions that ``n_basis='auto'`` tries, and the largest number.
COUNTS, MOST = (10, 14, 20, 28, 40, 60, 85, 120, 170, 240), 1000
#: Phases at which the forcing term is computed, at least and for each basis function.
PHASES, PER_FUNCTION = 480, 4
#: An error of this part of a factor's goal tolerance is small enough.
ENOUGH = 0.02
#: Step of the differences along the cycle [cycles].
_STEP = 1e-3


class LearnedCycle(NamedTuple):
    """A rhythmic primitive and how the recordings agree with it."""

    primitive: Skill
    fitted: FittedCycle


@one_thread
def learn_cycle(demonstrations: Demonstration | Sequence[Demonstration], n_basis: int | str,
                settings: FitSettings, tolerance: float, period: float | None) -> LearnedCycle:
    """Learn a rhythmic primitive; see `gdmp_ros.dmp.Skill.learn_rhythmic`."""
    if period is not None:
        check_range('period', period, SHORTEST_DURATION, 1e6)
    automatic = isinstance(n_basis, str) and n_basis == 'auto'
    if not automatic and (not isinstance(n_basis, (int, np.integer))
                          or isinstance(n_basis, bool) or not 4 <= n_basis <= MOST):
        raise ParameterError(f"n_basis is {n_basis!r}, expected an integer from 4 to {MOST} or "
                             "'auto'")
    check_tolerance(tolerance)
    if any(item.frames for item in as_list(demonstrations)):
        raise ParameterError('task frames: a rhythmic skill has none; leave the frames of its '
                             'demonstrations away')
    demos = [thinned(item.uniform()) for item in prepared(demonstrations, settings.smoothing)]
    weights = settings.weights(len(demos))
    fitted = CycleFit(demos, weights, period).fitted()
    manifold, gains = demos[0].manifold, settings.gains
    curve = _Curve(manifold, fitted.centre, fitted.series)
    counts = COUNTS if n_basis == 'auto' else (int(n_basis),)
    phases = max(PHASES, PER_FUNCTION * counts[-1])
    progress = np.arange(phases) / phases
    forcing, velocity = curve.forcing(progress, gains)
    chosen, result, error = _smallest(counts, progress, forcing, curve.limits(progress, tolerance))
    if n_basis == 'auto' and error > 1.0:
        warn_tolerance(chosen, error * tolerance, tolerance)
    lasts = float(np.average([take.period for take in fitted.takes], weights=weights))
    primitive = Skill(
        manifold=manifold, connection=settings.connection, gains=gains, start=curve.start,
        goal=curve.centre, frame=manifold.frame(curve.start), duration=lasts,
        velocity=manifold.to_frame(manifold.frame(curve.start), velocity), weights=result,
        steps=max(MIN_STEPS, math.ceil(lasts / 1e-3 - 1e-6)), provenance=settings.provenance,
        rhythmic=True)
    return LearnedCycle(primitive, fitted)


def _smallest(counts: Sequence[int], progress: np.ndarray, forcing: np.ndarray,
              limits: np.ndarray) -> tuple[int, np.ndarray, float]:
    """
    The fewest basis functions whose forcing term is near enough, otherwise the best.

    :param limits: of the error of each coordinate
    :returns: their number, the weights, and the largest error / limit
    """
    best: tuple[int, np.ndarray, float] | None = None
    for count in counts:
        matrix = np.empty((len(progress), count))
        periodic_design(periodic_basis(count), progress, matrix)
        weights = np.linalg.lstsq(matrix, forcing, rcond=None)[0]
        error = float((np.abs(matrix @ weights - forcing) / limits).max())
        if best is None or error < best[2]:
            best = count, weights, error
        if error <= 1.0:
            break
    if best is None:
        raise ParameterError('no number of basis functions was given')
    return best


class _Curve:
    """A closed curve around its mean, with its derivatives."""

    def __init__(self, manifold: Manifold, centre: np.ndarray, series: Series):
        self._manifold = manifold
        # The mean of the logarithms is zero at the Fréchet mean only: move there exactly.
        count = 2 * series.harmonics + 2
        points = _points(manifold, manifold.frame(centre), series.at(np.arange(count) / count))
        self.centre = manifold.mean(points.reshape(count, *manifold.point_shape))
        self.centre = manifold.align(self.centre, centre)
        fine = 4 * count
        points = _points(manifold, manifold.frame(centre), series.at(np.arange(fine) / fine))
        offset, _ = coordinates(manifold, self.centre, points)
        self._series = _interpolated(offset)
        self._frame = manifold.frame(self.centre)
        self.start = _points(manifold, self._frame, self._series.at(np.zeros(1))).reshape(
            manifold.point_shape)

    def limits(self, progress: np.ndarray, tolerance: float) -> np.ndarray:
        """
        How exact each coordinate has to be: by the span of its factor.

        A factor that hardly moves need not be more exact than a part of its goal's tolerance.
        """
        manifold = self._manifold
        points = _points(manifold, self._frame, self._series.at(progress))
        spans = manifold.factor_distances(np.repeat(manifold.flat(self.start)[None], len(points),
                                                    axis=0), points).max(axis=0)
        least = [ENOUGH * factor.goal_tolerance for factor in manifold.factors]
        return np.repeat(np.maximum(tolerance * spans, least),
                         [factor.tangent_size for factor in manifold.factors])

    def forcing(self, progress: np.ndarray, gains: Gains) -> tuple[np.ndarray, np.ndarray]:
        """
        Solve the dynamical system for the forcing term.

        Everything is seen in the frame that is carried from the centre to the curve: the way to
        the centre is -c there, and differences of logarithms are covariant derivatives.

        :returns: the forcing term in the frame of the centre, and the velocity by progress at the
            start, a tangent there
        """
        manifold, offset = self._manifold, self._series.at(progress)
        frames = manifold.transport_frame(self._frame, offset)
        near = {}
        for step in (-2, -1, 1, 2):
            points = _points(manifold, self._frame, self._series.at(progress + step * _STEP))
            near[step], _ = manifold.log_in_frame(frames, manifold.unflat(points))
        velocity = (8.0 * (near[1] - near[-1]) - (near[2] - near[-2])) / (12.0 * _STEP)
        acceleration = (16.0 * (near[1] + near[-1]) - (near[2] + near[-2])) / (12.0 * _STEP ** 2)
        pull = gains.alpha_z * gains.beta_z
        forcing = offset + (acceleration + gains.alpha_z * velocity) / pull
        return forcing, manifold.from_frame(frames[0], velocity[0])


def _points(manifold: Manifold, frame: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Flat points at coordinates, shape ``(count, point_size)``."""
    return manifold.flat(manifold.frame_point(manifold.transport_frame(frame, offset)))


def _interpolated(values: np.ndarray) -> Series:
    """Fourier series through equally spaced values of one cycle."""
    spectrum = np.fft.rfft(values, axis=0) / len(values)
    harmonics = len(spectrum) - 2  # without the highest, which has no sine
    coefficients = np.empty((1 + 2 * harmonics, values.shape[1]))
    coefficients[0] = spectrum[0].real
    coefficients[1::2] = 2.0 * spectrum[1:harmonics + 1].real
    coefficients[2::2] = -2.0 * spectrum[1:harmonics + 1].imag
    return Series(coefficients)
