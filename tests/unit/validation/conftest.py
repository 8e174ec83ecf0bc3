"""A model that is true, data of its loop, and its validation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.identification import IdentificationData, StateSpaceModel, Validation, validate
from amb_core.identification.estimate.predictor import kalman_gain
from amb_core.loop.control import ControllerParameters

NOISE, FORCE = 2e-8, 0.1  # m, N: rms on sensors and rotor
CONTROLLER = ControllerParameters()


@pytest.fixture(scope="module")
def model(bearing) -> StateSpaceModel:
    """The bearing with the Kalman filter of its noise: the truth about the data."""
    by_force = bearing._matrices[1][:, 2:]
    a, c = bearing.model.a, bearing.model.c
    k = kalman_gain(a, c, by_force @ by_force.T * FORCE**2, np.eye(2) * NOISE**2, np.zeros((6, 2)))
    covariance = bearing.innovation_covariance(NOISE, FORCE)
    return replace(bearing.model, k=k, innovation_covariance=covariance, method="truth")


@pytest.fixture(scope="module")
def data(bearing) -> IdentificationData:
    """6000 samples of squares of 20 Hz on x, then on y."""
    record = bearing.experiment(NOISE, force=FORCE, frequency=20.0, duration=0.6)
    return IdentificationData.from_record(record, source="bearing")


@pytest.fixture(scope="module")
def validation(model: StateSpaceModel, data: IdentificationData) -> Validation:
    return validate(model, data, CONTROLLER)
