"""Cycles of a recording: its period, where each cycle begins, and the fit of one cycle to all."""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.fft import fft, ifft, irfft, next_fast_len, rfft
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import CutLocusError, DataError
from gdmp_ros.learning.regression import fourier_columns, FourierRegression, Series
from gdmp_ros.manifolds import Manifold
from gdmp_ros.manifolds.factors import CUT_LOCUS_LIMIT

#: A recording has a period if it correlates with itself one period later by more than this …
CORRELATED = 0.4
#: … and the shortest period is taken that correlates by this part of the best one.
AS_GOOD = 0.9
#: Periods whose cycles are compared: from this part of the best correlation on, and from this
#: correlation; and how many.
CANDIDATE, LEAST_CORRELATED, MOST = 0.4, 0.15, 12
#: A period is refused if its cycles differ by more than this part of their mean square.
LARGEST_UNLIKENESS = 0.7
#: Parts of the recording that are left out at both ends, one after the other.
LEFT_OUT = (0.0, 0.125, 0.25)
#: Longest period, as a part of the recording: two cycles, of which the second may last longer.
LONGEST_LAG = 0.6
#: Shortest period [s], and fewest samples in it.
SHORTEST, FEWEST_SAMPLES = 0.1, 8
#: A cycle may last this part shorter or longer than the one before it.
UNEVEN = 0.2
#: Followed by its phase, a cycle may be this much shorter or longer than the mean, and this much
#: smaller or larger than the median.
PHASE_RANGE, SIZE_RANGE = (0.4, 2.0), (0.3, 3.0)
#: The phase is believed if it finds this many times as many samples that belong to cycles.
MORE = 1.25
#: Fewest cycles of a recording whose period is not given.
FEWEST_CYCLES = 1.8
#: How stiff the path of the centre is, relative to the samples of a cycle.
STIFF_CENTRE = 1.0
#: A cycle is one of the others if its mean squared distance from them is less than this many
#: times the median, or than this part of the mean square of the motion. What has nothing to do
#: with the cycle, such as rest, is further away than the mean square.
DIFFERENT_CYCLE, ALIKE_CYCLE, UNRELATED_CYCLE = 9.0, 0.02, 0.5
#: Most harmonics, and fewest samples of a cycle for each of them.
MOST_HARMONICS, SAMPLES_PER_HARMONIC = 60, 3
#: Turns of the fit: series and phases, one after the other; before and after what differs from the
#: cycles is left out.
TURNS = 4
#: Samples differ if their squared distances are this many times the median, and more than this
#: part of the mean square of the cycle, on average over this part of a cycle.
DIFFERENT, ALIKE, WINDOW = 9.0, 0.005, 0.1
#: Most samples of a recording that are used: an hour at 28 Hz.
MOST_SAMPLES = 100_000
#: Points from which a centre is guessed.
_FEW = 200
#: Phases at which cycles of different recordings are compared.
_PHASES = 256
#: Phases at which whole cycles of one recording are compared.
_FEW_PHASES = 48
#: Part of the span below which a factor counts as exact.
_EXACT = 1e-7


class Cycles(NamedTuple):
    """
    The cycles of one recording.

    :ivar marks: sample, as a real number, at which each cycle begins and the last one ends; the
        first and the last cycle may extend beyond the recording
    :ivar first: first sample that belongs to a cycle
    :ivar last: last one
    """

    marks: np.ndarray
    first: int
    last: int

    @property
    def period(self) -> float:
        """Mean length of a whole cycle, in samples."""
        inside = self.marks[(self.marks >= self.first - 0.5) & (self.marks <= self.last + 0.5)]
        full = inside if len(inside) > 1 else self.marks
        return float((full[-1] - full[0]) / (len(full) - 1))

    def progress(self, samples: np.ndarray) -> np.ndarray:
        """Cycles passed at each sample."""
        return np.asarray(np.interp(samples, self.marks, np.arange(len(self.marks))))


def find_period(curve: np.ndarray, dt: float) -> float:
    """
    Period of a curve, in samples: a maximum of its autocorrelation.

    The middle of the recording is looked at too: long ways to the first cycle and from the last
    one would hide the cycles. Cycles of a hand differ, and may be more alike two or three periods
    later. Of all maxima the shortest period is taken whose cycles are as alike as those of any.

    :param curve: shape ``(T, n)``, each coordinate of similar importance
    :param dt: spacing of the samples [s]
    :raises DataError: if it has none, or the recording is shorter than two of them
    """
    count = len(curve)
    peaks = [_repetitions(curve[round(left * count):count - round(left * count)], dt)
             for left in LEFT_OUT]
    best = max((correlation for found in peaks for correlation, _ in found), default=-1.0)
    periods = sorted({period for found in peaks for correlation, period in found
                      if correlation >= max(CANDIDATE * best, LEAST_CORRELATED)})
    unlike = {period: _unlikeness(curve, find_cycles(curve, period)) for period in periods[:MOST]}
    least = min(unlike.values(), default=math.inf)
    if least <= LARGEST_UNLIKENESS:
        limit = max(2.0 * least, ALIKE_CYCLE)
        return next(period for period in periods if unlike[period] <= limit)
    if least == math.inf and best >= CORRELATED:
        result = [_first(found) for found in peaks if found]
        full, first = result[0]
        return first if full >= AS_GOOD * best else max(result)[1]
    why = (f', expected {CORRELATED:g}' if best < CORRELATED else
           f', but what would be its cycles differ by {least:.0%} of their mean square')
    raise DataError(f'no period was found in {count * dt:.3g} s: record at least two cycles, or '
                    'tell the period. Shifted in time the recording correlates with itself by '
                    f'{max(best, 0.0):.2f} at most{why}')


def _unlikeness(curve: np.ndarray, cycles: Cycles) -> float:
    """
    Mean square of what whole cycles differ by, as a part of that of the motion in them.

    Seen from the line from the beginning to the end of each. Infinite with less than two.
    """
    marks = cycles.marks[(cycles.marks >= 0.0) & (cycles.marks <= len(curve) - 1.0)]
    if len(marks) < 3:
        return math.inf
    phase, samples = np.linspace(0.0, 1.0, _FEW_PHASES), np.arange(len(curve))
    whole = []
    for first, last in zip(marks[:-1], marks[1:]):
        one = np.column_stack([np.interp(first + phase * (last - first), samples, column)
                               for column in curve.T])
        one -= one[0] + phase[:, None] * (one[-1] - one[0])
        whole.append(one - one.mean(axis=0))
    mean, count = np.mean(whole, axis=0), len(whole)
    differs = float(np.mean((np.array(whole) - mean) ** 2)) * count / (count - 1.0)
    return differs / max(float(np.mean(mean ** 2)), 1e-300)


def _first(found: list[tuple[float, float]]) -> tuple[float, float]:
    """The shortest period that correlates nearly as well as the best."""
    best = max(found)[0]
    return next(one for one in found if one[0] >= AS_GOOD * best)


def _repetitions(curve: np.ndarray, dt: float) -> list[tuple[float, float]]:
    """How much a curve correlates with itself after each possible period, in samples."""
    correlation = _autocorrelation(curve)
    # The maximum at 0 ends where the correlation has become small.
    small = np.flatnonzero(correlation < 0.5)
    least = max(SHORTEST / dt, FEWEST_SAMPLES, float(small[0]) if len(small) else np.inf)
    from scipy.signal import find_peaks  # slow to import
    peaks = find_peaks(correlation)[0]
    peaks = peaks[peaks >= least]
    result = []
    for at in peaks.tolist():
        before, there, after = correlation[at - 1:at + 2]
        result.append((float(there),
                       float(at + 0.5 * (before - after) / (before - 2.0 * there + after))))
    return result


def _autocorrelation(curve: np.ndarray) -> np.ndarray:
    """Correlation of a curve with itself, by lag, up to `LONGEST_LAG` of its length."""
    from scipy.signal import detrend  # slow to import
    count = len(curve)
    # A centre that walks is no part of the cycle.
    centred = detrend(curve, axis=0)
    size = next_fast_len(2 * count, real=True)
    power = (np.abs(rfft(centred, size, axis=0)) ** 2).sum(axis=1)
    products = irfft(power, size)[:round(LONGEST_LAG * count) + 1]
    squares = np.concatenate([[0.0], (centred ** 2).sum(axis=1).cumsum()])
    lags = np.arange(len(products))
    # Of the two parts that overlap.
    first, last = squares[count - lags], squares[count] - squares[lags]
    return np.asarray(products / np.maximum(np.sqrt(first * last), 1e-300))


def find_cycles(curve: np.ndarray, period: float) -> Cycles:
    """
    Follow the cycles of a curve from its middle to both ends.

    Each cycle is placed where it is nearest to the one in the middle, so it may last longer or
    shorter than the one before; or, if this finds far more of them, by the phase of the
    fundamental. What differs from the cycles, such as the way to the first one, is left out.

    :param curve: shape ``(T, n)``
    :param period: in samples
    """
    nearest, followed = _by_template(curve, period), _by_phase(curve, period)
    if followed is not None and (followed.last - followed.first
                                 > MORE * (nearest.last - nearest.first)):
        return followed
    return nearest


def _by_phase(curve: np.ndarray, period: float) -> Cycles | None:
    """
    Cycles where the phase of the fundamental passes whole turns.

    For cycles that differ much in length and size from each other: the phase of what oscillates
    with about this period tells where each begins. None if there is no such part.
    """
    from scipy.signal import detrend  # slow to import
    count = len(curve)
    padded = next_fast_len(count + 2 * round(period))
    spectrum = fft(detrend(curve, axis=0), padded, axis=0)
    frequency = np.abs(np.fft.fftfreq(padded)) * period
    # What oscillates with 0.4 to 1.6 times the frequency; positive ones only give the phase.
    window = np.clip(np.minimum(frequency - 0.3, 1.75 - frequency) / 0.15, 0.0, 1.0)
    window[padded // 2:] = 0.0
    signals = ifft(2.0 * window[:, None] * spectrum, axis=0)[:count]
    # The direction, with a delay for each coordinate, in which it oscillates most.
    signal = signals @ np.linalg.svd(signals, full_matrices=False)[2][0].conj()
    size = np.abs(signal)
    if not size.max() > 0.0:
        return None
    phase = np.unwrap(np.angle(signal)) / (2.0 * np.pi)
    phase = phase if phase[-1] > phase[0] else -phase
    speed = np.gradient(gaussian_filter1d(phase, 0.1 * period, mode='nearest')) * period
    usual = float(np.median(size))
    good = ((speed > 1.0 / PHASE_RANGE[1]) & (speed < 1.0 / PHASE_RANGE[0])
            & (size > SIZE_RANGE[0] * usual) & (size < SIZE_RANGE[1] * usual))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    runs = edges.reshape(-1, 2)
    if not len(runs):
        return None
    first, last = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    inside = np.maximum.accumulate(phase[first:last])
    turns = np.arange(np.ceil(inside[0]), np.floor(inside[-1]) + 1.0)
    if len(turns) < 2:
        return None
    marks = first + np.interp(turns, inside, np.arange(last - first))
    if not (np.diff(marks) > 0.0).all():
        return None
    if marks[0] > first:
        marks = np.concatenate([[2.0 * marks[0] - marks[1]], marks])
    if marks[-1] < last - 1:
        marks = np.append(marks, 2.0 * marks[-1] - marks[-2])
    return Cycles(marks, max(int(np.ceil(marks[0])), int(first)),
                  min(int(np.floor(marks[-1])), int(last) - 1))


def _by_template(curve: np.ndarray, period: float) -> Cycles:
    """Cycles where they are nearest to the one in the middle."""
    count, length = len(curve), round(period)
    middle = _template(curve, length)
    template = curve[middle:middle + length]
    scatter = float(((template - template.mean(axis=0)) ** 2).sum(axis=1).mean())
    marks, errors = [float(middle)], [0.0]
    if count >= middle + length:
        for forward in (False, True):
            more, apart = _follow(curve, template, float(middle), period, forward)
            marks = [*marks, *more] if forward else [*more[::-1], *marks]
            errors = [*errors, *apart] if forward else [*apart[::-1], *errors]
    limit = min(max(DIFFERENT_CYCLE * float(np.median(errors)), ALIKE_CYCLE * scatter),
                UNRELATED_CYCLE * scatter)
    centre = marks.index(float(middle))
    first = last = centre
    while first > 0 and errors[first - 1] <= limit:
        first -= 1
    while last + 1 < len(marks) and errors[last + 1] <= limit:
        last += 1
    kept = marks[first:last + 1]
    full = np.array([*kept, kept[-1] + (kept[-1] - kept[-2] if len(kept) > 1 else period)])
    # Too little is left there to place a cycle by it.
    if first == 0 and full[0] > 0.0:
        full = np.array([2.0 * full[0] - full[1], *full])
    if last + 1 == len(marks) and full[-1] < count - 1:
        full = np.array([*full, 2.0 * full[-1] - full[-2]])
    begin, end = max(int(np.ceil(full[0])), 0), min(int(np.floor(full[-1])), count - 1)
    return Cycles(full, begin, end)


def _template(curve: np.ndarray, length: int) -> int:
    """First sample of the part nearest to the middle that moves as much as others, not in rest."""
    count, centred = len(curve), curve - curve.mean(axis=0)
    if count <= length:
        return 0
    sums, squares = (np.concatenate([np.zeros((1, curve.shape[1])), np.cumsum(item, axis=0)])
                     for item in (centred, centred ** 2))
    mean, square = ((item[length:] - item[:-length]) / length for item in (sums, squares))
    scatter = (square - mean ** 2).sum(axis=1)
    enough = np.flatnonzero(scatter >= 0.9 * np.median(scatter[scatter >= 0.01 * scatter.max()]))
    return int(enough[np.argmin(np.abs(enough - (count - length) // 2))])


def _follow(curve: np.ndarray, template: np.ndarray, start: float, period: float, forward: bool
            ) -> tuple[list[float], list[float]]:
    """Beginnings of the cycles on one side, and their mean squared distances."""
    count, length = len(curve), len(template)
    sign = 1.0 if forward else -1.0
    marks: list[float] = []
    errors: list[float] = []
    at, step = start, period
    fewest = max(0.25 * length, 4.0)
    while True:
        expected = at + sign * step
        # Where the cycle may begin, if enough of it is in the recording.
        shifts = np.arange(round(expected - UNEVEN * period),
                           round(expected + UNEVEN * period) + 1)
        overlap = np.minimum(shifts + length, count) - np.maximum(shifts, 0)
        if overlap.min() < fewest:
            return marks, errors
        apart = np.array([_distance(curve, template, int(shift)) for shift in shifts])
        # Where nothing moves all are alike: the expected one is taken then.
        alike = np.flatnonzero(apart <= apart.min() * (1.0 + 1e-9))
        best = int(alike[np.argmin(np.abs(shifts[alike] - expected))])
        place = float(shifts[best])
        if sign * (place - at) < 0.5 * period:
            return marks, errors
        if 0 < best < len(shifts) - 1:
            before, there, after = apart[best - 1:best + 2]
            bend = before - 2.0 * there + after
            place += 0.5 * (before - after) / bend if bend > 0.0 else 0.0
        marks.append(place)
        errors.append(float(apart[best]))
        step = min(max(0.5 * step + 0.5 * abs(place - at), 0.5 * period), 1.5 * period)
        at = place


def _distance(curve: np.ndarray, template: np.ndarray, shift: int) -> float:
    """Mean squared distance of a curve from a template that begins at a sample."""
    first, last = max(shift, 0), min(shift + len(template), len(curve))
    offset = curve[first:last] - template[first - shift:last - shift]
    return float(np.mean((offset ** 2).sum(axis=1)))


class FittedTake(NamedTuple):
    """
    One recording and the cycle.

    :ivar cycles: how many it has
    :ivar period: of a cycle, mean [s]
    :ivar samples: first and last one, of those with equal spacing, that belong to cycles
    :ivar progress: cycles passed at each of these
    :ivar closing: by factor, how far from its beginning a cycle ends (RMS): where the centre walks
    """

    cycles: float
    period: float
    samples: tuple[int, int]
    progress: np.ndarray
    closing: np.ndarray


class FittedCycle(NamedTuple):
    """
    A cycle and the recordings of it.

    :ivar centre: point
    :ivar series: in the canonical frame of the centre
    """

    centre: np.ndarray
    series: Series
    takes: list[FittedTake]


class CycleFit:
    """Recordings and what is known of their cycle so far."""

    def __init__(self, demos: list[Demonstration], weights: np.ndarray, period: float | None):
        """
        Find the cycles.

        :param demos: uniform, with consistent signs
        :param weights: of the recordings
        :param period: [s]; None to find it
        :raises DataError: if a recording has no period, or is shorter than one
        """
        self._manifold, self._shown, self._weights = demos[0].manifold, demos, weights
        self._dt = [demo.duration / (len(demo.times) - 1) for demo in demos]
        self._centre = self._guessed_centre()
        self._coordinates = [self._seen(demo) for demo in demos]
        spread = np.sqrt(np.mean([self._by_factor(curve - curve.mean(axis=0)).mean(axis=0)
                                  for curve in self._coordinates], axis=0))
        self._span = np.where(spread > 1e-12, spread, np.inf)
        self._cycles = [self._found(number, period) for number in range(len(demos))]
        # Where the centre of each cycle is, relative to the common one, at the marks.
        self._drift = [np.zeros((len(own.marks), curve.shape[1]))
                       for own, curve in zip(self._cycles, self._coordinates)]
        self._period = period
        # The phase begins with the first sample that is used.
        self._offsets = [-float(own.progress(np.array([own.first]))[0]) for own in self._cycles]
        self._scale = 1.0 / self._span ** 2

    def fitted(self) -> FittedCycle:
        """
        Fit series and phases.

        :raises CutLocusError: if the cycle meets the cut locus of its centre
        """
        series = self._series([0])
        for number in range(1, len(self._shown)):
            self._offsets[number] += self._shift(series, self._series([number]))
        if len(self._shown) > 1:
            series = self._series(range(len(self._shown)))
        for turn in range(2 * TURNS):
            self._weigh(series)
            for number in range(len(self._shown)):
                if turn == TURNS:
                    self._leave_out(number, series)
                self._correct_phase(number, series)
                self._correct_drift(number, series)
            self._recentre(series)
            series = self._series(range(len(self._shown)))
        self._check_count()
        return FittedCycle(self._centre, series, [self._take(number)
                                                  for number in range(len(self._shown))])

    def _guessed_centre(self) -> np.ndarray:
        points = np.concatenate([demo.points[::max(len(demo.points) // _FEW, 1)]
                                 for demo in self._shown])
        try:
            return self._manifold.mean(list(points))
        except CutLocusError as error:
            raise CutLocusError(f'the cycle has no centre: {error}. A rhythmic skill needs points '
                                'near their mean, so it cannot turn all the way round',
                                error.distance) from None

    def _seen(self, demo: Demonstration) -> np.ndarray:
        """Coordinates of the samples, seen from the centre."""
        offset, distances = coordinates(self._manifold, self._centre, demo.flat_points)
        at = int(np.argmin(distances))
        if distances[at] < CUT_LOCUS_LIMIT:
            raise CutLocusError(f'{self._manifold!r}: sample {at} is on the cut locus of the '
                                'centre of the cycle; a rhythmic skill cannot turn all the way '
                                'round', float(distances[at]))
        return offset

    def _by_factor(self, offset: np.ndarray) -> np.ndarray:
        """Squared norm in each factor, shape ``(count, factors)``."""
        return np.column_stack([(offset[:, part] ** 2).sum(axis=1)
                                for part in self._manifold.tangent_slices])

    def _spread(self, of_factors: np.ndarray) -> np.ndarray:
        """A number of each factor, for each of its coordinates."""
        sizes = [part.stop - part.start for part in self._manifold.tangent_slices]
        return np.repeat(of_factors, sizes)

    def _found(self, number: int, period: float | None) -> Cycles:
        curve = self._coordinates[number] / self._spread(self._span)
        dt = self._dt[number]
        if not np.isfinite(self._span).any():
            raise DataError(f'demonstration {number} does not move: no period was found')
        samples = find_period(curve, dt) if period is None else period / dt
        if samples < FEWEST_SAMPLES:
            raise DataError(f'demonstration {number} has {samples:.3g} samples in a period of '
                            f'{samples * dt:.3g} s, expected at least {FEWEST_SAMPLES}')
        if len(curve) < samples:
            raise DataError(f'demonstration {number} lasts {self._shown[number].duration:.4g} s, '
                            f'expected at least one period of {samples * dt:.4g} s')
        return find_cycles(curve, samples)

    def _passed(self, number: int) -> np.ndarray:
        """Cycles of a recording passed at each sample that is used."""
        own = self._cycles[number]
        return own.progress(np.arange(own.first, own.last + 1))

    def _progress(self, number: int) -> np.ndarray:
        """The same, on the phase that all recordings have in common."""
        return self._passed(number) + self._offsets[number]

    def _used(self, number: int) -> np.ndarray:
        """Coordinates of the samples that are used, seen from the centre of their cycle."""
        own, passed = self._cycles[number], self._passed(number)
        at = np.arange(len(own.marks))
        drift = np.column_stack([np.interp(passed, at, column)
                                 for column in self._drift[number].T])
        return np.asarray(self._coordinates[number][own.first:own.last + 1] - drift)

    def _series(self, numbers: range | list[int]) -> Series:
        """Fit the series to recordings."""
        progress = [self._progress(number) for number in numbers]
        period = min(self._cycles[number].period for number in numbers)
        harmonics = int(min(MOST_HARMONICS, max(period // SAMPLES_PER_HARMONIC, 1)))
        matrix = np.vstack([fourier_columns(item, harmonics) for item in progress])
        share = np.concatenate([np.full(len(item), self._weights[number] / len(item))
                                for number, item in zip(numbers, progress)])
        root = np.sqrt(share * len(share) / share.sum())[:, None]
        target = root * np.vstack([self._used(number) for number in numbers])
        smooth = FourierRegression(root * matrix, harmonics)
        result = np.empty((1 + 2 * harmonics, self._manifold.tangent_size))
        for part in self._manifold.tangent_slices:
            result[:, part] = smooth.fitted(target[:, part])
        return Series(result)

    def _shift(self, first: Series, other: Series) -> float:
        """By how much the phase of a cycle is to be shifted to agree with another one."""
        progress = np.arange(_PHASES) / _PHASES
        scale = 1.0 / self._spread(self._span)
        spectra = [np.fft.rfft(item.at(progress) * scale, axis=0) for item in (first, other)]
        likeness = np.fft.irfft((spectra[1] * spectra[0].conj()).sum(axis=1), _PHASES)
        return -float(np.argmax(likeness)) / _PHASES

    def _weigh(self, series: Series) -> None:
        """Weigh the factors by how exactly they follow the cycle."""
        squares = np.vstack([self._by_factor(self._used(number) - series.at(
            self._progress(number))) for number in range(len(self._shown))])
        self._scale = 1.0 / (squares.mean(axis=0) + (_EXACT * self._span) ** 2)

    def _correct_phase(self, number: int, series: Series) -> None:
        """One Gauss-Newton step for the beginnings of the cycles of a recording."""
        own, passed = self._cycles[number], self._passed(number)
        progress = passed + self._offsets[number]
        scale = self._spread(self._scale)
        slope, offset = series.slope(progress), self._used(number) - series.at(progress)
        gain, error = (slope ** 2) @ scale, (slope * offset) @ scale
        cycle = np.minimum(passed.astype(np.int64), len(own.marks) - 2)
        after = passed - cycle
        change = _beginnings(len(own.marks), cycle, after, gain, error)
        if number == 0:
            change -= np.interp(own.first, own.marks, change)
        marks = own.marks - np.clip(change, -0.25, 0.25) * own.period
        if (np.diff(marks) > 0.0).all():
            self._cycles[number] = own._replace(
                marks=marks, first=max(own.first, int(np.ceil(marks[0]))),
                last=min(own.last, int(np.floor(marks[-1]))))

    def _correct_drift(self, number: int, series: Series) -> None:
        """
        Let the centre walk: linear from the beginning of a cycle to the next.

        A cycle that does not close ends where the next one begins: that is such a walk, too.
        """
        own, passed = self._cycles[number], self._passed(number)
        left = self._used(number) - series.at(passed + self._offsets[number])
        cycle = np.minimum(passed.astype(np.int64), len(own.marks) - 2)
        ones = np.ones(len(passed))
        step = np.column_stack([_beginnings(len(own.marks), cycle, passed - cycle, ones, column,
                                            STIFF_CENTRE) for column in left.T])
        drift = self._drift[number] + step
        at = np.arange(len(own.marks))
        mean = np.array([np.interp(passed, at, column).mean() for column in drift.T])
        self._drift[number] = drift - mean

    def _check_count(self) -> None:
        """:raises DataError: if the period was to be found, and less than two cycles were"""
        takes = [self._take(number) for number in range(len(self._shown))]
        most = max(takes, key=lambda take: take.cycles)
        if self._period is None and most.cycles < FEWEST_CYCLES:
            first, last = most.samples
            number = takes.index(most)
            dt = self._dt[number]
            raise DataError(
                f'no rhythm was found: demonstration {number} has {most.cycles:.1f} cycles of '
                f'{most.period:.3g} s, from {first * dt:.2f} to {last * dt:.2f} s of '
                f'{self._shown[number].duration:.2f} s; a cycle ends '
                f'{", ".join(f"{value:.3g}" for value in most.closing)} from where it began. '
                'Record at least two cycles, or tell the period')

    def _leave_out(self, number: int, series: Series) -> None:
        """Leave out what differs from the cycle at both ends."""
        own, scale = self._cycles[number], self._spread(1.0 / self._span ** 2)
        progress = self._progress(number)
        shape = series.at(progress)
        apart = (self._used(number) - shape) ** 2 @ scale
        width = max(round(WINDOW * own.period), 1)
        apart = np.convolve(np.pad(apart, width, 'edge'), np.full(width, 1.0 / width), 'same')[
            width:-width]
        size = float(((shape - shape.mean(axis=0)) ** 2 @ scale).mean())
        differs = apart > max(DIFFERENT * float(np.median(apart)), ALIKE * size)
        quarter = len(apart) // 4
        before, after = np.flatnonzero(differs[:quarter]), np.flatnonzero(differs[-quarter:])
        first = own.first + (int(before[-1]) + 1 if len(before) else 0)
        last = own.last - (quarter - int(after[0]) if len(after) else 0)
        if last - first >= min(own.period, 0.999 * (own.last - own.first)):
            self._cycles[number] = own._replace(first=first, last=last)

    def _recentre(self, series: Series) -> None:
        """Move the centre to the mean of the cycle."""
        manifold = self._manifold
        step = manifold.from_frame(manifold.frame(self._centre), series.coefficients[0])
        self._centre = manifold.exp(self._centre, step)
        self._coordinates = [self._seen(demo) for demo in self._shown]

    def _take(self, number: int) -> FittedTake:
        own = self._cycles[number]
        return FittedTake((own.last - own.first) / own.period, own.period * self._dt[number],
                          (own.first, own.last), self._progress(number), np.sqrt(
                              self._by_factor(np.diff(self._drift[number], axis=0)).mean(axis=0)))


def thinned(demo: Demonstration) -> Demonstration:
    """A demonstration with at most `MOST_SAMPLES`."""
    every = -(-len(demo.times) // MOST_SAMPLES)
    return demo if every == 1 else Demonstration(demo.times[::every], demo.points[::every],
                                                 demo.manifold)


def _beginnings(count: int, cycle: np.ndarray, after: np.ndarray, gain: np.ndarray,
                error: np.ndarray, stiffness: float = 1e-4) -> np.ndarray:
    """
    By how much the phase changes at the beginnings of cycles: linear between them.

    :param cycle: number of the beginning before each sample
    :param after: part of the cycle that has passed since
    :param gain: weight of each sample
    :param error: gain times the change that it asks for
    :param stiffness: against bends from cycle to cycle, relative to the gain of a cycle
    """
    def sums(at: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.bincount(at, values, count)
    before = 1.0 - after
    bands = np.zeros((3, count))  # the upper diagonals, as scipy wants them
    bands[2] = sums(cycle, gain * before ** 2) + sums(cycle + 1, gain * after ** 2)
    bands[1, 1:] = sums(cycle, gain * before * after)[:-1]
    # Beginnings beyond the recording are hardly seen: they follow their neighbours.
    stiff = stiffness * gain.sum() / count
    bend = (1.0, -2.0, 1.0)
    for i in range(3):
        for j in range(i, 3):
            bands[2 - (j - i), j:max(count - 2, 0) + j] += stiff * bend[i] * bend[j]
    bands[2] += 1e-9 * (gain.sum() / count + 1e-300)
    right = sums(cycle, error * before) + sums(cycle + 1, error * after)
    return np.asarray(solveh_banded(bands, right))


def coordinates(manifold: Manifold, centre: np.ndarray, points: np.ndarray
                ) -> tuple[np.ndarray, np.ndarray]:
    """
    Logarithms in the canonical frame of a centre, and distances from its cut locus.

    :param points: flat, shape ``(count, point_size)``
    """
    return manifold.log_in_frame(manifold.frame(centre), manifold.unflat(points))
