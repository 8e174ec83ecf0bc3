"""A real-time target without hardware: the C code of `target/` around a simulated plant, on a real UDP socket."""

from amb_core.emulation.emulator import LOCALHOST, PORT, Address, TargetEmulator
from amb_core.emulation.faulty_link import FaultyLink, Gap, LinkCount
from amb_core.emulation.library import reference_library
from amb_core.emulation.parameters import FaultParameters, LimitParameters, LinkFaults, SensorFaultParameters

__all__ = [
    "LOCALHOST",
    "PORT",
    "Address",
    "FaultParameters",
    "FaultyLink",
    "Gap",
    "LimitParameters",
    "LinkCount",
    "LinkFaults",
    "SensorFaultParameters",
    "TargetEmulator",
    "reference_library",
]
