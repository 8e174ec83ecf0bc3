"""The region map: the frequency-amplitude graph of a bearing, from sweeps of many amplitudes."""

from amb_core.region_map.build import MapProgress, build_map
from amb_core.region_map.region_map import Boundary, MapSweep, RegionMap
from amb_core.region_map.settings import MapSettings

__all__ = ["Boundary", "MapProgress", "MapSettings", "MapSweep", "RegionMap", "build_map"]
