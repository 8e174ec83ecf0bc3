"""Identification: from a record of the closed loop to a discrete-time state-space model of the plant.

>>> result = identify(record, order=10, controller=ControllerParameters())  # doctest: +SKIP
>>> result.model.fit, result.model.unstable_poles()  # doctest: +SKIP
"""

from amb_core.data.experiments import IdentificationData
from amb_core.identification.closed_loop import closed_loop_poles, simulate_closed_loop
from amb_core.identification.conversion import to_continuous, to_predictor, to_scipy
from amb_core.identification.estimate.cva import cva
from amb_core.identification.estimate.methods import METHODS, Method
from amb_core.identification.estimate.order_selection import OrderSelection, select_order
from amb_core.identification.estimate.pbsid import pbsid
from amb_core.identification.estimate.pem import pem
from amb_core.identification.estimate.reduction import Reduction, reduce_balanced
from amb_core.identification.estimate.ssarx import ssarx
from amb_core.identification.estimate.subspace import n4sid
from amb_core.identification.focus.focus import focus_simulation
from amb_core.identification.frequency_response import FrequencyResponse, response_of
from amb_core.identification.identify import Focus, Identification, identify
from amb_core.identification.progress import IdentificationProgress
from amb_core.identification.uncertainty import ModelUncertainty, estimate_uncertainty
from amb_core.identification.validation import Comparison, Validation, compare, nrmse_fit, validate
from amb_core.linear.model.state_space import StateSpaceModel

__all__ = [
    "METHODS",
    "Comparison",
    "Focus",
    "FrequencyResponse",
    "Identification",
    "IdentificationData",
    "IdentificationProgress",
    "Method",
    "ModelUncertainty",
    "OrderSelection",
    "Reduction",
    "StateSpaceModel",
    "Validation",
    "closed_loop_poles",
    "compare",
    "cva",
    "estimate_uncertainty",
    "focus_simulation",
    "identify",
    "n4sid",
    "nrmse_fit",
    "pbsid",
    "pem",
    "reduce_balanced",
    "response_of",
    "select_order",
    "simulate_closed_loop",
    "ssarx",
    "to_continuous",
    "to_predictor",
    "to_scipy",
    "validate",
]
