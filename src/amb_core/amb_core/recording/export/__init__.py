"""Recordings and models for other people's tools: tables, PlotJuggler, Foxglove, MATLAB, C, FMU, Python and Julia."""

from amb_core.recording.export.foxglove import write_foxglove
from amb_core.recording.export.plotjuggler import write_plotjuggler
from amb_core.recording.export.run_telemetry import RunTelemetry
from amb_core.recording.export.tables import write_table

__all__ = ["RunTelemetry", "write_foxglove", "write_plotjuggler", "write_table"]
