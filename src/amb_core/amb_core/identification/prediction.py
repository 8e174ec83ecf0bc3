"""k-step predictions: from the filtered state, then without the outputs for k - 1 further steps.

    xhat[k+1|k] = A xhat[k|k-1] + B u[k] + K (y[k] - yhat[k|k-1])          (filter: k = 1)
    xhat[k+h|k] = A xhat[k+h-1|k] + B u[k+h-1]                              (open loop afterwards)

The inputs that were measured in between are used, as usual. Under feedback they depend on the noise of these steps,
which an unstable plant needs to stay bounded. One step tests the model with its noise model; many steps test the plant
alone.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 3.2 and 16.5.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.fit import nrmse_fit
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.simulation import state_sequence

_CURVE_POINTS = 20  # horizons between the first and the last requested one, for the curve of fit over horizon
_MEMORY = 5_000  # samples from which the first state of an experiment is estimated
_FARTHEST = 1e100  # of a state, whose square is still a number


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predictions of all experiments over several horizons.

    Attributes
    ----------
    horizons : ndarray of int, shape (h,)
        Horizons in steps, rising from 1.
    fit : ndarray, shape (h, p)
        NRMSE fit of each output at each horizon (percent).
    residuals : tuple of ndarray, shapes (steps, p)
        One-step prediction errors of each experiment, in the units of the outputs.
    first_states : ndarray, shape (experiments, n)
        State of the model (-) at the first sample of each experiment, the least-squares estimate.
    """

    horizons: NDArray[np.int64]
    fit: NDArray[np.float64]
    residuals: tuple[NDArray[np.float64], ...]
    first_states: NDArray[np.float64]

    def fit_at(self, horizon: int) -> NDArray[np.float64]:
        """Fit of each output at one of the horizons (percent), shape (p,).

        Parameters
        ----------
        horizon : int
            One of `horizons` (steps).

        Returns
        -------
        ndarray, shape (p,)
            NRMSE fits (percent).
        """
        return np.asarray(self.fit[self.horizons.tolist().index(horizon)])


def predict(model: StateSpaceModel, data: IdentificationData, horizons: Iterable[int] = (1,)) -> Prediction:
    """Predict the outputs of all experiments over the horizons, and some between them.

    Parameters
    ----------
    model : StateSpaceModel
        Model with a stable predictor.
    data : IdentificationData
        Data with as many signals as the model.
    horizons : iterable of int, optional
        Steps predicted ahead; 1 is always among them.

    Returns
    -------
    Prediction
        Fits, one-step residuals and first states.

    Raises
    ------
    IdentificationError
        If the predictor is unstable, a horizon is not positive, the data are too short for it or do not move, or have
        other numbers of signals than the model.
    """
    here, there = (len(data.input_names), len(data.output_names)), model.d.shape[::-1]
    if here != there:
        raise IdentificationError(
            f"the data have {here[0]} inputs and {here[1]} outputs, the model {there[0]} and {there[1]}"
        )
    wanted = sorted({1, *horizons})
    shortest = min(item.steps for item in data.experiments)
    if wanted[0] < 1 or 2 * wanted[-1] > shortest:
        raise IdentificationError(
            f"horizons from {wanted[0]} to {wanted[-1]} steps are not allowed; they must be from 1 to {shortest // 2}, "
            "half the shortest experiment"
        )
    curve = np.round(np.geomspace(1, wanted[-1], _CURVE_POINTS)).astype(int)
    all_horizons = np.union1d(wanted, curve).astype(np.int64)
    measured = [item.outputs - model.output_offset for item in data.experiments]
    inputs = [item.inputs - model.input_offset for item in data.experiments]
    first_states = np.array([first_state(model, u, y) for u, y in zip(inputs, measured, strict=True)])
    states = [predicted_states(model, u, y, x) for u, y, x in zip(inputs, measured, first_states, strict=True)]
    residuals = tuple(y - x @ model.c.T - u @ model.d.T for u, y, x in zip(inputs, measured, states, strict=True))
    fits = []
    for horizon in range(1, wanted[-1] + 1):
        if horizon > 1:
            states = [_next(model, x, u[horizon - 2 : -1]) for u, x in zip(inputs, states, strict=True)]
        if horizon in all_horizons:
            modelled = [x @ model.c.T + u[horizon - 1 :] @ model.d.T for u, x in zip(inputs, states, strict=True)]
            fits.append(nrmse_fit(np.vstack([y[horizon - 1 :] for y in measured]), np.vstack(modelled)))
    return Prediction(all_horizons, np.array(fits), residuals, first_states)


def _next(model: StateSpaceModel, states: NDArray[np.float64], inputs: NDArray[np.float64]) -> NDArray[np.float64]:
    """States one step ahead; those that grow beyond all numbers, of a model with a pole far outside, stay numbers."""
    ahead = states[:-1] @ model.a.T + inputs @ model.b.T
    if not -_FARTHEST < ahead.min() <= ahead.max() < _FARTHEST:
        ahead = np.clip(ahead, -_FARTHEST, _FARTHEST)
    return np.asarray(ahead)


def first_state(
    model: StateSpaceModel, inputs: NDArray[np.float64], outputs: NDArray[np.float64]
) -> NDArray[np.float64]:
    """State at the first sample that makes the prediction errors smallest, shape (n,), of data without offsets.

    Raises
    ------
    IdentificationError
        If the predictor is unstable.
    """
    inputs, outputs = inputs[:_MEMORY], outputs[:_MEMORY]
    zero = np.zeros(model.order)
    states = predicted_states(model, inputs, outputs, zero)
    errors = outputs - states @ model.c.T - inputs @ model.d.T
    # response of the predictor to each unit state, without inputs and outputs
    quiet_inputs, quiet_outputs = np.zeros_like(inputs), np.zeros_like(outputs)
    fading = np.stack(
        [predicted_states(model, quiet_inputs, quiet_outputs, unit) @ model.c.T for unit in np.eye(model.order)],
        axis=-1,
    )
    deviation = np.sqrt(np.diag(model.innovation_covariance))
    weight = 1.0 / np.where(deviation > 0.0, deviation, 1.0)
    rows = (fading * weight[:, np.newaxis]).reshape(-1, model.order)
    # each state is scaled by its effect, so that rounding makes none of them zero
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(rows / scale, (errors * weight).ravel(), rcond=1e-10)[0] / scale)


def predicted_states(
    model: StateSpaceModel,
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    state: NDArray[np.float64],
) -> NDArray[np.float64]:
    """States xhat[k|k-1] of the one-step predictor, shape (steps, n), of data without offsets.

    Raises
    ------
    IdentificationError
        If the predictor is unstable.
    """
    predictor = model.a - model.k @ model.c
    radius = float(np.max(np.abs(np.linalg.eigvals(predictor))))
    if not radius < 1.0:
        raise IdentificationError(
            f"the predictor of the model is unstable (spectral radius of A - K C {radius:.6g}) and cannot predict; "
            "estimate the gain K with the model, as all methods here do, or validate the model without it, K = 0"
        )
    gains = np.hstack([model.b - model.k @ model.d, model.k])
    return state_sequence(predictor, gains, np.hstack([inputs, outputs]), state)


def filtered(model: StateSpaceModel, driving: NDArray[np.float64]) -> NDArray[np.float64]:
    """States of x[k+1] = (A - K C) x[k] + driving[k] from rest, shape (steps, n)."""
    return state_sequence(model.a - model.k @ model.c, np.eye(model.order), driving, np.zeros(model.order))
