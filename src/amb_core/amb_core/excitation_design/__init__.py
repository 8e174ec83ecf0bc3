"""Excitations before they are used: in which regions they would run, and which one is the largest in region A."""

from amb_core.excitation_design.check import check_excitation
from amb_core.excitation_design.load import Load
from amb_core.excitation_design.result import AxisCheck, ExcitationCheck

__all__ = ["AxisCheck", "ExcitationCheck", "Load", "check_excitation"]
