"""Region B: a test for a trend of the bias with a stated rate of false alarms, and the step at which the trend begins.

Bias points (one per update interval) are averaged in pairs, pairs of pairs, and so on. On each of these `LEVELS`, the
means of the first and of the last third of the latest points are compared. With n points in a third, m_1 and m_3 the
means, s^2 the variance about a straight line through each third and rho the lag-one autocorrelation of the residuals,

    t = (m_3 - m_1) / (s sqrt(2 f / n)),  f = (1 + rho) / (1 - rho),    degrees of freedom = 2 (n - 2) / f >= 4,

is tested two-sided at the level at which all tests together raise `false_alarm_rate` false alarms at most (union
bound). Slow drift shows on a long level, a jump of the bias on a short one. Each third has its own line, so the
trend does not count as noise. White noise raises a tenth to a fifth of the stated alarms. The correction f is right on
average but not far out in the tail. With a correlation of 0.3 from one update interval to the next there are 0.6 times
the stated alarms at one per second, 1.6 times at one per minute, 2.8 times at six per hour.

The change over a test is its slope times its span. This overstates a jump between two levels by half. Where such a jump
explains the points better than two lines that meet in a kink, its height is the change.

Source of the correction f: von Storch, Zwiers, "Statistical Analysis in Climate Research", Cambridge 1999, section 6.6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

LEVELS = 6
FEWEST_POINTS = 12  # of the shortest test: its thirds need four, or the variance about their lines is not known
ABRUPT = 0.25  # squares left by a jump over those left by a kink, below which the trend begins at the jump


@dataclass(frozen=True)
class Trend:
    """Outcome of the latest tests.

    Attributes
    ----------
    slope : float
        Slope of the bias (m/s).
    significance : float
        Magnitude of t over its critical value.
    change : float
        Slope times span of the test (m); 1.5 times the height of a jump.
    span : int
        Span of the test in bias points.
    """

    slope: float
    significance: float
    change: float
    span: int


NO_TREND = Trend(0.0, 0.0, 0.0, 0)


@numba.njit(cache=True, error_model="numpy")
def compare_thirds(points: NDArray[np.float64]) -> tuple[float, float, float]:
    """Difference of the means of last and first third, standard deviation and autocorrelation about lines in both.

    Parameters
    ----------
    points : ndarray, shape (n,)
        Bias points (m).
    """
    third = len(points) // 3
    centre = 0.5 * (third - 1)
    spread = third * (third * third - 1) / 12.0
    means = np.zeros(2)
    power, product = 0.0, 0.0
    for end in range(2):
        part = points[:third] if end == 0 else points[len(points) - third :]
        slope = 0.0
        for k in range(third):
            means[end] += part[k] / third
            slope += (k - centre) * (part[k] - part[0]) / spread
        previous = 0.0
        for k in range(third):
            left = part[k] - means[end] - slope * (k - centre)
            power += left * left
            product += left * previous
            previous = left
    deviation = np.sqrt(power / (2.0 * (third - 2)))
    return means[1] - means[0], deviation, product / power if power > 0.0 else 0.0


@numba.njit(cache=True, error_model="numpy")
def kink(points: NDArray[np.float64]) -> tuple[int, float]:
    """Index at which two straight lines that meet there fit points best, and the sum of squares they leave (m^2)."""
    samples = len(points)
    x_sum, xx_sum = 0.5 * samples * (samples - 1), (samples - 1) * samples * (2 * samples - 1) / 6.0
    z_sum, xz_sum, zz_sum = 0.0, 0.0, 0.0
    for k in range(samples):
        z_sum += points[k] - points[0]
        xz_sum += k * (points[k] - points[0])
        zz_sum += (points[k] - points[0]) ** 2
    determinant = samples * xx_sum - x_sum * x_sum
    best, best_index = -1.0, 0
    tail_z, ramp_z = 0.0, 0.0
    # the ramp of index s is max(0, k - s); its part that no straight line explains is fitted to the points
    for s in range(samples - 2, 0, -1):
        tail_z += points[s + 1] - points[0]
        ramp_z += tail_z
        length = samples - 1 - s
        ramp = 0.5 * length * (length + 1)
        ramp_ramp = length * (length + 1) * (2 * length + 1) / 6.0
        ramp_x = ramp_ramp + s * ramp
        offset = (xx_sum * ramp - x_sum * ramp_x) / determinant
        slope = (samples * ramp_x - x_sum * ramp) / determinant
        own = ramp_ramp - offset * ramp - slope * ramp_x
        common = ramp_z - offset * z_sum - slope * xz_sum
        explained = common * common / own
        if explained > best:
            best, best_index = explained, s
    line_offset = (xx_sum * z_sum - x_sum * xz_sum) / determinant
    line_slope = (samples * xz_sum - x_sum * z_sum) / determinant
    return best_index, zz_sum - line_offset * z_sum - line_slope * xz_sum - best


@numba.njit(cache=True, error_model="numpy")
def jump(points: NDArray[np.float64]) -> tuple[float, float, float]:
    """Jump between two constant levels that fits points best by least squares, within the middle half of the points.

    The point during which the level jumps may lie anywhere between the levels. Further out than the middle half, a jump
    is scatter of an outer third rather than a difference of their means, and no test finds it significant.

    Parameters
    ----------
    points : ndarray, shape (n,)
        Bias points (m), each the mean over an interval around its index.

    Returns
    -------
    index, height, left
        Index at which the level jumps, with its fraction, its height (m), and the sum of squares left (m^2).
    """
    samples = len(points)
    total, square = 0.0, 0.0
    for k in range(samples):
        total += points[k] - points[0]
        square += (points[k] - points[0]) ** 2
    early = 0.0
    index, height, left = 0.0, 0.0, np.inf
    for s in range(1, samples - 1):
        early += points[s - 1] - points[0]
        here = points[s] - points[0]
        late = total - early - here
        before, after = early / s, late / (samples - 1 - s)
        rest = square - here * here - before * early - after * late
        if rest < left and samples <= 4 * s <= 3 * samples:
            passed = (after - here) / (after - before) if after != before else 0.5
            index, height, left = s - 0.5 + min(max(passed, 0.0), 1.0), after - before, rest
    return index, height, left


@numba.njit(cache=True, error_model="numpy")
def push(levels: NDArray[np.float64], counts: NDArray[np.int64], pending: NDArray[np.float64], point: float) -> int:
    """Add a point to the first level, and means of pairs to the next ones; returns the number of levels that got one.

    Parameters
    ----------
    levels : ndarray, shape (LEVELS, n)
        Latest points of each level, the newest last.
    counts : ndarray, shape (LEVELS,)
        Points that each level has got so far.
    pending : ndarray, shape (LEVELS,)
        Points that wait for the second point of their pair; NaN for none.
    point : float
        The point (m).
    """
    for level in range(len(levels)):
        levels[level, :-1] = levels[level, 1:].copy()
        levels[level, -1] = point
        counts[level] += 1
        if np.isnan(pending[level]):
            pending[level] = point
            return level + 1
        point = 0.5 * (point + pending[level])
        pending[level] = np.nan
    return len(levels)


class TrendTest:
    """Tests the bias of one axis for a trend.

    Parameters
    ----------
    points : int
        Bias points of the shortest test, `FEWEST_POINTS` or more.
    interval : float
        Time between bias points (s).
    false_alarm_rate : float
        False alarms (1/s) that all tests together may raise.

    Attributes
    ----------
    points : int
        Bias points of the shortest test.
    """

    def __init__(self, points: int, interval: float, false_alarm_rate: float) -> None:
        self.points = points
        self._interval = interval
        level = false_alarm_rate * interval / 2.0  # at most two tests per interval
        self._critical = -stdtrit(np.arange(1, 2 * (points // 3) - 3), level / 2.0)  # Student's t
        self._history = np.empty(2 * points << (LEVELS - 1))
        self.reset()

    @property
    def count(self) -> int:
        """Points since the last reset, as far as they are kept."""
        return self._count

    @property
    def complete(self) -> bool:
        """Whether the points since the last reset are enough for a test."""
        return self._count >= self.points

    @property
    def incomplete(self) -> int:
        """Points since the last reset, if they are too few for a test; otherwise 0."""
        return 0 if self.complete else self._count

    @property
    def longest(self) -> int:
        """Points of the longest test."""
        return self.points << (LEVELS - 1)

    def reset(self) -> None:
        """Forget all points."""
        self._count = 0
        self._levels = np.zeros((LEVELS, self.points))
        self._counts = np.zeros(LEVELS, np.int64)
        self._pending = np.full(LEVELS, math.nan)
        self._latest = [NO_TREND] * LEVELS

    def add(self, point: float) -> Trend:
        """Add a bias point (m); returns the most significant of the latest tests of all levels."""
        self._history[:-1] = self._history[1:].copy()
        self._history[-1] = point
        self._count = min(self._count + 1, len(self._history))
        for level in range(push(self._levels, self._counts, self._pending, point)):
            if self._counts[level] >= self.points:
                self._latest[level] = self._test(level)
        return max(self._latest, key=lambda trend: trend.significance)

    def drifting(self, threshold: float) -> Trend | None:
        """The shortest test that is significant and whose change reaches the threshold (m).

        If a jump explains the points better than a kink, its height is the change.
        """
        for trend in self._latest:
            if trend.significance >= 1.0 and abs(trend.change) >= threshold:
                _, height, share = self._jump(trend)
                if share >= 1.0 or abs(height) >= threshold:
                    return trend
        return None

    def beginning(self, trend: Trend) -> tuple[float, float]:
        """How many points before the latest one a trend began, and the bias before it (m)."""
        span = min(trend.span, self._count)
        index, _, share = self._jump(trend)
        last = int(index - 0.5)  # of the points before; the next one may lie on the way
        if share >= ABRUPT:
            span = min(trend.span * 3 // 2, self._count)
            index = last = kink(self._history[-span:])[0]
        before = self._history[-span:][max(last - 10, 0) : last + 1]
        return span - 1 - index, float(np.mean(before))

    def _jump(self, trend: Trend) -> tuple[float, float, float]:
        """Best jump in the span of a trend: index, height (m), and squares left over those that a kink leaves."""
        points = self._history[-min(trend.span, self._count) :]
        index, height, left = jump(points)
        return index, height, left / (kink(points)[1] + 1e-30)

    def _test(self, level: int) -> Trend:
        difference, deviation, correlation = compare_thirds(self._levels[level])
        third = self.points // 3
        # residuals about a line are less correlated than the noise (first-order correction), and few points determine
        # the correlation badly (one standard error to be safe)
        correlation += (3.0 + 3.0 * correlation) / third + 1.0 / math.sqrt(2 * third)
        correlation = min(max(correlation, 0.0), 0.9)
        inflation = (1.0 + correlation) / (1.0 - correlation)
        freedom = max(int(2 * (third - 2) / inflation), 4)
        error = deviation * math.sqrt(2.0 * inflation / third)
        significance = abs(difference) / (error * self._critical[freedom - 1] + 1e-15)
        slope = difference / ((self.points - third) * self._interval * 2**level)
        span = self.points << level
        return Trend(slope, float(significance), slope * span * self._interval, span)
