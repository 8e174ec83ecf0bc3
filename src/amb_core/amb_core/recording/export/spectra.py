"""Spectra of the positions of a run while its samples pass by."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.records import LoopRecord
from amb_core.recording.export.run_telemetry import RunTelemetry
from amb_core.recording.live.spectrum import RunningSpectrum

LENGTH = 8192
"""Samples of one spectrum; fewer, a power of two, if no stretch of the run has as many."""
SHORTEST = 256
"""Fewest samples of a stretch that has a spectrum."""


class Spectrum(NamedTuple):
    """Peak amplitudes of the lines of some samples.

    Attributes
    ----------
    step : int
        Step after the last of these samples.
    frequency : ndarray, shape (points,)
        Upper end of the range of frequencies of each point (Hz).
    amplitude : ndarray, shape (points, axes)
        The largest peak amplitude in this range (m); NaN where a short stretch does not resolve it.
    """

    step: int
    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]


class RunSpectra:
    """Spectra of the last `length` samples: one for every half of them, and one at each known end; none over a gap.

    At the end of a stretch that is shorter it is a spectrum of all its samples; there is none if they are fewer than
    `SHORTEST`.

    Parameters
    ----------
    axes : int
        Number of axes.
    sample_time : float
        Sample time (s).
    length : int, optional
        Samples of one spectrum; 0 for no spectra.
    ends : collection of int, optional
        The step after the last of each stretch without a gap, as far as known.

    Attributes
    ----------
    length : int
        Samples of one spectrum; 0 for no spectra, of a run that is too short.
    peak : Spectrum or None
        The largest amplitude of each point in all spectra so far.
    """

    def __init__(self, axes: int, sample_time: float, length: int = LENGTH, ends: Collection[int] = ()) -> None:
        self.length = length
        self.peak: Spectrum | None = None
        self._running = RunningSpectrum(axes, sample_time, length) if length else None
        self._first = self._next = 0  # steps: of this stretch, and the next one
        self._ends = frozenset(ends)

    @classmethod
    def of(cls, telemetry: RunTelemetry) -> RunSpectra:
        """Those of a run with all its ends, as long as its longest stretch allows."""
        longest = max(stop - first for first, stop in telemetry.spans)
        length = min(LENGTH, 1 << (longest.bit_length() - 1)) if longest >= SHORTEST else 0
        return cls(len(telemetry.axes), telemetry.sample_time, length, [stop for _, stop in telemetry.spans])

    def add(self, record: LoopRecord) -> Iterator[Spectrum]:
        """Take in the next samples of the run, and give the spectra that they complete."""
        if self._running is None:
            return
        if record.first_step != self._next:
            self._running.clear()
            self._first = self._next = record.first_step
        start, half = 0, self.length // 2
        while start < record.steps:
            count = min(half - (self._next - self._first) % half, record.steps - start)
            self._running.add(record.position[start : start + count])
            start, self._next = start + count, self._next + count
            samples = self._next - self._first
            ended = self._next in self._ends and samples >= SHORTEST
            if ended or (self._running.ready and samples % half == 0):
                yield self._spectrum(self._running)

    def take(self, record: LoopRecord) -> None:
        """Take in the next samples, where only the `peak` of all spectra is wanted."""
        for _ in self.add(record):
            pass

    def _spectrum(self, running: RunningSpectrum) -> Spectrum:
        """That of the samples up to the next step."""
        spectrum = Spectrum(self._next, running.frequency, running.amplitude())
        highest = spectrum.amplitude if self.peak is None else np.fmax(self.peak.amplitude, spectrum.amplitude)
        self.peak = Spectrum(self._next, spectrum.frequency, highest)
        return spectrum
