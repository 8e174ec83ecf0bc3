"""Subspace identification by canonical variate analysis (CVA).

The states are the canonical variates of past and future outputs given the future inputs (see `state_regression` for the
rest). Like the other classic methods it assumes future inputs independent of past noise, so feedback biases it.

Source: W. E. Larimore, Canonical variate analysis in identification, filtering, and adaptive control, 29th IEEE
Conference on Decision and Control, 1990.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.identification.estimate.data_triangle import PastRegression, RidgeRegression
from amb_core.identification.estimate.scaled_data import Samples
from amb_core.identification.estimate.state_regression import identify_by_states
from amb_core.linear.model.state_space import StateSpaceModel


def cva(
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
        Horizons (steps), with the limits and defaults of `ssarx`.
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
        If a setting is not allowed or the data do not determine the model.
    """
    return identify_by_states(
        inputs, outputs, sample_time, order, past, future, source, "cva", _future_map, feedthrough
    )


def _future_map(regression: PastRegression, ridge: float) -> NDArray[np.float64]:
    """Future outputs that the past explains beyond the future inputs, weighted by what it leaves unexplained."""
    triangle, p = regression.triangle, regression.triangle.p
    outputs = np.hstack([triangle.at(ahead)[:, :p] for ahead in range(triangle.future)])
    inputs = linalg.orth(np.hstack([triangle.at(ahead)[:, p:] for ahead in range(triangle.future)]))
    outputs, past = (columns - inputs @ (inputs.T @ columns) for columns in (outputs, regression.columns))
    observed = RidgeRegression(past).coefficients(outputs, ridge)
    unexplained = outputs - past @ observed
    covariance = unexplained.T @ unexplained + np.finfo(float).eps * np.eye(outputs.shape[1])
    return np.asarray(linalg.solve_triangular(linalg.cholesky(covariance, lower=True), observed.T, lower=True).T)
