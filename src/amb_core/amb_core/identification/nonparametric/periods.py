"""Responses averaged over the whole periods of a periodic reference: free of leakage, at the lines of the reference.

Each part of a recording in which the reference repeats is averaged over its settled periods. Where the parts together
separate the references at a line, the line is determined by itself. Otherwise, as with different signals on all axes
at once, by itself or on lines of their own (interleaved), the closed loop's response to each reference is a polynomial
over a few neighbouring lines.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import SpectrumError
from amb_core.identification.nonparametric.by_references import ByReferences, Complex, Signals, from_sums
from amb_core.regions.distortion.local_fit import fit_between_lines
from amb_core.regions.distortion.periods import EXCITED, SETTLING, PeriodicPart, find_periodic_parts, periodic_parts

_MOSTLY = 0.5  # part of the moving reference that must be periodic
_FREE_TERMS = 6.0  # of the noise at a line, from which the deviations are known well enough
_OF_ITS_OWN = 0.5  # part of the excited lines that must be determined each by itself
_MOST_LINES = 2_000  # at which polynomials are fitted


def over_periods(experiments: Sequence[Signals], sample_time: float, period: int | None = None) -> ByReferences | None:
    """Responses at the lines of the references; None if these are not periodic or do not separate the axes.

    Parameters
    ----------
    experiments : sequence of Signals
        The signals of each.
    sample_time : float
        Sample time (s).
    period : int, optional
        Period of the references (samples); by default it is found.
    """
    references = [item.references for item in experiments]
    if period is None:
        period, parts = find_periodic_parts(references)
    else:
        parts = periodic_parts(references, period)
    if not parts or period * sum(part.periods for part in parts) < _MOSTLY * sum(map(_moving, references)):
        return None
    settled = [_settled(part, period, sample_time) for part in parts]
    spectra = [  # of each part: periods, lines, signals
        np.fft.rfft(
            experiments[part.record]
            .all[part.start : part.start + part.periods * period]
            .reshape(part.periods, period, -1),
            axis=1,
        )[:, 1 : (period + 1) // 2]
        for part in settled
    ]
    count, columns = sum(map(len, spectra)), references[0].shape[1]
    frequency = np.arange(1, spectra[0].shape[1] + 1) / (period * sample_time)
    method = f"average of {count} period{'s' * (count > 1)} of {period * sample_time:g} s"
    stacked = np.concatenate(spectra)
    sums = np.einsum("lfi,lfj->fij", stacked, stacked.conj())
    strength = np.abs(stacked[..., :columns]).max(axis=(0, 2))
    excited = np.flatnonzero(strength > EXCITED * strength.max())
    by_line = from_sums(frequency, sums, float(count), columns, method, _FREE_TERMS)
    if len(by_line.frequency) >= _OF_ITS_OWN * len(excited):
        return by_line
    return _between(excited, frequency, spectra, columns, method)


def _between(
    excited: NDArray[np.int_], frequency: NDArray[np.float64], spectra: Sequence[Complex], columns: int, method: str
) -> ByReferences | None:
    """By polynomials over neighbouring lines, from the mean of each part; None if they do not separate the axes."""
    # The mean of n periods has 1 / n of the noise of one; so weighted, all parts have that of one.
    means = np.stack([np.sqrt(len(part)) * part.mean(axis=0)[excited] for part in spectra], axis=-1)
    try:
        local = fit_between_lines(excited, means[:, :columns], means[:, columns:], _MOST_LINES)
    except SpectrumError:
        return None
    kept = local.independent
    if not kept.any():
        return None
    share = np.diagonal(local.noise[kept], axis1=1, axis2=2).real / np.maximum(local.power[kept], np.finfo(float).tiny)
    return ByReferences(
        frequency[excited][local.at[kept]],
        local.response[kept],
        local.noise[kept],
        local.weights[kept],
        np.clip(1.0 - share, 0.0, 1.0),
        float(local.free),
        f"{method}, fitted between lines",
    )


def _settled(part: PeriodicPart, period: int, sample_time: float) -> PeriodicPart:
    """The part without the periods in which transients decay: one or more, as long as one remains."""
    transient = max(1, -(-round(SETTLING / sample_time) // period))
    left_out = min(transient, part.periods - 1)
    return PeriodicPart(part.record, part.start + left_out * period, part.periods - left_out)


def _moving(reference: NDArray[np.float64]) -> int:
    """Samples from the first to the last movement of a reference."""
    changes = np.flatnonzero(np.any(np.diff(reference, axis=0) != 0.0, axis=1))
    return int(changes[-1] - changes[0]) + 2 if len(changes) else 0
