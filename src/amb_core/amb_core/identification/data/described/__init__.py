"""Data of others: a table, what its columns are, and the experiments that follow from both."""

from amb_core.identification.data.described.description import DataDescription
from amb_core.identification.data.described.interpret import DescribedData, SignalRow, describe_table

__all__ = ["DataDescription", "DescribedData", "SignalRow", "describe_table"]
