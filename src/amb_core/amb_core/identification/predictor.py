"""The one-step predictor of a model in innovations form, and the input matrix that fits it best.

With F = A - K C the predictor of a model without direct feedthrough is

    x[k+1] = F x[k] + B u[k] + K y[k],    yhat[k] = C x[k].

F is stable even where A is not, so unstable plants are predicted without an open-loop simulation. For given A, C and K
the prediction is linear in B and x[0], which makes their best values a linear least-squares problem.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 4.3 and 10.6.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.errors import IdentificationError
from amb_core.identification.small_matrices import add_product, set_matrix_product, set_product

_BLOCK = 10_000  # samples whose regressors are held at once
_SMALLEST_SINGULAR_VALUE = 1e-9  # of the regressors, relative to the largest; good data stay above 1e-6


def fit_input_matrix(
    a: NDArray[np.float64],
    c: NDArray[np.float64],
    k: NDArray[np.float64],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """B and x[0] with the least sum of squared one-step prediction errors, for D = 0.

    Parameters
    ----------
    a, c, k : ndarray, shapes (n, n), (p, n), (n, p)
        Matrices of the predictor; A - K C must be stable.
    inputs, outputs : ndarray, shapes (steps, m), (steps, p)
        Data without offsets, each column scaled to the order of 1.

    Returns
    -------
    b, initial_state : ndarray, shapes (n, m), (n,)

    Raises
    ------
    IdentificationError
        If the data do not determine B.
    """
    n, m = len(a), inputs.shape[1]
    unknowns = n * m + n
    f, c = np.ascontiguousarray(a - k @ c), np.ascontiguousarray(c)
    unexplained = innovations(a, np.zeros((n, m)), c, k, np.zeros(n), inputs, outputs)
    sensitivity = np.hstack([np.zeros((n, n * m)), np.eye(n)])  # of the predictor's state to vec(B) and x[0]
    triangle = np.zeros((0, unknowns + 1))
    for start in range(0, len(inputs), _BLOCK):
        part = slice(start, start + _BLOCK)
        regressors = np.empty((len(inputs[part]), len(c), unknowns))
        sensitivity = _regress(f, c, inputs[part], sensitivity, np.empty_like(sensitivity), regressors)
        rows = np.dstack([regressors, unexplained[part, :, np.newaxis]]).reshape(-1, unknowns + 1)
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, rows]), mode="r"))
    solution, _, _, singular_values = linalg.lstsq(triangle[:, :unknowns], triangle[:, unknowns])
    if singular_values[-1] < _SMALLEST_SINGULAR_VALUE * singular_values[0]:
        raise IdentificationError("the data do not tell the effects of the inputs apart; excite the axes independently")
    return solution[: n * m].reshape(m, n).T, solution[n * m :]


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
            f"the Kalman gain of order {n} does not exist; lower the order or excite both axes more"
        ) from None
    k = np.linalg.solve(c @ variance @ c.T + r, (a @ variance @ c.T + s).T).T
    radius = float(np.max(np.abs(np.linalg.eigvals(a - k @ c))))
    if not radius < 1.0:
        raise IdentificationError(f"the predictor of order {n} is unstable (spectral radius {radius:.6g})")
    return np.asarray(k)


def innovations(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    k: NDArray[np.float64],
    initial_state: NDArray[np.float64],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
) -> NDArray[np.float64]:
    """One-step prediction errors, shape (steps, p), of data without offsets."""
    predictions = np.empty_like(outputs)
    _predict(
        np.ascontiguousarray(a - k @ c),
        np.ascontiguousarray(b),
        np.ascontiguousarray(c),
        np.ascontiguousarray(k),
        initial_state.copy(),
        np.empty_like(initial_state),
        inputs,
        outputs,
        predictions,
    )
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
    """Fill in the derivatives of yhat by vec(B) and x[0], shape (steps, p, n m + n); return those of the last state.

    `sensitivity`, the derivatives of the first state, and `advanced` are overwritten.
    """
    for step in range(len(inputs)):
        set_matrix_product(c, sensitivity, regressors[step])
        set_matrix_product(f, sensitivity, advanced)
        for column in range(inputs.shape[1]):
            for row in range(len(f)):
                advanced[row, column * len(f) + row] += inputs[step, column]
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
    """Fill in yhat, shape (steps, p), from the state at the first step; `advanced` is work space of its shape."""
    for step in range(len(inputs)):
        set_product(c, state, predictions[step])
        set_product(f, state, advanced)
        add_product(b, inputs[step], advanced)
        add_product(k, outputs[step], advanced)
        state, advanced = advanced, state
