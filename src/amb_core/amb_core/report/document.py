"""What a report says: sections of text, figures, tables and verdicts. How it looks is the writer's business."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import plotly.graph_objects as go  # type: ignore[import-untyped]

Answer = Literal["agrees", "agrees in part", "does not agree"]
ANSWERS: tuple[Answer, ...] = ("agrees", "agrees in part", "does not agree")


@dataclass(frozen=True)
class Prose:
    """A paragraph of plain text."""

    text: str


@dataclass(frozen=True)
class FigureBlock:
    """An interactive figure with its caption; the page of a chart of `amb_core.figures`.

    Its title is left out: the heading of the section, or `title`, says what it shows.
    """

    page: go.Figure
    title: str = ""


@dataclass(frozen=True)
class Picture:
    """An image file, put into the page, with the text for those who cannot see it."""

    path: Path
    alt: str


@dataclass(frozen=True)
class TableBlock:
    """Rows of texts below a header, which numbers in a report are too; `caption` says what they are."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str


@dataclass(frozen=True)
class Verdict:
    """What somebody states, what was found, and whether they agree."""

    statement: str
    finding: str
    answer: Answer
    reason: str = ""


@dataclass(frozen=True)
class Listing:
    """Text whose spacing matters, such as a report in plain text."""

    text: str
    caption: str


Block = Prose | FigureBlock | Picture | TableBlock | Verdict | Listing


@dataclass(frozen=True)
class Section:
    """A heading and what is below it."""

    heading: str
    blocks: Sequence[Block]

    @property
    def anchor(self) -> str:
        """Its name in links within the page."""
        return re.sub(r"[^a-z0-9]+", "-", self.heading.lower()).strip("-")


@dataclass(frozen=True)
class Report:
    """A page: title, a few lines of what matters most, the blocks that show it, and the sections.

    Attributes
    ----------
    title, lead : str
        Heading of the page and the paragraph below it.
    opening : sequence of Block
        What stands before the first section.
    sections : sequence of Section
        With different headings.
    made_from : str
        Where the numbers come from; shown at the end.
    """

    title: str
    lead: str
    opening: Sequence[Block]
    sections: Sequence[Section]
    made_from: str = ""
