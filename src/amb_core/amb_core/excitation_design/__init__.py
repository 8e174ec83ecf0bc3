"""Check and design of excitations: the regions in which they would run, and the largest excitation in region A."""

from amb_core.excitation_design.check import check_excitation
from amb_core.excitation_design.design import DESIGNED_KINDS, DesignedExcitation, design_excitation
from amb_core.excitation_design.load import Load
from amb_core.excitation_design.persistence import Persistence, persistence
from amb_core.excitation_design.result import AxisCheck, ExcitationCheck
from amb_core.excitation_design.trial import Trial, TrialBench

__all__ = [
    "DESIGNED_KINDS",
    "AxisCheck",
    "DesignedExcitation",
    "ExcitationCheck",
    "Load",
    "Persistence",
    "Trial",
    "TrialBench",
    "check_excitation",
    "design_excitation",
    "persistence",
]
