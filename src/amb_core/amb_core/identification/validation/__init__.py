"""Validation: what data other than those of the identification say about a model."""

from amb_core.identification.validation.fit import nrmse_fit
from amb_core.identification.validation.prediction import Prediction, predict
from amb_core.identification.validation.residuals import ChiSquareTest, ResidualTests, check_residuals
from amb_core.identification.validation.simulation import ClosedLoop, check_closed_loop, simulate_records
from amb_core.identification.validation.validate import Validation, validate

__all__ = [
    "ChiSquareTest",
    "ClosedLoop",
    "Prediction",
    "ResidualTests",
    "Validation",
    "check_closed_loop",
    "check_residuals",
    "nrmse_fit",
    "predict",
    "simulate_records",
    "validate",
]
