"""The plant's frequency response without a model: `estimate_response`, over periods where the reference has some."""

from amb_core.identification.nonparametric.estimate import (
    NonparametricEstimate,
    estimate_over_periods,
    estimate_response,
)

__all__ = ["NonparametricEstimate", "estimate_over_periods", "estimate_response"]
