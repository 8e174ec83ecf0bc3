"""The error of a model's response by frequency, from the reference to the residuals, with what noise alone would show.

The one-step prediction errors of a model G, H on data of a plant G0 are e = H^-1 ((G0 - G) u + v), so that

    X = S_er S_ur^-1,    D = H X

estimates H^-1 (G0 - G) and the error D of the response in a band of frequencies. The reference r contains no noise, so
that a true model gives X = 0 but for noise; feedback, leakage and the colour of the noise do not change this. With L
lines in a band and S_ee of the part of e that r does not explain, the elements of X have the variances

    var X_ij = (S_ee)_ii / (L - p) [S_ur^-H S_rr S_ur^-1]_jj,

and |X_ij|^2 / var X_ij has the distribution F(2, 2 (L - p)). In open loop the inputs take the place of r.

Sources: L. Ljung, Model validation and model error modeling, in B. Wittenmark and A. Rantzer (eds.), The Astrom
Symposium on Control, 1999; L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 6.4 and 16.6.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.closed_loop import complementary_sensitivity
from amb_core.linear import LinearSystem
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.known_controller import KnownController

Arrays = NDArray[np.float64]

PER_OCTAVE = 6
RESOLVED = 30.0
"""Relative deviation of the response (percent) up to which the data say anything in a band."""
MATTERS, LEAST_ACTION = 5.0, 0.1
"""Error that matters where the loop acts (percent), and the action of the loop below which it grows no more."""
_LEAST_POWER = 1e-8  # of the reference in a band, relative to that in all
_LEAST_INDEPENDENCE = 1e-4  # smallest eigenvalue of the references' correlation in a band
_LEAST_SEPARATE = 1e-8  # smallest singular value of how the inputs follow the references, each of length 1
_POINTS = 24  # of a band at which the model's response is computed


@dataclass(frozen=True)
class BandError:
    """Error of the response in a band of which the data say anything.

    Attributes
    ----------
    low, high : float
        The band (Hz); it ends where the excitation does.
    input_name : str
        The input whose response it is, to all outputs.
    error, deviation : float
        Size of the error relative to that of the response (root mean squares over the band), less what noise adds on
        average, and the root mean square that noise gives a true model (percent). The response is the larger one of
        the model's and the plant's, so that a model that hardly responds does not hide its error.
    limit : float
        Error that matters (percent): 5 where the loop acts, up to 50 where it hardly does.
    p_value : float
        Probability of so large an error for a true model.
    p_estimated : float
        The same for a model that was estimated from as few samples as this one, as if its data had been excited alike.
    """

    low: float
    high: float
    input_name: str
    error: float
    deviation: float
    limit: float
    p_value: float
    p_estimated: float


def response_errors(
    model: StateSpaceModel,
    data: IdentificationData,
    residuals: Sequence[Arrays],
    controller: KnownController | None = None,
    *,
    open_loop: bool = False,
) -> tuple[BandError, ...]:
    """Errors in all bands of which the data say anything; none without a reference that moves."""
    references = [item.inputs if open_loop else item.reference for item in data.experiments]
    parts = [
        (reference, item.inputs, errors)
        for reference, item, errors in zip(references, data.experiments, residuals, strict=True)
        if reference is not None
    ]
    if not parts:
        return ()
    spectra = [tuple(np.fft.rfft(part - part.mean(axis=0), axis=0)[1:] for part in item) for item in parts]
    frequency = np.concatenate([np.fft.rfftfreq(len(item[0]), data.sample_time)[1:] for item in parts])
    r, u, e = (np.vstack([item[place] for item in spectra]) for place in range(3))
    power = np.sum(np.abs(r) ** 2)
    last = _last_excited(frequency, r)
    noise_filter = LinearSystem(model.a, model.k, model.c, np.eye(model.outputs), model.sample_time)
    errors_of_bands = []
    for low, high in _bands(frequency, 4 * (r.shape[1] + 1)):
        lines = (frequency >= low) & (frequency < high)
        if np.sum(np.abs(r[lines]) ** 2) <= _LEAST_POWER * power:
            continue
        try:
            estimate = _estimate(r[lines], u[lines], e[lines])
        except np.linalg.LinAlgError:  # the references do not separate the inputs at all
            continue
        if estimate is None:
            continue
        x, variance, free = estimate
        high = min(high, float(frequency.max()))  # a band may reach beyond half the sample rate
        middle = math.sqrt(low * high)
        h, limit = noise_filter.response([middle])[0], limit_at(model, controller, middle)
        of_plant = model.response([middle]) + h @ x
        sizes = np.maximum(column_sizes(model.response(np.linspace(low, high, _POINTS))), column_sizes(of_plant))
        noise = np.sum(np.abs(h) ** 2 @ variance, axis=0)
        error = np.sum(np.abs(h @ x) ** 2, axis=0)
        ratio = np.mean(np.abs(x) ** 2 / variance, axis=0)
        for column, name in enumerate(model.input_names):
            deviation = 100.0 * math.sqrt(noise[column]) / sizes[column]
            if deviation <= RESOLVED:
                more = 100.0 * math.sqrt(max(error[column] - noise[column], 0.0)) / sizes[column]
                p_value, p_estimated = (
                    float(special.fdtrc(2 * len(x), 2 * free, ratio[column] / variance))
                    for variance in (1.0, variance_of_estimate(model, data))
                )
                errors_of_bands.append(
                    BandError(low, max(min(high, last), low), name, more, deviation, limit, p_value, p_estimated)
                )
    return tuple(errors_of_bands)


def _last_excited(frequency: Arrays, r: NDArray[np.complex128]) -> float:
    """The highest frequency (Hz) with a visible part of the power of the reference at or above it."""
    order = np.argsort(frequency)
    power = np.sum(np.abs(r[order]) ** 2, axis=1)
    beyond = np.cumsum(power[::-1])[::-1]
    return float(frequency[order][np.flatnonzero(beyond >= _LEAST_POWER * beyond[0])[-1]])


def variance_of_estimate(model: StateSpaceModel, data: IdentificationData) -> float:
    """Variance of an error by noise, relative to a true model's, of one estimated from N_i samples: 1 + N / N_i.

    It excuses what is significant and small, and nothing that matters: a model from few samples is not accurate.
    """
    return 1.0 + (data.samples / model.samples if model.samples else 0.0)


def limit_at(model: StateSpaceModel, controller: KnownController | None, frequency: float) -> float:
    """Relative error of the response that matters at a frequency (percent).

    An error D of the response G changes the loop by T D / G, T being the complementary sensitivity.
    """
    if controller is None:
        return MATTERS
    try:
        action = np.linalg.norm(complementary_sensitivity(model, controller, frequency), 2)
    except (IdentificationError, np.linalg.LinAlgError):
        return MATTERS
    return MATTERS / float(np.clip(action, LEAST_ACTION, 1.0))


def column_sizes(values: NDArray[np.complex128]) -> Arrays:
    """Root mean square over the points of each column of matrices, shape (points, p, m); shape (m,)."""
    return np.maximum(np.sqrt(np.mean(np.sum(np.abs(values) ** 2, axis=1), axis=0)), np.finfo(float).tiny)


def _estimate(
    r: NDArray[np.complex128], u: NDArray[np.complex128], e: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], Arrays, int] | None:
    """X, its variances and the free terms of a band; None where the references do not separate the inputs."""
    free = len(r) - r.shape[1]
    rr, ur, er = (part.T @ r.conj() for part in (r, u, e))
    scale = np.sqrt(np.diag(rr).real)
    if free < 1 or not np.all(scale > 0.0):
        return None
    if np.linalg.eigvalsh(rr / np.outer(scale, scale))[0] < _LEAST_INDEPENDENCE:
        return None
    inner = ur / np.maximum(np.linalg.norm(ur, axis=1, keepdims=True), np.finfo(float).tiny)
    if np.linalg.svd(inner, compute_uv=False)[-1] < _LEAST_SEPARATE:  # inputs that are multiples of one another
        return None
    by_inputs = ur.conj().T @ np.linalg.inv(ur @ np.linalg.solve(rr, ur.conj().T))  # S_ur^-1, least squares if p > m
    x = er @ np.linalg.solve(rr, by_inputs)
    rest = e - r @ np.linalg.solve(rr.T, er.T)
    noise = np.maximum(np.sum(np.abs(rest) ** 2, axis=0) / free, np.finfo(float).tiny)
    spread = np.diag(by_inputs.conj().T @ np.linalg.solve(rr, by_inputs)).real
    return x, np.outer(noise, spread), free


def _bands(frequency: Arrays, fewest: int) -> list[tuple[float, float]]:
    """Bands of a part of an octave, or wider where there are too few lines in one."""
    ordered = np.sort(frequency)
    bands, low = [], float(ordered[0])
    while low < ordered[-1]:
        wide = ordered[min(int(np.searchsorted(ordered, low)) + fewest, len(ordered) - 1)]
        high = max(low * 2.0 ** (1.0 / PER_OCTAVE), float(wide))
        bands.append((low, high))
        low = high
    return bands
