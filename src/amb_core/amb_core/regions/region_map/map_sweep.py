"""One sweep of a region map: where regions B, C and D begin in it, and the same as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from amb_core.regions import Region

BOUNDARIES = (Region.B, Region.C, Region.D)


@dataclass(frozen=True)
class Boundary:
    """Where a region begins in a sweep.

    Attributes
    ----------
    frequency : float
        Input frequency at the onset (Hz).
    resonance : bool
        Whether the loop was then at its resonance: see `amb_core.regions.Onset`.
    """

    frequency: float
    resonance: bool


@dataclass(frozen=True)
class MapSweep:
    """The result of one sweep.

    Attributes
    ----------
    amplitude : float
        Amplitude of the sweep (m).
    boundaries : dict of Region to Boundary
        Onsets of the rotor's regions B, C and D in order; those that did not occur are missing.
    beats : tuple of (float, float)
        Spans of the input frequency (Hz) in which the input beat with the sample rate.
    highest_frequency : float
        Frequency reached: the sweep's end, or that of delevitation (Hz).
    steps : int
        Controller steps simulated.
    """

    amplitude: float
    boundaries: dict[Region, Boundary]
    beats: tuple[tuple[float, float], ...]
    highest_frequency: float
    steps: int


def sweep_to_json(sweep: MapSweep) -> dict[str, Any]:
    """A sweep as plain JSON values."""
    return {
        "amplitude": sweep.amplitude,
        "boundaries": {
            region.name: {"frequency": boundary.frequency, "resonance": boundary.resonance}
            for region, boundary in sweep.boundaries.items()
        },
        "beats": [list(span) for span in sweep.beats],
        "highest_frequency": sweep.highest_frequency,
        "steps": sweep.steps,
    }


def sweep_from_json(entry: dict[str, Any]) -> MapSweep:
    """The sweep that `sweep_to_json` wrote; KeyError, TypeError or ValueError for anything else."""
    beats: Sequence[Sequence[float]] = entry["beats"]
    return MapSweep(
        float(entry["amplitude"]),
        {
            Region[name]: Boundary(float(boundary["frequency"]), bool(boundary["resonance"]))
            for name, boundary in entry["boundaries"].items()
        },
        tuple((float(low), float(high)) for low, high in beats),
        float(entry["highest_frequency"]),
        int(entry["steps"]),
    )
