"""Samples for a live display: decimated while they arrive, in bounded memory, with peaks kept. Without ROS."""

from amb_core.live.columns import ColumnPyramid, Columns
from amb_core.live.orbit import OrbitPath, Plane, planes_of
from amb_core.live.spectrum import RunningSpectrum

__all__ = ["ColumnPyramid", "Columns", "OrbitPath", "Plane", "RunningSpectrum", "planes_of"]
