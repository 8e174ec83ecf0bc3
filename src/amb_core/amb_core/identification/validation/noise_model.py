"""The gain of a model that has none, such as one of finite elements or of a design, from the data it is judged on.

Without a gain K the one-step predictions of an unstable plant diverge, and those of a stable one are worse than they
need to be, which is no fault of the plant's part.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.estimate.predictor import kalman_gain
from amb_core.identification.focus.gain import fit_kalman_gain
from amb_core.identification.prediction import first_state
from amb_core.linear.model.state_space import StateSpaceModel

_ROUNDS = 2  # the weight of the errors is that of the round before
_NOISE = 1e-2  # of the outputs and inputs, relative to their motion, with which the search starts

Arrays = NDArray[np.float64]


def with_noise_model(model: StateSpaceModel, data: IdentificationData) -> StateSpaceModel:
    """The model with the gain K and the covariance of the innovations that predict the data best; A to D stay.

    Parameters
    ----------
    model : StateSpaceModel
        Model without a gain, K = 0; one that has a gain is returned as it is.
    data : IdentificationData
        Data with as many signals as the model.

    Returns
    -------
    StateSpaceModel
        The model itself if no gain can be found, as of data without noise.
    """
    if np.any(model.k):
        return model
    inputs = [item.inputs - model.input_offset for item in data.experiments]
    outputs = [
        item.outputs - model.output_offset - u @ model.d.T for u, item in zip(inputs, data.experiments, strict=True)
    ]
    found = replace(model, d=np.zeros_like(model.d))
    try:
        found = replace(found, k=_first_gain(model, np.vstack(inputs), np.vstack(outputs)))
        for _ in range(_ROUNDS):
            states = np.array([first_state(found, u, y) for u, y in zip(inputs, outputs, strict=True)])
            found = fit_kalman_gain(found, inputs, outputs, states, start=found.k)
    except (IdentificationError, np.linalg.LinAlgError):
        return model
    return replace(found, d=model.d)


def _first_gain(model: StateSpaceModel, inputs: Arrays, outputs: Arrays) -> Arrays:
    """That of noise at the inputs and outputs, relative to their motion, shape (n, p)."""
    moved, seen = inputs.std(axis=0), outputs.std(axis=0)
    by_noise = _NOISE * model.b * moved
    c = model.c / seen[:, np.newaxis]
    covariance = _NOISE**2 * np.eye(len(c))
    return kalman_gain(model.a, c, by_noise @ by_noise.T, covariance, np.zeros((len(c.T), len(c)))) / seen
