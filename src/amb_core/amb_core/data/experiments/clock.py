"""Times of samples: one sample time, the stretches without a gap, and the repair of what is irregular."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.sample_times import SAME

TOLERANCE = 0.1
"""Part of a sample time by which a time may miss its sample."""
ROUGHEST = 0.1
"""Part of a signal by which a cubic through every other sample may miss the others."""
WIDEST = 4.0
"""Longest interval that is interpolated, in median intervals: beyond it samples are missing."""


@dataclass(frozen=True, eq=False)
class Clock:
    """When the samples were taken.

    Attributes
    ----------
    sample_time : float
        Sample time (s).
    spans : list of (int, int, int)
        First row, row after the last and first step of each stretch without a gap.
    jitter : float
        Largest distance of a time from its sample, as part of the sample time.
    missing : int
        Samples missing between the stretches.
    shown : float or None
        Sample time (s) that the times show where a given one contradicts it; None otherwise.
    """

    sample_time: float
    spans: list[tuple[int, int, int]]
    jitter: float = 0.0
    missing: int = 0
    shown: float | None = None

    @property
    def notes(self) -> list[str]:
        """What is doubtful of the times."""
        notes = []
        if self.missing:
            notes.append(f"{self.missing} samples are missing: {len(self.spans)} experiments between them")
        if self.jitter > 0.01:
            notes.append(f"times are up to {100.0 * self.jitter:.0f} % of a sample off; taken as equidistant")
        if self.shown is not None:
            rates = f"{1.0 / self.shown:.7g} Hz; {1.0 / self.sample_time:.7g} Hz"
            notes.append(f"the times show {rates}, as given, is used")
        return notes


def clock_of(time: NDArray[np.float64], given: float | None) -> Clock:
    """The clock of times (s), with a sample time that a user gave, if any.

    Raises
    ------
    IdentificationError
        If the times do not rise, are irregular or contradict the given sample time.
    """
    require_rising(time)
    intervals = np.diff(time)
    typical = float(np.quantile(intervals, 0.5, method="lower"))  # one of them, also where a gap is every other one
    # more exact than one interval: from all steps of the whole record
    regular = intervals[np.abs(intervals - typical) < 0.5 * typical]
    shown = float(f"{regular.mean():.9g}")
    if given is not None and abs(shown - given) > 0.01 * given:
        raise IdentificationError(
            f"sample_time {given:g} s is given, but the times are {shown:g} s apart; correct it or leave it out "
            "(--rate, --sample-time), or leave the times out with --time none"
        )
    given = shown if given is None else given
    unsure = float(np.ptp(regular)) / len(regular)  # of the mean: jitter and resolution move the first and last time
    contradicts = abs(shown - given) > max(SAME * given, unsure)
    steps = intervals / given
    off = np.abs(steps - np.round(steps))
    worst = int(np.argmax(off))
    if off[worst] > TOLERANCE:
        raise IdentificationError(
            f"irregular sample time: between samples {worst} and {worst + 1} are {intervals[worst]:g} s, not a "
            f"multiple of {given:g} s; if only the stamps jitter, count the samples: --time none --rate "
            f"{1.0 / given:.6g}; if the samples were taken at these times: --repair resample"
        )
    whole = np.round(steps).astype(np.int64)
    edges = [0, *(np.flatnonzero(whole > 1) + 1).tolist(), len(time)]
    ahead = np.concatenate([[0], np.cumsum(whole)])
    first = round(float(time[0]) / given)
    spans = [(start, stop, first + int(ahead[start])) for start, stop in itertools.pairwise(edges)]
    missing = int((whole - 1).sum())
    return Clock(given, spans, float(off[worst]), missing, shown if contradicts else None)


def resampled(
    time: NDArray[np.float64], signals: NDArray[np.float64], given: float | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times of one rate (by default the median one) and signals (rows, columns) interpolated by cubic splines at them.

    Raises
    ------
    IdentificationError
        If an interval is so long that samples are missing, the signals have values that are not finite, or they change
        too much between samples.
    """
    from scipy.interpolate import CubicSpline

    require_rising(time)
    intervals = np.diff(time)
    typical = float(np.median(intervals))
    if (longest := float(intervals.max())) > WIDEST * typical:
        row = int(np.argmax(intervals))
        raise IdentificationError(
            f"between samples {row} and {row + 1} are {longest:g} s, {longest / typical:.0f} times the median: too "
            "long to be interpolated; cut the file there and give the parts as separate files"
        )
    if not np.isfinite(signals).all():
        raise IdentificationError(
            "samples that are missing are not interpolated; leave their rows out of the file first"
        )
    step = given or typical
    if step < 0.5 * typical:
        raise IdentificationError(
            f"--rate {1.0 / step:g} Hz is above twice the rate of the samples, {1.0 / typical:g} Hz"
        )
    rough = _roughness(time, signals)
    if rough > ROUGHEST:
        raise IdentificationError(
            f"the signals change too much between samples to be interpolated: every other sample is missed by "
            f"{100.0 * rough:.0f} % (allowed {100.0 * ROUGHEST:.0f} %); if the samples are equidistant and only their "
            "stamps jitter, count them: --time none --rate HZ"
        )
    grid = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-9) + 1)
    return grid, np.asarray(CubicSpline(time, signals)(np.minimum(grid, time[-1])))


def _roughness(time: NDArray[np.float64], signals: NDArray[np.float64]) -> float:
    """How far a cubic through every other sample misses the others: the worst signal, rms over its deviation."""
    from scipy.interpolate import CubicSpline

    if len(time) < 8:
        return 0.0
    missed = CubicSpline(time[::2], signals[::2])(time[1:-1:2]) - signals[1:-1:2]
    spread = signals.std(axis=0)
    return float(np.max(np.sqrt((missed**2).mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)))


def require_rising(time: NDArray[np.float64]) -> None:
    """Raise IdentificationError unless the times are finite and rise."""
    if len(time) < 2 or not np.isfinite(time).all():
        raise IdentificationError(
            "the times must be two or more finite numbers; otherwise leave the column out: --time none --rate HZ"
        )
    backward = np.flatnonzero(np.diff(time) <= 0.0)
    if backward.size:
        row = int(backward[0])
        raise IdentificationError(
            f"times must rise; sample {row + 1} is at {time[row + 1]:g} s, the one before at {time[row]:g} s; if the "
            "samples are equidistant, count them: --time none --rate HZ"
        )
