"""Recordings and models for other people's tools: tables, PlotJuggler, Foxglove, MATLAB, C, FMU, Python and Julia."""

from amb_core.export.foxglove import write_foxglove
from amb_core.export.plotjuggler import write_plotjuggler
from amb_core.export.run_telemetry import RunTelemetry
from amb_core.export.tables import write_table

__all__ = ["RunTelemetry", "write_foxglove", "write_plotjuggler", "write_table"]
