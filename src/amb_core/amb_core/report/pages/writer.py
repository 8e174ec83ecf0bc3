"""Writes a report as one HTML file: readable on a phone, by keyboard and by screen readers, in dark and in light."""

from __future__ import annotations

import base64
import mimetypes
from collections.abc import Iterator
from pathlib import Path

from amb_core.ground.errors import AmbError
from amb_core.ground.extras import extra
from amb_core.ground.given_values import path_of
from amb_core.ground.version import __version__
from amb_core.report.figures.saving import DRAWING, STYLE, page_fragment
from amb_core.report.pages.breaks import breakable
from amb_core.report.pages.document import Badge, Block, FigureBlock, Picture, Report, TableBlock, anchor_of

with extra("figures"):
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs  # type: ignore[import-untyped]


def write_report(report: Report, path: str | Path) -> None:
    """Write a report as an HTML file that holds all it needs.

    Its content security policy forbids it to load anything from anywhere, so it neither needs nor asks for a network.
    A PDF that was printed of the page that it replaces is removed, so that no two tell different things.

    Parameters
    ----------
    report : Report
        The page.
    path : str or Path
        File to write.

    Raises
    ------
    AmbError
        If two sections have one heading, a badge links to none, an image cannot be read, or the file cannot be written.
    """
    anchors = [section.anchor for section in report.sections]
    if len(set(anchors)) < len(anchors):
        raise AmbError(f"report '{report.title}': its headings must differ")
    for badge in _badges(report):
        if badge.section and anchor_of(badge.section) not in anchors:
            raise AmbError(f"report '{report.title}': badge '{badge.text}' links to no section '{badge.section}'")
    environment = Environment(
        loader=PackageLoader("amb_core.report", "pages"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.globals |= {
        "kind_of": lambda item: type(item).__name__,
        "fragment": _fragment,
        "embedded": _embedded,
        "anchor_of": anchor_of,
        "breakable": breakable,
        "column_of": lambda table, name: list(table.header).index(name),
    }
    folder = Path(__file__).parent
    page = environment.get_template("page.html.j2").render(
        report=report,
        program=f"amb_core {__version__}",
        style=Markup(STYLE + (folder / "page.css").read_text(encoding="utf-8")),
        script=Markup(get_plotlyjs()),
        page_script=Markup(DRAWING + (folder / "page.js").read_text(encoding="utf-8")),
    )
    target = path_of("path", path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists():
            target.with_suffix(".pdf").unlink(missing_ok=True)
        # names of files need not be UTF-8
        target.write_text(page, encoding="utf-8", errors="backslashreplace")
    except OSError as problem:
        raise AmbError(f"report {path}: cannot be written: {problem.strerror}") from None


def _badges(report: Report) -> Iterator[Badge]:
    if report.strip is not None:
        yield report.strip.verdict
        yield from (number for _, number in report.strip.numbers)
    blocks: list[Block] = [*report.opening, *(block for section in report.sections for block in section.blocks)]
    tables = [block for block in blocks if isinstance(block, TableBlock)]
    yield from (cell for table in tables for row in table.rows for cell in row if isinstance(cell, Badge))


def _fragment(chart: FigureBlock) -> Markup:
    return Markup(page_fragment(chart.page))


def _embedded(picture: Picture) -> str:
    """The image as a data URL."""
    kind = mimetypes.guess_type(picture.path)[0] or "image/png"
    try:
        content = picture.path.read_bytes()
    except OSError as problem:
        raise AmbError(f"image {picture.path}: cannot be read: {problem.strerror}") from None
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
