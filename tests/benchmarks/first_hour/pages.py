"""How long the pages of results take to be drawn in headless Chromium. See `run`."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel
from amb_core.report.figures.style import BLUE, Stroke
from tests.benchmarks.skipped import Skipped
from tests.front_door.results import results_file
from tests.graph.live_page import CHROMIUM, Visit, open_browser
from tests.page_pictures import DRAWN, WIDTHS, overflowing
from tests.page_specimen import write_specimen

RESULTS = results_file("first_hour.json").parent
PAGES = {
    "report": ("rig-demo/report.html", "demo/report.html", "report.html"),
    "paper": ("paper/index.html",),
}
"""Candidates by key; the first one that is there is loaded."""
READY = """[...document.querySelectorAll('.plotly-graph-div')].every((chart) =>
    chart.getBoundingClientRect().top > innerHeight || chart.querySelector('.main-svg'))"""


def measure(folder: Path = RESULTS) -> dict[str, Any]:
    """The figures of the key `pages`, of the pages in a folder; of pages with one chart where the folder is new."""
    if CHROMIUM is None:
        raise Skipped("there is no Chromium")
    figures: dict[str, Any] = {}
    if not folder.exists():
        _draw(folder)
    with open_browser() as browser, TemporaryDirectory() as name:
        browser.new_page().close()  # the first page of a browser takes longer
        pages = [write_specimen(Path(name))]
        for key, names in PAGES.items():
            page = next((folder / name for name in names if (folder / name).exists()), None)
            ready, load = (None, None) if page is None else _seconds(browser, page)
            figures |= {f"{key}_load_s": load, f"{key}_ready_s": ready}
            pages += [] if page is None else [page]
        figures |= {"sizes": list(WIDTHS), "overflow": len(list(overflowing(pages, browser)))}
    return figures


def _draw(folder: Path) -> None:
    """The last candidate of each key, as small as such pages can be."""
    line = Curve(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "line", Stroke(BLUE))
    chart = Chart("Line", "A line that rises.", (Panel(Axis("x (-)"), Axis("y (-)"), (line,)),))
    for names in PAGES.values():
        page = folder / names[-1]
        chart.save(page.parent, page.stem)


def _seconds(browser: Any, path: Path) -> tuple[float, float]:
    """Time from opening a file until the figures in its window are drawn, and until all are (s)."""
    begin = time.monotonic()
    visit = Visit(browser, path.as_uri())
    taken = []
    for condition in (READY, DRAWN):
        visit.wait(condition)
        taken.append(round(time.monotonic() - begin, 2))
    visit.close()
    return taken[0], taken[1]
