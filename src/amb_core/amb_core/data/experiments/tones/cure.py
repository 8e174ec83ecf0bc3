"""Tones that the reference lacks are removed from data: disturbances that say nothing of the plant.

An undamped oscillation would stand in a model otherwise, as if the plant had it. Taken from inputs, outputs and
reference alike, as a notch filter would, they leave the responses between these as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.experiment import Experiment
from amb_core.data.experiments.tones.find import (
    FEWEST,
    NO_POWER,
    Arrays,
    centred,
    find_tones,
    is_steady,
    standing_out,
    without_tones,
)
from amb_core.regions.distortion.periods import find_periodic_parts

_CLEAR = 30.0  # power over that of the lines beside it, of a tone that is removed from data
_SEGMENT, _SEGMENTS = 0.2, 8  # s, over which a bearing answers, and their number at least


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
    """Data without the tones that `cure_tones` removes.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.

    Returns
    -------
    IdentificationData
        The data, as they are if there are no such tones.
    """
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
    if reference is None or item.steps < FEWEST or not np.ptp(reference, axis=0).any():
        return []
    outputs, given = (
        each / np.maximum(np.abs(each).max(axis=0), np.finfo(float).tiny) for each in (item.outputs, reference)
    )
    outputs, given = outputs - outputs.mean(axis=0), given - given.mean(axis=0)
    own, multiples = standing_out(given), _multiples_of(given)
    explained = own | (multiples & centred(outputs))
    about = without_tones(outputs, find_tones(outputs, explained, _CLEAR).frequencies)  # they would count as answers
    left = outputs - _answer(about, given, sample_time)
    found = find_tones(left, own | (multiples & centred(left)), _CLEAR)
    return [frequency for frequency in found.frequencies if is_steady(left, frequency)]


def _multiples_of(reference: Arrays) -> NDArray[np.bool_]:
    """Lines nearest to multiples of the frequency of a periodic reference; none of another one."""
    lines = np.zeros(len(reference) // 2 + 1, dtype=bool)
    period, parts = find_periodic_parts([reference])
    if period * sum(part.periods for part in parts) > len(reference) / 2:
        multiples = np.arange(period // 2 + 1) * len(reference) / period
        lines[np.round(multiples).astype(int).clip(max=len(lines) - 1)] = True
    return lines


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
    least = NO_POWER * np.trace(of_reference, axis1=1, axis2=2).real.max() * np.eye(given)
    response = np.fft.irfft(of_outputs @ np.linalg.inv(of_reference + least), size, axis=0)
    response = np.roll(response, size // 2, axis=0)  # its second half is what comes before the reference
    length = 1 << (len(outputs) + size).bit_length()
    spectrum, gains = np.fft.rfft(reference, length, axis=0), np.fft.rfft(response, length, axis=0)
    whole = np.fft.irfft(np.einsum("kij,kj->ki", gains, spectrum), length, axis=0)
    return np.asarray(whole[size // 2 : size // 2 + len(outputs)])
