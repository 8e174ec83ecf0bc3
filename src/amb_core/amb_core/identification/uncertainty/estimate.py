"""Covariance of the parameters of a model in innovations form at the least prediction errors.

With psi the derivatives of the one-step predictions, weighted by the root of the inverse innovation covariance, N
samples and white innovations e of unit covariance after that weight,

    Cov(theta) = (sum psi psi')^-1,    in general    (sum psi psi')^-1 Q (sum psi psi')^-1,    Q = Var(sum psi e),

where Q is estimated from sums over batches of samples, longer than the errors are correlated ("sandwich"). The
derivatives are those of the stable predictor, in its modal coordinates; initial states are estimated along and
projected out, and changes of coordinates within a pair of modes, which the data do not see, are left out.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, (9.10) to (9.17) of sections 9.2 and 9.3, and
section 9.4 for closed loop; H. White, Maximum likelihood estimation of misspecified models, Econometrica 50 (1982).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from threadpoolctl import threadpool_limits

from amb_core.errors import IdentificationError
from amb_core.identification.data import IdentificationData
from amb_core.identification.filter_bank import compressed, filtered
from amb_core.identification.model import StateSpaceModel
from amb_core.identification.predictor import experiments
from amb_core.identification.scaled_data import ScaledData
from amb_core.identification.uncertainty.modal_predictor import ModalPredictor
from amb_core.identification.uncertainty.model_uncertainty import ModelUncertainty

_LEAST_SINGULAR_VALUE = 1e-10  # of the normalised sensitivities, relative to the largest; good data stay above 1e-5

Arrays = NDArray[np.float64]


def estimate_uncertainty(model: StateSpaceModel, data: IdentificationData, *, robust: bool = False) -> ModelUncertainty:
    """The asymptotic distribution of a model that `pem` has identified from the data.

    It holds for many samples and a model that is the one of least prediction errors; `distance` of the result shows
    whether it is. Without `robust` the innovations are taken as white and the order as sufficient; `inflation` of the
    result shows whether they are. With it the variances are right for correlated innovations too, to first order, but
    they remain variances: a systematic error of a model that is too simple is in no band.

    Parameters
    ----------
    model : StateSpaceModel
        Model without direct feedthrough and with a stable predictor; it may be unstable.
    data : IdentificationData
        The data that it was identified from; means over all experiments are removed.
    robust : bool
        Whether to take the covariance of the innovations over time from the data (sandwich estimator).

    Raises
    ------
    IdentificationError
        If model and data do not fit together, the predictor is unstable or the data do not determine the model.
    """
    scaled = _scaled(model, data)
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            predictor = ModalPredictor.of(model, scaled)
            signals, _ = compressed(predictor.modes, scaled.inputs, scaled.outputs, predictor.weight, scaled.lengths)
            normal, scores = _normal_coordinates(predictor, signals, scaled)
        except (linalg.LinAlgError, ValueError) as problem:
            reason = " ".join(str(problem).split())
            raise IdentificationError(f"no uncertainty of the model of order {model.order}: {reason}") from None
        # In these coordinates the estimate has the unit matrix as covariance if the innovations are white.
        to_least = scores.sum(axis=0)
        centred = scores - to_least / len(scores)
        covariance = centred.T @ centred * len(scores) / (len(scores) - 1)
        root = normal @ _root(covariance) if robust else normal
        return ModelUncertainty(
            model=model,
            root=predictor.changes_of(model, scaled, signals, root),
            inflation=float(np.trace(covariance)) / len(covariance),
            distance=float(np.linalg.norm(to_least)) / math.sqrt(len(covariance)),
            robust=robust,
        )


def _scaled(model: StateSpaceModel, data: IdentificationData) -> ScaledData:
    """The data, checked against the model."""
    if (len(model.input_names), len(model.output_names)) != (len(data.input_names), len(data.output_names)):
        raise IdentificationError(
            f"the model has {len(model.input_names)} inputs and {len(model.output_names)} outputs, "
            f"the data {len(data.input_names)} and {len(data.output_names)}"
        )
    if abs(model.sample_time - data.sample_time) > 1e-9 * data.sample_time:
        raise IdentificationError(
            f"the model has the sample time {model.sample_time:g} s, the data {data.sample_time:g} s"
        )
    if np.any(model.d):
        raise IdentificationError(
            "the model has direct feedthrough, for which there is no uncertainty; `pem` gives none"
        )
    radius = float(np.max(np.abs(np.linalg.eigvals(model.a - model.k @ model.c))))
    if not radius < 1.0:
        raise IdentificationError(f"the model must have a stable predictor; its spectral radius is {radius:.6g}")
    unknowns = model.order * (len(data.experiments) + 2 * len(model.output_names) + len(model.input_names))
    if data.samples * len(model.output_names) <= unknowns:
        raise IdentificationError(
            f"{data.samples} samples are too few for the {unknowns} unknowns of order {model.order}"
        )
    return ScaledData.of([item.inputs for item in data.experiments], [item.outputs for item in data.experiments])


def _normal_coordinates(predictor: ModalPredictor, signals: Arrays, data: ScaledData) -> tuple[Arrays, Arrays]:
    """Coordinates in which the estimate has independent errors of variance 1, and the scores of batches in them.

    Shapes (parameters, q) and (batches, q): the parameters' change by each coordinate, and shares of each batch in the
    way to the least prediction errors.
    """
    sensitivity = predictor.sensitivity(signals).reshape(-1, predictor.parameters)
    directions = predictor.directions
    by_state, by_direction = sensitivity[:, predictor.initial_states], sensitivity @ directions
    absorbed = linalg.lstsq(by_state, by_direction, check_finite=False)[0]  # by the initial states
    by_direction = by_direction - by_state @ absorbed
    scale = np.linalg.norm(by_direction, axis=0)
    if not np.all(scale > 0.0):
        raise IdentificationError("the data do not tell all parameters of the model; lower the order or excite more")
    _, singular, right = linalg.svd(by_direction / scale, full_matrices=False, check_finite=False)
    if not singular[-1] > _LEAST_SINGULAR_VALUE * singular[0]:
        raise IdentificationError(
            f"the data do not tell the parameters of a model of order {predictor.modes.order} apart; lower the order "
            "or excite all axes independently"
        )
    unknowns = by_direction.shape[1] + by_state.shape[1]
    p = len(predictor.weight)
    freedom = len(data.inputs) - unknowns / p
    to_normal = right.T / singular / scale[:, np.newaxis] / math.sqrt(freedom)
    scores = _batch_scores(predictor, data)
    return directions @ to_normal, (scores @ directions - scores[:, predictor.initial_states] @ absorbed) @ to_normal


def _batch_scores(predictor: ModalPredictor, data: ScaledData) -> Arrays:
    """Sums over batches of samples of the derivatives times the weighted errors, shape (batches, parameters).

    A batch has about the root of the number of samples: many samples in each, and many batches.
    """
    parts = experiments(len(data.inputs), data.lengths)
    errors = predictor.errors(data)
    length = math.isqrt(len(errors))
    products = [
        np.tensordot(errors[part][start : start + length], signals[start : start + length], axes=(0, 0))
        for part, signals in filtered(predictor.modes, data.inputs, data.outputs, parts)
        for start in range(0, len(signals), length)
    ]
    p = errors.shape[1]
    # Derivatives are linear in the signals, so those of the products with an error are products with that error.
    derivatives = predictor.sensitivity(np.concatenate(products)).reshape(p, len(products), p, -1)
    return np.einsum("ibik->bk", derivatives)


def _root(covariance: Arrays) -> Arrays:
    """A root of a positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
