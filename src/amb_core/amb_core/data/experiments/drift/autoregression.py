"""A long ARX model from prefiltered data: its errors on the data themselves show the drift.

With y = G u + d + H e, d the drift of the outputs, the errors of an ARX model A y - B u of the plant are A d + e: white
noise, and the drift multiplied by A(1) where it is slow. Estimated from the data themselves, the model would explain
part of the drift; estimated from data without their slow part, it does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.data.experiments.dataset import IdentificationData

LAGS = 20
_BLOCK = 4_000  # rows of the data matrix held at once
_ADDED_NOISE = 1e-12  # variance relative to a column's; keeps the equations definite where signals have no noise


@dataclass(frozen=True)
class Autoregression:
    """Coefficients of y[k] on z[k-1] ... z[k-LAGS], z = (u, y).

    Attributes
    ----------
    coefficients : ndarray, shape (LAGS * (m + p), p)
        One column for each output.
    covariance : ndarray, shape (p, p)
        Covariance of the errors on the data of the estimate.
    """

    coefficients: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def static_gain(self) -> NDArray[np.float64]:
        """A(1): the constant error for a constant offset of the outputs, shape (p, p)."""
        p = self.coefficients.shape[1]
        by_output = self.coefficients.reshape(LAGS, -1, p)[:, -p:]
        return np.asarray(np.eye(p) - by_output.sum(axis=0).T)

    def errors(self, signals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Errors of y[k] for the rows k = LAGS ... of (u, y) of one experiment, shape (steps - LAGS, p)."""
        errors = signals[LAGS:, -self.coefficients.shape[1] :].copy()
        for start in range(0, len(errors), _BLOCK):
            part = signals[start : start + _BLOCK + LAGS]
            errors[start : start + _BLOCK] -= _rows(part)[:, part.shape[1] :] @ self.coefficients
        return errors


def fit(parts: list[NDArray[np.float64]], outputs: int) -> Autoregression:
    """Least squares over the samples (u, y) of all experiments, without means and of the order of 1.

    Raises
    ------
    LinAlgError
        If the samples do not determine the coefficients.
    """
    columns = (LAGS + 1) * parts[0].shape[1]
    products, rows = np.zeros((columns, columns)), 0
    for signals in parts:
        for start in range(0, len(signals) - LAGS, _BLOCK):
            block = _rows(signals[start : start + _BLOCK + LAGS])
            products += block.T @ block
            rows += len(block)
    q = parts[0].shape[1]
    past, target = products[q:, q:], products[q:, q - outputs : q]
    past[np.diag_indices_from(past)] *= 1.0 + _ADDED_NOISE
    # Signals of very different size, such as those that a prefilter almost removes, are no ill condition.
    power = past.diagonal()
    size = np.sqrt(np.where(power > 0.0, power, 1.0))
    scaled = linalg.solve(past / np.outer(size, size), target / size[:, np.newaxis], assume_a="pos")
    coefficients = scaled / size[:, np.newaxis]
    left = products[q - outputs : q, q - outputs : q] - target.T @ coefficients
    return Autoregression(coefficients, left / rows)


def signals_of(data: IdentificationData) -> list[NDArray[np.float64]]:
    """Inputs and outputs of each experiment side by side, less their means, each scaled to variance 1 over all."""
    parts = [np.hstack([item.inputs, item.outputs]) for item in data.experiments]
    parts = [part - part.mean(axis=0) for part in parts]
    return [part / scales(data) for part in parts]


def scales(data: IdentificationData) -> NDArray[np.float64]:
    """Standard deviations of inputs and outputs about the means of their experiments; 1 for constant signals."""
    parts = [np.hstack([item.inputs, item.outputs]) for item in data.experiments]
    power = sum(np.sum((part - part.mean(axis=0)) ** 2, axis=0) for part in parts) / data.samples
    return np.asarray(np.where(power > 0.0, np.sqrt(power), 1.0))


def _rows(signals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows z[k] ... z[k-LAGS] for k = LAGS onwards, shape (steps - LAGS, (LAGS + 1) * (m + p))."""
    steps = len(signals)
    return np.hstack([signals[LAGS - lag : steps - lag] for lag in range(LAGS + 1)])
