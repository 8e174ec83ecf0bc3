"""What all results have: plain values for files and messages, names with units, and cards for notebooks."""

from amb_core.ground.results.card import Result, rows_by_axis
from amb_core.ground.results.names import NAMES, unnamed
from amb_core.ground.results.plain import VERSION, plain

__all__ = ["NAMES", "VERSION", "Result", "plain", "rows_by_axis", "unnamed"]
