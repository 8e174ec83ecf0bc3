"""Reports: pages of text, numbers and interactive figures in one file that needs no network."""

from amb_core.report.document import (
    ANSWERS,
    Answer,
    Block,
    Chart,
    Listing,
    Picture,
    Prose,
    Report,
    Section,
    Table,
    Verdict,
)
from amb_core.report.writer import write_report

__all__ = [
    "ANSWERS",
    "Answer",
    "Block",
    "Chart",
    "Listing",
    "Picture",
    "Prose",
    "Report",
    "Section",
    "Table",
    "Verdict",
    "write_report",
]
