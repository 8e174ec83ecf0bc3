"""Phases that give a multisine a low crest factor, so that it has much power for its peak.

Schroeder's phases make a chirp: at each moment it contains one frequency. A bearing then runs as under a sweep of the
whole amplitude, and tolerates less of it than of a signal with a constant spectrum over time. Phases optimised from
random ones give such a signal, with the same crest factor as those optimised from Schroeder's.

Sources: M. R. Schroeder, "Synthesis of low-peak-factor signals and binary sequences with low autocorrelation", IEEE
Trans. Information Theory 16 (1970) 85-89; E. Van der Ouderaa, J. Schoukens, J. Renneboog, "Peak factor minimization
using a time and frequency domain swapping algorithm", IEEE Trans. Instrumentation and Measurement 37 (1988) 145-147
(clipping); see also R. Pintelon, J. Schoukens, System Identification, 2nd ed., Wiley 2012, section 5.3.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

OVERSAMPLING = 8
"""Samples per period of the highest line during the search; more do not change the crest factor by 1 %."""
ROUNDS = 300
"""Number of clippings; 1000 lower the crest factor by another 1 %."""
EFFORT = 5e7
"""Samples clipped in total, a few seconds: a multisine of more than a few minutes gets fewer clippings."""
HIGHEST_REMEMBERED = 20_000
"""Largest number of lines for which phases are cached: more would fill the memory of a node that runs for weeks."""
STEPS_PER_RADIAN = 4096.0
"""Phases are rounded to such steps after each clipping, or the last bit, in which processors differ, would grow."""
FIRST_CLIP, LAST_CLIP = 0.4, 0.99
"""Share of the peak at which the first and the last clipping limit the signal."""


def schroeder_phases(lines: NDArray[np.int_]) -> NDArray[np.float64]:
    """Phases of lines of equal amplitude, -pi k (k - 1) / n for the k-th of n: a chirp with a crest factor near 1.7.

    Parameters
    ----------
    lines : ndarray of int, shape (n,)
        Numbers of the lines; evenly spaced.

    Returns
    -------
    ndarray, shape (n,)
        Phases (rad).
    """
    order = np.arange(1, len(lines) + 1)
    return -np.pi * order * (order - 1.0) / len(lines)


def optimised_phases(lines: NDArray[np.int_], phases: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phases of lines of equal amplitude by repeated clipping; crest factor below 1.5.

    The signal is clipped below its peak and transformed. The phases are kept, and the amplitudes are made equal again.

    Parameters
    ----------
    lines : ndarray of int, shape (n,)
        Numbers of the lines, ascending and positive.
    phases : ndarray, shape (n,)
        Phases from which to start (rad).

    Returns
    -------
    ndarray, shape (n,)
        Phases (rad).
    """
    if len(lines) > HIGHEST_REMEMBERED:
        return _clipped(lines, phases)
    return np.frombuffer(_remembered(lines.astype(np.int64).tobytes(), phases.tobytes()))


@lru_cache(maxsize=8)  # a design requests them for every amplitude that it tries
def _remembered(lines: bytes, phases: bytes) -> bytes:
    return _clipped(np.frombuffer(lines, dtype=np.int64), np.frombuffer(phases)).tobytes()


def _clipped(lines: NDArray[np.int_], phases: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.fft import irfft, next_fast_len, rfft  # slow to import, and not needed by other kinds

    steps = next_fast_len(OVERSAMPLING * int(lines[-1]), real=True)
    best, lowest = phases, np.inf
    for clip in np.linspace(FIRST_CLIP, LAST_CLIP, min(ROUNDS, max(1, round(EFFORT / steps)))):
        spectrum = np.zeros(steps // 2 + 1, dtype=complex)
        spectrum[lines] = np.exp(1j * phases)
        signal = irfft(spectrum, steps)
        peak = np.max(np.abs(signal))
        if peak < lowest:
            best, lowest = phases, peak
        level = clip * peak
        clipped = np.angle(rfft(np.clip(signal, -level, level))[lines])
        phases = np.round(STEPS_PER_RADIAN * clipped) / STEPS_PER_RADIAN
    return best
