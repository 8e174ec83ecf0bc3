"""Confirmation of a region map: where the regions begin under fixed sines, and in sweeps at another rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

from amb_core.regions import Region
from amb_core.regions.region_map.map_sweep import MapSweep, sweep_from_json, sweep_to_json
from amb_core.regions.region_map.settings import ConfirmationSettings

Direction = Literal["below", "above"]
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)


@dataclass(frozen=True)
class DwellBoundary:
    """Where a region begins under fixed sines of one amplitude, approached from one direction.

    Attributes
    ----------
    amplitude : float
        Amplitude of the sines (m).
    region : Region
        The region, or a higher one, into which the boundary leads.
    direction : {"below", "above"}
        From which side the frequency of the sine reached its final value.
    low : float
        Highest frequency that stayed below the region (Hz); 0 if none did, down to the start of the sweeps.
    high : float
        Lowest frequency in the region or a higher one (Hz); infinity if there was none, up to the end of the sweeps.
    reached : bool
        Whether the rotor could be brought to the side of the region: false if it fell at the frequency at which it was
        started, so that this direction only shows that the boundary lies above `low`.
    """

    amplitude: float
    region: Region
    direction: Direction
    low: float
    high: float
    reached: bool = True

    @property
    def frequency(self) -> float:
        """The boundary (Hz): the geometric mean of `low` and `high`; infinity if the region does not begin."""
        return self.high if self.low == 0.0 or math.isinf(self.high) else math.sqrt(self.low * self.high)


@dataclass(frozen=True)
class Confirmation:
    """What fixed sines and sweeps at another rate add to a region map.

    Attributes
    ----------
    settings : ConfirmationSettings
        The dwells, and the rate of the other sweeps.
    dwells : tuple of DwellBoundary
        In order of amplitude, region and direction.
    sweeps : tuple of MapSweep
        Sweeps of amplitudes of the map at the other rate, in order of amplitude.
    complete : bool
        Whether every boundary was bisected and every sweep repeated; false after a cancellation.
    """

    settings: ConfirmationSettings
    dwells: tuple[DwellBoundary, ...]
    sweeps: tuple[MapSweep, ...]
    complete: bool

    def dwell(self, region: Region, amplitude: float, direction: Direction) -> DwellBoundary | None:
        """The boundary of a region at an amplitude of the map (m) from a direction; None if it was not determined.

        Parameters
        ----------
        region : Region
            B, C or D.
        amplitude : float
            Amplitude of a sweep of the map (m).
        direction : Direction
            `below` or `above`.

        Returns
        -------
        DwellBoundary or None
            The boundary.
        """
        for one in self.dwells:
            if one.amplitude == amplitude and one.region == region and one.direction == direction:
                return one
        return None

    def frequency(self, region: Region, amplitude: float) -> float | None:
        """Lowest dwell boundary of both directions (Hz) at an amplitude of the map (m).

        Infinity if the region does not begin; None if it was not bisected there, or neither direction reached it.

        Parameters
        ----------
        region : Region
            B, C or D.
        amplitude : float
            Amplitude of a sweep of the map (m).

        Returns
        -------
        float or None
            Frequency (Hz).
        """
        dwells = [self.dwell(region, amplitude, direction) for direction in DIRECTIONS]
        return min((one.frequency for one in dwells if one is not None and one.reached), default=None)


def confirmation_to_json(confirmation: Confirmation) -> dict[str, Any]:
    """A confirmation as plain JSON values; no frequency is null."""
    return {
        "settings": confirmation.settings.model_dump(),
        "complete": confirmation.complete,
        "dwells": [
            {
                "amplitude": one.amplitude,
                "region": one.region.name,
                "direction": one.direction,
                "low": one.low or None,
                "high": None if math.isinf(one.high) else one.high,
                "reached": one.reached,
            }
            for one in confirmation.dwells
        ],
        "sweeps": [sweep_to_json(sweep) for sweep in confirmation.sweeps],
    }


def confirmation_from_json(entry: dict[str, Any]) -> Confirmation:
    """The confirmation that `confirmation_to_json` wrote; KeyError, TypeError or ValueError for anything else."""
    return Confirmation(
        ConfirmationSettings.model_validate(entry["settings"]),
        tuple(_dwell_from_json(one) for one in entry["dwells"]),
        tuple(sweep_from_json(one) for one in entry["sweeps"]),
        bool(entry["complete"]),
    )


def _dwell_from_json(entry: dict[str, Any]) -> DwellBoundary:
    if entry["direction"] not in DIRECTIONS:
        raise ValueError(f"direction {entry['direction']!r}; allowed: {', '.join(DIRECTIONS)}")
    return DwellBoundary(
        float(entry["amplitude"]),
        Region[entry["region"]],
        entry["direction"],
        float(entry["low"] or 0.0),
        math.inf if entry["high"] is None else float(entry["high"]),
        bool(entry["reached"]),
    )
