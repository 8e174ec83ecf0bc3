"""ARX models of several inputs and outputs by least squares, as state-space models.

    y[k] = A_1 y[k-1] + ... + A_L y[k-L] + B_1 u[k-1] + ... + B_L u[k-L] + e[k]

In the observer form, where state i holds the contribution of the lags i, i + 1, ..., this is an innovations form with
K = (A_1; ...; A_L): its predictor is the regression itself, of finite memory and always stable. With direct
feedthrough a term B_0 u[k] is added, and D = B_0.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 4.2 and 10.1.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.identification.estimate.predictor import experiments
from amb_core.identification.estimate.scaled_data import HIGHEST_ORDER, Samples, ScaledData
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import one_blas_thread

_FEWEST = 2  # samples per regressor


def arx(
    inputs: Samples,
    outputs: Samples,
    sample_time: float,
    lags: int,
    source: str = "",
    feedthrough: bool = False,
) -> StateSpaceModel:
    """Identify an ARX model; means are removed from the data and kept as its offsets.

    Parameters
    ----------
    inputs, outputs : ndarray, shapes (steps, m), (steps, p), or lists of such
        Inputs and outputs of one experiment, or of each of several.
    sample_time : float
        Sample time of the data (s).
    lags : int
        Number of lags L of both, from 1 to 40; the model has p L states.
    source : str
        Where the data come from, kept in the model.
    feedthrough : bool
        Whether outputs respond within the sample.

    Returns
    -------
    StateSpaceModel
        In innovations form; its initial state is zero, that of a plant at rest at the means.

    Raises
    ------
    IdentificationError
        If the number of lags does not suit the data, or the data do not determine the model.
    """
    if not 1 <= lags <= HIGHEST_ORDER:
        raise IdentificationError(f"{lags} lags are not allowed; allowed: 1 to {HIGHEST_ORDER}")
    data = ScaledData.of(inputs, outputs)
    p, m = data.outputs.shape[1], data.inputs.shape[1]
    signals = np.hstack([data.outputs, data.inputs])
    parts = [part for part in experiments(len(signals), data.lengths) if part.stop - part.start > lags]
    rows = sum(part.stop - part.start - lags for part in parts)
    if rows < _FEWEST * lags * (p + m):
        raise IdentificationError(f"{len(signals)} samples are too few for {lags} lags; use fewer lags or longer data")
    past = np.vstack(
        [
            np.hstack([signals[part.start + lags - lag : part.stop - lag] for lag in range(1, lags + 1)])
            for part in parts
        ]
    )
    if feedthrough:
        past = np.hstack([past, np.vstack([data.inputs[part.start + lags : part.stop] for part in parts])])
    present = np.vstack([data.outputs[part.start + lags : part.stop] for part in parts])
    with one_blas_thread():
        coefficients, _, rank, _ = linalg.lstsq(past, present)
    if rank < past.shape[1]:
        raise IdentificationError(f"the data do not determine {lags} lags; use fewer, or excite more")
    coefficients, direct = np.split(coefficients, [lags * (p + m)])
    blocks = coefficients.T.reshape(p, lags, p + m).transpose(1, 0, 2)  # of each lag: (A_i, B_i)
    k, b = blocks[:, :, :p].reshape(lags * p, p), blocks[:, :, p:].reshape(lags * p, m)
    a, c = np.eye(lags * p, k=p), np.eye(p, lags * p)
    a[:, :p] += k
    d = direct.T if feedthrough else None
    if d is not None:
        b = b + k @ d  # the regression has the input matrix of the predictor, B - K D
    start = np.zeros((len(data.lengths), lags * p))
    return data.model(a, b, c, k, start, sample_time, "arx", source, d)
