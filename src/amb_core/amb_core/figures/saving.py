"""Writes figures: a PNG, and an HTML page that needs no network.

Pages of one folder share one `plotly.min.js` beside them: each alone would be 5 MB.
"""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import plotly.graph_objects as go  # type: ignore[import-untyped]
import plotly.io  # type: ignore[import-untyped]
from matplotlib.figure import Figure
from plotly.offline import get_plotlyjs  # type: ignore[import-untyped]

from amb_core.errors import AmbError

SCRIPT = "plotly.min.js"

CONFIG = {
    "responsive": True,
    "displaylogo": False,
    "plotlyServerURL": "",  # nothing is sent anywhere
    "showTips": False,
    "modeBarButtons": [["zoom2d", "pan2d", "resetScale2d", "toImage"]],
}

COLUMN_WIDTH = 20  # of a panel beside others (rem); narrower windows scroll

STYLE = """
:root { color-scheme: light dark; --text: #1a1a1a; --page: #ffffff; --line: #cccccc; }
@media (prefers-color-scheme: dark) { :root { --text: #e8e8e8; --page: #16181c; --line: #444444; } }
body { margin: 0 auto; max-width: 70rem; padding: 0.8rem; font: 1rem/1.5 system-ui, sans-serif;
  color: var(--text); background: var(--page); }
h1 { font-size: 1.3rem; line-height: 1.25; }
figure { margin: 0 0 1.5rem; }
.chart .main-svg text { fill: var(--text) !important; }
.chart .hoverlayer text { fill: #ffffff !important; }
.chart .hoverlayer path { fill: #333333 !important; }
.chart, .numbers { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid var(--line); padding: 0.25rem 0.8rem; text-align: left; white-space: nowrap; }
"""

# A finger that scrolls the page must not zoom the chart that it touches.
TOUCH = """
if (matchMedia("(pointer: coarse)").matches)
  document.querySelectorAll(".plotly-graph-div").forEach((chart) => Plotly.relayout(chart, {dragmode: false}));
"""


def save_figure(folder: str | Path, name: str, figure: Figure, page: go.Figure) -> tuple[Path, Path]:
    """Write a figure as name.png and its page as name.html; the PNG's metadata have title and alt text.

    Parameters
    ----------
    folder : path
        Made if it does not exist.
    name : str
        Name of both files, without their endings.
    figure, page : matplotlib Figure, plotly Figure
        The pair that a subject makes: `sweep_figure` and `sweep_page`, for example.

    Raises
    ------
    AmbError
        If a file cannot be written.
    """
    folder = Path(folder)
    image, document = folder / f"{name}.png", folder / f"{name}.html"
    title, alt = page.layout.title.text, page.layout.meta["alt"]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        figure.savefig(image, metadata={"Title": title, "Description": alt}, pil_kwargs={"optimize": True})
    except OSError as problem:
        raise AmbError(f"figure {name} in {folder}: cannot be written: {problem.strerror}") from None
    write_page(folder, name, page)
    return image, document


def write_page(folder: Path, name: str, page: go.Figure) -> None:
    """Write a page as name.html to a folder that exists; AmbError if it cannot be written."""
    title = html.escape(page.layout.title.text)
    try:
        (folder / f"{name}.html").write_text(
            f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f'<style>{STYLE}</style>\n<script src="{SCRIPT}"></script>\n</head>\n<body>\n<main>\n'
            f"<h1>{title}</h1>\n{page_fragment(page)}\n</main>\n<script>{TOUCH}</script>\n</body>\n</html>\n",
            encoding="utf-8",
        )
        write_script(folder)
    except OSError as problem:
        raise AmbError(f"page {name} in {folder}: cannot be written: {problem.strerror}") from None


def page_from_json(text: str) -> go.Figure:
    """The page that a page's `to_json` has written."""
    return plotly.io.from_json(text)


def write_script(folder: Path) -> None:
    """Write `plotly.min.js` to a folder unless it is there in this version."""
    script, path = get_plotlyjs(), folder / SCRIPT
    if not path.exists() or path.stat().st_size != len(script.encode()):
        path.write_text(script, encoding="utf-8")


def page_fragment(page: go.Figure) -> str:
    """A page's chart, alt text and numbers as HTML, to put into a document that has the script and `STYLE`.

    The title is left to the document, whose headings wrap on narrow screens.
    """
    alt, table, columns = (page.layout.meta[name] for name in ("alt", "table", "columns"))
    width = f"min-width: {COLUMN_WIDTH * columns}rem" if columns > 1 else ""
    chart = go.Figure(page)
    chart.update_layout(title=None, meta=None, margin_t=50)
    drawn = chart.to_html(
        full_html=False,
        include_plotlyjs=False,
        config=CONFIG,
    )
    parts = [
        "<figure>",
        f'<div class="chart" role="img" aria-label="{html.escape(alt)}"><div style="{width}">{drawn}</div></div>',
        f"<figcaption>{html.escape(alt)}</figcaption>",
        *([_numbers(table)] if table else []),
        "</figure>",
    ]
    return "\n".join(parts)


def _numbers(table: dict[str, Any]) -> str:
    """The table as HTML that opens on demand, by keyboard too."""
    heads = "".join(f'<th scope="col">{html.escape(text)}</th>' for text in table["header"])
    rows = "".join(
        "<tr>" + "".join(f"<td>{html.escape(text)}</td>" for text in row) + "</tr>\n" for row in table["rows"]
    )
    return (
        f'<details><summary>Numbers</summary><div class="numbers"><table><thead><tr>{heads}</tr></thead>'
        f"<tbody>\n{rows}</tbody></table></div></details>"
    )
