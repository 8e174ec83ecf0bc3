"""Reports: pages of text, numbers and interactive figures in one file that needs no network."""

from amb_core.report.pages.document import (
    ANSWERS,
    Answer,
    Badge,
    Block,
    FigureBlock,
    Listing,
    Picture,
    Prose,
    Report,
    Section,
    State,
    TableBlock,
    Verdict,
    VerdictStrip,
)
from amb_core.report.pages.writer import write_report

__all__ = [
    "ANSWERS",
    "Answer",
    "Badge",
    "Block",
    "FigureBlock",
    "Listing",
    "Picture",
    "Prose",
    "Report",
    "Section",
    "State",
    "TableBlock",
    "Verdict",
    "VerdictStrip",
    "write_report",
]
