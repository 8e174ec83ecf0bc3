"""Which sweeps a region map needs: few, but enough to resolve its boundaries.

The order of the sweeps depends only on their results, taken in the order of the requests. Neither the number of workers
nor the order in which sweeps finish affects the map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from amb_core.regions.region_map.map_sweep import BOUNDARIES, MapSweep
from amb_core.regions.region_map.region_map import RegionMap
from amb_core.regions.region_map.settings import MapSettings


@dataclass(frozen=True)
class Interval:
    """Two neighbouring amplitudes between which a boundary is not resolved.

    Attributes
    ----------
    middle : Fraction
        Place half-way between them, see `Refinement`.
    uncertainty : float
        Estimated error of the boundary, relative in frequency, or in amplitude where it ends.
    """

    middle: Fraction
    uncertainty: float


class Refinement:
    """Chooses the amplitudes of a map.

    An amplitude is a place from 0 (smallest) to 1 (largest) on the logarithmic axis. Sweeps are requested in a fixed
    order. Results count only up to the oldest request without a result; from that one on, at most `initial_sweeps` are
    under way.

    Parameters
    ----------
    settings : MapSettings
        Amplitudes, numbers of sweeps, resolution.
    """

    def __init__(self, settings: MapSettings) -> None:
        self._settings = settings
        count = settings.initial_sweeps
        self._asked = [Fraction(index, count - 1) for index in range(count)]
        self._results: dict[float, MapSweep] = {}
        self._counted = 0

    @property
    def amplitudes(self) -> list[float]:
        """Amplitudes requested so far (m), in order."""
        return [self._amplitude(place) for place in self._asked]

    @property
    def sweeps(self) -> tuple[MapSweep, ...]:
        """Results so far in order of amplitude."""
        return tuple(self._results[amplitude] for amplitude in sorted(self._results))

    @property
    def open(self) -> list[Interval]:
        """Intervals in which the results that count leave a boundary unresolved and no sweep is under way."""
        pending = set(self._asked[self._counted :])
        return [interval for interval in self._unresolved() if interval.middle not in pending]

    @property
    def finished(self) -> bool:
        """Whether every requested sweep has its result."""
        return len(self._results) == len(self._asked)

    @property
    def resolved(self) -> bool:
        """Whether all boundaries are resolved."""
        return self.finished and not self._unresolved()

    def add(self, sweep: MapSweep) -> list[float]:
        """Add the result of a requested sweep; returns the amplitudes (m) that are now requested in addition."""
        self._results[sweep.amplitude] = sweep
        before = len(self._asked)
        while self._counted < len(self._asked) and self._amplitude(self._asked[self._counted]) in self._results:
            self._counted += 1
            self._ask()
        return self.amplitudes[before:]

    def _ask(self) -> None:
        settings = self._settings
        while len(self._asked) < settings.max_sweeps and len(self._asked) - self._counted < settings.initial_sweeps:
            candidates = self.open
            if not candidates:
                return
            widest = max(candidates, key=lambda interval: (interval.uncertainty, -interval.middle))
            self._asked.append(widest.middle)

    def _amplitude(self, place: Fraction) -> float:
        low, high = self._settings.amplitude_low, self._settings.amplitude_high
        # Rounded: the ends are exactly as given, and equal amplitudes are equal in every map.
        return float(f"{low * (high / low) ** float(place):.9g}")

    def _unresolved(self) -> list[Interval]:
        known = sorted(self._asked[: self._counted])
        if len(known) < self._settings.initial_sweeps:
            return []
        sweeps = [self._results[self._amplitude(place)] for place in known]
        logarithm = np.log([sweep.amplitude for sweep in sweeps])
        region_map = RegionMap(self._settings, tuple(sweeps))
        uncertainty = np.max(
            [_uncertainty(logarithm, np.log(region_map.frequencies(region))) for region in BOUNDARIES], axis=0
        )
        narrow = np.diff(logarithm) <= math.log1p(self._settings.resolution)
        return [
            Interval((known[i] + known[i + 1]) / 2, float(uncertainty[i]))
            for i in np.flatnonzero((uncertainty > self._settings.resolution) & ~narrow)
        ]


def _uncertainty(amplitude: NDArray[np.float64], frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Estimated error of a boundary between neighbouring sweeps.

    Parameters
    ----------
    amplitude, frequency : ndarray, shape (sweeps,)
        Logarithms; the frequency is NaN where the boundary does not occur.

    Returns
    -------
    ndarray, shape (sweeps - 1,)
        If both sweeps have the boundary: |c| h^2 for an interval h and the second divided difference c. This is how far
        a straight line between the neighbours of a sweep misses it, for neighbours with the spacing of the interval. It
        is taken at the end where it is smaller, so a jump, which is large at both ends of its own interval, does not
        spread to the next one. Within the interval the error of a line is smaller (a quarter of this). A boundary that
        falls cannot deviate by more than it falls. If only one sweep has the boundary: the width of the interval. If
        none has it: 0.
    """
    width = np.diff(amplitude)
    slope = np.diff(frequency) / width
    curvature = np.full(len(amplitude), np.inf)
    curvature[1:-1] = np.abs(np.diff(slope) / (amplitude[2:] - amplitude[:-2]))
    curvature[np.isnan(curvature)] = np.inf
    deviation = np.minimum(curvature[:-1], curvature[1:]) * width**2
    deviation = np.minimum(deviation, np.abs(np.diff(frequency)))
    missing = np.isnan(frequency)
    deviation[missing[:-1] != missing[1:]] = width[missing[:-1] != missing[1:]]
    deviation[missing[:-1] & missing[1:]] = 0.0
    return deviation
