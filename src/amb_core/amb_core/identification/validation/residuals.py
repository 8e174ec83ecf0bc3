"""Tests of the residuals (one-step prediction errors): are they white, and independent of past inputs?

Whiteness: the multivariate portmanteau statistic of Hosking over the lags 1 to M,

    Q = N^2 sum_l tr(C_l^T C_0^-1 C_l C_0^-1) / (N - l)   ~   chi^2(p^2 M),

which for one output is that of Ljung and Box. Independence: with phi[k] = (u[k-1], ..., u[k-M]), the score statistic

    S = N tr(R_e^-1 R_ephi R_phi^-1 R_phie)   ~   chi^2(p rank R_phi).

Each takes all its lags together, so that one of a hundred true models fails at 99 %, however many the lags are; of the
correlations at single lags one of a hundred lies outside its band. Under feedback the inputs answer the residuals of
the same and earlier samples. Residuals of a true model are still independent of inputs before them, so only these are
tested; that S has its distribution takes white residuals. Means of the residuals are not tested: they are removed.

A model estimated from N_i samples has uncertain parameters, which other data show. That adds at most
(N / N_i) chi^2(d) to either statistic, d = n (2 p + m) being the parameters that data determine; the limits allow for
it. On the data of the identification itself the tests are milder than 99 %.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 16.6; T. Soderstrom and P. Stoica,
System Identification, Prentice Hall, 1989, section 11.2; J. R. M. Hosking, The multivariate portmanteau statistic,
Journal of the American Statistical Association 75 (1980).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from amb_core.errors import IdentificationError

CONFIDENCE = 0.99
QUANTILE = float(special.ndtri(0.5 + 0.5 * CONFIDENCE))
"""Half the width of a 99 % band in standard deviations."""

LAGS = 25
_FEWEST = 10  # samples per lag
_BLOCK = 10_000  # rows of the lagged inputs held at once
_SMALLEST_EIGENVALUE = 1e-10  # of the correlation matrix of the lagged inputs, relative to the largest

Signals = Sequence[NDArray[np.float64]]


@dataclass(frozen=True)
class ChiSquareTest:
    """A statistic that is large where the model leaves something unexplained.

    Attributes
    ----------
    statistic : float
        Its value.
    degrees : int
        Degrees of freedom of its chi-square distribution for a model that is known exactly.
    limit : float
        Value that a true model exceeds once in a hundred, uncertain parameters allowed for.
    p_value : float
        Probability of so large a value for a true model.
    unexplained : float
        Share of the variance of the residuals that the lags explain beyond chance, from 0 to 1: what the failure of a
        test is worth. With many samples a test finds defects that matter to nobody.
    """

    statistic: float
    degrees: int
    limit: float
    p_value: float
    unexplained: float

    @property
    def passed(self) -> bool:
        """Whether the statistic is below its limit."""
        return self.statistic <= self.limit


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """Correlations of the residuals, and what they tell.

    Attributes
    ----------
    lags : int
        Largest lag M.
    samples : int
        Number of residuals N.
    deviation : ndarray, shape (p,)
        Standard deviation of the residuals, in the units of the outputs.
    mean : ndarray, shape (p,)
        Their mean: what the offsets of the model miss.
    autocorrelation : ndarray, shape (M + 1, p, p)
        Correlation of residual i with residual j, `lag` samples before.
    cross_correlation : ndarray, shape (2 M + 1, p, m)
        Correlation of residual i with input j, `lag` samples before, for lags from -M to M. Lags up to 0 show feedback.
    band : float
        Half the width of the 99 % band of a single correlation.
    whiteness, independence : ChiSquareTest
        All outputs and, for independence, all inputs together.
    whiteness_by_output, independence_by_output : tuple of ChiSquareTest
        The same for each output alone.
    """

    lags: int
    samples: int
    deviation: NDArray[np.float64]
    mean: NDArray[np.float64]
    autocorrelation: NDArray[np.float64]
    cross_correlation: NDArray[np.float64]
    band: float
    whiteness: ChiSquareTest
    independence: ChiSquareTest
    whiteness_by_output: tuple[ChiSquareTest, ...]
    independence_by_output: tuple[ChiSquareTest, ...]


def check_residuals(
    residuals: Signals, inputs: Signals, lags: int = LAGS, parameters: int = 0, estimation_samples: int = 0
) -> ResidualTests:
    """Test residuals of one or more experiments.

    Parameters
    ----------
    residuals, inputs : sequences of ndarray, shapes (steps, p), (steps, m)
        Of each experiment.
    lags : int
        Largest lag M.
    parameters, estimation_samples : int
        Parameters of the model that were estimated, and samples that they were estimated from; 0 for a model that is
        known exactly.

    Raises
    ------
    IdentificationError
        If there are too few samples, or a residual or input does not move.
    """
    samples = sum(map(len, residuals))
    if lags < 1 or samples < _FEWEST * lags or min(map(len, residuals)) <= lags:
        raise IdentificationError(
            f"{samples} samples are too few to test residuals over {lags} lags; at least {_FEWEST * max(lags, 1)} are "
            f"needed, and more than {lags} in each experiment"
        )
    mean = np.vstack(list(residuals)).mean(axis=0)
    errors = [part - part.mean(axis=0) for part in residuals]
    past = [part - part.mean(axis=0) for part in inputs]
    covariance, spread = _product(errors, errors, 0) / samples, _deviation(past)
    deviation = np.sqrt(np.diag(covariance))
    if np.any(deviation == 0.0) or np.any(spread == 0.0):
        kind, index = ("residual", deviation) if np.any(deviation == 0.0) else ("input", spread)
        raise IdentificationError(f"{kind} {int(np.argmin(index))} is constant, so that it has no correlations")
    share = samples / estimation_samples if estimation_samples else 0.0
    decorrelation = linalg.inv(linalg.cholesky(covariance, lower=True))
    white = [part @ decorrelation.T for part in errors]
    auto = np.array([_product(white, white, lag) for lag in range(1, lags + 1)])
    pairs = np.array([sum(len(part) - lag for part in errors) for lag in range(1, lags + 1)])
    autocorrelation = np.array([_product(errors, errors, lag) / samples for lag in range(lags + 1)])
    autocorrelation /= np.outer(deviation, deviation)
    p = len(deviation)

    def judged(statistic: float, degrees: int, outputs: int) -> ChiSquareTest:
        return _judge(statistic, degrees, parameters, share, samples * outputs)

    white_alone = samples**2 * np.sum(_diagonals(autocorrelation[1:]) ** 2 / pairs[:, np.newaxis], axis=0)
    scores, rank = _scores(white, past, spread, lags)
    scores_alone, _ = _scores([part / deviation for part in errors], past, spread, lags)
    cross = [_product(errors, past, lag) / samples / np.outer(deviation, spread) for lag in range(-lags, lags + 1)]
    return ResidualTests(
        lags,
        samples,
        deviation,
        mean,
        autocorrelation,
        np.array(cross),
        QUANTILE / np.sqrt(samples),
        judged(float(np.sum(auto**2 / pairs[:, np.newaxis, np.newaxis])), p * p * lags, p),
        judged(float(scores.sum()), p * rank, p),
        tuple(judged(float(value), lags, 1) for value in white_alone),
        tuple(judged(float(value), rank, 1) for value in scores_alone),
    )


def _judge(statistic: float, degrees: int, parameters: int, share: float, values: int) -> ChiSquareTest:
    """Compare with chi^2(degrees) + share chi^2(parameters), approximated by a scaled chi^2 of the same variance."""
    expected, half_variance = degrees + share * parameters, degrees + share**2 * parameters
    scale, equivalent = half_variance / expected, expected**2 / half_variance
    limit = scale * float(special.chdtri(equivalent, 1.0 - CONFIDENCE))
    p_value = float(special.chdtrc(equivalent, statistic / scale))
    return ChiSquareTest(statistic, degrees, limit, p_value, min(max((statistic - expected) / values, 0.0), 1.0))


def _scores(white: Signals, inputs: Signals, spread: NDArray[np.float64], lags: int) -> tuple[NDArray[np.float64], int]:
    """Squared lengths of white residuals in the space of the lagged inputs, shape (p,), and its dimension."""
    columns = lags * inputs[0].shape[1]
    power, product = np.zeros((columns, columns)), np.zeros((columns, white[0].shape[1]))
    for regressors, errors in _lagged(inputs, white, lags, spread):
        power += regressors.T @ regressors
        product += regressors.T @ errors
    eigenvalues, vectors = np.linalg.eigh(power)
    kept = eigenvalues > _SMALLEST_EIGENVALUE * eigenvalues[-1]
    along = vectors[:, kept].T @ product / np.sqrt(eigenvalues[kept])[:, np.newaxis]
    return np.asarray(np.sum(along**2, axis=0)), int(kept.sum())


def _lagged(
    inputs: Signals, errors: Signals, lags: int, spread: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Inputs at the lags 1 to M, side by side and scaled, and the errors to which they belong, in blocks."""
    for u, e in zip(inputs, errors, strict=True):
        for start in range(lags, len(u), _BLOCK):
            stop = min(start + _BLOCK, len(u))
            yield np.hstack([u[start - lag : stop - lag] / spread for lag in range(1, lags + 1)]), e[start:stop]


def _product(first: Signals, second: Signals, lag: int) -> NDArray[np.float64]:
    """Sum of first[k] second[k - lag]^T over all samples of all experiments."""
    parts = zip(first, second, strict=True)
    if lag < 0:
        return np.asarray(sum(a[:lag].T @ b[-lag:] for a, b in parts))
    return np.asarray(sum(a[lag:].T @ b[: len(b) - lag] for a, b in parts))


def _deviation(parts: Signals) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(sum(np.sum(part**2, axis=0) for part in parts) / sum(map(len, parts))))


def _diagonals(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.diagonal(matrices, axis1=1, axis2=2)
