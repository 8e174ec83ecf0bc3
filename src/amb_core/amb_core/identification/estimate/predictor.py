"""The one-step predictor of a model in innovations form, and the input matrix that fits it best.

With F = A - K C the predictor is

    x[k+1] = F x[k] + (B - K D) u[k] + K y[k],    yhat[k] = C x[k] + D u[k].

F is stable even if A is not, so unstable plants are predicted without an open-loop simulation. For given A, C and K
the prediction is linear in B - K D, D and x[0], which makes their best values a linear least-squares problem. Without
direct feedthrough D is zero. Data of several experiments are one after the other; each experiment has its own x[0].

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 4.3 and 10.6.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from contextlib import suppress

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.linear.numerics import with_rows
from amb_core.linear.small_matrices import add_product, set_matrix_product, set_product

_BLOCK = 10_000  # samples whose regressors are held at once, fewer if these are many
_ENTRIES = 2_420_000  # of the regressors held at once: 20 MB
_ADDED = (0.0, 1e-8, 1e-6, 1e-4, 1e-2)  # shares of the noise of each state, in turn until there is a gain
_SMALLEST_SINGULAR_VALUE = 1e-9  # of the regressors, relative to the largest; good data stay above 1e-6


def fit_input_matrix(
    a: NDArray[np.float64],
    c: NDArray[np.float64],
    k: NDArray[np.float64],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    lengths: Sequence[int] | None = None,
    feedthrough: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, NDArray[np.float64]]:
    """B, D and each x[0] with the least sum of squared one-step prediction errors.

    Parameters
    ----------
    a, c, k : ndarray, shapes (n, n), (p, n), (n, p)
        Matrices of the predictor; A - K C must be stable.
    inputs, outputs : ndarray, shapes (steps, m), (steps, p)
        Data without offsets, each column scaled to the order of 1.
    lengths : sequence of int, optional
        Steps of each experiment; one experiment by default.
    feedthrough : bool
        Whether outputs respond within the sample.

    Returns
    -------
    b, d, initial_states : ndarray, shapes (n, m), (p, m), (experiments, n)
        d is None without feedthrough.

    Raises
    ------
    IdentificationError
        If the data do not determine them.
    """
    n, m, p = len(a), inputs.shape[1], len(c)
    f, c = np.ascontiguousarray(a - k @ c), np.ascontiguousarray(c)
    unexplained = innovations(a, np.zeros((n, m)), c, k, np.zeros(n), inputs, outputs, lengths)
    factors = [
        experiment_factor(f, c, inputs[part], unexplained[part], feedthrough)
        for part in experiments(len(inputs), lengths)
    ]
    # The first rows of a factor determine an experiment's x[0] for any B, D. The other rows depend on these alone.
    rows = np.vstack([factor[n:, n:] for factor in factors])
    solution, _, _, singular_values = linalg.lstsq(rows[:, :-1], rows[:, -1])
    if singular_values[-1] < _SMALLEST_SINGULAR_VALUE * singular_values[0]:
        raise IdentificationError("the effects of the inputs cannot be separated; excite them independently")
    first_states = [linalg.lstsq(factor[:n, :n], factor[:n, -1] - factor[:n, n:-1] @ solution)[0] for factor in factors]
    if not feedthrough:
        return solution.reshape(m, n).T, None, np.array(first_states)
    d = solution[n * m :].reshape(p, m)
    return solution[: n * m].reshape(m, n).T + k @ d, d, np.array(first_states)


def experiments(steps: int, lengths: Sequence[int] | None) -> list[slice]:
    """The rows of each experiment in data of that many steps."""
    stops = list(itertools.accumulate(lengths if lengths is not None else [steps]))
    return [slice(start, stop) for start, stop in zip([0, *stops], stops, strict=False)]


def experiment_factor(
    f: NDArray[np.float64],
    c: NDArray[np.float64],
    inputs: NDArray[np.float64],
    unexplained: NDArray[np.float64],
    feedthrough: bool = False,
) -> NDArray[np.float64]:
    """Triangular factor of the derivatives of yhat by x[0], vec(B) and, row by row, D, and of their target."""
    n, m, p = len(f), inputs.shape[1], len(c)
    present = inputs if feedthrough else inputs[:, :0]
    columns = n + n * m + p * present.shape[1] + 1
    sensitivity = np.hstack([np.eye(n), np.zeros((n, n * m))])  # of the predictor's state
    factor = np.zeros((0, columns))
    block = min(_BLOCK, _ENTRIES // (p * columns) + 1)
    for start in range(0, len(inputs), block):
        part = slice(start, start + block)
        regressors = np.empty((len(inputs[part]), p, n + n * m))
        sensitivity = _regress(f, c, inputs[part], sensitivity, np.empty_like(sensitivity), regressors)
        by_d = np.einsum("ri,kj->krij", np.eye(p), present[part]).reshape(len(regressors), p, -1)
        rows = np.dstack([regressors, by_d, unexplained[part, :, np.newaxis]]).reshape(-1, columns)
        factor = with_rows(factor, rows)
    return factor


def kalman_gain(
    a: NDArray[np.float64],
    c: NDArray[np.float64],
    q: NDArray[np.float64],
    r: NDArray[np.float64],
    s: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Gain K of the stationary Kalman filter, with which A - K C is stable, shape (n, p).

    Parameters
    ----------
    a, c : ndarray, shapes (n, n), (p, n)
        System matrices.
    q, r, s : ndarray, shapes (n, n), (p, p), (n, p)
        Covariances of the noise of the states, of the outputs, and of both.

    Raises
    ------
    IdentificationError
        If there is no such gain.
    """
    n = len(a)
    try:
        variance = linalg.solve_discrete_are(a.T, c.T, q, r, s=s)
    except (linalg.LinAlgError, ValueError):
        raise IdentificationError(
            f"the Kalman gain of order {n} does not exist; lower the order or excite all inputs more"
        ) from None
    k = np.linalg.solve(c @ variance @ c.T + r, (a @ variance @ c.T + s).T).T
    radius = float(np.max(np.abs(np.linalg.eigvals(a - k @ c))))
    if not radius < 1.0:
        raise IdentificationError(f"the predictor of order {n} is unstable (spectral radius {radius:.6g})")
    return np.asarray(k)


def filter_gain(
    a: NDArray[np.float64], c: NDArray[np.float64], k: NDArray[np.float64], covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Gain of the Kalman filter for the noise of a model: its own K if that makes a stable predictor, shape (n, p).

    The Riccati equation gives none if a zero of the noise model is on the unit circle, or too close to it: modes that
    a fit has moved or a reduction has left out do that. With a little more noise of the states there is one.

    Parameters
    ----------
    a, c, k : ndarray, shapes (n, n), (p, n), (n, p)
        System matrices, and how the innovations move the states.
    covariance : ndarray, shape (p, p)
        Of the innovations.

    Raises
    ------
    IdentificationError
        If there is no such gain with more noise either.
    """
    # For innovations of variance 1: with the squares of positions in m the Riccati equation is too badly scaled.
    root = linalg.cholesky(covariance, lower=True)
    unit, gain = np.linalg.inv(root), k @ root
    noise = gain @ gain.T
    for share in _ADDED:
        with suppress(IdentificationError):
            added = share * np.diag(np.diag(noise))
            return kalman_gain(a, unit @ c, noise + added, np.eye(len(root)), gain) @ unit
    return kalman_gain(a, unit @ c, noise, np.eye(len(root)), gain) @ unit


def innovations(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    k: NDArray[np.float64],
    initial_states: NDArray[np.float64],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    lengths: Sequence[int] | None = None,
    d: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """One-step prediction errors, shape (steps, p), of data without offsets.

    `initial_states` has shape (experiments, n), or (n,) if all experiments have the same one; for `lengths` see
    `fit_input_matrix`. Without `d` there is no direct feedthrough.
    """
    if d is not None:
        outputs = outputs - inputs @ d.T  # (B - K D) u + K y = B u + K (y - D u)
    predictions = np.empty_like(outputs)
    parts = experiments(len(inputs), lengths)
    f, b, c, k = (np.ascontiguousarray(matrix) for matrix in (a - k @ c, b, c, k))
    for part, first in zip(parts, np.broadcast_to(initial_states, (len(parts), len(a))), strict=True):
        _predict(f, b, c, k, first.copy(), np.empty(len(a)), inputs[part], outputs[part], predictions[part])
    return outputs - predictions


@numba.njit(cache=True)
def _regress(
    f: NDArray[np.float64],
    c: NDArray[np.float64],
    inputs: NDArray[np.float64],
    sensitivity: NDArray[np.float64],
    advanced: NDArray[np.float64],
    regressors: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Fill in the derivatives of yhat by x[0] and vec(B), shape (steps, p, n + n m); return those of the last state.

    `sensitivity`, the derivatives of the first state, and `advanced` are overwritten.
    """
    for step in range(len(inputs)):
        set_matrix_product(c, sensitivity, regressors[step])
        set_matrix_product(f, sensitivity, advanced)
        for column in range(inputs.shape[1]):
            for row in range(len(f)):
                advanced[row, (column + 1) * len(f) + row] += inputs[step, column]
        sensitivity, advanced = advanced, sensitivity
    return sensitivity


@numba.njit(cache=True)
def _predict(
    f: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    k: NDArray[np.float64],
    state: NDArray[np.float64],
    advanced: NDArray[np.float64],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    predictions: NDArray[np.float64],
) -> None:
    """Fill in yhat, shape (steps, p), from the state at the first step; `advanced` is work space of its shape.

    As `amb_core.linear.simulation`, without a copy of inputs and outputs side by side: estimates run it thousands of
    times.
    """
    for step in range(len(inputs)):
        set_product(c, state, predictions[step])
        set_product(f, state, advanced)
        add_product(b, inputs[step], advanced)
        add_product(k, outputs[step], advanced)
        state, advanced = advanced, state
