"""Drops that follow a flux with memory, as a passive sum of first-order terms: what the integrators need of a fit.

With phi the flux and R a reluctance, the drop is R (1 + sum_n c_n s / (s + p_n) + r s) phi. Term n stores the lead of
the flux, m_n = c_n (phi - q_n) with q_n' = p_n (phi - q_n); it is zero at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOST_TERMS = 30
"""Largest number of terms of a fit; the integrators have room for as many."""


@dataclass(frozen=True)
class MemoryTerms:
    """A passive sum, 1 + sum_n c_n s / (s + p_n) + r s.

    Attributes
    ----------
    weights : ndarray, shape (n,)
        c_n > 0 (-).
    rates : ndarray, shape (n,)
        p_n (1/s), ascending.
    rest : float
        r > 0 (s): everything that is faster than the terms.
    """

    weights: NDArray[np.float64]
    rates: NDArray[np.float64]
    rest: float

    def response(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """The sum at frequencies (Hz)."""
        s = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
        return 1.0 + (s[..., None] / (s[..., None] + self.rates)) @ self.weights + self.rest * s

    def mean(self, step: float) -> tuple[NDArray[np.float64], float]:
        """Mean drop over a step (s) whose flux changes at a constant rate, over R, as alpha and k.

        With phi and m_n at its start, the mean is phi + (h / 2) dphi/dt + sum_n alpha_n m_n + k dphi/dt.

        Returns
        -------
        shares : ndarray, shape (n,)
            alpha_n = (1 - exp(-p_n h)) / (p_n h).
        coefficient : float
            k = r + sum_n c_n (1 - alpha_n) / p_n (s).
        """
        exponent = self.rates * step
        shares = -np.expm1(-exponent) / exponent
        return shares, self.rest + float(np.sum(self.weights * (1.0 - shares) / self.rates))

    def update(self, step: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coefficients a, b, each of shape (n,), of the recursion m_n <- a_n m_n + b_n (phi_new - phi_old).

        It is exact for a flux that is linear within the step (s), and otherwise of second order.
        """
        exponent = self.rates * step
        return np.exp(-exponent), -self.weights * np.expm1(-exponent) / exponent


def fit_weights(
    rates: NDArray[np.float64], frequency: NDArray[np.float64], wanted: NDArray[np.complex128]
) -> tuple[NDArray[np.float64], float]:
    """Weights and rest of a sum that has the wanted response, with the smallest sum of squares of the relative error.

    Parameters
    ----------
    rates : ndarray, shape (n,)
        p_n (1/s).
    frequency : ndarray, shape (m,)
        Frequencies of the fit (Hz).
    wanted : ndarray, shape (m,)
        Response there (-).

    Returns
    -------
    weights : ndarray, shape (n,)
        c_n, 0 for terms that are not needed.
    rest : float
        r (s).
    """
    from scipy.optimize import nnls  # takes a quarter of a second to import

    s = 2j * np.pi * frequency[:, None]
    columns = np.hstack([s / (s + rates), s]) / wanted[:, None]
    matrix = np.vstack([columns.real, columns.imag])
    scale = np.linalg.norm(matrix, axis=0)
    target = (wanted - 1.0) / wanted
    coefficients = nnls(matrix / scale, np.concatenate([target.real, target.imag]))[0] / scale
    return coefficients[:-1], float(coefficients[-1])
