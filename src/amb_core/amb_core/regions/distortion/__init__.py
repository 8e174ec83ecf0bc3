"""Nonlinear distortion of the closed loop: how much of the rotor's motion no linear model can explain.

`DistortionSettings` define random-phase multisines, `measure_distortion` analyses the response to them, and
`simulate_distortion` does both on the simulated bearing. `find_evidence` measures distortion in a recording, or the
coherence of position and reference where the recording does not permit more.
"""

from amb_core.regions.distortion.coherence import Coherence, measure_coherence
from amb_core.regions.distortion.evidence import Evidence, find_evidence
from amb_core.regions.distortion.measurement import PeriodicResponse, measure_distortion
from amb_core.regions.distortion.recorded import measure_recorded
from amb_core.regions.distortion.result import Distortion
from amb_core.regions.distortion.settings import DistortionSettings
from amb_core.regions.distortion.signals import Lines, lines_of, reference_of
from amb_core.regions.distortion.simulation import simulate_distortion

__all__ = [
    "Coherence",
    "Distortion",
    "DistortionSettings",
    "Evidence",
    "Lines",
    "PeriodicResponse",
    "find_evidence",
    "lines_of",
    "measure_coherence",
    "measure_distortion",
    "measure_recorded",
    "reference_of",
    "simulate_distortion",
]
