"""Narrow peaks in the spectrum of the residuals: modes that a model lacks and noise excites.

The prediction errors of a true model are white. A mode that the model lacks rings in them, whatever the reference
excites. In each band of frequencies the median of the periodogram is compared with its median over the octaves beside
it. The median leaves single lines out: a tone, such as that of an unbalance, is a disturbance, and no mode. The power
of p outputs at a line of a flat spectrum has a gamma distribution, of which more than half of n lines exceed a level
with a binomial probability.

Source: P. Stoica and R. Moses, Spectral Analysis of Signals, Prentice Hall, 2005, section 2.4 (periodogram).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from amb_core.identification.validation.residuals import decorrelated

NOTABLE, SHARE = 1.5, 0.1
"""Height over its neighbourhood, and error relative to the motion in its band, from which a peak is that of a mode."""
_WIDTH = 0.02  # of a band, relative to its frequency
_FEWEST = 12  # lines in a band
_BESIDE = 2.0  # factor of frequency to either side that is the neighbourhood
_HIGHEST = 0.8  # of the Nyquist frequency
_LOWEST = 30.0  # periods in the longest experiment


@dataclass(frozen=True)
class Ringing:
    """The highest peak.

    Attributes
    ----------
    frequency : float
        Its frequency (Hz).
    height : float
        Power over that of the neighbourhood.
    share : float
        Prediction error relative to the motion in its band, root mean squares, of the output where it is largest.
    p_value : float
        Probability of so high a peak anywhere in a flat spectrum.
    """

    frequency: float
    height: float
    share: float
    p_value: float


def find_ringing(
    residuals: Sequence[NDArray[np.float64]], outputs: Sequence[NDArray[np.float64]], sample_time: float
) -> Ringing | None:
    """The most significant peak in the longest experiment; None for records that are too short."""
    white = decorrelated([part - part.mean(axis=0) for part in residuals])
    longest = int(np.argmax([len(part) for part in white]))
    steps, p = white[longest].shape
    power = np.sum(np.abs(np.fft.rfft(white[longest], axis=0)) ** 2, axis=1)[1:]
    frequency = np.fft.rfftfreq(steps, sample_time)[1:]
    middle = float(special.gammaincinv(p, 0.5))
    best, tested, start = None, 0, int(np.searchsorted(frequency, _LOWEST / (steps * sample_time)))
    while frequency[start] < _HIGHEST * frequency[-1]:
        count = max(int(np.searchsorted(frequency, frequency[start] * (1.0 + _WIDTH))) - start, _FEWEST)
        part = slice(start, start + count)
        if part.stop > len(power):
            break
        ends = np.searchsorted(frequency, [frequency[start] / _BESIDE, frequency[start] * _BESIDE])
        beside = float(np.median(power[slice(*ends)]))
        height = float(np.median(power[part])) / beside if beside > 0.0 else 0.0
        p_value = float(special.bdtrc((count - 1) // 2, count, special.gammaincc(p, height * middle)))
        tested += 1
        if best is None or (p_value, -height) < (best[0], -best[1]):
            best = (p_value, height, part)
        start += count // 2
    if best is None:
        return None
    of_errors, of_motion = (
        np.sqrt(
            np.sum(np.abs(np.fft.rfft(item[longest] - item[longest].mean(axis=0), axis=0)[1:][best[2]]) ** 2, axis=0)
        )
        for item in (residuals, outputs)
    )
    share = float(np.max(of_errors / np.maximum(of_motion, np.finfo(float).tiny)))
    return Ringing(float(frequency[best[2]].mean()), best[1], share, min(1.0, tested * best[0]))
