"""Distribution of the largest root of a Wishart matrix: what one combination of outputs explains by chance.

Source: M. Chiani, Distribution of the largest eigenvalue for real Wishart and Gaussian random matrices and a simple
approximation for the Tracy-Widom distribution, Journal of Multivariate Analysis 129 (2014), algorithm 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

MOST_COLUMNS = 6
"""Columns up to which tails of 1e-7 are right to rounding."""


def survival(root: ArrayLike, rows: int, columns: int) -> NDArray[np.float64]:
    """Probability that the largest eigenvalue of Z^T Z is above a value, Z of independent standard normal numbers.

    Parameters
    ----------
    root : array_like
        Values.
    rows, columns : int
        Of Z. With more than `MOST_COLUMNS` columns, and as many rows, the sum of all eigenvalues stands for the
        largest: an upper bound.

    Returns
    -------
    ndarray, shape of root
        Probabilities.
    """
    values = np.asarray(root, dtype=float)
    least, most = min(rows, columns), max(rows, columns)
    if least == 1 or least > MOST_COLUMNS:
        return np.asarray(special.chdtrc(rows * columns, values))
    places = np.arange(1, least + 1)
    half, size = 0.5 * (most - least - 1), least + least % 2
    below = special.gammainc(half + places, values[..., np.newaxis] / 2.0)
    skew = np.zeros((*values.shape, size, size))
    for first in places:
        area = below[..., first - 1] ** 2 / 2.0
        for second in range(first, least):
            total = 2.0 * half + first + second
            logarithm = special.gammaln(total) - special.gammaln(half + second + 1) - special.gammaln(half + first)
            area = area - np.exp(logarithm - total * np.log(2.0)) * special.gammainc(total, values)
            skew[..., first - 1, second] = below[..., first - 1] * below[..., second] - 2.0 * area
    if size > least:
        last = half + size
        skew[..., :least, least] = np.exp(-last * np.log(2.0) - special.gammaln(last)) * below
    skew = skew - np.swapaxes(skew, -1, -2)
    factor = least**2 / 2.0 * np.log(np.pi) - least * most / 2.0 * np.log(2.0)
    factor -= special.multigammaln(most / 2.0, least) + special.multigammaln(least / 2.0, least)
    factor += (half * size + size * (size + 1) / 2.0) * np.log(2.0) + special.gammaln(half + np.arange(size) + 1).sum()
    return np.clip(1.0 - np.exp(factor + 0.5 * np.linalg.slogdet(skew)[1]), 0.0, 1.0)


def mean(rows: int, columns: int) -> float:
    """About the mean of the largest eigenvalue of Z^T Z, by the distribution of Tracy and Widom.

    Source: I. M. Johnstone, On the distribution of the largest eigenvalue in principal components analysis, Annals of
    Statistics 29 (2001).
    """
    one, other = np.sqrt(max(rows, columns) - 1.0), np.sqrt(min(rows, columns))
    return float((one + other) ** 2 - 1.2065 * (one + other) * (1.0 / one + 1.0 / other) ** (1.0 / 3.0))
