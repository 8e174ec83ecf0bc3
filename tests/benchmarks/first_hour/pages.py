"""How long the pages of results take to be drawn in headless Chromium. See `run`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel
from amb_core.report.figures.style import BLUE, Stroke
from tests.benchmarks.skipped import Skipped
from tests.front_door.results import results_file
from tests.graph.live_page import CHROMIUM, Visit, open_browser

RESULTS = results_file("first_hour.json").parent
PAGES = {
    "report_load_s": ("rig-demo/report.html", "demo/report.html", "report.html"),
    "paper_load_s": ("paper/index.html",),
}
"""Candidates by key; the first one that is there is loaded."""
DRAWN = "[...document.querySelectorAll('.plotly-graph-div')].every((chart) => chart.querySelector('.main-svg'))"


def measure(folder: Path = RESULTS) -> dict[str, Any]:
    """The figures of the key `pages`, of the pages in a folder; of pages with one chart where the folder is new."""
    if CHROMIUM is None:
        raise Skipped("there is no Chromium")
    found: dict[str, Any] = {}
    if not folder.exists():
        _draw(folder)
    with open_browser() as browser:
        browser.new_page().close()  # the first page of a browser takes longer
        for key, names in PAGES.items():
            page = next((folder / name for name in names if (folder / name).exists()), None)
            found[key] = None if page is None else _seconds(browser, page)
    return found


def _draw(folder: Path) -> None:
    """The last candidate of each key, as small as such pages can be."""
    line = Curve(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "line", Stroke(BLUE))
    chart = Chart("Line", "A line that rises.", (Panel(Axis("x (-)"), Axis("y (-)"), (line,)),))
    for names in PAGES.values():
        page = folder / names[-1]
        chart.save(page.parent, page.stem)


def _seconds(browser: Any, path: Path) -> float:
    """Time from opening a file until all its figures are drawn (s)."""
    begin = time.monotonic()
    visit = Visit(browser, path.as_uri())
    visit.wait(DRAWN)
    taken = time.monotonic() - begin
    visit.close()
    return round(taken, 2)
