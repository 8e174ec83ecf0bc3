"""What is wrong with a rig, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

FaultName = Literal[
    "amplifier gain", "amplifier saturates", "bias or stiffness", "coil dead",
    "coils reversed", "coils swapped", "coils turned", "delay",
    "force", "load", "low-pass", "mass", "no response",
    "noise when on", "reversed", "sensor clips", "sensor coarse",
    "sensor dead", "sensor hum", "sensor noise", "sensor offset",
    "sensor reversed", "sensor scale", "sensor silent", "sensors swapped",
    "sensors turned", "swapped", "target trips", "too little force",
    "turned", "unstable loop",
]  # fmt: skip
"""Without `sensor` or `coil` in its name: one of both, which only a rotor moved by hand could tell apart."""


@dataclass(frozen=True)
class Finding:
    """One fault.

    Attributes
    ----------
    fault : str
        Its name.
    axes : tuple of str
        Names of the axes that have it; empty if it is one of the whole machine.
    detail : str
        What was measured, with what was expected, and what to do.
    """

    fault: FaultName
    axes: tuple[str, ...]
    detail: str

    def __str__(self) -> str:
        return f"{self.fault} ({', '.join(self.axes)}): {self.detail}" if self.axes else f"{self.fault}: {self.detail}"
