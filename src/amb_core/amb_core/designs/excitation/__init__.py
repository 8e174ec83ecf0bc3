"""Check and design of excitations: regions and distortion under an excitation, and the largest one within limits."""

from amb_core.designs.excitation.certificate import ExcitationCertificate
from amb_core.designs.excitation.check import check_excitation
from amb_core.designs.excitation.design import DesignedExcitation, design_excitation
from amb_core.designs.excitation.excited_order import ExcitedOrder, excited_order
from amb_core.designs.excitation.limits import Limits, use_of_trial
from amb_core.designs.excitation.load import Load
from amb_core.designs.excitation.measures import AxisMeasure
from amb_core.designs.excitation.result import AxisCheck, ExcitationCheck
from amb_core.designs.excitation.saved import designed_excitation
from amb_core.designs.excitation.trial import Trial, TrialBench

__all__ = [
    "AxisCheck",
    "AxisMeasure",
    "DesignedExcitation",
    "ExcitationCertificate",
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
