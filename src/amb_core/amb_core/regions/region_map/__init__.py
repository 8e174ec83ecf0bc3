"""The region map: the frequency-amplitude graph of a bearing, from sweeps of many amplitudes."""

from amb_core.regions.region_map.band import (
    BoundaryBand,
    below_and_above,
    confirmation_warnings,
    sweep_and_dwell,
    sweep_rate_text,
    two_rates,
)
from amb_core.regions.region_map.build import MapProgress, build_map
from amb_core.regions.region_map.compare import AnalyticLine, Comparison, analytic_lines, compare
from amb_core.regions.region_map.confirm import confirm_map
from amb_core.regions.region_map.confirmation import DIRECTIONS, Confirmation, DwellBoundary
from amb_core.regions.region_map.grid import GridCell, build_grid
from amb_core.regions.region_map.map_sweep import BOUNDARIES, Boundary, MapSweep
from amb_core.regions.region_map.region_map import RegionMap, Side
from amb_core.regions.region_map.settings import ConfirmationSettings, MapSettings

__all__ = [
    "BOUNDARIES",
    "DIRECTIONS",
    "AnalyticLine",
    "Boundary",
    "BoundaryBand",
    "Comparison",
    "Confirmation",
    "ConfirmationSettings",
    "DwellBoundary",
    "GridCell",
    "MapProgress",
    "MapSettings",
    "MapSweep",
    "RegionMap",
    "Side",
    "analytic_lines",
    "below_and_above",
    "build_grid",
    "build_map",
    "compare",
    "confirm_map",
    "confirmation_warnings",
    "sweep_and_dwell",
    "sweep_rate_text",
    "two_rates",
]
