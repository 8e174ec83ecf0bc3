"""The plant of an active magnetic bearing: control current references in, rotor position out."""

from amb_core.plant.description import PlantDescription, describe
from amb_core.plant.linearise import Linearization, linearize
from amb_core.plant.parameters import (
    AmplifierParameters,
    IntegrationParameters,
    MagneticCircuitParameters,
    PlantParameters,
    RotorParameters,
)
from amb_core.plant.plant import Plant, PlantSnapshot
from amb_core.plant.trace import Trace

__all__ = [
    "AmplifierParameters",
    "IntegrationParameters",
    "Linearization",
    "MagneticCircuitParameters",
    "Plant",
    "PlantDescription",
    "PlantParameters",
    "PlantSnapshot",
    "RotorParameters",
    "Trace",
    "describe",
    "linearize",
]
