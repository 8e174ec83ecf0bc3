"""Subspace identification (SSARX) that stays consistent on data of a closed loop.

The Markov parameters of a long ARX model give the part of the future outputs that comes from future inputs and outputs.
This part is removed. The remainder depends on the past alone, with or without feedback. Its canonical correlations with
the past give the state (see `state_regression` for the rest).

Source: M. Jansson, Subspace identification and ARX modeling, 13th IFAC Symposium on System Identification, 2003.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.identification.estimate.data_triangle import PastRegression
from amb_core.identification.estimate.scaled_data import Samples
from amb_core.identification.estimate.state_regression import identify_by_states, models_of_all_ridges
from amb_core.linear.model.state_space import StateSpaceModel


def ssarx(
    inputs: Samples,
    outputs: Samples,
    sample_time: float,
    order: int = 10,
    past: int | None = None,
    future: int | None = None,
    source: str = "",
    feedthrough: bool = False,
) -> StateSpaceModel:
    """Identify a state-space model of a given order; means are removed from the data and kept as its offsets.

    Parameters
    ----------
    inputs, outputs : ndarray, shapes (steps, m), (steps, p), or lists of such
        Inputs and outputs of one experiment, or of each of several, in any units of their own.
    sample_time : float
        Sample time of the data (s).
    order : int, optional
        Number of states n.
    past, future : int, optional
        Horizons (steps), each more than the order over the number of outputs, so that n states can be distinguished. By
        default the past is that of the ARX model with the best Akaike criterion, the future twice the order.
    source : str, optional
        Where the data come from, kept in the model.
    feedthrough : bool, optional
        Whether outputs respond within the sample; D is then estimated, and zero otherwise.

    Returns
    -------
    StateSpaceModel
        The model in innovations form; `fit` is empty.

    Raises
    ------
    IdentificationError
        If order or horizons do not suit the data or the data determine no model; one line with the reason.
    """
    return identify_by_states(
        inputs, outputs, sample_time, order, past, future, source, "ssarx", future_map, feedthrough
    )


def ssarx_ridges(
    inputs: Samples, outputs: Samples, sample_time: float, order: int = 10, feedthrough: bool = False
) -> list[StateSpaceModel]:
    """Models of one order with every ridge that gives one; arguments and errors are those of `ssarx`.

    `ssarx` takes the ridge with the smallest prediction errors. Where data have next to no noise, its model can be the
    worst in simulation.
    """
    return models_of_all_ridges(inputs, outputs, sample_time, order, "ssarx", future_map, feedthrough)


def future_map(regression: PastRegression, ridge: float) -> NDArray[np.float64]:
    """Future outputs for unknown future signals, weighted by their part that the past does not explain."""
    triangle = regression.triangle
    p, q = triangle.p, triangle.q
    outputs = np.hstack([triangle.at(ahead)[:, :p] for ahead in range(triangle.future)])
    markov, direct, _ = regression.markov_parameters(ridge)
    markov = markov.T  # columns for z[k-1], z[k-2], ...
    if triangle.feedthrough:
        for ahead in range(triangle.future):
            outputs[:, ahead * p : (ahead + 1) * p] -= triangle.at(ahead)[:, p:] @ direct
    for ahead in range(1, triangle.future):
        lags = min(ahead, regression.steps)
        known = np.hstack([triangle.at(ahead - lag) for lag in range(1, lags + 1)])
        outputs[:, ahead * p : (ahead + 1) * p] -= known @ markov[:, : lags * q].T
    observed = regression.coefficients(outputs, ridge)
    unexplained = outputs - regression.columns @ observed
    covariance = unexplained.T @ unexplained + np.finfo(float).eps * np.eye(outputs.shape[1])
    weight = linalg.cholesky(covariance, lower=True)
    return np.asarray(linalg.solve_triangular(weight, observed.T, lower=True).T)
