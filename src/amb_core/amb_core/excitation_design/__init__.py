"""Check and design of excitations: regions and distortion under an excitation, and the largest one within limits."""

from amb_core.excitation_design.certificate import Certificate
from amb_core.excitation_design.check import check_excitation
from amb_core.excitation_design.design import DesignedExcitation, design_excitation
from amb_core.excitation_design.excited_order import ExcitedOrder, excited_order
from amb_core.excitation_design.limits import Limits, use_of_trial
from amb_core.excitation_design.load import Load
from amb_core.excitation_design.measures import AxisMeasure
from amb_core.excitation_design.result import AxisCheck, ExcitationCheck
from amb_core.excitation_design.saved import designed_excitation
from amb_core.excitation_design.trial import Trial, TrialBench

__all__ = [
    "AxisCheck",
    "AxisMeasure",
    "Certificate",
    "DesignedExcitation",
    "ExcitationCheck",
    "ExcitedOrder",
    "Limits",
    "Load",
    "Trial",
    "TrialBench",
    "check_excitation",
    "design_excitation",
    "designed_excitation",
    "excited_order",
    "use_of_trial",
]
