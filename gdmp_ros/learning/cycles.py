"""Cycles of a recording: its period, and where each cycle begins."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from gdmp_ros.errors import DataError

#: A recording has a period if it correlates with itself one period later by more than this …
CORRELATED = 0.4
#: … and the shortest period is taken that correlates by this part of the best one.
AS_GOOD = 0.9
#: Parts of the recording that are left out at both ends, one after the other.
LEFT_OUT = (0.0, 0.125, 0.25)
#: Shortest period [s], and fewest samples in it.
SHORTEST, FEWEST_SAMPLES = 0.1, 8
#: A cycle may last this part shorter or longer than the one before it.
UNEVEN = 0.2
#: A cycle is one of the others if its mean squared distance from them is less than this many
#: times the median, or than this part of the mean square of the motion. What has nothing to do
#: with the cycle, such as rest, is further away than the mean square.
DIFFERENT, ALIKE, UNRELATED = 9.0, 0.02, 0.5


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
        whole = inside if len(inside) > 1 else self.marks
        return float((whole[-1] - whole[0]) / (len(whole) - 1))

    def progress(self, samples: np.ndarray) -> np.ndarray:
        """Cycles passed at each sample."""
        return np.asarray(np.interp(samples, self.marks, np.arange(len(self.marks))))


def find_period(curve: np.ndarray, dt: float) -> float:
    """
    Period of a curve, in samples: the first large maximum of its autocorrelation.

    The middle of the recording is looked at too: long ways to the first cycle and from the last
    one would hide the cycles.

    :param curve: shape ``(T, n)``, each coordinate of similar importance
    :param dt: spacing of the samples [s]
    :raises DataError: if it has none, or the recording is shorter than two of them
    """
    count = len(curve)
    found = [_repetition(curve[round(left * count):count - round(left * count)], dt)
             for left in LEFT_OUT]
    best, period = max(found)
    if best < CORRELATED:
        raise DataError(f'no period was found in {count * dt:.3g} s: record at least two cycles, '
                        'or tell the period. Shifted in time the recording correlates with itself '
                        f'by {max(best, 0.0):.2f} at most, expected {CORRELATED:g}')
    whole, first = found[0]
    return first if whole >= AS_GOOD * best else period


def _repetition(curve: np.ndarray, dt: float) -> tuple[float, float]:
    """How much a curve correlates with itself one period later, and the period in samples."""
    correlation = _autocorrelation(curve)
    # The maximum at 0 ends where the correlation has become small.
    small = np.flatnonzero(correlation < 0.5)
    least = max(SHORTEST / dt, FEWEST_SAMPLES, float(small[0]) if len(small) else np.inf)
    from scipy.signal import find_peaks  # slow to import
    peaks = find_peaks(correlation)[0]
    peaks = peaks[peaks >= least]
    if not len(peaks):
        return -1.0, 0.0
    best = float(correlation[peaks].max())
    at = int(peaks[correlation[peaks] >= AS_GOOD * best][0])
    before, there, after = correlation[at - 1:at + 2]
    return best, float(at + 0.5 * (before - after) / (before - 2.0 * there + after))


def _autocorrelation(curve: np.ndarray) -> np.ndarray:
    """Correlation of a curve with itself, by lag, up to half of its length."""
    centred = curve - curve.mean(axis=0)
    count = len(centred)
    size = next_fast_len(2 * count, real=True)
    power = (np.abs(rfft(centred, size, axis=0)) ** 2).sum(axis=1)
    products = irfft(power, size)[:count // 2 + 1]
    squares = np.concatenate([[0.0], (centred ** 2).sum(axis=1).cumsum()])
    lags = np.arange(len(products))
    # Of the two parts that overlap.
    first, last = squares[count - lags], squares[count] - squares[lags]
    return np.asarray(products / np.maximum(np.sqrt(first * last), 1e-300))


def find_cycles(curve: np.ndarray, period: float) -> Cycles:
    """
    Follow the cycles of a curve from its middle to both ends.

    Each cycle is placed where it is nearest to the one in the middle, so it may last longer or
    shorter than the one before. What differs from the cycles, such as the way to the first one, is
    left out.

    :param curve: shape ``(T, n)``
    :param period: in samples
    """
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
    limit = min(max(DIFFERENT * float(np.median(errors)), ALIKE * scatter), UNRELATED * scatter)
    centre = marks.index(float(middle))
    first = last = centre
    while first > 0 and errors[first - 1] <= limit:
        first -= 1
    while last + 1 < len(marks) and errors[last + 1] <= limit:
        last += 1
    kept = marks[first:last + 1]
    whole = np.array([*kept, kept[-1] + (kept[-1] - kept[-2] if len(kept) > 1 else period)])
    # Too little is left there to place a cycle by it.
    if first == 0 and whole[0] > 0.0:
        whole = np.array([2.0 * whole[0] - whole[1], *whole])
    if last + 1 == len(marks) and whole[-1] < count - 1:
        whole = np.array([*whole, 2.0 * whole[-1] - whole[-2]])
    begin, end = max(int(np.ceil(whole[0])), 0), min(int(np.floor(whole[-1])), count - 1)
    return Cycles(whole, begin, end)


def _template(curve: np.ndarray, length: int) -> int:
    """First sample of the part nearest to the middle that moves as much as others, not in rest."""
    count, centred = len(curve), curve - curve.mean(axis=0)
    if count <= length:
        return 0
    sums, squares = (np.concatenate([np.zeros((1, curve.shape[1])), np.cumsum(one, axis=0)])
                     for one in (centred, centred ** 2))
    mean, square = ((one[length:] - one[:-length]) / length for one in (sums, squares))
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
    away = curve[first:last] - template[first - shift:last - shift]
    return float(np.mean((away ** 2).sum(axis=1)))
