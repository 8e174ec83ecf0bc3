"""Hostile names of signals, models and files on the pages that are written from them, opened in Chromium.

A payload is executed if it runs a script, opens a dialog, leaves the page or asks for anything beside the page's files.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.identification.frequency_response import FrequencyResponse
from amb_core.report.figures import bode_chart
from amb_core.report.figures.saving import SCRIPT
from amb_core.report.pages.document import Badge, FigureBlock, Prose, Report, Section, TableBlock, VerdictStrip
from amb_core.report.pages.writer import write_report
from tests.benchmarks.skipped import Skipped
from tests.graph.live_page import CHROMIUM, open_browser

RUN = "globalThis.executed=1"
PAYLOADS = (
    f"<script>{RUN}</script>",
    f"</script><script>{RUN}</script>",
    f'<img src=x onerror="{RUN}">',
    f'"><svg onload="{RUN}">',
    f"' onmouseover='{RUN}' autofocus onfocus='{RUN}",
    f"<a href=\"javascript:{RUN}\">x</a>",
    f"<iframe srcdoc=\"<script>parent.{RUN}</script>\"></iframe>",
    '<meta http-equiv="refresh" content="0;url=http://203.0.113.1/">',
    "<link rel=stylesheet href=http://203.0.113.1/a.css>",
    "<style>@import 'http://203.0.113.1/b.css'</style>",
    "<object data=http://203.0.113.1/c></object><base href=http://203.0.113.1/>",
    "<form action=http://203.0.113.1/><input name=a><button>b</button></form>",
    f"${{{RUN}}} {{{{{RUN}}}}} {{% raw %}}",
    f"\\u003cscript\\u003e{RUN}\\u003c/script\\u003e",
    f"<!--<script>{RUN}//-->",
    f"\u202ecod.exe\u202c\u2028{RUN}\u2029",
    f"\x1b]8;;javascript:{RUN}\x07x\x1b]8;;\x07\x00",
    f"<math><mtext><table><mglyph><style><img src onerror={RUN}>",
)  # fmt: skip
DRAWN = "[...document.querySelectorAll('.plotly-graph-div')].every((chart) => chart.querySelector('.main-svg'))"
_SEEN = "globalThis.executed !== undefined || document.querySelectorAll('a[href^=javascript]').length > 0"


def open_payloads(quick: bool = False) -> dict[str, Any]:
    """Write the pages of each payload and open them; the number of payloads, and those executed, by number.

    Raises
    ------
    Skipped
        If there is no Chromium.
    """
    if CHROMIUM is None:
        raise Skipped("there is no Chromium")
    chosen = PAYLOADS[:: len(PAYLOADS) // 2] if quick else PAYLOADS
    executed = []
    with tempfile.TemporaryDirectory() as name, open_browser() as browser:
        for number, payload in enumerate(chosen):
            pages = write_pages(payload, Path(name) / str(number))
            if any(does_something(browser, page) for page in pages):
                executed.append(payload)
    return {"payloads": len(chosen), "executed": len(executed), "names": executed}


def write_pages(payload: str, folder: Path) -> list[Path]:
    """A figure and a report in which a stranger chose every name."""
    frequency = np.geomspace(1.0, 1e3, 20)
    response = FrequencyResponse(
        frequency,
        np.ones((20, 1, 1)) / (1.0 + 1j * frequency[:, np.newaxis, np.newaxis]),
        payload,
        input_names=(payload,),
        output_names=(payload,),
        input_units=(payload,),
        output_units=(payload,),
    )
    chart = bode_chart([response], payload)
    chart = replace(chart, alt=payload)
    figure = chart.save(folder, "figure")[-1]
    table = TableBlock((payload, "x"), [(payload, Badge(payload, "bad", payload))], payload)
    section = Section(payload, [Prose(payload), table, FigureBlock(chart.page(), payload)])
    report = Report(
        payload, payload, [Prose(payload)], [section], payload, VerdictStrip(Badge(payload, "bad"), payload, [])
    )
    write_report(report, folder / "report.html")
    return [figure.with_suffix(".html"), folder / "report.html"]


def does_something(browser: Any, page: Path) -> bool:
    """Whether a page does anything but draw its figures; the pointer goes over all of it."""
    visit = browser.new_page()
    events: list[str] = []
    allowed = {page.as_uri(), (page.parent / SCRIPT).as_uri()}
    visit.on("dialog", lambda dialog: (events.append("dialog"), dialog.dismiss()))
    visit.on("framenavigated", lambda frame: events.append(frame.url) if frame.url != page.as_uri() else None)
    visit.on(
        "request",
        lambda request: events.append(request.url) if not request.url.startswith("data:") and request.url not in allowed
        else None,
    )  # fmt: skip
    visit.goto(page.as_uri())
    while not visit.evaluate(DRAWN):
        visit.wait_for_timeout(20)
    for place in range(100, 700, 100):
        visit.mouse.move(place, place)
    ran = bool(visit.evaluate(_SEEN))
    visit.close()
    return ran or bool(events)
