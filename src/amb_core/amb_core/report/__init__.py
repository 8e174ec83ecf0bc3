"""Reports: pages of text, numbers and interactive figures in one file that needs no network."""

from amb_core.report.document import (
    ANSWERS,
    Answer,
    Block,
    FigureBlock,
    Listing,
    Picture,
    Prose,
    Report,
    Section,
    TableBlock,
    Verdict,
)
from amb_core.report.writer import write_report

__all__ = [
    "ANSWERS",
    "Answer",
    "Block",
    "FigureBlock",
    "Listing",
    "Picture",
    "Prose",
    "Report",
    "Section",
    "TableBlock",
    "Verdict",
    "write_report",
]
