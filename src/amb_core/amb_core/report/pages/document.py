"""What a report says: sections of text, figures, tables and verdicts. How it looks is the writer's business."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from amb_core.ground.extras import extra

with extra("figures"):
    import plotly.graph_objects as go  # type: ignore[import-untyped]

State = Literal["good", "limited", "bad", "neutral"]
Answer = Literal["agrees", "agrees in part", "does not agree"]
ANSWERS: tuple[Answer, ...] = ("agrees", "agrees in part", "does not agree")


@dataclass(frozen=True)
class Badge:
    """A few words with a state, which a colour and a sign show.

    Attributes
    ----------
    text : str
        The words; they must be clear without the colour.
    state : "good", "limited", "bad" or "neutral"
        What the state of that is.
    section : str
        Heading of the section that shows why, to which the badge links; empty for none.
    """

    text: str
    state: State = "neutral"
    section: str = ""


Cell = str | Badge


@dataclass(frozen=True)
class VerdictStrip:
    """What a page found, before everything else.

    Attributes
    ----------
    verdict : Badge
        The verdict.
    reason : str
        Why, in one sentence.
    numbers : sequence of (str, Badge)
        The main numbers with their names.
    """

    verdict: Badge
    reason: str
    numbers: Sequence[tuple[str, Badge]]


@dataclass(frozen=True)
class Prose:
    """A paragraph of plain text.

    Attributes
    ----------
    text : str
        The paragraph.
    """

    text: str


@dataclass(frozen=True)
class FigureBlock:
    """An interactive figure with its caption; the page of a chart of `amb_core.report.figures`.

    Attributes
    ----------
    page : plotly Figure
        From `Chart.page`; its own title is left out.
    title : str, optional
        What it shows, where the heading of the section does not say it.
    """

    page: go.Figure
    title: str = ""


@dataclass(frozen=True)
class Picture:
    """An image file, put into the page.

    Attributes
    ----------
    path : Path
        The file.
    alt : str
        What it shows, for those who cannot see it.
    """

    path: Path
    alt: str


@dataclass(frozen=True)
class TableBlock:
    """Rows of texts and badges below a header.

    Attributes
    ----------
    header : sequence of str
        Names of the columns.
    rows : sequence of sequence of Cell
        Cells in the order of the header.
    caption : str
        What the rows are.
    filters : sequence of str
        Columns, by their header, of few different texts: a reader may choose one and see only its rows.

    Raises
    ------
    ValueError
        If a filter is no column.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str
    filters: Sequence[str] = ()

    def __post_init__(self) -> None:
        if unknown := set(self.filters) - set(self.header):
            raise ValueError(f"table '{self.caption}' has no columns {', '.join(sorted(unknown))}")

    def choices(self, name: str) -> list[str]:
        """The different texts of a column, in the order of the rows.

        Parameters
        ----------
        name : str
            Header of the column.

        Returns
        -------
        list of str
            Texts, each once.
        """
        place = list(self.header).index(name)
        return list(dict.fromkeys(text_of(row[place]) for row in self.rows))


def text_of(cell: Cell) -> str:
    """The words of a cell."""
    return cell.text if isinstance(cell, Badge) else cell


@dataclass(frozen=True)
class Verdict:
    """What somebody states, what was found, and whether they agree.

    Attributes
    ----------
    statement : str
        What is stated.
    finding : str
        What was found.
    answer : Answer
        Whether they agree.
    reason : str, optional
        Why they do not; empty if they do.
    """

    statement: str
    finding: str
    answer: Answer
    reason: str = ""


@dataclass(frozen=True)
class Listing:
    """Text whose spacing matters, such as a report in plain text.

    Attributes
    ----------
    text : str
        The text, line by line.
    caption : str
        What it is.
    """

    text: str
    caption: str


Block = Prose | FigureBlock | Picture | TableBlock | Verdict | Listing


def anchor_of(heading: str) -> str:
    """The name of a section in links within the page."""
    return re.sub(r"[^a-z0-9]+", "-", heading.lower()).strip("-")


@dataclass(frozen=True)
class Section:
    """A heading and what is below it.

    Attributes
    ----------
    heading : str
        Heading, unlike all others of the page.
    blocks : sequence of Block
        What is below it, in order.
    """

    heading: str
    blocks: Sequence[Block]

    @property
    def anchor(self) -> str:
        """Its name in links within the page."""
        return anchor_of(self.heading)


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
    strip : VerdictStrip, optional
        The verdict, above everything but the title. None for no verdict.
    """

    title: str
    lead: str
    opening: Sequence[Block]
    sections: Sequence[Section]
    made_from: str = ""
    strip: VerdictStrip | None = None
