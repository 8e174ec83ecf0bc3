"""How far the boundaries of a confirmed map lie apart: sweep and dwell, both directions, two rates of the sweeps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.regions import Region
from amb_core.regions.region_map.confirmation import Direction
from amb_core.regions.region_map.map_sweep import BOUNDARIES, MapSweep
from amb_core.regions.region_map.region_map import RegionMap

MOVED = 0.1  # relative change of a boundary above which a warning reports it


@dataclass(frozen=True)
class BoundaryBand:
    """One boundary of a map, found in two ways, at the amplitudes at which either has it.

    Attributes
    ----------
    region : Region
        Region that begins at the boundary.
    amplitude : ndarray, shape (n,)
        Amplitudes (m).
    first, second : ndarray, shape (n,)
        Frequencies (Hz); NaN where the region does not begin.
    """

    region: Region
    amplitude: NDArray[np.float64]
    first: NDArray[np.float64]
    second: NDArray[np.float64]

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Second over first frequency where there are both, shape (m,)."""
        ratio = self.second / self.first
        return ratio[np.isfinite(ratio)]

    @property
    def only_first(self) -> int:
        """Number of amplitudes at which only the first way shows the region."""
        return int(np.sum(np.isfinite(self.first) & np.isnan(self.second)))

    @property
    def only_second(self) -> int:
        """Number of amplitudes at which only the second way shows the region."""
        return int(np.sum(np.isnan(self.first) & np.isfinite(self.second)))

    @property
    def moved(self) -> int:
        """Number of amplitudes at which the boundary moves by more than `MOVED`, or appears in one way only."""
        return int(np.sum(np.abs(self.ratio - 1.0) > MOVED)) + self.only_first + self.only_second


def sweep_and_dwell(region_map: RegionMap) -> list[BoundaryBand]:
    """Boundaries in the sweeps of a map (first) and under fixed sines (second), where both are determined.

    Parameters
    ----------
    region_map : RegionMap
        A region map.

    Returns
    -------
    list of BoundaryBand
        Pairs of frequencies; none if the map was not confirmed.
    """
    confirmation = region_map.confirmation
    if confirmation is None:
        return []
    return _bands(
        (region, sweep.amplitude, _swept(sweep, region), dwell)
        for region in BOUNDARIES
        for sweep in region_map.sweeps
        if (dwell := confirmation.frequency(region, sweep.amplitude)) is not None
    )


def below_and_above(region_map: RegionMap) -> list[BoundaryBand]:
    """Boundaries under fixed sines that were approached from below (first) and above (second), where both are known.

    Parameters
    ----------
    region_map : RegionMap
        A region map.

    Returns
    -------
    list of BoundaryBand
        Pairs of frequencies; none if the map was not confirmed.
    """
    confirmation = region_map.confirmation
    if confirmation is None:
        return []
    sides: tuple[Direction, Direction] = ("below", "above")
    pairs = [
        (region, sweep.amplitude, [confirmation.dwell(region, sweep.amplitude, side) for side in sides])
        for region in BOUNDARIES
        for sweep in region_map.sweeps
    ]
    return _bands(
        (region, amplitude, pair[0].frequency, pair[1].frequency)
        for region, amplitude, pair in pairs
        if pair[0] is not None and pair[1] is not None and pair[0].reached and pair[1].reached
    )


def two_rates(region_map: RegionMap) -> list[BoundaryBand]:
    """Boundaries in the sweeps of a map (first) and in those at the other rate (second).

    Parameters
    ----------
    region_map : RegionMap
        A region map.

    Returns
    -------
    list of BoundaryBand
        Pairs of frequencies; none if the map was not confirmed.
    """
    confirmation = region_map.confirmation
    if confirmation is None:
        return []
    other = {sweep.amplitude: sweep for sweep in confirmation.sweeps}
    return _bands(
        (
            region,
            sweep.amplitude,
            _swept(sweep, region),
            _swept(other[sweep.amplitude], region),
        )
        for region in BOUNDARIES
        for sweep in region_map.sweeps
        if sweep.amplitude in other
    )


def confirmation_warnings(region_map: RegionMap) -> list[str]:
    """Boundaries of a confirmed map that its sweeps alone do not settle, as sentences.

    They move by more than 10 % with the rate of the sweeps, from the sweeps to fixed sines (the limit of slow sweeps),
    or with the direction from which a fixed sine comes; or they appear on one side only.

    Parameters
    ----------
    region_map : RegionMap
        A region map.

    Returns
    -------
    list of str
        Sentences; none if the map was not confirmed.
    """
    if region_map.confirmation is None:
        return []
    here = sweep_rate_text(region_map)
    other = sweep_rate_text(region_map, region_map.confirmation.settings.rate_factor)
    compared = (
        (two_rates(region_map), f"depends on the rate of the sweeps: from {here} to {other}"),
        (sweep_and_dwell(region_map), f"differs under fixed sines: from sweeps of {here} to fixed sines"),
        (below_and_above(region_map), "depends on the direction: from fixed sines from below to those from above"),
    )
    return [
        f"{band.region.name} {what} it {', '.join(_movement(band))}"
        for bands, what in compared
        for band in bands
        if band.moved
    ]


def sweep_rate_text(region_map: RegionMap, factor: float = 1.0) -> str:
    """The rate of the sweeps of a map, multiplied by a factor, as text.

    Parameters
    ----------
    region_map : RegionMap
        A region map.
    factor : float, optional
        Factor on the rate (-).

    Returns
    -------
    str
        Rate, or rates at the first and last frequency, in Hz/s.
    """
    settings = region_map.settings if factor == 1.0 else region_map.settings.at_rate(factor)
    start, end = (settings.sweep_rate(edge) for edge in (settings.frequency_start, settings.frequency_end))
    return f"{start:.4g} Hz/s" if start == end else f"{start:.3g} to {end:.3g} Hz/s"


def _movement(band: BoundaryBand) -> Iterator[str]:
    """How a boundary moves with the rate of the sweeps, and at which amplitudes."""
    with np.errstate(invalid="ignore"):
        ratio = band.second / band.first
        moved = np.abs(ratio - 1.0) > MOVED
    if moved.any():
        most = ratio[moved][np.argmax(np.abs(np.log(ratio[moved])))]
        yield f"moves by up to {100.0 * (most - 1.0):+.0f} % at {_amplitudes(band.amplitude[moved])}"
    for word, begins, ends in (("disappears", band.first, band.second), ("appears", band.second, band.first)):
        alone = np.isfinite(begins) & np.isnan(ends)
        if alone.any():
            yield f"{word} at {_amplitudes(band.amplitude[alone])}"


def _amplitudes(amplitude: NDArray[np.float64]) -> str:
    return f"{', '.join(f'{UM * one:.3g}' for one in amplitude)} um"


def _swept(sweep: MapSweep, region: Region) -> float:
    """Frequency at which a region begins in a sweep (Hz); infinity if it does not."""
    return sweep.boundaries[region].frequency if region in sweep.boundaries else math.inf


def _bands(rows: Iterable[tuple[Region, float, float, float]]) -> list[BoundaryBand]:
    """Bands of the boundaries that occur, from rows of region, amplitude and two frequencies (infinite: none)."""
    by_region: dict[Region, list[tuple[float, float, float]]] = {}
    for region, amplitude, first, second in rows:
        if math.isfinite(first) or math.isfinite(second):
            by_region.setdefault(region, []).append((amplitude, first, second))
    return [
        BoundaryBand(region, *np.where(np.isfinite(values := np.array(rows_).T), values, np.nan))
        for region, rows_ in by_region.items()
    ]
