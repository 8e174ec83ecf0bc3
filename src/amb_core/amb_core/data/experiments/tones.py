"""Tones that the reference lacks: lines of an unbalance or of the mains, disturbances that say nothing of the plant.

In prediction errors they are set apart. From data of a loop they are removed before a model is estimated: an
undamped oscillation would stand in the model otherwise, as if the plant had it. Taken from inputs, outputs and
reference alike, as a notch filter would, they leave the responses between these as they are.

A tone stands out of the lines beside it, and one sinusoid explains it: unlike a lightly damped mode that noise drives,
which spreads over the lines of its bandwidth. Tones seldom have the frequency of a line, so that a rectangular window
spreads them over many: they are found behind a Hann window and subtracted by least squares, with an amplitude that may
change evenly over the record.

Source: D. C. Rife and R. R. Boorstyn, Single-tone parameter estimation from discrete-time observations, IEEE
Transactions on Information Theory 20 (1974).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.experiment import Experiment
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.regions.distortion.periods import find_periodic_parts

Arrays = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_BESIDE = 8  # lines to either side that are compared with
_TONE = 12.0  # power of a line over that of those beside it
_ONE = 0.9  # of the power about the line beyond the level beside it, that one sinusoid explains
_MOST = 20  # tones
_PASSES = 3
_BLOCKS = 1024  # of time: a line or less beside another one, phases change little within
_SMALL = 1e-9  # of sums of squares at half the sample rate
_TURNS = 12  # halvings of the search for a frequency
_FADED = 1e-4  # of its start, that is left of a transient of the predictor
_FEWEST = 8 * _BESIDE  # samples
_NO_POWER = 1e-8  # of the largest line of the reference
_CLEAR = 30.0  # power over that of the lines beside it, of a tone that is removed from data
_STEADY = 0.3  # of a tone's amplitude, that it changes from the middle of a record to its ends
_ON_LINE = 0.25  # lines, from a multiple of the frequency of a reference
_SEGMENT, _SEGMENTS = 0.2, 8  # s, over which a bearing answers, and their number at least


@dataclass(frozen=True)
class Tone:
    """A tone of the prediction errors.

    Attributes
    ----------
    frequency : float
        Its frequency (Hz).
    share : float
        What it has of the variance of the errors, of the output in which that is most (-).
    """

    frequency: float
    share: float


@dataclass(frozen=True)
class Tones:
    """Tones of several signals of one experiment.

    Attributes
    ----------
    frequencies : tuple of float
        Their frequencies (cycles per sample), the strongest first.
    shares : tuple of float
        What each has of the variance of the signals, of the signal in which that is most (-).
    rest : ndarray, shape (steps, p)
        The signals without tones and means.
    """

    frequencies: tuple[float, ...]
    shares: tuple[float, ...]
    rest: Arrays


@dataclass(frozen=True)
class Undisturbed:
    """Prediction errors of an experiment without tones that its reference lacks.

    Attributes
    ----------
    first : int
        Sample of the experiment with which they begin: at its start the predictor answers to a tone with a transient.
    errors : ndarray, shape (steps, p)
        The errors from there on.
    tones : tuple of Tone
        The tones, the strongest first.
    """

    first: int
    errors: Arrays
    tones: tuple[Tone, ...]


@dataclass(frozen=True)
class ToneCure:
    """Tones that were removed from data.

    Attributes
    ----------
    data : IdentificationData
        The data without them.
    frequencies : tuple of float
        Their frequencies (Hz), rising.
    """

    data: IdentificationData
    frequencies: tuple[float, ...]

    @property
    def summary(self) -> str:
        """What was done, as a phrase."""
        shown = ", ".join(f"{frequency:.4g}" for frequency in self.frequencies[:4])
        more = " ..." if len(self.frequencies) > 4 else ""
        return f"tones removed that the reference lacks, as of an unbalance: {shown}{more} Hz"


def cure_tones(data: IdentificationData) -> ToneCure | None:
    """Remove steady tones from all signals that stand out of what the reference does not explain of the outputs.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values; experiments without reference stay as they are.

    Returns
    -------
    ToneCure or None
        The data without tones; None if there are none.
    """
    experiments, found = list[Experiment](), set[float]()
    for item in data.experiments:
        frequencies = _unanswered(item, data.sample_time)
        found |= {frequency / data.sample_time for frequency in frequencies}
        experiments.append(_without(item, frequencies) if frequencies else item)
    return ToneCure(replace(data, experiments=tuple(experiments)), tuple(sorted(found))) if found else None


def without_unanswered(data: IdentificationData) -> IdentificationData:
    """Data without the tones that `cure_tones` removes."""
    cure = cure_tones(data)
    return data if cure is None else cure.data


def _without(item: Experiment, frequencies: Sequence[float]) -> Experiment:
    """An experiment without tones.

    The window leaves no weight to its ends: what differs there, as from a start at rest, would count as part of the
    tones, and not in the same ratio in inputs and outputs.
    """
    assert item.reference is not None
    inputs, outputs, reference = (
        without_tones(signal, frequencies, np.hanning(item.steps))
        for signal in (item.inputs, item.outputs, item.reference)
    )
    return replace(item, inputs=inputs, outputs=outputs, reference=reference)


def _unanswered(item: Experiment, sample_time: float) -> list[float]:
    """Tones of the outputs (cycles per sample) that no smooth response to the reference explains, of steady amplitude.

    A mode so narrow that it looks like a tone rings up and down within the record. Multiples of the frequency of a
    periodic reference are distortion.
    """
    reference = item.reference
    if reference is None or item.steps < _FEWEST or not np.ptp(reference, axis=0).any():
        return []
    outputs, given = (each / max(float(np.abs(each).max()), np.finfo(float).tiny) for each in (item.outputs, reference))
    outputs, given = outputs - outputs.mean(axis=0), given - given.mean(axis=0)
    own, multiples = standing_out(given), _multiples_of(given)
    explained = own | (multiples & _centred(outputs))
    about = without_tones(outputs, find_tones(outputs, explained, _CLEAR).frequencies)  # they would count as answers
    left = outputs - _answer(about, given, sample_time)
    found = find_tones(left, own | (multiples & _centred(left)), _CLEAR)
    return [frequency for frequency in found.frequencies if _is_steady(left, frequency)]


def _multiples_of(reference: Arrays) -> NDArray[np.bool_]:
    """Lines nearest to multiples of the frequency of a periodic reference; none of another one."""
    lines = np.zeros(len(reference) // 2 + 1, dtype=bool)
    period, parts = find_periodic_parts([reference])
    if period * sum(part.periods for part in parts) > len(reference) / 2:
        multiples = np.arange(period // 2 + 1) * len(reference) / period
        lines[np.round(multiples).astype(int).clip(max=len(lines) - 1)] = True
    return lines


def _centred(signals: Arrays) -> NDArray[np.bool_]:
    """Lines at which a peak, if there is one, is nearer than a quarter of a line: what a Hann window makes of it."""
    size = np.sqrt(_power(signals))
    padded = np.pad(size, 1, mode="edge")
    ratio = np.maximum(padded[:-2], padded[2:]) / np.maximum(size, np.finfo(float).tiny)
    return np.asarray((2.0 * ratio - 1.0) / (ratio + 1.0) < _ON_LINE)


def _answer(outputs: Arrays, reference: Arrays, sample_time: float) -> Arrays:
    """What a response to the reference explains that is smooth over some hertz, from averages over segments."""
    size = max(min(round(_SEGMENT / sample_time), len(outputs) // _SEGMENTS), 2)
    window = np.hanning(size)[:, np.newaxis]
    lines, given, moved = size // 2 + 1, reference.shape[1], outputs.shape[1]
    of_reference, of_outputs = np.zeros((lines, given, given), complex), np.zeros((lines, moved, given), complex)
    for start in range(0, len(outputs) - size + 1, max(size // 2, 1)):
        r, y = (np.fft.rfft(window * one[start : start + size], axis=0) for one in (reference, outputs))
        of_reference += r[:, :, np.newaxis] * r[:, np.newaxis].conj()
        of_outputs += y[:, :, np.newaxis] * r[:, np.newaxis].conj()
    least = _NO_POWER * np.trace(of_reference, axis1=1, axis2=2).real.max() * np.eye(given)
    response = np.fft.irfft(of_outputs @ np.linalg.inv(of_reference + least), size, axis=0)
    response = np.roll(response, size // 2, axis=0)  # its second half is what comes before the reference
    length = 1 << (len(outputs) + size).bit_length()
    spectrum, gains = np.fft.rfft(reference, length, axis=0), np.fft.rfft(response, length, axis=0)
    whole = np.fft.irfft(np.einsum("kij,kj->ki", gains, spectrum), length, axis=0)
    return np.asarray(whole[size // 2 : size // 2 + len(outputs)])


def _is_steady(signals: Arrays, frequency: float) -> bool:
    """Whether a tone changes little over the record."""
    sizes = np.linalg.lstsq(_waves(len(signals), [frequency]), signals, rcond=1e-12)[0]
    return bool(0.5 * np.linalg.norm(sizes[2:]) < _STEADY * np.linalg.norm(sizes[:2]))


def undisturbed(model: StateSpaceModel, errors: Arrays, reference: Arrays | None) -> Undisturbed:
    """Prediction errors of an experiment, shape (steps, p), without tones.

    Without a reference a tone cannot be told from what the model does not follow, and stays.
    """
    if reference is None or not find_tones(errors, standing_out(reference)).frequencies:
        return Undisturbed(0, errors, ())
    radius = float(np.abs(np.linalg.eigvals(model.a - model.k @ model.c)).max(initial=0.0))
    memory = math.ceil(math.log(_FADED) / math.log(radius)) if radius > 0.0 else 1
    first = min(memory, len(errors) // 4)
    tones_of_errors = find_tones(errors[first:], standing_out(reference[first:]))
    tones = zip(tones_of_errors.frequencies, tones_of_errors.shares, strict=True)
    return Undisturbed(
        first, tones_of_errors.rest, tuple(Tone(each / model.sample_time, share) for each, share in tones)
    )


def find_tones(signals: Arrays, given: NDArray[np.bool_] | None = None, least: float = _TONE) -> Tones:
    """The tones of signals, shape (steps, p).

    Those at given lines, shape (steps // 2 + 1,), are left out. `least` is the power of a line over that of those
    beside it.
    """
    whole = signals - signals.mean(axis=0)
    size = np.maximum(whole.std(axis=0), np.finfo(float).tiny)
    rest, frequencies = whole / size, list[float]()
    if len(rest) < _FEWEST:
        return Tones((), (), whole)
    for _ in range(_PASSES):
        power = _power(rest)
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
    """Signals, shape (steps, p), without their parts of these frequencies (cycles per sample).

    Of their parts as they are behind a window, if there is one.
    """
    if not len(frequencies):
        return signals
    waves = _waves(len(signals), frequencies)
    basis = np.hstack([waves, np.ones((len(signals), 1))])
    seen = basis if window is None else basis * window[:, np.newaxis]
    sizes = np.linalg.lstsq(seen.T @ basis, seen.T @ signals, rcond=1e-12)[0]
    return np.asarray(signals - waves @ sizes[:-1])


def _power(signals: Arrays) -> Arrays:
    """Of each line behind a Hann window, all signals together."""
    window = np.hanning(len(signals))[:, np.newaxis]
    return np.asarray(np.sum(np.abs(np.fft.rfft(signals * window, axis=0)) ** 2, axis=1))


def _beside(power: Arrays) -> Arrays:
    """Median over the lines to either side of each."""
    padded = np.pad(power, _BESIDE, mode="reflect")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _BESIDE + 1), axis=1))


def _peaks(power: Arrays, least: float) -> NDArray[np.bool_]:
    """Lines that stand out of those beside them, and are the highest of these."""
    padded = np.pad(power, _BESIDE, mode="reflect")
    highest = np.lib.stride_tricks.sliding_window_view(padded, 2 * _BESIDE + 1).max(axis=1)
    lines = (power > least * _beside(power)) & (power >= highest)
    lines[:2] = False  # the mean behind the window
    return np.asarray(lines)


def standing_out(reference: Arrays) -> NDArray[np.bool_]:
    """Lines that stand out in a reference, and those next to them, to which a window spreads them."""
    power = _power(reference - reference.mean(axis=0))
    out = (power > _TONE * _beside(power)) & (power > _NO_POWER * power.max())
    return np.asarray(np.convolve(out, np.ones(5), mode="same") > 0.5)


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
    explained = float(np.sum(power[low:high]) - np.sum(_power(without_tones(rest, [frequency]))[low:high]))
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
