"""Predictor-based subspace identification (PBSID), consistent on data of a closed loop.

The Markov parameters of a long ARX model, shifted and stacked, are the product of the predictor's extended
observability and controllability matrices. Applied to the past, this product gives the predicted future outputs for
unknown future signals. Their strongest directions are the state (see `state_regression` for the rest).

Sources: A. Chiuso, The role of vector autoregressive modeling in predictor-based subspace identification, Automatica 43
(2007); G. van der Veen, J.-W. van Wingerden, M. Bergamasco, M. Lovera and M. Verhaegen, Closed-loop subspace
identification methods: an overview, IET Control Theory and Applications 7 (2013).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.identification.estimate.data_triangle import PastRegression
from amb_core.identification.estimate.scaled_data import Samples
from amb_core.identification.estimate.state_regression import identify_by_states
from amb_core.linear.model.state_space import StateSpaceModel


def pbsid(
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
        inputs, outputs, sample_time, order, past, future, source, "pbsid", _future_map, feedthrough
    )


def _future_map(regression: PastRegression, ridge: float) -> NDArray[np.float64]:
    """Shifted Markov parameters: z[k-lag] contributes to the output at k + ahead with the parameter lag + ahead."""
    triangle = regression.triangle
    markov, _, errors = regression.markov_parameters(ridge)
    # In units of the innovations all outputs count alike.
    markov = linalg.solve_triangular(linalg.cholesky(errors.T @ errors, lower=True), markov.T, lower=True).T
    shifted = np.zeros((len(markov), triangle.p * min(triangle.future, regression.steps)))
    for ahead in range(shifted.shape[1] // triangle.p):
        kept = len(markov) - ahead * triangle.q
        shifted[:kept, ahead * triangle.p : (ahead + 1) * triangle.p] = markov[len(markov) - kept :]
    return shifted
