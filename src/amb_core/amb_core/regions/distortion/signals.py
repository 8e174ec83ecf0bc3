"""Random-phase odd multisines with detection lines.

Only odd multiples of the resolution 1 / period are excited. One of every few consecutive ones, drawn by lot, is left
out. A nonlinearity of even order then shows only at the even lines, one of odd order at the odd lines that are not
excited.

Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, sections
4.2 and 4.3; T. P. Dobrowiecki, J. Schoukens and P. Guillaume, Optimized excitation signals for MIMO frequency response
function measurements, IEEE Trans. Instrumentation and Measurement 55 (2006), for the two experiments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import SpectrumError
from amb_core.regions.distortion.settings import DistortionSettings

EXPERIMENTS = {"both": np.array([[1.0, 1.0], [1.0, -1.0]]), "in_turn": np.eye(2)}
"""Factors on the references of x and y, a row for each experiment of a realisation."""


@dataclass(frozen=True)
class Lines:
    """Lines of the spectrum up to the end of the band, as multiples of the resolution.

    Attributes
    ----------
    steps : int
        Samples of a period.
    excited, odd, even : ndarray of int, shapes (excited,), (odd,), (even,)
        Excited lines; odd lines that are not excited; even lines. Those below the band belong to it, as slow motion is
        a distortion too.
    """

    steps: int
    excited: NDArray[np.int_]
    odd: NDArray[np.int_]
    even: NDArray[np.int_]


def lines_of(settings: DistortionSettings, sample_rate: float) -> Lines:
    """Lines of a measurement at a sample rate (Hz).

    Parameters
    ----------
    settings : DistortionSettings
        Period and band.
    sample_rate : float
        Sample rate (Hz).

    Returns
    -------
    Lines
        Excited lines, and odd and even lines that are not.

    Raises
    ------
    SpectrumError
        If the period is not a whole number of samples, or the band reaches beyond the Nyquist frequency.
    """
    steps = round(settings.period * sample_rate)
    if abs(steps - settings.period * sample_rate) > 1e-6:
        raise SpectrumError(
            f"period = {settings.period:g} s has {settings.period * sample_rate:g} samples at {sample_rate:g} Hz; "
            "allowed: a whole number"
        )
    if not settings.frequency_end < 0.5 * sample_rate:
        raise SpectrumError(
            f"frequency_end = {settings.frequency_end:g} Hz; allowed: less than half the sample rate, "
            f"{0.5 * sample_rate:g} Hz"
        )
    highest = int(settings.frequency_end * settings.period)
    odd, even = np.arange(1, highest + 1, 2), np.arange(2, highest + 1, 2)
    band = odd[odd >= settings.frequency_start * settings.period - 1e-9]
    random = np.random.default_rng([settings.seed, 0])
    left_out = [random.choice(band[n : n + settings.group]) for n in range(0, len(band), settings.group)]
    excited = np.setdiff1d(band, left_out)
    return Lines(steps, excited, np.setdiff1d(odd, excited), even)


def reference_of(settings: DistortionSettings, lines: Lines, realisation: int, experiment: int) -> NDArray[np.float64]:
    """One period of the reference (m), shape (steps, 2), of an experiment (0 or 1) of a realisation (from 0 on).

    Parameters
    ----------
    settings : DistortionSettings
        Amplitude, axes and seed.
    lines : Lines
        Which lines are excited.
    realisation : int
        Number of the realisation, from 0.
    experiment : int
        Number of the experiment in it, 0 or 1.

    Returns
    -------
    ndarray, shape (steps, 2)
        Reference (m).
    """
    random = np.random.default_rng([settings.seed, 1 + realisation])
    spectrum = np.zeros((lines.steps // 2 + 1, 2), dtype=complex)
    spectrum[lines.excited] = np.exp(2j * np.pi * random.random((len(lines.excited), 2)))
    signal: NDArray[np.float64] = np.fft.irfft(spectrum, lines.steps, axis=0)
    return EXPERIMENTS[settings.axes][experiment] * settings.rms * signal / np.sqrt(np.mean(signal**2, axis=0))
