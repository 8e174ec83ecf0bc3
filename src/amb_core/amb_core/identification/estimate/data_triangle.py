"""The data matrix of past and future, compressed to its triangular factor, and ridge regressions on the past.

Columns of the factor have the inner products of the data's columns, so they stand for the data in every least-squares
problem. It is built in blocks: time and memory are linear in the samples.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from amb_core.identification.estimate.predictor import experiments
from amb_core.identification.estimate.scaled_data import ScaledData
from amb_core.linear.numerics import thin_svd, with_rows

_BLOCK = 4_000  # rows of the data matrix held at once


class DataTriangle:
    """Triangular factor of the rows [z[k-1] ... z[k-past]  z[k] ... z[k+future]] with z = (y, u).

    Attributes
    ----------
    past, future : int
        Horizons (steps).
    p, q : int
        Number of outputs, and of outputs and inputs.
    rows : int
        Rows of the data matrix: steps whose past and future lie within one experiment.
    feedthrough : bool
        Whether outputs respond to the inputs of the same sample.
    """

    def __init__(self, data: ScaledData, past: int, future: int, feedthrough: bool = False) -> None:
        self.past, self.future, self.feedthrough = past, future, feedthrough
        self.p, self.q = data.outputs.shape[1], data.outputs.shape[1] + data.inputs.shape[1]
        z = np.hstack([data.outputs, data.inputs])
        lags = np.concatenate([np.arange(-1, -past - 1, -1), np.arange(future + 1)])
        self.rows = 0
        factor = np.zeros((0, self.q * len(lags)))
        for part in experiments(len(z), data.lengths):
            for start in range(part.start + past, part.stop - future, _BLOCK):
                stop = min(start + _BLOCK, part.stop - future)
                block = np.hstack([z[start + lag : stop + lag] for lag in lags])
                factor = with_rows(factor, block)
                self.rows += stop - start
        self._factor = factor / math.sqrt(self.rows)

    def before(self, steps: int, lead: int = 0) -> NDArray[np.float64]:
        """The columns z[k-1+lead] ... z[k-steps+lead], lead 0 or 1."""
        recent = [self.at(ahead) for ahead in range(lead - 1, -1, -1)]
        return np.hstack([*recent, self._factor[:, : self.q * (steps - lead)]])

    def at(self, ahead: int) -> NDArray[np.float64]:
        """The columns z[k+ahead]."""
        start = self.q * (self.past + ahead)
        return self._factor[:, start : start + self.q]

    def residual_covariance(self, steps: int) -> NDArray[np.float64]:
        """Covariance of y[k] minus its least-squares fit by z[k-1] ... z[k-steps] and, with feedthrough, u[k]."""
        rest = self.at(0)[self.q * steps :, : self.p]
        if self.feedthrough:
            present = np.linalg.qr(self.at(0)[self.q * steps :, self.p :])[0]
            rest = rest - present @ (present.T @ rest)
        return np.asarray(rest.T @ rest)

    def best_past(self, shortest: int) -> int:
        """Steps, at least `shortest`, of the autoregressive model with the smallest Akaike criterion."""
        candidates = range(shortest, self.past + 1)
        criteria = [
            self.rows * np.linalg.slogdet(self.residual_covariance(steps))[1] + 2.0 * self.p * self.q * steps
            for steps in candidates
        ]
        return candidates[int(np.argmin(criteria))]


class RidgeRegression:
    """Ridge regressions on given columns, for any ridge from one decomposition."""

    def __init__(self, columns: NDArray[np.float64]) -> None:
        self.columns = columns
        self._left, self._singular, self._right = thin_svd(columns)

    def coefficients(self, targets: NDArray[np.float64], ridge: float) -> NDArray[np.float64]:
        """Coefficients with the least sum of squared errors plus ridge times squared coefficients.

        Parameters
        ----------
        targets : ndarray, shape (rows, t)
            The values that the sum of the columns is fitted to.
        ridge : float
            Relative to the largest eigenvalue of the columns' covariance.

        Returns
        -------
        ndarray, shape (columns, t)
        """
        shrunk = self._singular / (self._singular**2 + ridge * self._singular[0] ** 2)
        return np.asarray(self._right.T @ (shrunk[:, np.newaxis] * (self._left.T @ targets)))


class PastRegression(RidgeRegression):
    """Ridge regressions on z[k-1] ... z[k-steps]."""

    def __init__(self, triangle: DataTriangle, steps: int) -> None:
        super().__init__(triangle.before(steps))
        self.triangle, self.steps = triangle, steps
        self._with_present = RidgeRegression(np.hstack([self.columns, self._present])) if triangle.feedthrough else self

    def markov_parameters(self, ridge: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The long ARX model of y[k], and its errors.

        Returns
        -------
        markov, direct, errors : ndarray, shapes (q * steps, p), (m, p), (rows, p)
            Coefficients of z[k-1] ... z[k-steps] and of u[k], which are zero without feedthrough.
        """
        now = self.triangle.at(0)[:, : self.triangle.p]
        coefficients = self._with_present.coefficients(now, ridge)
        errors = now - self._with_present.columns @ coefficients
        markov, direct = np.split(coefficients, [self.columns.shape[1]])
        return markov, direct if len(direct) else np.zeros((self._present.shape[1], self.triangle.p)), errors

    @property
    def _present(self) -> NDArray[np.float64]:
        """The columns u[k]."""
        return self.triangle.at(0)[:, self.triangle.p :]
