"""Nonlinear distortion of the closed loop: how much of the rotor's motion no linear model can explain.

`DistortionSettings` define random-phase multisines, `measure_distortion` analyses the response to them, and
`simulate_distortion` does both on the simulated bearing.
"""

from amb_core.distortion.measurement import Distortion, PeriodicResponse, measure_distortion
from amb_core.distortion.settings import DistortionSettings
from amb_core.distortion.signals import Lines, lines_of, reference_of
from amb_core.distortion.simulation import simulate_distortion

__all__ = [
    "Distortion",
    "DistortionSettings",
    "Lines",
    "PeriodicResponse",
    "lines_of",
    "measure_distortion",
    "reference_of",
    "simulate_distortion",
]
