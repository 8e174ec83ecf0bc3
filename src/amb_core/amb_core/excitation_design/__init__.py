"""Excitations before they are used: in which regions they would run, and which one is the largest in region A."""

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
