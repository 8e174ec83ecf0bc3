"""Frequency response of the plant from closed-loop data without a model: indirect, from the reference.

Correlating inputs u and outputs y of the plant with the noise u carries by feedback gives a mixture of plant and
controller. Correlated with the reference r, which contains no noise, both give the plant:

    S_yr = G_yr S_rr,  S_ur = G_ur S_rr,  G = G_yr G_ur^-1 = S_yr S_ur^-1.

For two axes the references must be independent: use one axis after the other, different signals, or several
experiments. The cross-spectra S are sums of products of Fourier coefficients over

- the periods of a periodic reference, each exactly one period long and taken after the loop has settled: free of
  leakage, at the lines of the reference alone; or, if that does not determine G,
- neighbouring frequencies, of whole experiments with Hann windows: for any broadband reference, with the resolution of
  a band and a bias where G bends within it.

With v = y - G u, the disturbance at the output, the elements of the estimate have the variances

    var G_ij = (S_vv)_ii / (L - m) [S_ur^-H S_rr S_ur^-1]_jj

of their complex errors, L being the number of independent terms in the sums.

Sources: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, sections
2.6, 2.7 and 7.2; L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 6.4 and 13.5.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.identification.data import Experiment, IdentificationData
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
        the references, corrected for a small number of terms; its label shows how it was estimated.
    variance : ndarray, shape (f, p, m)
        Variance of the complex error of each element by noise.
    free_terms : float
        Independent terms from which the variance is estimated, minus those that the estimate itself uses.
    notes : tuple of str
        Frequencies at which the data do not determine it.
    """

    response: FrequencyResponse
    variance: NDArray[np.float64]
    free_terms: float
    notes: tuple[str, ...]

    def largest_error(self, level: float) -> float:
        """Ratio of |error|^2 to `variance` that is exceeded with the probability 1 - level.

        This is half the ratio of a chi-square variable of 2 degrees of freedom to the variance estimated from so many
        terms. It has an F distribution with a quantile in closed form.
        """
        return self.free_terms * float((1.0 - level) ** (-1.0 / self.free_terms) - 1.0)


@dataclass(frozen=True, eq=False)
class _Spectra:
    """Sums z z^H of z = (r, u, y) at each frequency, shape (f, 2 p + m, 2 p + m), of `terms` independent ones."""

    frequency: NDArray[np.float64]
    sums: NDArray[np.complex128]
    terms: float
    method: str


def estimate_response(data: IdentificationData, period: int | None = None) -> NonparametricEstimate:
    """Estimate the plant's frequency response from the reference.

    Parameters
    ----------
    data : IdentificationData
        Experiments; those without reference are not used.
    period : int, optional
        Period of the reference (samples); by default it is found in the data, if there is one.

    Raises
    ------
    IdentificationError
        If no experiment has a reference, all are too short, or the references cannot separate the axes.
    """
    experiments = [item for item in data.experiments if item.reference is not None]
    if not experiments:
        raise IdentificationError(
            "the data have no reference; without it the plant cannot be separated from its feedback"
        )
    if max(item.steps for item in experiments) < _FEWEST_STEPS:
        raise IdentificationError(f"the experiments are too short; {_FEWEST_STEPS} samples of one are needed")
    experiments = [item for item in experiments if item.steps >= _FEWEST_STEPS]
    period = period or find_period(experiments)
    by_periods = None if period is None else _over_periods(experiments, period, data.sample_time)
    if by_periods is not None and _independent(by_periods, len(data.output_names)).any():
        return _estimate(by_periods, data)
    return _estimate(_over_bands(experiments, data.sample_time), data)


def find_period(experiments: Sequence[Experiment]) -> int | None:
    """Shortest period (samples) with which the references of experiments repeat often enough; None if there is none."""
    for item in experiments:
        assert item.reference is not None
        reference = item.reference - item.reference.mean(axis=0)
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


def _over_periods(experiments: Sequence[Experiment], period: int, sample_time: float) -> _Spectra | None:
    """Sums over periods at the lines of the reference; None if they are too few."""
    settling = round(_SETTLING / sample_time)
    coefficients = [
        np.fft.rfft(signals[start : start + period], axis=0)[1 : (period + 1) // 2]
        for item, signals in _signals(experiments)
        for start in _settled_periods(signals[:, : item.outputs.shape[1]], period, settling)
    ]
    if len(coefficients) < _FEWEST_PERIODS:
        return None
    stacked = np.array(coefficients)
    sums = np.einsum("lfi,lfj->fij", stacked, stacked.conj())
    frequency = np.arange(1, len(sums) + 1) / (period * sample_time)
    terms = float(len(stacked))
    return _Spectra(frequency, sums, terms, f"average of {len(stacked)} periods of {period * sample_time:g} s")


def _over_bands(experiments: Sequence[Experiment], sample_time: float) -> _Spectra:
    """Sums over neighbouring frequencies of all experiments, in bands of one width."""
    total = sum(item.steps for item in experiments) * sample_time
    bands = int(min(0.5 / sample_time * total / _LINES_PER_BAND, _MOST_BANDS))
    width = 0.5 / sample_time / bands
    size = sum(signals.shape[1] for _, signals in _signals(experiments[:1]))
    sums, terms = np.zeros((bands, size, size), dtype=np.complex128), 0.0
    for item, signals in _signals(experiments):
        window = np.hanning(item.steps + 1)[:-1, np.newaxis]
        centred = signals - (window * signals).sum(axis=0) / window.sum()
        lines = np.fft.rfft(window * centred, axis=0) / np.sqrt(item.steps)
        edges = np.round(np.arange(bands + 1) * width * item.steps * sample_time).astype(int)
        edges[0] = 2  # the window spreads the mean over the first lines
        for band, (start, stop) in enumerate(itertools.pairwise(edges)):
            sums[band] += lines[start:stop].T @ lines[start:stop].conj()
        terms += width * item.steps * sample_time
    terms /= _HANN_CORRELATION
    method = f"smoothed over {width:.3g} Hz, Hann window"
    return _Spectra(width * np.linspace(0.5, bands - 0.5, bands), sums, terms, method)


def _signals(experiments: Sequence[Experiment]) -> Iterator[tuple[Experiment, NDArray[np.float64]]]:
    """Each experiment with reference, inputs and outputs side by side."""
    for item in experiments:
        assert item.reference is not None
        yield item, np.hstack([item.reference, item.inputs, item.outputs])


def _independent(spectra: _Spectra, references: int) -> NDArray[np.bool_]:
    """Whether all references have power at a frequency and are not multiples of one another; shape (f,)."""
    power = spectra.sums[:, :references, :references]
    own = np.diagonal(power, axis1=1, axis2=2).real
    strong = np.all(own > _LEAST_POWER * own.max(axis=0), axis=1) & np.all(own > 0.0, axis=1)
    scale = np.sqrt(np.where(strong[:, np.newaxis], own, 1.0))
    correlation = np.where(strong[:, np.newaxis, np.newaxis], power, 0.0) / (scale[:, :, None] * scale[:, None, :])
    return strong & (np.linalg.eigvalsh(correlation)[:, 0] > _LEAST_INDEPENDENCE)


def _estimate(spectra: _Spectra, data: IdentificationData) -> NonparametricEstimate:
    """The response at the frequencies at which it is determined, with its variance."""
    p, m = len(data.output_names), len(data.input_names)
    independent = _independent(spectra, p)
    free = spectra.terms - p
    if not independent.any() or free < 1.0 or p != m:
        raise IdentificationError(
            "the frequency response is not determined: the references of the axes are not independent; excite the axes "
            "one after the other, by different signals, or in several experiments"
        )
    sums = spectra.sums[independent]
    r, u, y = slice(0, p), slice(p, p + m), slice(p + m, None)
    inverse = np.linalg.inv(sums[:, r, r])
    to_inputs = sums[:, u, r] @ inverse
    input_noise = _residual(sums[:, u, u], to_inputs, sums[:, u, r], sums[:, r, r]) / free
    worst = np.sqrt(np.linalg.eigvalsh(inverse)[:, -1] * np.trace(input_noise, axis1=1, axis2=2).real)
    known = worst < _LARGEST_ERROR * np.linalg.svd(to_inputs, compute_uv=False)[:, -1]
    answering = np.linalg.inv(sums[known][:, u, r])
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
        _notes(int(independent.sum()), frequency, spectra.frequency[independent]),
    )


def _notes(excited: int, kept: NDArray[np.float64], frequency: NDArray[np.float64]) -> tuple[str, ...]:
    notes = [f"determined from {kept[0]:.4g} to {kept[-1]:.4g} Hz; references excite {frequency[0]:.4g} to "
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
