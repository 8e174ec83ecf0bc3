"""Frequency response of the plant without a model: in closed loop indirect, from the reference; else from the inputs.

Correlating inputs u and outputs y of the plant with the noise u carries by feedback gives a mixture of plant and
controller. Correlated with the reference r, which contains no noise, both give the plant:

    S_yr = G_yr S_rr,  S_ur = G_ur S_rr,  G = G_yr G_ur^-1 = S_yr S_ur^-1.

With p references for m inputs, p > m, this becomes G = S_yr W (S_ur W)^-1, W = S_rr^-1 S_ru: least squares. In open
loop the inputs themselves contain no noise of the outputs and take the place of r, so that G = S_yu S_uu^-1.

The references (or inputs) must be independent: use one after the other, different signals, or several experiments. The
cross-spectra S are sums of products of Fourier coefficients over

- the periods of a periodic reference, each exactly one period long and taken after the loop has settled: free of
  leakage, at the lines of the reference alone; or, if that does not determine G,
- neighbouring frequencies, of whole experiments with Hann windows: for any broadband reference, with the resolution of
  a band and a bias where G bends within it.

With v = y - G u, the disturbance at the output, the elements of the estimate have the variances

    var G_ij = (S_vv)_ii / (L - p) [S_ur^-H S_rr S_ur^-1]_jj

of their complex errors, L being the number of independent terms in the sums (in open loop L - m and S_uu^-1).

Sources: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, sections
2.6, 2.7 and 7.2; L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 6.4 and 13.5.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.identification.data import IdentificationData
from amb_core.identification.frequency_response import FrequencyResponse

_FEWEST_PERIODS = 6
_SETTLING = 0.1  # s, after which transients of a bearing's loop have decayed
_SAME = 1e-6  # difference of reference samples a period apart, relative to their range
_FEWEST_STEPS = 512  # of an experiment
_LINES_PER_BAND = 16
_MOST_BANDS = 2_000
_HANN_CORRELATION = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)  # of neighbouring lines: fewer are independent
_LEAST_POWER = 1e-12  # of the reference at a frequency, relative to the largest
_LEAST_INDEPENDENCE = 1e-6  # smaller eigenvalue of the references' correlation
_LARGEST_ERROR = 0.3  # relative, of the response to the reference and of the plant's, standard deviation


@dataclass(frozen=True, eq=False)
class NonparametricEstimate:
    """Frequency response of the plant at the frequencies at which the data determine it.

    Attributes
    ----------
    response : FrequencyResponse
        The response with its deviations by noise (without the bias by leakage), and the coherence of each output with
        the references or, in open loop, the inputs, corrected for a small number of terms; its label shows how it was
        estimated.
    variance : ndarray, shape (f, p, m)
        Variance of the complex error of each element by noise.
    free_terms : float
        Independent terms from which the variance is estimated, minus those that the estimate itself uses.
    notes : tuple of str
        Frequencies at which the data do not determine it.
    open_loop : bool
        Whether it was estimated from the inputs, which is right in open loop only; else from the references.
    """

    response: FrequencyResponse
    variance: NDArray[np.float64]
    free_terms: float
    notes: tuple[str, ...]
    open_loop: bool = False

    def largest_error(self, level: float) -> float:
        """Ratio of the squared error to `variance` that is exceeded with the probability 1 - level.

        This is half the ratio of a chi-square variable of 2 degrees of freedom to the variance estimated from so many
        terms. It has an F distribution with a quantile in closed form.
        """
        return self.free_terms * float((1.0 - level) ** (-1.0 / self.free_terms) - 1.0)


@dataclass(frozen=True, eq=False)
class _Spectra:
    """Sums z z^H of z = (r, u, y) at each frequency, of `terms` independent ones, with `references` signals r."""

    frequency: NDArray[np.float64]
    sums: NDArray[np.complex128]
    terms: float
    references: int
    method: str


@dataclass(frozen=True, eq=False)
class _Signals:
    """The signals of an experiment: references, or the inputs that take their place, inputs and outputs."""

    references: NDArray[np.float64]
    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]

    @property
    def all(self) -> NDArray[np.float64]:
        return np.hstack([self.references, self.inputs, self.outputs])


def estimate_response(
    data: IdentificationData, period: int | None = None, *, open_loop: bool = False
) -> NonparametricEstimate:
    """Estimate the plant's frequency response from the reference or, in open loop, from the inputs.

    Parameters
    ----------
    data : IdentificationData
        Experiments; those without reference are only used in open loop.
    period : int, optional
        Period of the reference (samples); by default it is found in the data, if there is one.
    open_loop : bool
        Whether the outputs do not act on the inputs; the inputs then serve as references.

    Raises
    ------
    IdentificationError
        If no experiment has a reference, all are too short, or the references cannot separate the inputs.
    """
    moving = [(item.inputs if open_loop else item.reference, item) for item in data.experiments]
    experiments = [_Signals(signals, item.inputs, item.outputs) for signals, item in moving if signals is not None]
    if not experiments:
        raise IdentificationError(
            "the data have no reference; without it the plant cannot be separated from its feedback"
        )
    if max(len(item.inputs) for item in experiments) < _FEWEST_STEPS:
        raise IdentificationError(f"the experiments are too short; {_FEWEST_STEPS} samples of one are needed")
    experiments = [item for item in experiments if len(item.inputs) >= _FEWEST_STEPS]
    period = period or find_period([item.references for item in experiments])
    by_periods = None if period is None else _over_periods(experiments, period, data.sample_time)
    if by_periods is not None and _independent(by_periods).any():
        return _estimate(by_periods, data, open_loop)
    return _estimate(_over_bands(experiments, data.sample_time), data, open_loop)


def find_period(references: Sequence[NDArray[np.float64]]) -> int | None:
    """Shortest period (samples) with which the references of experiments repeat often enough; None if there is none."""
    for samples in references:
        reference = samples - samples.mean(axis=0)
        steps = len(reference)
        spectrum = np.abs(np.fft.rfft(reference, 2 * steps, axis=0)) ** 2
        correlation = np.fft.irfft(spectrum.sum(axis=1))[: steps // 2] / np.arange(steps, steps - steps // 2, -1)
        inner = correlation[1:-1]
        peaks = np.flatnonzero((inner > correlation[:-2]) & (inner >= correlation[2:]) & (inner > 0.5 * correlation[0]))
        for period in peaks + 1:
            if len(_settled_periods(reference, int(period), 0)) >= _FEWEST_PERIODS:
                return int(period)
    return None


def _settled_periods(reference: NDArray[np.float64], period: int, settling: int) -> list[int]:
    """First samples of consecutive whole periods; before each the reference has been periodic for long enough."""
    tolerance = _SAME * np.ptp(reference)
    same = np.all(np.abs(reference[period:] - reference[:-period]) <= tolerance, axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))).reshape(-1, 2)
    more = max(settling - period, 0)
    return [int(first) for start, stop in edges + period for first in range(start + more, stop - period + 1, period)]


def _over_periods(experiments: Sequence[_Signals], period: int, sample_time: float) -> _Spectra | None:
    """Sums over periods at the lines of the reference; None if they are too few."""
    settling = round(_SETTLING / sample_time)
    coefficients = [
        np.fft.rfft(signals[start : start + period], axis=0)[1 : (period + 1) // 2]
        for item, signals in ((item, item.all) for item in experiments)
        for start in _settled_periods(item.references, period, settling)
    ]
    if len(coefficients) < _FEWEST_PERIODS:
        return None
    stacked = np.array(coefficients)
    sums = np.einsum("lfi,lfj->fij", stacked, stacked.conj())
    frequency = np.arange(1, len(sums) + 1) / (period * sample_time)
    terms = float(len(stacked))
    references = experiments[0].references.shape[1]
    return _Spectra(
        frequency, sums, terms, references, f"average of {len(stacked)} periods of {period * sample_time:g} s"
    )


def _over_bands(experiments: Sequence[_Signals], sample_time: float) -> _Spectra:
    """Sums over neighbouring frequencies of all experiments, in bands of one width."""
    total = sum(len(item.inputs) for item in experiments) * sample_time
    bands = int(min(0.5 / sample_time * total / _LINES_PER_BAND, _MOST_BANDS))
    width = 0.5 / sample_time / bands
    size = experiments[0].all.shape[1]
    sums, terms = np.zeros((bands, size, size), dtype=np.complex128), 0.0
    for signals in (item.all for item in experiments):
        steps = len(signals)
        window = np.hanning(steps + 1)[:-1, np.newaxis]
        centred = signals - (window * signals).sum(axis=0) / window.sum()
        lines = np.fft.rfft(window * centred, axis=0) / np.sqrt(steps)
        edges = np.round(np.arange(bands + 1) * width * steps * sample_time).astype(int)
        edges[0] = 2  # the window spreads the mean over the first lines
        for band, (start, stop) in enumerate(itertools.pairwise(edges)):
            sums[band] += lines[start:stop].T @ lines[start:stop].conj()
        terms += width * steps * sample_time
    terms /= _HANN_CORRELATION
    method = f"smoothed over {width:.3g} Hz, Hann window"
    references = experiments[0].references.shape[1]
    return _Spectra(width * np.linspace(0.5, bands - 0.5, bands), sums, terms, references, method)


def _independent(spectra: _Spectra) -> NDArray[np.bool_]:
    """Whether all references have power at a frequency and are not multiples of one another; shape (f,)."""
    references = spectra.references
    power = spectra.sums[:, :references, :references]
    own = np.diagonal(power, axis1=1, axis2=2).real
    strong = np.all(own > _LEAST_POWER * own.max(axis=0), axis=1) & np.all(own > 0.0, axis=1)
    scale = np.sqrt(np.where(strong[:, np.newaxis], own, 1.0))
    correlation = np.where(strong[:, np.newaxis, np.newaxis], power, 0.0) / (scale[:, :, None] * scale[:, None, :])
    return strong & (np.linalg.eigvalsh(correlation)[:, 0] > _LEAST_INDEPENDENCE)


def _estimate(spectra: _Spectra, data: IdentificationData, open_loop: bool) -> NonparametricEstimate:
    """The response at the frequencies at which it is determined, with its variance."""
    m, references = len(data.input_names), spectra.references
    independent = _independent(spectra)
    free = spectra.terms - references
    if references < m:
        raise IdentificationError(
            f"the frequency response is not determined: {m} inputs need as many references, there are {references}"
        )
    if not independent.any() or free < 1.0:
        raise IdentificationError(
            f"the frequency response is not determined: the {'inputs' if open_loop else 'references of the axes'} are "
            "not independent; excite the axes one after the other, by different signals, or in several experiments"
        )
    sums = spectra.sums[independent]
    r, u, y = slice(0, references), slice(references, references + m), slice(references + m, None)
    inverse = np.linalg.inv(sums[:, r, r])
    to_inputs = sums[:, u, r] @ inverse
    input_noise = _residual(sums[:, u, u], to_inputs, sums[:, u, r], sums[:, r, r]) / free
    worst = np.sqrt(np.linalg.eigvalsh(inverse)[:, -1] * np.trace(input_noise, axis1=1, axis2=2).real)
    known = worst < _LARGEST_ERROR * np.linalg.svd(to_inputs, compute_uv=False)[:, -1]
    answering = _right_inverse(sums[known], to_inputs[known], r, u)
    sums = sums[known]
    response = sums[:, y, r] @ answering
    noise = _residual(sums[:, y, y], response, sums[:, y, u], sums[:, u, u]) / free
    spread = np.swapaxes(answering.conj(), 1, 2) @ sums[:, r, r] @ answering
    variance = _diagonals(noise)[:, :, np.newaxis] * _diagonals(spread)[:, np.newaxis, :]
    error = np.sqrt(variance.sum(axis=(1, 2))) / np.linalg.norm(response, ord=2, axis=(1, 2))
    kept = error < _LARGEST_ERROR
    explained = sums[:, y, r] @ np.linalg.inv(sums[:, r, r])
    output_noise = _residual(sums[:, y, y], explained, sums[:, y, r], sums[:, r, r])
    coherence = 1.0 - _diagonals(output_noise) / free * spectra.terms / _diagonals(sums[:, y, y])
    frequency = spectra.frequency[independent][known][kept]
    if not kept.any():
        raise IdentificationError(
            "the frequency response is not determined: at no frequency is the coherence of inputs and outputs with the "
            "reference sufficient; use a larger or longer excitation"
        )
    response, variance = response[kept], variance[kept]
    deviation = np.sqrt(0.5 * variance)  # of the real and of the imaginary part alike
    return NonparametricEstimate(
        FrequencyResponse(
            frequency,
            response,
            spectra.method,
            deviation,
            deviation / np.maximum(np.abs(response), np.finfo(float).tiny),
            np.clip(coherence[kept], 0.0, 1.0),
            data.input_names,
            data.output_names,
            data.input_units,
            data.output_units,
        ),
        variance,
        free,
        _notes(int(independent.sum()), frequency, spectra.frequency[independent], open_loop),
        open_loop,
    )


def _right_inverse(
    sums: NDArray[np.complex128], to_inputs: NDArray[np.complex128], r: slice, u: slice
) -> NDArray[np.complex128]:
    """The inverse of S_ur or, with more references than inputs, the one of least variance."""
    if sums[:, u, r].shape[1] == sums[:, u, r].shape[2]:
        return np.asarray(np.linalg.inv(sums[:, u, r]))
    weighted = np.swapaxes(to_inputs.conj(), 1, 2)  # S_rr^-1 S_ru
    return np.asarray(weighted @ np.linalg.inv(sums[:, u, r] @ weighted))


def _notes(excited: int, kept: NDArray[np.float64], frequency: NDArray[np.float64], open_loop: bool) -> tuple[str, ...]:
    signals = "inputs" if open_loop else "references"
    notes = [f"determined from {kept[0]:.4g} to {kept[-1]:.4g} Hz; {signals} excite {frequency[0]:.4g} to "
             f"{frequency[-1]:.4g} Hz"]  # fmt: skip
    if len(kept) < excited:
        notes.append(
            f"left out {excited - len(kept)} of {excited} frequencies, where coherence is too low: the standard "
            f"deviation of the estimate is above {100 * _LARGEST_ERROR:.0f} %"
        )
    return tuple(notes)


def _residual(
    power: NDArray[np.complex128],
    gain: NDArray[np.complex128],
    cross: NDArray[np.complex128],
    driving: NDArray[np.complex128],
) -> NDArray[np.complex128]:
    """Sums e e^H of e = a - G b from a a^H, G, a b^H and b b^H; rounding may not make its diagonal negative."""
    other = gain @ np.swapaxes(cross.conj(), 1, 2)
    left = power - other - np.swapaxes(other.conj(), 1, 2) + gain @ driving @ np.swapaxes(gain.conj(), 1, 2)
    index = np.arange(left.shape[1])
    left[:, index, index] = np.maximum(left[:, index, index].real, 0.0)
    return np.asarray(left)


def _diagonals(matrices: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.diagonal(matrices, axis1=1, axis2=2).real
