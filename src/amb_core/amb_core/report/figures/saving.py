"""Writes figures: a PNG, and an HTML page that needs no network.

Pages of one folder share one `plotly.min.js` beside them: each alone would be 5 MB.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from pathlib import Path

from amb_core.ground.errors import AmbError
from amb_core.ground.extras import extra
from amb_core.report.figures.plotly_page import COLUMN_PIXELS

with extra("figures"):
    import plotly.graph_objects as go  # type: ignore[import-untyped]
    import plotly.io  # type: ignore[import-untyped]
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup
    from matplotlib.figure import Figure
    from plotly.offline import get_plotlyjs  # type: ignore[import-untyped]

SCRIPT = "plotly.min.js"

CONFIG = {
    "responsive": True,
    "displaylogo": False,
    "displayModeBar": "hover",
    "plotlyServerURL": "",  # nothing is sent anywhere
    "showTips": False,
    "modeBarButtons": [["zoom2d", "pan2d", "resetScale2d", "toImage"]],
}

_MARKUP = re.compile(r"<(?!/?(?:b|br|extra)>)")
"""Where a tag begins that charts do not use: plotly would make links and styles of those in texts of others."""

STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")
DRAWING = (Path(__file__).parent / "draw.js").read_text(encoding="utf-8")
_OWN = base64.b64encode(hashlib.sha256(f"\n{DRAWING}".encode()).digest()).decode()
POLICY = (
    f"default-src 'none'; script-src 'self' file: 'sha256-{_OWN}'; "
    "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'"
)
"""What a figure's page may load and run: the script beside it and its own, nothing from elsewhere."""

_TEMPLATES = Environment(
    loader=PackageLoader("amb_core.report", "figures"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
)


def write_image(folder: Path, name: str, figure: Figure, title: str, alt: str) -> Path:
    """Write a figure as name.png, title and alt text in its metadata; AmbError if it cannot be written."""
    image = folder / f"{name}.png"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        figure.savefig(image, metadata={"Title": title, "Description": alt})
    except OSError as problem:
        raise AmbError(f"figure {name} in {folder}: cannot be written: {problem.strerror}") from None
    return image


def write_page(folder: Path, name: str, page: go.Figure) -> Path:
    """Write a page as name.html to a folder that exists; AmbError if it cannot be written."""
    path = folder / f"{name}.html"
    document = _TEMPLATES.get_template("page.html.j2").render(
        title=page.layout.title.text,
        style=Markup(STYLE),
        script=SCRIPT,
        fragment=Markup(page_fragment(page)),
        drawing=Markup(DRAWING),
        policy=POLICY,
    )
    try:
        path.write_text(document, encoding="utf-8")
        write_script(folder)
    except OSError as problem:
        raise AmbError(f"page {name} in {folder}: cannot be written: {problem.strerror}") from None
    return path


def page_from_json(text: str) -> go.Figure:
    """The page that a page's `to_json` has written."""
    return plotly.io.from_json(text)


def write_script(folder: Path) -> None:
    """Write `plotly.min.js` to a folder unless it is there in this version."""
    script, path = get_plotlyjs(), folder / SCRIPT
    if not path.exists() or path.stat().st_size != len(script.encode()):
        path.write_text(script, encoding="utf-8")


def page_fragment(page: go.Figure) -> str:
    """A page's chart, alt text and numbers as HTML, to put into a document with plotly's script, `STYLE` and `DRAWING`.

    The title is left to the document, whose headings wrap on narrow screens.

    Parameters
    ----------
    page : plotly Figure
        From `Chart.page`.

    Returns
    -------
    str
        HTML elements without head and body.
    """
    alt, table, columns = (page.layout.meta[name] for name in ("alt", "table", "columns"))
    width = f"min-width: {COLUMN_PIXELS * columns}px" if columns > 1 else ""
    chart = go.Figure(page)
    chart.update_layout(title=None, meta=None, margin_t=50)
    content = json.loads(chart.to_json()) | {"config": CONFIG}
    data = _MARKUP.sub("&lt;", json.dumps(content, separators=(",", ":")))
    data = data.replace("</", "<\\/")  # no text ends the script
    return _TEMPLATES.get_template("fragment.html.j2").render(
        alt=alt, table=table, width=width, height=chart.layout.height, data=Markup(data)
    )
