"""Uncertainty: how accurately the data determine a model, its poles and its frequency response.

>>> uncertainty = estimate_uncertainty(model, data)  # doctest: +SKIP
>>> uncertainty.response(np.geomspace(5.0, 1000.0, 200)).magnitude_band(0.99)  # doctest: +SKIP
"""

from amb_core.identification.uncertainty.estimate import estimate_uncertainty
from amb_core.identification.uncertainty.model_uncertainty import ModelUncertainty
from amb_core.identification.uncertainty.reference import uncertainty_of

__all__ = ["ModelUncertainty", "estimate_uncertainty", "uncertainty_of"]
