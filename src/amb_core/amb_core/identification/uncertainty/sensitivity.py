"""How the one-step predictions of a model respond to small changes of its matrices.

With F = A - K C, the predictor's state x, inputs u and innovations e = y - C x - D u,

    dx[k+1] = F dx[k] + (dA - K dC) x[k] + (dB - K dD) u[k] + dK e[k],    dyhat[k] = C dx[k] + dC x[k] + dD u[k].

F is stable even if A is not, so unstable plants need no special treatment.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.identification.uncertainty.directions import Directions
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import with_rows

_ENTRIES = 1_000_000  # of the derivatives of states held at once

Arrays = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The information of an experiment about the directions.

    Attributes
    ----------
    factor : ndarray, shape (rows, q)
        Triangular factor of the derivatives of the weighted predictions, initial state and constants adapted.
    scores : ndarray, shape (batches, q)
        Sums over batches of samples of these derivatives times the weighted errors.
    """

    factor: Arrays
    scores: Arrays


def sensitivity(
    model: StateSpaceModel,
    directions: Directions,
    inputs: Arrays,
    states: Arrays,
    errors: Arrays,
    weight: Arrays,
    batch: int,
) -> Sensitivity:
    """Derivatives of the weighted one-step predictions of an experiment along the directions.

    Parameters
    ----------
    model : StateSpaceModel
        Model with a stable predictor.
    directions : Directions
        Changes of the model.
    inputs, states, errors : ndarray, shapes (steps, m), (steps, n), (steps, p)
        Inputs, states of the predictor and prediction errors without mean.
    weight : ndarray, shape (p, p)
        Errors and predictions are weighted as weight @ error.
    batch : int
        Samples in a batch.

    Raises
    ------
    LinAlgError
        If a derivative is so large that it, or its square, is not finite.
    """
    n, p, q = model.order, len(model.c), directions.count
    free = n + p  # initial states and constants of the outputs, first, so that the factor's first rows are theirs
    columns = free + q
    f = np.ascontiguousarray(model.a - model.k @ model.c)
    by_input = directions.b if directions.d is None else directions.b - model.k @ directions.d
    forcing = np.concatenate([directions.a - model.k @ directions.c, by_input, directions.k], axis=2)
    by_signal = np.zeros((forcing.shape[2], n, columns))
    by_signal[:, :, free:] = forcing.transpose(2, 1, 0)
    seen, by_seen = states, directions.c
    if directions.d is not None:
        seen, by_seen = np.hstack([states, inputs]), np.concatenate([directions.c, directions.d], axis=2)
    by_state = np.zeros((seen.shape[1], p, columns))
    by_state[:, :, free:] = by_seen.transpose(2, 1, 0)
    signals = np.hstack([states, inputs, errors])
    change = np.hstack([np.eye(n), np.zeros((n, p + q))])
    triangle, scores = np.zeros((0, columns)), []
    batches = max(1, _ENTRIES // (n * columns * batch))
    for start in range(0, len(signals), batch * batches):
        part = slice(start, start + batch * batches)
        changes = np.tensordot(signals[part], by_signal, axes=1)
        _propagate(f, change, changes)
        derivatives = model.c @ changes + np.tensordot(seen[part], by_state, axes=1)
        derivatives[:, :, n:free] += np.eye(p)
        derivatives = weight @ derivatives
        triangle = with_rows(triangle, derivatives.reshape(-1, columns))
        weighted = errors[part] @ weight.T
        scores += [
            np.tensordot(weighted[first : first + batch], derivatives[first : first + batch], axes=2)
            for first in range(0, len(derivatives), batch)
        ]
    all_scores = np.array(scores)
    if not all(np.isfinite(np.sum(part**2)) for part in (triangle, all_scores)):
        raise np.linalg.LinAlgError("derivatives of its predictions are not finite")
    absorbed = np.linalg.lstsq(triangle[:free, :free], triangle[:free, free:], rcond=None)[0]
    return Sensitivity(triangle[free:, free:], all_scores[:, free:] - all_scores[:, :free] @ absorbed)


@numba.njit(cache=True)
def _propagate(f: Arrays, change: Arrays, forcing: Arrays) -> None:
    """Replace the forcing terms by the changes of the states, shape (steps, n, columns).

    `change` contains the changes at the first step, and after the call those at the step after the last.
    """
    n, columns = change.shape
    after = np.empty_like(change)
    for step in range(len(forcing)):
        for row in range(n):
            for column in range(columns):
                after[row, column] = forcing[step, row, column]
                forcing[step, row, column] = change[row, column]
            for inner in range(n):
                factor = f[row, inner]
                for column in range(columns):
                    after[row, column] += factor * change[inner, column]
        change[:] = after
