"""Coherence of the position with the references: what any recording shows, noise and distortion together.

In a band of neighbouring lines of the spectrum over the whole record, the response to each reference and the transient
from the past before the record are quadratics of the line's number. What such a smooth response leaves is noise,
distortion, and what else moves the rotor. Its power is divided by the number of lines less that of the unknowns: a
multiple coherence of few segments is too large by their ratio otherwise.

A reference of few lines, such as a slow square wave's, can be followed by any response at these lines, and the
distortion with it. Bands are therefore made wider until each reference has lines enough, and if that takes too wide
ones, there is no coherence.

Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, section
7.2 (local polynomial method); J. S. Bendat and A. G. Piersol, Random Data, 4th ed., Wiley, 2010, section 7.3 (multiple
coherence) and 9.2 (its bias).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import SpectrumError
from amb_core.ground.results import Result, plain, rows_by_axis
from amb_core.loop.records import LoopRecord
from amb_core.regions.distortion.records import axes_of, moving, require_motion

_DEGREE = 2
_LINES_PER_BAND = 24  # at least; two for each unknown of a machine of more axes
_NARROWEST_BAND = 5.0  # Hz; a narrower one could follow a sweep's harmonics as if they were late answers
_WIDEST_BAND = 30.0  # Hz, within which a bearing's response is taken as a quadratic
_REFERENCE_POWER = 0.999  # part of it that lies below the end of the band
_LINES_PER_UNKNOWN = 2.0  # of a reference in a band
_ENOUGH = 0.9  # part of the power of the reference in bands with that many
_NEGLIGIBLE = 1e-9  # singular value of the regressors of a band
_FEWEST_STEPS = 3  # that have a line of the spectrum above 0

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False, repr=False)
class Coherence(Result):
    """Which part of the motion a linear response to the references explains, over frequency and as a whole.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes, in the order of the arrays below.
    frequency : ndarray, shape (bands,)
        Centres of the bands (Hz).
    coherence : ndarray, shape (bands, axes)
        Multiple coherence of the positions with the references, corrected for the number of lines, 0 to 1 (-).
    explained, rest : ndarray, shape (axes,)
        Root mean square of the motion that the references explain in these bands, and of the rest (m); NaN for an axis
        whose reference does not move.
    width : float
        Width of a band (Hz).
    """

    axes: tuple[str, ...]
    frequency: NDArray[np.float64]
    coherence: NDArray[np.float64]
    explained: NDArray[np.float64]
    rest: NDArray[np.float64]
    width: float

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Noise and distortion over the explained motion, shape (axes,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.rest / self.explained)

    @property
    def overall(self) -> NDArray[np.float64]:
        """Coherence of all bands together, weighted by the power of the motion, shape (axes,)."""
        return np.asarray(1.0 / (1.0 + self.ratio**2))

    @property
    def brief(self) -> str:
        """The number of each axis in a few words."""
        known = [(name, ratio) for name, ratio in zip(self.axes, self.ratio, strict=True) if not np.isnan(ratio)]
        shares = (
            (name, f"{100.0 * ratio:.2g} %" if np.isfinite(ratio) else "all of the motion") for name, ratio in known
        )
        return "noise and distortion together " + ", ".join(f"{share} on {name}" for name, share in shares)

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The numbers of each axis."""
        return rows_by_axis(self.as_dict())

    @property
    def summary(self) -> str:
        """One line for people."""
        known = [(name, value) for name, value in zip(self.axes, self.overall, strict=True) if not np.isnan(value)]
        values = ", ".join(f"{value:.3f} on {name}" for name, value in known)
        return f"coherence of the position with the reference: {values} ({self.brief}, over the explained motion)"

    def as_dict(self) -> dict[str, dict[str, float | None]]:
        """Numbers of each axis, as plain values for strict JSON; None where there is none.

        Returns
        -------
        dict of str to dict of str to float or None
            Values by axis and name.
        """
        return {
            name: {
                "coherence": plain(self.overall[axis]),
                "lowest_coherence": plain(self.coherence[:, axis].min()),
                "noise_and_distortion_percent": plain(100.0 * self.ratio[axis]),
            }
            for axis, name in enumerate(self.axes)
        }


def measure_coherence(records: Sequence[LoopRecord]) -> Coherence:
    """Measure the coherence of the positions with all references together over the band of the references.

    Parameters
    ----------
    records : sequence of LoopRecord
        Consecutive samples each; the longest one is used.

    Returns
    -------
    Coherence
        Coherence over frequency, and explained motion.

    Raises
    ------
    SpectrumError
        If a sample is not finite, the records are not of one machine, there are fewer than 3 steps, the reference does
        not move or has too few lines, or a position stands still while its reference moves.
    """
    if not records:
        raise SpectrumError("no coherence: there are no samples")
    axes = axes_of(records)
    record = max(records, key=lambda item: item.steps)
    if record.steps < _FEWEST_STEPS:
        raise SpectrumError(f"no coherence: steps in the record: {record.steps}; needed: {_FEWEST_STEPS} or more")
    if not (np.isfinite(record.reference).all() and np.isfinite(record.position).all()):
        raise SpectrumError("no coherence: a reference or position is not finite")
    excited = moving(record.reference)
    if not excited.any():
        raise SpectrumError("no coherence: the reference does not move")
    require_motion(axes, record.reference, record.position)
    resolution = 1.0 / (record.steps * record.sample_time)
    reference = _lines(record.reference[:, excited])
    reference /= np.sqrt((np.abs(reference) ** 2).mean(axis=0))
    bands = _bands(reference, resolution)
    position = _lines(record.position)
    answered, rest = (np.array(part) for part in zip(*(_fit(reference[b], position[b]) for b in bands), strict=True))
    total = answered + rest
    with np.errstate(invalid="ignore", divide="ignore"):
        coherence = np.clip(np.where(total > 0.0, answered / total, 0.0), 0.0, 1.0)
    for values in (coherence, answered, rest):
        values[:, ~excited] = np.nan
    return Coherence(
        axes=axes,
        frequency=resolution * np.array([1 + 0.5 * (b.start + b.stop - 1) for b in bands]),
        coherence=coherence,
        explained=np.sqrt(np.maximum(answered.sum(axis=0), 0.0)),
        rest=np.sqrt(rest.sum(axis=0)),
        width=resolution * (bands[0].stop - bands[0].start),
    )


def _lines(signal: NDArray[np.float64]) -> Complex:
    """Lines of the spectrum above 0; the sum of their squared magnitudes is the variance."""
    steps = len(signal)
    return np.asarray(np.fft.rfft(signal, axis=0)[1 : (steps + 1) // 2] * (np.sqrt(2.0) / steps))


def _bands(reference: Complex, resolution: float) -> list[slice]:
    """Bands of equal width up to the end of the references' band, with lines enough of each reference."""
    power = np.abs(reference) ** 2
    share = np.cumsum(power.sum(axis=1))
    end = int(np.searchsorted(share, _REFERENCE_POWER * share[-1])) + 1
    fewest = max(_LINES_PER_BAND, 2 * (_DEGREE + 1) * (reference.shape[1] + 1))
    width = max(fewest, round(_NARROWEST_BAND / resolution))
    widest = max(width, int(_WIDEST_BAND / resolution))
    while True:
        edges = np.linspace(0, end, max(1, end // width) + 1).astype(int)
        bands = [slice(start, stop) for start, stop in itertools.pairwise(edges.tolist())]
        rich = np.array([[_rich(power[b, column]) for column in range(power.shape[1])] for b in bands])
        held = np.array([power[b].sum(axis=0) for b in bands])
        if len(bands) > 1 and np.all((rich * held).sum(axis=0) >= _ENOUGH * held.sum(axis=0)):
            break
        if width >= widest or end // (2 * width) < 1:
            raise SpectrumError(
                f"no coherence: the reference has too few lines for its response within {_WIDEST_BAND:g} Hz; needed: "
                "a sweep, a multisine, PRBS or noise of a second or more"
            )
        width = min(2 * width, widest)
    if resolution * width > _WIDEST_BAND:
        raise SpectrumError(
            f"no coherence: the record is too short for bands of {_WIDEST_BAND:g} Hz; "
            f"needed: {fewest / _WIDEST_BAND:g} s or more"
        )
    return bands


def _rich(power: NDArray[np.float64]) -> bool:
    """Whether a reference has lines enough in a band; their effective number is (sum of p)^2 over the sum of p^2."""
    squares = float(np.sum(power**2))
    return squares > 0.0 and float(np.sum(power)) ** 2 / squares >= _LINES_PER_UNKNOWN * (_DEGREE + 1)


def _fit(reference: Complex, position: Complex) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Power of the positions in a band that the references explain, and of the rest, without bias.

    What the transient from before the record explains is left out of both.
    """
    count = len(reference)
    powers = np.linspace(-1.0, 1.0, count)[:, np.newaxis] ** np.arange(_DEGREE + 1)
    transient = np.linalg.qr(powers)[0]
    columns = np.hstack([powers * column[:, np.newaxis] for column in reference.T])
    moved, columns = (part - transient @ (transient.T @ part) for part in (position, columns))
    basis, strengths, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, strengths > _NEGLIGIBLE * max(strengths[0], 1.0)]
    left = moved - basis @ (basis.conj().T @ moved)
    free = count - transient.shape[1]
    rest = (np.abs(left) ** 2).sum(axis=0) / (free - basis.shape[1])  # of a line
    return ((np.abs(moved) ** 2).sum(axis=0) / free - rest) * count, rest * count
