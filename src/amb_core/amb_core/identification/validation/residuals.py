"""Tests of the residuals (one-step prediction errors): are they white, and independent of past inputs?

Whiteness: the multivariate portmanteau statistic of Hosking over the lags 1 to M,

    Q = N^2 sum_l tr(C_l^T C_0^-1 C_l C_0^-1) / (N - l)   ~   chi^2(p^2 M),

which for one output is that of Ljung and Box. Independence: with phi[k] = (u[k-1], ..., u[k-M]), the score statistic

    S = N tr(R_e^-1 R_ephi R_phi^-1 R_phie)   ~   chi^2(p rank R_phi).

Each test combines all its lags, so one of a thousand true models fails at 99.9 %, for any number of lags. Of the
correlations at single lags one of a hundred lies outside its band. Under feedback the inputs respond to the residuals
of the same and earlier samples. Residuals of a true model are still independent of earlier inputs, so only these are
tested. S has its distribution only for white residuals. Means of the residuals are not tested: they are removed.

A model estimated from N_i samples has uncertain parameters, which other data show. That adds at most
(N / N_i) chi^2(d) to either statistic, d being the number of parameters that data determine, n (2 p + m) and, with
direct feedthrough, m p more; the limits include it. On the data of the identification itself the tests are less strict
than 99.9 %.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 16.6; T. Soderstrom and P. Stoica,
System Identification, Prentice Hall, 1989, section 11.2; J. R. M. Hosking, The multivariate portmanteau statistic,
Journal of the American Statistical Association 75 (1980).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from amb_core.ground.errors import IdentificationError

CONFIDENCE = 0.999
"""Of the tests over all lags."""
QUANTILE = float(special.ndtri(0.5 + 0.5 * 0.99))
"""Half the width of a 99 % band in standard deviations."""

LAGS = 25
_FEWEST = 10  # samples per lag
_CONSTANT = 1e-12  # deviation, relative to the largest magnitude, that rounding alone may make
_BLOCK = 10_000  # rows of the lagged inputs held at once
_SMALLEST_EIGENVALUE = 1e-10  # of the correlation matrix of the lagged inputs, relative to the largest

Signals = Sequence[NDArray[np.float64]]


@dataclass(frozen=True)
class ChiSquareTest:
    """A statistic that is large if the model does not explain the data.

    Attributes
    ----------
    statistic : float
        Its value (-).
    degrees : int
        Degrees of freedom of its chi-square distribution for a model that is known exactly.
    limit : float
        Value (-) that a true model exceeds in one of a thousand cases, uncertain parameters included.
    p_value : float
        Probability of so large a value for a true model (-).
    unexplained : float
        Share (-) of the variance of the residuals that least squares on the lags explains, from 0 to 1, chance
        included. It shows how serious a failed test is: with many samples a test finds defects that do not matter.
    """

    statistic: float
    degrees: int
    limit: float
    p_value: float
    unexplained: float

    @property
    def beyond_chance(self) -> float:
        """Share that is explained beyond what `degrees` independent regressors explain by chance."""
        by_chance = self.unexplained * self.degrees / self.statistic if self.statistic > 0.0 else 0.0
        return max(self.unexplained - by_chance, 0.0)

    @property
    def passed(self) -> bool:
        """Whether the statistic is below its limit."""
        return self.statistic <= self.limit


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """Correlations of the residuals, and their tests.

    Attributes
    ----------
    lags : int
        Largest lag M.
    samples : int
        Number of residuals N.
    deviation : ndarray, shape (p,)
        Standard deviation of the residuals, in the units of the outputs.
    mean : ndarray, shape (p,)
        Their mean, in the units of the outputs: the error of the model's offsets.
    autocorrelation : ndarray, shape (M + 1, p, p)
        Correlation (-) of residual i with residual j, `lag` samples before.
    cross_correlation : ndarray, shape (2 M + 1, p, m)
        Correlation (-) of residual i with input j, `lag` samples before, for lags from -M to M. Lags up to 0 show
        feedback.
    band : float
        Half the width of the 99 % band of a single correlation (-).
    whiteness, independence : ChiSquareTest
        All outputs and, for independence, all inputs together.
    whiteness_by_output, independence_by_output : tuple of ChiSquareTest
        The same for each output alone.
    undisturbed_whiteness_by_output : tuple of ChiSquareTest
        Whiteness of each output without disturbances that are known.
    undisturbed_share : ndarray, shape (p,)
        Share of the variance of the residuals that is left without them (-).
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
    undisturbed_whiteness_by_output: tuple[ChiSquareTest, ...]
    undisturbed_share: NDArray[np.float64]


def check_residuals(
    residuals: Signals,
    inputs: Signals,
    lags: int = LAGS,
    parameters: int = 0,
    estimation_samples: int = 0,
    undisturbed: tuple[Signals, Signals] | None = None,
) -> ResidualTests:
    """Test residuals of one or more experiments.

    Parameters
    ----------
    residuals, inputs : sequences of ndarray, shapes (steps, p), (steps, m)
        Of each experiment, in the units of outputs and inputs.
    lags : int, optional
        Largest lag M.
    parameters, estimation_samples : int, optional
        Parameters of the model that were estimated, and samples that they were estimated from; 0 for a model that is
        known exactly.
    undisturbed : tuple of two sequences of ndarray, shapes (steps, p), (steps, m), optional
        Residuals without disturbances that are known, and their inputs, for the test of independence, in the units of
        outputs and inputs; by default all.

    Returns
    -------
    ResidualTests
        Correlations and tests of all outputs together and of each.

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
    errors, deviation = _normalised(residuals, "residual")
    driving, _ = _normalised(inputs, "input")
    white = decorrelated(errors)
    quiet, along = (residuals, inputs) if undisturbed is None else undisturbed
    (driven, left), (driven_by, _) = _normalised(quiet, "residual"), _normalised(along, "input")
    judge = partial(_judge, parameters=parameters, share=samples / estimation_samples if estimation_samples else 0.0)
    alone, driven_alone = (
        [[part[:, [output]] for part in parts] for output in range(len(deviation))] for parts in (errors, driven)
    )
    return ResidualTests(
        lags=lags,
        samples=samples,
        deviation=deviation,
        mean=mean,
        autocorrelation=np.array([_product(errors, errors, lag) for lag in range(lags + 1)]) / samples,
        cross_correlation=np.array([_product(errors, driving, lag) for lag in range(-lags, lags + 1)]) / samples,
        band=QUANTILE / np.sqrt(samples),
        whiteness=_whiteness(white, lags, judge),
        independence=_independence(decorrelated(driven), driven_by, lags, judge),
        whiteness_by_output=tuple(_whiteness(errors, lags, judge) for errors in alone),
        independence_by_output=tuple(_independence(errors, driven_by, lags, judge) for errors in driven_alone),
        undisturbed_whiteness_by_output=tuple(_whiteness(errors, lags, judge) for errors in driven_alone),
        undisturbed_share=np.minimum((left / deviation) ** 2, 1.0),
    )


def _whiteness(white: Signals, lags: int, judge: Callable[..., ChiSquareTest]) -> ChiSquareTest:
    """The portmanteau test of signals with the unit matrix as covariance."""
    samples, p = sum(map(len, white)), white[0].shape[1]
    statistic = 0.0
    for lag in range(1, lags + 1):
        pairs = sum(len(part) - lag for part in white)
        statistic += float(np.sum(_product(white, white, lag) ** 2)) / pairs
    explained, _ = _score(white, white, lags)
    return judge(statistic, p * p * lags, unexplained=explained / (samples * p))


def _independence(white: Signals, inputs: Signals, lags: int, judge: Callable[..., ChiSquareTest]) -> ChiSquareTest:
    """The score test of signals with the unit matrix as covariance."""
    samples, p = sum(map(len, white)), white[0].shape[1]
    score, rank = _score(white, inputs, lags)
    return judge(score, p * rank, unexplained=score / (samples * p))


def _judge(statistic: float, degrees: int, unexplained: float, parameters: int, share: float) -> ChiSquareTest:
    """Compare with chi^2(degrees) + share chi^2(parameters), approximated by a scaled chi^2 of the same variance."""
    expected, half_variance = degrees + share * parameters, degrees + share**2 * parameters
    scale, equivalent = half_variance / expected, expected**2 / half_variance
    limit = scale * float(special.chdtri(equivalent, 1.0 - CONFIDENCE))
    p_value = float(special.chdtrc(equivalent, statistic / scale))
    return ChiSquareTest(statistic, degrees, limit, p_value, unexplained)


def _score(errors: Signals, signals: Signals, lags: int) -> tuple[float, int]:
    """Squared length of the errors in the space of the lagged signals, and the dimension of that space."""
    columns = lags * signals[0].shape[1]
    power, product = np.zeros((columns, columns)), np.zeros((columns, errors[0].shape[1]))
    for regressors, explained in _lagged(signals, errors, lags):
        power += regressors.T @ regressors
        product += regressors.T @ explained
    eigenvalues, vectors = np.linalg.eigh(power)
    kept = eigenvalues > _SMALLEST_EIGENVALUE * eigenvalues[-1]
    along = vectors[:, kept].T @ product / np.sqrt(eigenvalues[kept])[:, np.newaxis]
    return float(np.sum(along**2)), int(kept.sum())


def _lagged(signals: Signals, errors: Signals, lags: int) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Signals at the lags 1 to M, side by side, and the errors to which they belong, in blocks."""
    for z, e in zip(signals, errors, strict=True):
        for start in range(lags, len(z), _BLOCK):
            stop = min(start + _BLOCK, len(z))
            yield np.hstack([z[start - lag : stop - lag] for lag in range(1, lags + 1)]), e[start:stop]


def _product(first: Signals, second: Signals, lag: int) -> NDArray[np.float64]:
    """Sum of first[k] second[k - lag]^T over all samples of all experiments."""
    parts = zip(first, second, strict=True)
    if lag < 0:
        return np.asarray(sum(a[:lag].T @ b[-lag:] for a, b in parts))
    return np.asarray(sum(a[lag:].T @ b[: len(b) - lag] for a, b in parts))


def _normalised(signals: Signals, kind: str) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Signals without the mean of each experiment and with variance 1 over all, and their deviations."""
    centred = [part - part.mean(axis=0) for part in signals]
    deviation = np.sqrt(sum(np.sum(part**2, axis=0) for part in centred) / sum(map(len, centred)))
    largest = np.max([np.abs(part).max(axis=0) for part in signals], axis=0)
    constant = np.flatnonzero(deviation <= _CONSTANT * largest)
    if constant.size:
        raise IdentificationError(
            f"{kind} {constant[0] + 1} is constant in these data, so it has no correlations; "
            "use data in which all signals move, of a measured or simulated bearing with noise"
        )
    return [part / deviation for part in centred], deviation


def decorrelated(errors: Signals) -> list[NDArray[np.float64]]:
    """The errors in coordinates in which their covariance is the unit matrix."""
    covariance = _product(errors, errors, 0) / sum(map(len, errors))
    try:
        factor = linalg.cholesky(covariance, lower=True)
    except linalg.LinAlgError:
        raise IdentificationError("the residuals of the outputs are multiples of one another") from None
    return [linalg.solve_triangular(factor, part.T, lower=True).T for part in errors]
