"""A real-time target without hardware: the C code of `target/` around a simulated plant, on a real UDP socket."""

from amb_core.rig.emulation.emulator import LOCALHOST, Address, TargetEmulator
from amb_core.rig.emulation.faulty_link import FaultyLink, LinkCount, UndeliveredSamples
from amb_core.rig.emulation.library import reference_library
from amb_core.rig.emulation.load import Load, measure_load
from amb_core.rig.emulation.paced import PacedEmulator
from amb_core.rig.emulation.parameters import (
    CoilFaultParameters,
    FaultParameters,
    LimitParameters,
    LinkFaults,
    SensorFaultParameters,
)
from amb_core.rig.emulation.process import EmulatorProcess, EmulatorReport, EmulatorSettings
from amb_core.rig.emulation.real_rig import as_on_a_rig

__all__ = [
    "LOCALHOST",
    "Address",
    "CoilFaultParameters",
    "EmulatorProcess",
    "EmulatorReport",
    "EmulatorSettings",
    "FaultParameters",
    "FaultyLink",
    "LimitParameters",
    "LinkCount",
    "LinkFaults",
    "Load",
    "PacedEmulator",
    "SensorFaultParameters",
    "TargetEmulator",
    "UndeliveredSamples",
    "as_on_a_rig",
    "measure_load",
    "reference_library",
]
