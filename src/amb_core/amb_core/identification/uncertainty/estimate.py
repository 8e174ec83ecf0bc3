"""Covariance of the parameters of a model in innovations form at the least prediction errors.

With psi the derivatives of the one-step predictions, weighted by the root of the inverse innovation covariance, N
samples and white innovations e of unit covariance after that weight,

    Cov(theta) = (sum psi psi')^-1,    in general    (sum psi psi')^-1 Q (sum psi psi')^-1,    Q = Var(sum psi e),

where Q is estimated from sums over batches of samples, longer than the errors are correlated ("sandwich"). Initial
states and a constant in each output are estimated along with the parameters and projected out.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, (9.10) to (9.17) of sections 9.2 and 9.3, and
section 9.4 for closed loop; H. White, Maximum likelihood estimation of misspecified models, Econometrica 50 (1982).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.dataset import require_data
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_kind
from amb_core.ground.sample_times import difference, same_sample_time
from amb_core.identification.estimate.local_coordinates import local_directions
from amb_core.identification.estimate.predictor import experiments
from amb_core.identification.estimate.scaled_data import ScaledData
from amb_core.identification.prediction import first_state, predicted_states
from amb_core.identification.uncertainty.directions import Directions
from amb_core.identification.uncertainty.model_uncertainty import ModelUncertainty
from amb_core.identification.uncertainty.sensitivity import Sensitivity, sensitivity
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import small_matrices, thin_svd

_LEAST_SINGULAR_VALUE = 1e-10  # of the normalised sensitivities, relative to the largest; good data stay above 1e-4
_CONSTANT = 1.0 - 1e-9  # pole of a state that hardly fades, but lets the predictor count as stable
_LEAST_SQUARE = 1e-28  # of a Hankel singular value, relative to the largest

Arrays = NDArray[np.float64]


def estimate_uncertainty(model: StateSpaceModel, data: IdentificationData, *, robust: bool = False) -> ModelUncertainty:
    """The asymptotic distribution of a model that `pem` has identified from the data.

    It holds for many samples and the model with the smallest prediction errors; `distance` of the result shows whether
    the model is this one. Without `robust` the innovations are taken as white and the order as sufficient; `inflation`
    of the result shows whether they are. With `robust` the variances are right for correlated innovations too, to first
    order. They remain variances: no band includes the systematic error of a model that is too simple.

    Parameters
    ----------
    model : StateSpaceModel
        Model with a stable predictor; it may be unstable. If its D is not zero, D is taken as estimated too.
    data : IdentificationData
        The data that it was identified from; means over all experiments are removed.
    robust : bool, optional
        Whether to take the covariance of the innovations over time from the data (sandwich estimator).

    Returns
    -------
    ModelUncertainty
        The distribution of the parameters of the model.

    Raises
    ------
    IdentificationError
        If model and data do not fit together, the predictor is unstable or the data do not determine the model.
    """
    _check(model, data)
    scaled = ScaledData.of([item.inputs for item in data.experiments], [item.outputs for item in data.experiments])
    undetermined = (
        f"the data do not determine how accurate the model of order {model.order} is, as with less noise than rounding "
        "or too high an order"
    )
    with small_matrices(undetermined), np.errstate(over="ignore", invalid="ignore"):  # `sensitivity` refuses them
        return _estimate(model, scaled, robust)


def _estimate(model: StateSpaceModel, data: ScaledData, robust: bool) -> ModelUncertainty:
    directions, by_experiment = _sensitivities(model, data)
    normal = _normal_coordinates(np.vstack([item.factor for item in by_experiment]), model.order)
    # The following coordinates give the estimate the unit matrix as covariance if innovations are white.
    scores = np.vstack([item.scores for item in by_experiment]) @ normal
    to_least = scores.sum(axis=0)
    centred = scores - to_least / len(scores)
    covariance = centred.T @ centred * len(scores) / (len(scores) - 1)
    total = float(np.trace(covariance))
    if robust:
        normal = normal @ _root(covariance)
    # The errors are smaller than the innovations, because the unknowns use some degrees of freedom.
    unknowns = directions.count + (model.order + len(model.c)) * len(by_experiment)  # with initial states and constants
    return ModelUncertainty(
        model=model,
        root=directions.rows.T @ normal / math.sqrt(1.0 - unknowns / data.outputs.size),
        inflation=total / len(covariance),
        distance=float(np.linalg.norm(to_least)) / math.sqrt(total),
        robust=robust,
    )


def _sensitivities(model: StateSpaceModel, data: ScaledData) -> tuple[Directions, list[Sensitivity]]:
    """Directions of change of a model, and the information of each experiment about them."""
    u, y = data.input_scale, data.output_scale
    of_scaled = replace(
        model,
        b=model.b * u,
        c=model.c / y[:, np.newaxis],
        d=model.d * u / y[:, np.newaxis],
        k=model.k * y,
        innovation_covariance=model.innovation_covariance / np.outer(y, y),
    )
    parts = experiments(len(data.inputs), data.lengths)
    outputs = [_levelled(of_scaled, data.inputs[part], data.outputs[part]) for part in parts]
    states = [_states(of_scaled, data.inputs[part], known) for part, known in zip(parts, outputs, strict=True)]
    basis = _balanced(of_scaled, np.vstack(states))
    back = np.linalg.inv(basis)
    balanced = replace(
        of_scaled, a=back @ of_scaled.a @ basis, b=back @ of_scaled.b, c=of_scaled.c @ basis, k=back @ of_scaled.k
    )
    local = _directions(balanced)
    weight = np.linalg.inv(np.linalg.cholesky(of_scaled.innovation_covariance))
    batch = math.isqrt(len(data.inputs))  # many samples per batch, and many batches
    by_experiment = [
        sensitivity(
            balanced,
            local,
            data.inputs[part],
            state @ back.T,
            _errors(of_scaled, state, data.inputs[part], known),
            weight,
            batch,
        )
        for part, state, known in zip(parts, states, outputs, strict=True)
    ]
    of_model = Directions(
        basis @ local.a @ back,
        basis @ local.b / u,
        local.c @ back * y[:, np.newaxis],
        basis @ local.k / y,
        None if local.d is None else local.d * y[:, np.newaxis] / u,
    )
    return of_model, by_experiment


def _check(model: StateSpaceModel, data: IdentificationData) -> None:
    require_kind("model", model, StateSpaceModel, "a StateSpaceModel", IdentificationError)
    require_data(data)
    if (len(model.input_names), len(model.output_names)) != (len(data.input_names), len(data.output_names)):
        raise IdentificationError(
            f"the model has {len(model.input_names)} inputs and {len(model.output_names)} outputs, "
            f"the data {len(data.input_names)} and {len(data.output_names)}"
        )
    if not same_sample_time(model.sample_time, data.sample_time):
        raise IdentificationError(
            f"the model has the sample time {model.sample_time:g} s, the data {data.sample_time:g} s; "
            + difference(model.sample_time, data.sample_time)
        )
    radius = float(np.max(np.abs(np.linalg.eigvals(model.a - model.k @ model.c))))
    if not radius < 1.0:
        raise IdentificationError(f"the model must have a stable predictor; its spectral radius is {radius:.6g}")
    m, p, parts = len(model.input_names), len(model.output_names), len(data.experiments)
    unknowns = model.order * (2 * p + m) + (model.d.size if np.any(model.d) else 0)
    unknowns += (model.order + p) * parts  # initial states and constants
    if data.samples * len(model.output_names) <= unknowns:
        raise IdentificationError(
            f"{data.samples} samples are too few for the {unknowns} unknowns of order {model.order}"
        )


def _levelled(model: StateSpaceModel, inputs: Arrays, outputs: Arrays) -> Arrays:
    """The outputs less the constants that predict best along with the initial state."""
    (n, p), m = model.k.shape, model.b.shape[1]
    constant = replace(
        model,
        a=linalg.block_diag(model.a, _CONSTANT * np.eye(p)),
        b=np.vstack([model.b, np.zeros((p, m))]),
        c=np.hstack([model.c, np.eye(p)]),
        k=np.vstack([model.k, np.zeros((p, p))]),
        initial_state=np.zeros(n + p),
    )
    return np.asarray(outputs - first_state(constant, inputs, outputs)[n:])


def _states(model: StateSpaceModel, inputs: Arrays, outputs: Arrays) -> Arrays:
    """States of the predictor from the initial state that predicts best, shape (steps, n)."""
    return predicted_states(model, inputs, outputs, first_state(model, inputs, outputs))


def _errors(model: StateSpaceModel, states: Arrays, inputs: Arrays, outputs: Arrays) -> Arrays:
    """One-step prediction errors without their mean, shape (steps, p)."""
    errors = outputs - states @ model.c.T
    if np.any(model.d):
        errors = errors - inputs @ model.d.T
    return errors - errors.mean(axis=0)


def _balanced(model: StateSpaceModel, states: Arrays) -> Arrays:
    """Balanced coordinates: each state is as observable in the predictions as the data excite it.

    Shape (n, n), from them into those of the model. Small changes of the matrices then are small changes of the model;
    in other coordinates, such as those of nearly equal modes, they can be large.
    """
    moved = np.asarray(np.linalg.qr(states / math.sqrt(len(states)), mode="r")).T
    f, c = np.linalg.solve(moved, (model.a - model.k @ model.c) @ moved), model.c @ moved
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of a pole of the predictor close to the unit circle
        observed = linalg.solve_discrete_lyapunov(f.T, c.T @ c, method="bilinear")
    vectors, squares, _ = np.linalg.svd(observed)
    if not squares[-1] > _LEAST_SQUARE * squares[0]:
        raise IdentificationError(
            f"a state of the model of order {model.order} is not excited in the data, or not visible in the outputs; "
            "lower the order"
        )
    return np.asarray(moved @ vectors / squares**0.25)


def _directions(model: StateSpaceModel) -> Directions:
    """Changes of A, B and C that do more than change the coordinates of the state, all those of K and, if any, D."""
    (n, p), m = model.k.shape, model.b.shape[1]
    local = [change.transpose(2, 0, 1) for change in local_directions(model.a, model.b, model.c)]
    free = n * p + (p * m if np.any(model.d) else 0)
    a, b, c = (np.concatenate([change, np.zeros((free, *change.shape[1:]))]) for change in local)
    k = np.concatenate([np.zeros((len(local[0]), n * p)), np.eye(free, n * p)]).reshape(-1, n, p)
    if free == n * p:
        return Directions(a, b, c, k)
    d = np.concatenate([np.zeros((len(local[0]) + n * p, p * m)), np.eye(p * m)]).reshape(-1, p, m)
    return Directions(a, b, c, k, d)


def _normal_coordinates(factor: Arrays, order: int) -> Arrays:
    """Combinations of the columns along which the estimate has independent errors of variance 1, in new columns."""
    scale = np.linalg.norm(factor, axis=0)
    if not np.all(scale > 0.0):
        raise IdentificationError(
            f"the data do not determine all parameters of a model of order {order}; lower the order"
        )
    _, singular, right = thin_svd(factor / scale)
    if not singular[-1] > _LEAST_SINGULAR_VALUE * singular[0]:
        raise IdentificationError(
            f"the data cannot distinguish the parameters of a model of order {order}; lower the order or excite "
            "all axes independently"
        )
    return np.asarray(right.T / singular / scale[:, np.newaxis])


def _root(covariance: Arrays) -> Arrays:
    """A root of a positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
