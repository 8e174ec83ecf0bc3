"""The plant of an active magnetic bearing: control current references in, rotor position out."""

from amb_core.plant.description import PlantDescription, describe
from amb_core.plant.linearise import Linearization, linearize
from amb_core.plant.modal_data import ModalData
from amb_core.plant.parameters import (
    AmplifierParameters,
    BackupBearingParameters,
    ConverterParameters,
    FlexibleRotorParameters,
    IntegrationParameters,
    IronParameters,
    MagneticCircuitParameters,
    PlantParameters,
    RigidRotorParameters,
    RotorParameters,
    SensorParameters,
)
from amb_core.plant.plant import Plant
from amb_core.plant.ross_rotor import modal_data_from_ross
from amb_core.plant.snapshot import PlantSnapshot
from amb_core.plant.trace import Trace
from amb_core.plant.uniform_shaft import uniform_shaft

__all__ = [
    "AmplifierParameters",
    "BackupBearingParameters",
    "ConverterParameters",
    "FlexibleRotorParameters",
    "IntegrationParameters",
    "IronParameters",
    "Linearization",
    "MagneticCircuitParameters",
    "ModalData",
    "Plant",
    "PlantDescription",
    "PlantParameters",
    "PlantSnapshot",
    "RigidRotorParameters",
    "RotorParameters",
    "SensorParameters",
    "Trace",
    "describe",
    "linearize",
    "modal_data_from_ross",
    "uniform_shaft",
]
