"""Excitations before they are used: in which regions they would run, and which one is the largest in region A."""

from amb_core.excitation_design.check import AxisCheck, ExcitationCheck, check_excitation

__all__ = ["AxisCheck", "ExcitationCheck", "check_excitation"]
