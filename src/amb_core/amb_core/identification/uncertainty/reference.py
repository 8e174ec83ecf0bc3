"""Bands of a model with what a richer one, identified from the same data, says otherwise.

The covariance of an estimate describes its random errors, provided that its order suffices for plant and noise. Where
it does not, as under forces or sensors with coloured noise, the error is systematic and residuals may look white all
the same. So a model with one state more for each output is identified too. Its response differs from that of the
estimate by chance alone where the order suffices; otherwise by the systematic error, as far as the data show it. The
difference counts as one more standard deviation: a column of the root where a change of the estimate explains it, and
frequency by frequency for the rest, with the variance of the richer model where that is larger.

Source: L. Ljung, Model validation and model error modeling, in B. Wittenmark and A. Rantzer (eds.), The Astrom
Symposium on Control, 1999; H. Hjalmarsson and B. Ninness, Least-squares estimation of a class of frequency functions:
a finite sample variance expression, Automatica 42 (2006).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.estimate.methods import estimate
from amb_core.identification.frequency_response import response_of, transfers
from amb_core.identification.progress import Watch
from amb_core.identification.uncertainty.directions import response_changes
from amb_core.identification.uncertainty.estimate import estimate_uncertainty
from amb_core.identification.uncertainty.model_uncertainty import ModelUncertainty, rounding_of
from amb_core.linear.model.state_space import StateSpaceModel

_FREQUENCIES = np.geomspace(4e-4, 0.9, 150)  # at which responses are compared, relative to half the sample rate


def uncertainty_of(model: StateSpaceModel, data: IdentificationData, watch: Watch | None = None) -> ModelUncertainty:
    """The uncertainty of a model that `pem` has identified: the one place that decides how wide its bands are.

    Innovations that are not white are taken as they are (`robust` of `estimate_uncertainty`), and the difference to a
    richer model counts as an error, if the data determine one.

    Parameters
    ----------
    model : StateSpaceModel
        Model that `pem` has identified from the data.
    data : IdentificationData
        The data of the estimate.
    watch : Watch, optional
        Reports the progress of the richer model's estimate and can cancel it; None for neither.

    Returns
    -------
    ModelUncertainty
        The distribution of the parameters, with the richer model as `reference` where the data determine one.

    Raises
    ------
    IdentificationError
        As `estimate_uncertainty`, or if the identification is cancelled.
    """
    own = _random(model, data)
    try:
        richer = estimate(
            data, model.order + model.outputs, "pem", watch or Watch(None, None), "", bool(np.any(model.d))
        )[0]
        reference = _random(richer, data)
    except IdentificationError:
        if watch is not None:
            watch.tell("uncertainty", 1, 1)  # raises where the cause is a cancellation
        return own
    return with_reference(own, reference)


def with_reference(own: ModelUncertainty, reference: ModelUncertainty) -> ModelUncertainty:
    """The uncertainty with the difference to a richer model, as one more column of the root."""
    frequency = _FREQUENCIES * 0.5 / own.model.sample_time
    of, other = own.response(frequency), reference.response(frequency)
    assert of.magnitude_deviation is not None and other.magnitude_deviation is not None
    parts = own.deviations
    changes = np.concatenate([
        response_changes(by_state, by_input, parts.a, parts.b, parts.c, parts.d)
        for _, by_state, by_input in transfers(own.model, frequency, own.model.b)
    ])  # fmt: skip
    difference = response_of(reference.model, frequency).response - of.response
    least = np.maximum(rounding_of(of.response), np.finfo(float).tiny)
    weight = 1.0 / np.maximum(np.hypot(of.magnitude_deviation, other.magnitude_deviation), least)
    rows = (changes * weight[..., np.newaxis]).reshape(-1, changes.shape[-1])
    wanted = (difference * weight).ravel()
    rows, wanted = np.vstack([rows.real, rows.imag]), np.concatenate([wanted.real, wanted.imag])
    # Each of the columns has a factor of variance 1: least squares with that much knowledge.
    factors = np.linalg.solve(rows.T @ rows + np.eye(rows.shape[1]), rows.T @ wanted)
    size = np.abs(difference) / np.maximum(of.magnitude_deviation, least)
    return replace(
        own,
        root=np.column_stack([own.root, own.root @ factors]),
        reference=reference,
        difference=math.sqrt(float(np.median(size**2))),
    )


def _random(model: StateSpaceModel, data: IdentificationData) -> ModelUncertainty:
    """The distribution of random errors; robust if the innovations are not white: it is far too narrow otherwise."""
    random = estimate_uncertainty(model, data)
    return random if random.white else estimate_uncertainty(model, data, robust=True)
