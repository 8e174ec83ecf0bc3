"""Frequency response of the plant without a model: in closed loop indirect, from the reference; else from the inputs.

Correlating inputs u and outputs y of the plant with the noise u carries by feedback gives a mixture of plant and
controller. Correlated with the reference r, which contains no noise, both give the plant:

    S_yr = G_yr S_rr,  S_ur = G_ur S_rr,  G = G_yr G_ur^-1 = S_yr S_ur^-1.

With p references for m inputs, p > m, this becomes G = S_yr W (S_ur W)^-1, W = S_rr^-1 S_ru: least squares. In open
loop the inputs themselves contain no noise of the outputs and take the place of r, so that G = S_yu S_uu^-1.

The references (or inputs) must be independent: use one after the other, different signals, or several experiments. The
cross-spectra S are sums of products of Fourier coefficients over

- the settled periods of a periodic reference: free of leakage, at the lines of the reference alone (`periods`); where a
  line does not determine G, the responses to each reference are fitted over a few neighbouring lines; or, without
  period,
- neighbouring frequencies, of whole experiments with Hann windows: for any broadband reference, with the resolution of
  a band and a bias where G bends within it (`bands`).

With v = y - G u, the disturbance at the output, the elements of the estimate have the variances

    var G_ij = (S_vv)_ii / (L - p) [S_ur^-H S_rr S_ur^-1]_jj

of their complex errors, L being the number of independent terms in the sums.

Sources: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, sections
2.6, 2.7 and 7.2; L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 6.4 and 13.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_kind, whole_number
from amb_core.identification.frequency_response import FrequencyResponse
from amb_core.identification.given import Data, given_loop
from amb_core.identification.nonparametric.bands import over_bands
from amb_core.identification.nonparametric.by_references import ByReferences, Complex, Signals
from amb_core.identification.nonparametric.periods import over_periods

_FEWEST_STEPS = 512  # of an experiment
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
        Variance of the complex error of each element by noise (unit of the response, squared).
    free_terms : float
        Independent terms from which the variance is estimated, minus those that the estimate itself uses (-).
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

        Parameters
        ----------
        level : float
            Probability with which the error is smaller (-).

        Returns
        -------
        float
            The ratio (-).
        """
        return self.free_terms * float((1.0 - level) ** (-1.0 / self.free_terms) - 1.0)


def estimate_response(data: Data, period: int | None = None, *, open_loop: bool = False) -> NonparametricEstimate:
    """Estimate the plant's frequency response from the reference or, in open loop, from the inputs.

    Parameters
    ----------
    data : LoopRecord, IdentificationData or RecordedLoop
        Experiments, as for `identify`; those without reference are only used in open loop.
    period : int, optional
        Period of the reference (samples); by default it is found in the data, if there is one.
    open_loop : bool, optional
        Whether the outputs do not act on the inputs; the inputs then serve as references.

    Returns
    -------
    NonparametricEstimate
        The response where the data determine it, with its variance.

    Raises
    ------
    IdentificationError
        If no experiment has a reference, all are too short, or the references cannot separate the inputs.
    """
    data = given_loop(data).data
    if period is not None and (period := whole_number("period", period, IdentificationError)) < 1:
        raise IdentificationError(f"period = {period} is not allowed; allowed: 1 sample or more")
    require_kind("open_loop", open_loop, (bool, np.bool_), "True or False", IdentificationError)
    experiments = _signals(data, open_loop)
    if not experiments:
        raise IdentificationError(f"the experiments are too short; {_FEWEST_STEPS} samples of one are needed")
    by_references = over_periods(experiments, data.sample_time, period) or over_bands(experiments, data.sample_time)
    return _estimate(by_references, data, experiments[0].references.shape[1], open_loop)


def estimate_over_periods(data: IdentificationData) -> NonparametricEstimate | None:
    """As `estimate_response`, from the periods of the reference alone; None where these do not determine the response.

    Parameters
    ----------
    data : IdentificationData
        Experiments with reference.

    Returns
    -------
    NonparametricEstimate or None
        The response at the lines of the reference; None where the periods do not determine it.

    Raises
    ------
    IdentificationError
        As `estimate_response`.
    """
    experiments = _signals(data, open_loop=False)
    by_references = over_periods(experiments, data.sample_time) if experiments else None
    return (
        None
        if by_references is None
        else _estimate(by_references, data, experiments[0].references.shape[1], open_loop=False)
    )


def _signals(data: IdentificationData, open_loop: bool) -> list[Signals]:
    """The experiments that are long enough, with what moves them."""
    moving = [(item.inputs if open_loop else item.reference, item) for item in data.experiments]
    experiments = [Signals(signals, item.inputs, item.outputs) for signals, item in moving if signals is not None]
    if not experiments:
        raise IdentificationError(
            "the data have no reference; without it the plant cannot be separated from its feedback"
        )
    return [item for item in experiments if len(item.inputs) >= _FEWEST_STEPS]


def _estimate(
    by_references: ByReferences, data: IdentificationData, references: int, open_loop: bool
) -> NonparametricEstimate:
    """The response at the frequencies at which it is determined, with its variance."""
    m = len(data.input_names)
    if references < m:
        raise IdentificationError(
            f"the frequency response is not determined: {m} inputs need as many references, there are {references}"
        )
    if by_references.free_terms < 1.0:
        raise IdentificationError(
            f"the frequency response is not determined: {data.samples} samples are too few for {references} "
            f"{'inputs' if open_loop else 'references'}; record longer"
        )
    if not len(by_references.frequency):
        raise IdentificationError(
            f"the frequency response is not determined: the {'inputs' if open_loop else 'references of the axes'} are "
            "not independent; excite the axes one after the other, by different signals, or in several experiments"
        )
    known, response, variance = _of_inputs(by_references, m)
    error = np.sqrt(variance.sum(axis=(1, 2))) / np.linalg.norm(response, ord=2, axis=(1, 2))
    kept = error < _LARGEST_ERROR
    if not kept.any():
        raise IdentificationError(
            "the frequency response is not determined: at no frequency is the coherence of inputs and outputs with the "
            "reference sufficient; use a larger or longer excitation"
        )
    frequency, coherence = by_references.frequency[known][kept], by_references.coherence[known][kept][:, m:]
    response, variance = response[kept], variance[kept]
    deviation = np.sqrt(0.5 * variance)  # of the real and of the imaginary part alike
    return NonparametricEstimate(
        FrequencyResponse(
            frequency,
            response,
            by_references.method,
            deviation,
            deviation / np.maximum(np.abs(response), np.finfo(float).tiny),
            coherence,
            data.input_names,
            data.output_names,
            data.input_units,
            data.output_units,
            by_references.free_terms,
        ),
        variance,
        by_references.free_terms,
        _notes(frequency, by_references.frequency, open_loop),
        open_loop,
    )


def _of_inputs(by_references: ByReferences, m: int) -> tuple[NDArray[np.bool_], Complex, NDArray[np.float64]]:
    """Where m inputs are known well enough; the response of the outputs to them there, and its variance."""
    u, y = slice(0, m), slice(m, None)
    input_noise = np.trace(by_references.noise[:, u, u], axis1=1, axis2=2).real
    worst = np.sqrt(np.linalg.eigvalsh(by_references.spread)[:, -1] * input_noise)
    known = worst < _LARGEST_ERROR * np.linalg.svd(by_references.response[:, u], compute_uv=False)[:, -1]
    by_inputs = _right_inverse(by_references.response[known][:, u], by_references.spread[known])
    response = by_references.response[known][:, y] @ by_inputs
    size = response.shape[1]
    opened = np.concatenate([-response, np.broadcast_to(np.eye(size), (len(response), size, size))], axis=2)
    noise = opened @ by_references.noise[known] @ _conjugate(opened)
    spread = _conjugate(by_inputs) @ by_references.spread[known] @ by_inputs
    variance = np.maximum(_diagonals(noise), 0.0)[:, :, np.newaxis] * _diagonals(spread)[:, np.newaxis, :]
    return known, response, variance


def _right_inverse(to_inputs: Complex, spread: Complex) -> Complex:
    """The inverse of the response of the inputs or, with more references than inputs, the one of least variance."""
    if to_inputs.shape[1] == to_inputs.shape[2]:
        return np.asarray(np.linalg.inv(to_inputs))
    weighted = np.linalg.solve(spread, _conjugate(to_inputs))
    return np.asarray(weighted @ np.linalg.inv(to_inputs @ weighted))


def _notes(kept: NDArray[np.float64], frequency: NDArray[np.float64], open_loop: bool) -> tuple[str, ...]:
    signals, excited = "inputs" if open_loop else "references", len(frequency)
    notes = [f"determined from {kept[0]:.4g} to {kept[-1]:.4g} Hz; {signals} excite {frequency[0]:.4g} to "
             f"{frequency[-1]:.4g} Hz"]  # fmt: skip
    if len(kept) < excited:
        notes.append(
            f"left out {excited - len(kept)} of {excited} frequencies, where coherence is too low: the standard "
            f"deviation of the estimate is above {100 * _LARGEST_ERROR:.0f} %"
        )
    return tuple(notes)


def _conjugate(matrices: Complex) -> Complex:
    return np.swapaxes(matrices.conj(), 1, 2)


def _diagonals(matrices: Complex) -> NDArray[np.float64]:
    return np.diagonal(matrices, axis1=1, axis2=2).real
