"""Subspace identification (SSARX) that stays consistent on data of a closed loop.

A long regularised autoregressive model (ARX) gives the predictor's Markov parameters. With them the part of the future
outputs that stems from future inputs and outputs is removed, so what is left depends on the past alone, whether there
is feedback or not. Its canonical correlations with the past give the state, and least squares on the state the
predictor. The feedthrough is zero throughout, since the position answers after the current reference.

All steps work on one triangular factor of the data matrix, which is built in blocks: time and memory are linear in the
samples. The length of the past is the one of the best Akaike criterion; the ridge, without which band-limited data
leave the ARX model undetermined, is the one of the best generalised cross-validation.

Sources: M. Jansson, Subspace identification and ARX modeling, 13th IFAC Symposium on System Identification, 2003;
G. H. Golub, M. Heath and G. Wahba, Generalized cross-validation as a method for choosing a good ridge parameter,
Technometrics 21 (1979).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from threadpoolctl import threadpool_limits

from amb_core.errors import IdentificationError
from amb_core.identification.model import StateSpaceModel
from amb_core.identification.predictor import fit_input_matrix, kalman_gain
from amb_core.identification.scaled_data import ScaledData, check_order

_LONGEST_PAST = 60  # steps; by then the predictor of a bearing has forgotten most, at any noise worth the name
_SAMPLES_PER_STEP = 20  # at least, so that short data leave the long ARX model enough freedom
_BLOCK = 4_000  # rows of the data matrix held at once
_LEAST_STRENGTH = 1e-12  # of a state, relative to the strongest; beyond it is rounding
_RIDGES = np.logspace(-14, -2, 25)  # relative to the largest eigenvalue of the past's covariance


def ssarx(
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    sample_time: float,
    order: int = 10,
    past: int | None = None,
    future: int | None = None,
    source: str = "",
) -> StateSpaceModel:
    """Identify a state-space model of a given order; means are removed from the data and kept as its offsets.

    Parameters
    ----------
    inputs, outputs : ndarray, shapes (steps, 2), (steps, 2)
        Control current references (A) and positions (m).
    sample_time : float
        Sample time of the data (s).
    order : int
        Number of states n.
    past, future : int, optional
        Horizons (steps), each at least half the order, so that n states can be told apart. By default the past is that
        of the ARX model of the best Akaike criterion, the future twice the order.
    source : str
        Where the data come from, kept in the model.

    Raises
    ------
    IdentificationError
        If order or horizons do not suit the data or the data determine no model; one line that says why.
    """
    check_order(order)
    shortest = math.ceil(order / 2) + 1
    longest = max(shortest, min(_LONGEST_PAST, len(inputs) // _SAMPLES_PER_STEP)) if past is None else past
    future = max(shortest, 2 * order) if future is None else future
    for name, horizon in (("past", longest), ("future", future)):
        if horizon < shortest:
            raise IdentificationError(
                f"{name} {horizon} is not allowed; allowed: at least {shortest} for order {order}"
            )
    data = ScaledData.of(inputs, outputs)
    needed = 5 * (longest + future + 1)  # as many rows of the data matrix as columns
    if len(data.inputs) < needed:
        raise IdentificationError(
            f"{len(data.inputs)} samples are too few for order {order}; at least {needed} are needed"
        )
    # The matrices are small: more BLAS threads only cost time, and take cores from the control loop.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            triangle = _Triangle(data, longest, future)
            a, c, k = _predictor(triangle, order, _best_past(triangle, shortest) if past is None else past)
            b, initial_state = fit_input_matrix(a, c, k, data.inputs, data.outputs)
            return data.model(a, b, c, k, initial_state, sample_time, "ssarx", source)
        except (linalg.LinAlgError, ValueError) as problem:
            reason = " ".join(str(problem).split())
            raise IdentificationError(f"no model of order {order} from {len(data.inputs)} samples: {reason}") from None


class _Triangle:
    """Triangular factor of the rows [z[k-1] ... z[k-past]  z[k] ... z[k+future]] with z = (y, u).

    Columns of the factor have the inner products of the data's columns, so they stand for the data in least squares.
    """

    def __init__(self, data: ScaledData, past: int, future: int) -> None:
        self.past, self.future = past, future
        self.p, self.q = data.outputs.shape[1], data.outputs.shape[1] + data.inputs.shape[1]
        z = np.hstack([data.outputs, data.inputs])
        lags = np.concatenate([np.arange(-1, -past - 1, -1), np.arange(future + 1)])
        self.rows = len(z) - past - future
        factor = np.zeros((0, self.q * len(lags)))
        for start in range(past, past + self.rows, _BLOCK):
            stop = min(start + _BLOCK, past + self.rows)
            block = np.hstack([z[start + lag : stop + lag] for lag in lags])
            factor = linalg.qr(np.vstack([factor, block]), mode="r", overwrite_a=True, check_finite=False)[0]
            factor = factor[: factor.shape[1]]
        self._factor = np.asarray(factor) / math.sqrt(self.rows)

    def before(self, steps: int, lead: int = 0) -> NDArray[np.float64]:
        """The columns z[k-1+lead] ... z[k-steps+lead], lead 0 or 1."""
        recent = [self.at(ahead) for ahead in range(lead - 1, -1, -1)]
        return np.hstack([*recent, self._factor[:, : self.q * (steps - lead)]])

    def at(self, ahead: int) -> NDArray[np.float64]:
        """The columns z[k+ahead]."""
        start = self.q * (self.past + ahead)
        return self._factor[:, start : start + self.q]

    def residual_covariance(self, steps: int) -> NDArray[np.float64]:
        """Covariance of y[k] less its least-squares fit by z[k-1] ... z[k-steps]."""
        rest = self.at(0)[self.q * steps :, : self.p]
        return np.asarray(rest.T @ rest)


def _best_past(triangle: _Triangle, shortest: int) -> int:
    """Steps of the ARX model with the least Akaike criterion."""
    candidates = range(shortest, triangle.past + 1)
    criteria = [
        triangle.rows * np.linalg.slogdet(triangle.residual_covariance(steps))[1]
        + 2.0 * triangle.p * triangle.q * steps
        for steps in candidates
    ]
    return candidates[int(np.argmin(criteria))]


def _predictor(
    triangle: _Triangle, order: int, past: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A, C and the Kalman gain K."""
    z_now, z_past = triangle.at(0), triangle.before(past)
    to_state, strengths = _state_from_past(triangle, order, past)
    state, advanced = z_past @ to_state, triangle.before(past, lead=1) @ to_state
    c = linalg.lstsq(state, z_now[:, : triangle.p])[0].T
    errors = z_now[:, : triangle.p] - state @ c.T
    # The controller answers within the sample, so the errors correlate with the inputs and must be regressors too.
    regressors = np.hstack([state, errors, z_now[:, triangle.p :]])
    transition = linalg.lstsq(regressors, advanced)[0]
    a, k = transition[:order].T, transition[order : order + triangle.p].T
    # A model of too low an order leaves residuals; with them K is the gain of the Kalman filter, which is stable.
    residuals = advanced - regressors @ transition
    r = errors.T @ errors
    # States that are seen equally well: the input matrix is then well determined by the data, however weak a state is.
    ratio = np.divide.outer(strengths, strengths)
    a, c, k = a * ratio, c / strengths, k * strengths[:, np.newaxis]
    q = residuals.T @ residuals * np.outer(strengths, strengths) + k @ r @ k.T
    return a, c, kalman_gain(a, c, q, r, k @ r)


def _state_from_past(triangle: _Triangle, order: int, past: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The map from z[k-1] ... z[k-past] to states of variance 1, and how strongly the future shows each."""
    p, q, future = triangle.p, triangle.q, triangle.future
    z_past = triangle.before(past)
    outputs = np.hstack([triangle.at(ahead)[:, :p] for ahead in range(future)])
    left, singular, right = linalg.svd(z_past, full_matrices=False, check_finite=False)
    ridge = _best_ridge(left, singular, outputs[:, :p], triangle.rows)
    markov = _ridge_solution(left, singular, right, outputs[:, :p], ridge).T  # columns for z[k-1], z[k-2], ...
    for ahead in range(1, future):
        for lag in range(1, min(ahead, past) + 1):
            known = triangle.at(ahead - lag) @ markov[:, (lag - 1) * q : lag * q].T
            outputs[:, ahead * p : (ahead + 1) * p] -= known
    observed = _ridge_solution(left, singular, right, outputs, ridge)
    unexplained = outputs - z_past @ observed
    covariance = unexplained.T @ unexplained + np.finfo(float).eps * np.eye(p * future)
    weight = linalg.cholesky(covariance, lower=True)
    weighted = linalg.solve_triangular(weight, (z_past @ observed).T, lower=True)
    directions, strengths, _ = linalg.svd(weighted, full_matrices=False, check_finite=False)
    if not strengths[order - 1] > _LEAST_STRENGTH * strengths[0]:
        raise IdentificationError(f"the data show fewer than {order} states; lower the order")
    directions, strengths = directions[:, :order], strengths[:order]
    return observed @ linalg.solve_triangular(weight, directions, lower=True, trans="T") / strengths, strengths


def _best_ridge(
    left: NDArray[np.float64], singular: NDArray[np.float64], targets: NDArray[np.float64], samples: int
) -> float:
    """The ridge with the least generalised cross-validation score, in units of the squared singular values."""
    seen = left.T @ targets
    beyond = np.sum(targets**2) - np.sum(seen**2)
    ridges = _RIDGES * singular[0] ** 2
    scores = []
    for ridge in ridges:
        lost = ridge / (singular**2 + ridge)
        freedom = 1.0 - np.sum(1.0 - lost) / samples
        scores.append((beyond + np.sum((lost[:, np.newaxis] * seen) ** 2)) / freedom**2)
    return float(ridges[int(np.argmin(scores))])


def _ridge_solution(
    left: NDArray[np.float64],
    singular: NDArray[np.float64],
    right: NDArray[np.float64],
    targets: NDArray[np.float64],
    ridge: float,
) -> NDArray[np.float64]:
    """Coefficients with the least sum of squared errors plus ridge times squared coefficients."""
    return np.asarray(right.T @ ((singular / (singular**2 + ridge))[:, np.newaxis] * (left.T @ targets)))
