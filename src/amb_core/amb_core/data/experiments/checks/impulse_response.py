"""Impulse response of the plant with its covariance, also where the inputs excite a part of the band only.

The one-step predictor of outputs from past inputs and outputs holds in open and in closed loop. Its impulse responses
get the prior of stable splines, smooth and decaying, whose scales and decay rates maximise the marginal likelihood of
the data. Without a prior a multisine that ends far below half the sample rate leaves single samples of the response
undetermined. The impulse response of the plant follows from the predictor's.

Source: G. Pillonetto, A. Chiuso, G. De Nicolao, Prediction error identification of linear systems: a nonparametric
Gaussian regression approach, Automatica 47 (2011) 291-305.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.data.experiments.checks.lagged import pieces, rows_of, triangle_of
from amb_core.data.experiments.dataset import IdentificationData

_LONGEST_LAG = 40
_MOST_COLUMNS = 160
_ROWS_PER_COLUMN = 8
_LEAST_NOISE = 1e-6  # variance relative to the output's: no bearing is linear to better than 0.1 %
_DRAWS = 200
_START = np.array([0.0, 0.0, -2.0, -3.5])  # ln of the scales of inputs and outputs, and of their decay rates
_SPREAD = np.array([2.0, 2.0, 1.0, 1.0])
_BOUNDS = np.array([[-14.0, 8.0], [-14.0, 8.0], [-5.0, 1.0], [-5.0, 1.0]])
_EVALUATIONS = 120


@dataclass(frozen=True)
class ImpulseResponse:
    """Response of outputs to an impulse of an input, in standard deviations of output and input.

    Attributes
    ----------
    mean : ndarray, shape (lags, p, m)
        Estimate, from the lag of one sample onwards.
    draws : ndarray, shape (n, lags, p, m)
        Draws from its distribution given the data.
    """

    mean: NDArray[np.float64]
    draws: NDArray[np.float64]


def impulse_response(data: IdentificationData) -> ImpulseResponse | None:
    """Estimate the first half of the lags; None if there are too few samples or the data determine nothing."""
    m, p = len(data.input_names), len(data.output_names)
    longest = max(item.steps for item in data.experiments)
    lags = min(_LONGEST_LAG, max(_MOST_COLUMNS // (m + p), 4), longest // (_ROWS_PER_COLUMN * (m + p) + 1))
    if lags < 4:
        return None
    factor, rows = triangle_of(_regression(u, y, lags) for u, y in pieces(data, lags))
    size = (m + p) * lags
    if rows <= 2 * size:
        return None
    random, predictors = np.random.default_rng(0), np.empty((_DRAWS + 1, p, m + p, lags))
    for output in range(p):
        try:
            mean, root = _posterior(factor, size, output, rows - size, m, lags)
        except linalg.LinAlgError:
            return None
        draws = mean + random.normal(size=(_DRAWS, size)) @ root.T
        predictors[:, output] = np.vstack([mean, draws]).reshape(-1, m + p, lags)
    responses = _of_the_plant(predictors, m, lags // 2)
    return ImpulseResponse(responses[0], responses[1:]) if np.isfinite(responses).all() else None


def _regression(u: NDArray[np.float64], y: NDArray[np.float64], lags: int) -> NDArray[np.float64]:
    """Rows [u_1[k-1] ... u_1[k-lags]  u_2[k-1] ...  y_p[k-lags]  y[k]]."""
    past = [rows_of(signal[:, np.newaxis], range(1, lags + 1)) for signals in (u, y) for signal in signals.T]
    return np.hstack([*past, y[lags:]])


def _posterior(
    factor: NDArray[np.float64], size: int, output: int, freedom: int, m: int, lags: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of the predictor's impulse responses for an output, and a square root of their covariance."""
    from scipy.optimize import minimize  # takes a quarter of a second to import

    regressors, target = factor[:size, :size], factor[:size, size + output]
    residual = float(np.sum(factor[size:, size + output] ** 2))
    noise = max(residual, _LEAST_NOISE * (residual + float(target @ target))) / freedom
    if not noise > 0.0:
        raise linalg.LinAlgError("an output that does not move")

    def weighted(shape: NDArray[np.float64]) -> NDArray[np.float64]:
        """Regressors times a square root of the prior covariance."""
        of_inputs, of_outputs = _prior_roots(shape, lags)
        blocks = [regressors[:, first : first + lags] for first in range(0, size, lags)]
        return np.hstack([block @ (of_inputs if number < m else of_outputs) for number, block in enumerate(blocks)])

    def cost(shape: NDArray[np.float64]) -> float:
        """Minus the logarithm of the marginal likelihood."""
        if np.any(shape < _BOUNDS[:, 0]) or np.any(shape > _BOUNDS[:, 1]):
            return np.inf
        root = weighted(shape)
        covariance = root @ root.T
        covariance[np.diag_indices(size)] += noise
        try:
            triangle = linalg.cholesky(covariance, lower=True, check_finite=False)
        except linalg.LinAlgError:
            return np.inf
        white = linalg.solve_triangular(triangle, target, lower=True, check_finite=False)
        return float(0.5 * white @ white + np.log(np.diag(triangle)).sum())

    simplex = np.vstack([_START, _START + np.diag(_SPREAD)])
    options = {"maxfev": _EVALUATIONS, "xatol": 0.1, "fatol": 0.1, "initial_simplex": simplex}
    shape = minimize(cost, _START, method="Nelder-Mead", options=options).x
    return _regularised(weighted(shape), shape, target, noise, m, lags)


def _regularised(
    root: NDArray[np.float64],
    shape: NDArray[np.float64],
    target: NDArray[np.float64],
    noise: float,
    m: int,
    lags: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Posterior by singular values: with theta = S w, w of unit covariance, and regressors S = U diag(s) V^T."""
    left, singular, right = linalg.svd(root)
    of_inputs, of_outputs = _prior_roots(shape, lags)
    prior = linalg.block_diag(*[of_inputs if number < m else of_outputs for number in range(len(root) // lags)])
    mean = prior @ (right.T @ (singular / (singular**2 + noise) * (left.T @ target)))
    return mean, prior @ (right.T * np.sqrt(noise / (singular**2 + noise)))


def _prior_roots(shape: NDArray[np.float64], lags: int) -> list[NDArray[np.float64]]:
    """Square roots of the prior covariances of the responses to inputs and to outputs."""
    pairs = zip(shape[:2], shape[2:], strict=True)
    return [linalg.cholesky(_stable_spline(float(scale), float(rate), lags), lower=True) for scale, rate in pairs]


def _stable_spline(log_scale: float, log_rate: float, lags: int) -> NDArray[np.float64]:
    """Covariance of a cubic spline over exp(-beta t), of the order of `scale` at the first lags."""
    time, rate = np.arange(1.0, lags + 1.0), np.exp(log_rate)
    total, later = np.add.outer(time, time), np.maximum.outer(time, time)
    spline = 0.5 * np.exp(-rate * (total + later)) - np.exp(-3.0 * rate * later) / 6.0
    return np.exp(log_scale) * (spline + 1e-10 * np.eye(lags))


def _of_the_plant(predictors: NDArray[np.float64], m: int, lags: int) -> NDArray[np.float64]:
    """Impulse responses G[k] = B[k] + sum_j A[j] G[k - j] of predictors [B A], shape (n, lags, p, m)."""
    count, p = predictors.shape[:2]
    responses = np.zeros((count, lags, p, m))
    with np.errstate(over="ignore", invalid="ignore"):
        for lag in range(lags):
            responses[:, lag] = predictors[:, :, :m, lag]
            for before in range(lag):
                responses[:, lag] += predictors[:, :, m:, before] @ responses[:, lag - 1 - before]
    return responses
