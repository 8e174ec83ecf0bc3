"""Running amplitude spectrum of the last samples, with its peaks kept where it is thinned."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

LOWEST_BIN = 3  # of as many bins as samples: a Hann window spreads the mean over the bins below


class RunningSpectrum:
    """Amplitude spectrum of the last samples of several signals.

    A Hann window, scaled so that a sine shows its peak amplitude, half-way between two bins 15 % less: Harris,
    "On the use of windows for harmonic analysis with the discrete Fourier transform", 1978.

    Parameters
    ----------
    signals : int
        Number of signals.
    sample_time : float
        Sample time (s).
    length : int, optional
        Samples of one spectrum; resolution is 1 / (length x sample_time).
    points : int, optional
        Most points per spectrum, equally spaced in the logarithm of frequency. Each holds the largest bin in its range.

    Attributes
    ----------
    frequency : ndarray, shape (points,)
        Upper end of each range (Hz).
    """

    def __init__(self, signals: int, sample_time: float, length: int = 8192, points: int = 320) -> None:
        self._samples = np.zeros((length, signals))
        self._filled = 0
        bins = length // 2
        starts = np.unique(np.geomspace(LOWEST_BIN, bins, points + 1).astype(int))
        self._starts = starts[:-1]
        self.frequency = (starts[1:] - 1.0) / (length * sample_time)

    def add(self, samples: NDArray[np.float64]) -> None:
        """Take in consecutive samples, shape (steps, signals).

        Parameters
        ----------
        samples : ndarray, shape (steps, signals)
            Samples, in the unit of each signal.
        """
        length = len(self._samples)
        count = min(len(samples), length)
        self._samples[: length - count] = self._samples[count:]
        self._samples[length - count :] = samples[-count:] if count else samples
        self._filled = min(length, self._filled + count)

    def clear(self) -> None:
        """Forget all samples, after a gap: a jump would show as a broad spectrum."""
        self._filled = 0

    @property
    def ready(self) -> bool:
        """Whether there are enough samples."""
        return self._filled == len(self._samples)

    def amplitude(self) -> NDArray[np.float64]:
        """Peak amplitude of the lines at each point, shape (points, signals), in the unit of the samples.

        While there are fewer samples than `length`, two at least, zeros follow them for the same points.

        Returns
        -------
        ndarray, shape (points, signals)
            Peak amplitudes; NaN at frequencies that fewer samples do not resolve.
        """
        length, filled = len(self._samples), self._filled
        samples = self._samples[length - filled :]
        window = np.hanning(filled + 1)[:filled, np.newaxis]
        lines = np.abs(np.fft.rfft((samples - samples.mean(axis=0)) * window, length, axis=0)) * (2.0 / window.sum())
        lines[: math.ceil(LOWEST_BIN * length / filled)] = np.nan
        return np.fmax.reduceat(lines[: length // 2], self._starts, axis=0)
