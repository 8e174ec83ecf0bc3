"""Samples for a live display: decimated while they arrive, in bounded memory, with peaks kept. Without ROS."""

from amb_core.recording.live.columns import ColumnPyramid, Columns
from amb_core.recording.live.orbit import OrbitPath, Plane, planes_of
from amb_core.recording.live.spectrum import RunningSpectrum

__all__ = ["ColumnPyramid", "Columns", "OrbitPath", "Plane", "RunningSpectrum", "planes_of"]
