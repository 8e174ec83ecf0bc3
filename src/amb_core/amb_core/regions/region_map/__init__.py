"""The region map: the frequency-amplitude graph of a bearing, from sweeps of many amplitudes."""

from amb_core.regions.region_map.build import MapProgress, build_map
from amb_core.regions.region_map.compare import AnalyticLine, Comparison, analytic_lines, compare
from amb_core.regions.region_map.grid import GridCell, build_grid
from amb_core.regions.region_map.region_map import BOUNDARIES, Boundary, MapSweep, RegionMap
from amb_core.regions.region_map.settings import MapSettings

__all__ = [
    "BOUNDARIES",
    "AnalyticLine",
    "Boundary",
    "Comparison",
    "GridCell",
    "MapProgress",
    "MapSettings",
    "MapSweep",
    "RegionMap",
    "analytic_lines",
    "build_grid",
    "build_map",
    "compare",
]
