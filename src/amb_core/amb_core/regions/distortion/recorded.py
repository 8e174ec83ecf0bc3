"""Distortion from a recording: periodic parts, realisations and excited lines are found in its reference."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from amb_core.ground.errors import SpectrumError
from amb_core.ground.units import UM
from amb_core.loop.records import LoopRecord
from amb_core.regions.distortion.measurement import PeriodicResponse, check_responses, distortion_of
from amb_core.regions.distortion.periods import (
    FEWEST_LINES,
    excited_lines,
    find_periodic_parts,
    settled_responses,
    without_repetitions,
)
from amb_core.regions.distortion.records import axes_of
from amb_core.regions.distortion.result import Distortion

_SAME_AMPLITUDE = 0.5  # difference of the rms of two realisations, which for one peak differ by their crest factors
NEEDED = (
    "needed: two whole periods or more of a multisine, in three realisations (seeds) or more, or in one that leaves "
    "out lines, such as a multisine with odd = true and periods = 3"
)
"""What a recording must hold, for messages."""


def measure_recorded(records: Sequence[LoopRecord]) -> Distortion:
    """Measure the distortions in recorded samples of a loop.

    Several realisations of one multisine give the robust method, one of them with lines left out the fast one. The
    first 0.1 s of each are left out where two periods remain; otherwise a transient counts as noise.

    Parameters
    ----------
    records : sequence of LoopRecord
        Consecutive samples each, of one loop under signals of one amplitude and band.

    Returns
    -------
    Distortion
        Linear response, distortions and noise.

    Raises
    ------
    SpectrumError
        If the recording does not permit it, or the records are not of one machine; the message says what is needed.
    """
    axes = axes_of(records)
    records = _usable(records)
    period, parts = find_periodic_parts([record.reference for record in records])
    if not parts:
        raise SpectrumError(f"the reference repeats no period of its own; {NEEDED}")
    responses = settled_responses(records, period, parts)
    if not all(np.isfinite(item.position).all() and np.isfinite(item.current).all() for item in responses):
        raise SpectrumError("a position or current is not finite in the periods that the reference repeats")
    check_responses(responses, axes)
    sample_time = records[0].sample_time
    responses = without_repetitions(responses)
    _check_amplitudes(responses)
    lines = excited_lines(responses)
    if len(lines.excited) < FEWEST_LINES:
        raise SpectrumError(
            f"the reference has {len(lines.excited)} lines in its period of {period * sample_time:g} s, a multisine "
            f"has {FEWEST_LINES} or more; {NEEDED}"
        )
    try:
        return distortion_of(responses, lines, sample_time, axes)
    except SpectrumError as problem:
        raise SpectrumError(f"{problem}; its period is {period * sample_time:g} s; {NEEDED}") from None


def periodic_once(records: Sequence[LoopRecord]) -> list[LoopRecord]:
    """The records, where the reference repeats only the last period of each part: repetitions show no distortion."""
    usable = _usable(records)
    period, parts = find_periodic_parts([record.reference for record in usable])
    if not parts:
        return list(records)
    last = [(usable[part.record], part.start + (part.periods - 1) * period) for part in parts]
    return [record.window(record.first_step + start, period) for record, start in last]


def _usable(records: Sequence[LoopRecord]) -> list[LoopRecord]:
    """The records in which a period can be searched for."""
    return [record for record in records if record.steps and np.isfinite(record.reference).all()]


def _check_amplitudes(responses: Sequence[PeriodicResponse]) -> None:
    """Distortion depends on the amplitude, so all realisations must have the same."""
    rms = [float(np.sqrt(np.sum(np.var(item.reference, axis=0)))) for item in responses]
    if max(rms) > (1.0 + _SAME_AMPLITUDE) * min(rms):
        raise SpectrumError(
            f"the reference's rms is {UM * min(rms):.3g} um in one realisation and {UM * max(rms):.3g} um in another; "
            f"allowed: a difference of {100 * _SAME_AMPLITUDE:.0f} %; choose the steps of one amplitude"
        )
