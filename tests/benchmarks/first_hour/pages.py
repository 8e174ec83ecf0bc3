"""How long the pages of results take to be drawn in headless Chromium. See `run`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from tests.graph.live_page import Visit, open_browser

RESULTS = Path(__file__).parents[3] / "results"
PAGES = {
    "report_load_s": ("rig-demo/report.html", "demo/report.html", "report.html"),
    "paper_load_s": ("paper/index.html",),
}
"""Candidates by key; the first one that is there is loaded."""
DRAWN = "[...document.querySelectorAll('.plotly-graph-div')].every((chart) => chart.querySelector('.main-svg'))"


def measure() -> dict[str, Any]:
    """The figures of the key `pages`."""
    found: dict[str, Any] = {}
    with open_browser() as browser:
        browser.new_page().close()  # the first page of a browser takes longer
        for key, names in PAGES.items():
            page = next((RESULTS / name for name in names if (RESULTS / name).exists()), None)
            found[key] = None if page is None else _seconds(browser, page)
    return found


def _seconds(browser: Any, path: Path) -> float:
    """Time from opening a file until all its figures are drawn (s)."""
    begin = time.monotonic()
    visit = Visit(browser, path.as_uri())
    visit.wait(DRAWN)
    taken = time.monotonic() - begin
    visit.close()
    return round(taken, 2)
