"""Tones of signals: lines that stand out of those beside them, as of an unbalance or of the mains.

One sinusoid explains a tone: unlike a lightly damped mode that noise drives, which spreads over the lines of its
bandwidth. Tones seldom have the frequency of a line, so that a rectangular window spreads them over many: they are
found behind a Hann window and subtracted by least squares, with an amplitude that may change evenly over the record.

Source: D. C. Rife and R. R. Boorstyn, Single-tone parameter estimation from discrete-time observations, IEEE
Transactions on Information Theory 20 (1974).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Arrays = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_BESIDE = 8  # lines to either side that are compared with
_TONE = 12.0  # power of a line over that of those beside it
_BETWEEN = 0.2  # of the lines of a reference of single tones, whose power
_APART = 0.01  # of the highest is what a window leaves between them
_NEAREST = 0.35  # of the power of a line, that one beside it has if the tone is more than a tenth of a line off
FEWEST = 8 * _BESIDE
"""Samples in which tones are sought."""
NO_POWER = 1e-8
"""Of the largest line of a reference, below which a line is none of it."""
_ONE = 0.9  # of the power about the line beyond the level beside it, that one sinusoid explains
_MOST = 20  # tones
_PASSES = 3
_BLOCKS = 1024  # of time: a line or less beside another one, phases change little within
_SMALL = 1e-9  # of sums of squares at half the sample rate
_TURNS = 12  # halvings of the search for a frequency
_STEADY = 0.3  # of a tone's amplitude, that it changes from the middle of a record to its ends
_ON_LINE = 0.25  # lines, beside the middle of one


@dataclass(frozen=True)
class Tones:
    """Tones of several signals of one experiment.

    Attributes
    ----------
    frequencies : tuple of float
        Their frequencies (1, cycles per sample), the strongest first.
    shares : tuple of float
        What each has of the variance of the signals, of the signal in which that is most (-).
    rest : ndarray, shape (steps, p)
        The signals without tones and means (m, A or as they are).
    """

    frequencies: tuple[float, ...]
    shares: tuple[float, ...]
    rest: Arrays


def find_tones(signals: Arrays, given: NDArray[np.bool_] | None = None, least: float = _TONE) -> Tones:
    """The tones of signals.

    Parameters
    ----------
    signals : ndarray, shape (steps, p)
        Samples (m, A).
    given : ndarray of bool, shape (steps // 2 + 1,), optional
        Lines whose tones are left out. None for no line.
    least : float, optional
        Power of the line of a tone over that of those beside it (-).

    Returns
    -------
    Tones
        The tones, and the signals without them.
    """
    whole = signals - signals.mean(axis=0)
    size = np.maximum(whole.std(axis=0), np.finfo(float).tiny)
    rest, frequencies = whole / size, list[float]()
    if len(rest) < FEWEST:
        return Tones((), (), whole)
    for _ in range(_PASSES):
        power = power_of(rest)
        peaks = _peaks(power, least)
        lines = np.flatnonzero(peaks if given is None else peaks & ~given)
        strongest = lines[np.argsort(-power[lines])][: _MOST - len(frequencies)]
        new = [frequency for line in strongest if (frequency := _tone_at(rest, int(line), power)) is not None]
        if not new:
            break
        frequencies += new
        rest = without_tones(whole / size, frequencies)
        rest = rest - rest.mean(axis=0)
    shares = [float(np.max(1.0 - np.mean(without_tones(whole / size, [one]) ** 2, axis=0))) for one in frequencies]
    order = np.argsort([-share for share in shares])
    return Tones(tuple(frequencies[place] for place in order), tuple(shares[place] for place in order), rest * size)


def without_tones(signals: Arrays, frequencies: Sequence[float], window: Arrays | None = None) -> Arrays:
    """Signals without their parts of some frequencies.

    Parameters
    ----------
    signals : ndarray, shape (steps, p)
        Samples (m, A).
    frequencies : sequence of float
        Frequencies (1, cycles per sample).
    window : ndarray, shape (steps,), optional
        Weights (-) of the samples from which the parts are estimated. None for equal ones.

    Returns
    -------
    ndarray, shape (steps, p)
        The rest, in the unit of the signals.
    """
    if not len(frequencies):
        return signals
    waves = _waves(len(signals), frequencies)
    basis = np.hstack([waves, np.ones((len(signals), 1))])
    seen = basis if window is None else basis * window[:, np.newaxis]
    sizes = np.linalg.lstsq(seen.T @ basis, seen.T @ signals, rcond=1e-12)[0]
    return np.asarray(signals - waves @ sizes[:-1])


def standing_out(reference: Arrays) -> NDArray[np.bool_]:
    """Lines that stand out in a reference, and those next to them, to which a window spreads them.

    Of tones so near to each other that their windows meet only the lines nearest to them, so that what lies between
    them is none of the reference.

    Parameters
    ----------
    reference : ndarray, shape (steps, r)
        Samples (m).

    Returns
    -------
    ndarray of bool, shape (steps // 2 + 1,)
        Whether each line is one of them.
    """
    power = power_of(reference - reference.mean(axis=0))
    around = _around(power)
    out = power > _TONE * np.median(around, axis=1)
    between = np.quantile(around, _BETWEEN, axis=1)
    apart = between < _APART * around.max(axis=1)  # the skirts of lines as near as these reach the median
    nearest = power > _NEAREST * around[:, [_BESIDE - 1, _BESIDE + 1]].max(axis=1)
    one = apart & nearest & (power > _TONE * between)
    some = power > NO_POWER * power.max()
    return np.asarray((np.convolve(out & some, np.ones(5), mode="same") > 0.5) | (one & some))


def is_steady(signals: Arrays, frequency: float) -> bool:
    """Whether a tone changes little over the record."""
    sizes = np.linalg.lstsq(_waves(len(signals), [frequency]), signals, rcond=1e-12)[0]
    return bool(0.5 * np.linalg.norm(sizes[2:]) < _STEADY * np.linalg.norm(sizes[:2]))


def centred(signals: Arrays) -> NDArray[np.bool_]:
    """Lines at which a peak, if there is one, is nearer than a quarter of a line: what a Hann window makes of it."""
    size = np.sqrt(power_of(signals))
    padded = np.pad(size, 1, mode="edge")
    ratio = np.maximum(padded[:-2], padded[2:]) / np.maximum(size, np.finfo(float).tiny)
    return np.asarray((2.0 * ratio - 1.0) / (ratio + 1.0) < _ON_LINE)


def power_of(signals: Arrays) -> Arrays:
    """Of each line behind a Hann window, all signals together."""
    window = np.hanning(len(signals))[:, np.newaxis]
    return np.asarray(np.sum(np.abs(np.fft.rfft(signals * window, axis=0)) ** 2, axis=1))


def _beside(power: Arrays) -> Arrays:
    """Median over the lines to either side of each."""
    return np.asarray(np.median(_around(power), axis=1))


def _around(power: Arrays) -> Arrays:
    """Power of each line and those to either side of it, shape (lines, 2 _BESIDE + 1)."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(power, _BESIDE, mode="reflect"), 2 * _BESIDE + 1)


def _peaks(power: Arrays, least: float) -> NDArray[np.bool_]:
    """Lines that stand out of those beside them, and are the highest of these."""
    lines = (power > least * _beside(power)) & (power >= _around(power).max(axis=1))
    lines[:2] = False  # the mean behind the window
    return np.asarray(lines)


def _tone_at(rest: Arrays, line: int, power: Arrays) -> float | None:
    """Frequency of the tone at a line (cycles per sample); None if it is none."""
    low, high = max(line - _BESIDE, 0), line + _BESIDE + 1
    demodulated = _demodulated(rest, line)
    offset, step = 0.0, 0.5
    left = _left(demodulated, len(rest), line, offset)
    for _ in range(_TURNS):  # halve the interval about the frequency that leaves least
        sides = [offset - step, offset + step]
        left, offset = min([(left, offset), *((_left(demodulated, len(rest), line, side), side) for side in sides)])
        step *= 0.5
    frequency = (line + offset) / len(rest)
    beyond = float(np.sum(power[low:high]) - (high - low) * _beside(power)[line])
    explained = float(np.sum(power[low:high]) - np.sum(power_of(without_tones(rest, [frequency]))[low:high]))
    return frequency if explained > _ONE * beyond else None


def _demodulated(signals: Arrays, line: int) -> Complexes:
    """Signals times exp(-j w t) with w of a line and t from the middle, summed over blocks of time, shape (b, p)."""
    steps = len(signals)
    turned = signals * np.exp(-2j * np.pi * line / steps * (np.arange(steps) - 0.5 * (steps - 1)))[:, np.newaxis]
    return np.asarray(np.add.reduceat(turned, _block_starts(steps)))


def _block_starts(steps: int) -> NDArray[np.int_]:
    return np.unique(np.linspace(0, steps, min(_BLOCKS, steps), endpoint=False).astype(int))


def _left(demodulated: Complexes, steps: int, line: int, offset: float) -> float:
    """Squares that a steady sinusoid so many lines beside a line leaves, but for those of the signals."""
    starts = _block_starts(steps)
    middle = 0.5 * (starts + np.append(starts[1:], steps) - 1) - 0.5 * (steps - 1)
    sums = np.exp(-2j * np.pi * offset / steps * middle) @ demodulated  # along the cosine, and minus the sine
    angle = 2.0 * np.pi * (line + offset) / steps
    double = math.sin(angle * steps) / math.sin(angle) if abs(math.sin(angle)) > _SMALL else float(steps)
    squares = [max(0.5 * (steps + sign * double), _SMALL) for sign in (1.0, -1.0)]  # of the cosine and the sine
    return -float(np.sum(sums.real**2) / squares[0] + np.sum(sums.imag**2) / squares[1])


def _waves(steps: int, frequencies: Sequence[float]) -> Arrays:
    """Sinusoids of these frequencies, and their products with time, shape (steps, 4 f)."""
    place = np.arange(steps)[:, np.newaxis] - 0.5 * (steps - 1)
    angle = 2.0 * np.pi * place * np.array(frequencies)
    steady = np.hstack([np.cos(angle), np.sin(angle)])
    return np.asarray(np.hstack([steady, steady * (place / steps)]))
