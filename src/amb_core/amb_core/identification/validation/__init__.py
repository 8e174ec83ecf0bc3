"""Validation of a model on data other than those of the identification."""

from amb_core.identification.fit import nrmse_fit
from amb_core.identification.prediction import Prediction, predict
from amb_core.identification.validation.compare import Comparison, compare
from amb_core.identification.validation.frequency import BandComparison, FrequencyComparison, compare_responses
from amb_core.identification.validation.residuals import ChiSquareTest, ResidualTests, check_residuals
from amb_core.identification.validation.simulation import ClosedLoop
from amb_core.identification.validation.validate import validate
from amb_core.identification.validation.validation import Validation
from amb_core.identification.validation.verdict import Condition, Verdict

__all__ = [
    "BandComparison",
    "ChiSquareTest",
    "ClosedLoop",
    "Comparison",
    "Condition",
    "FrequencyComparison",
    "Prediction",
    "ResidualTests",
    "Validation",
    "Verdict",
    "check_residuals",
    "compare",
    "compare_responses",
    "nrmse_fit",
    "predict",
    "validate",
]
