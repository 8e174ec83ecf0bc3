"""A report in a browser: it draws, answers to the pointer and the keyboard, and asks for nothing outside itself.

Needs Chromium, as Debian packages it; without it these tests are left out.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from amb_core.loop.records import LoopRecord
from amb_core.regions import Region
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep, RegionMap
from amb_core.report.figures import map_chart, response_chart
from amb_core.report.pages import (
    Badge,
    FigureBlock,
    Prose,
    Report,
    Section,
    TableBlock,
    Verdict,
    VerdictStrip,
    write_report,
)

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")

TABLE = TableBlock(
    ("claim", "paper", "verdict"),
    [
        (
            "At low frequencies the bearing behaves as the identified linear model.",
            "Section 2.2",
            "does not agree",
        ),
        ("The rotor falls.", "Fig. 5", "agrees"),
        ("It drifts before.", "Fig. 5", "agrees"),
    ],
    "44 claims; agrees: 26, agrees in part: 14, does not agree: 4",
    filters=("paper", "verdict"),
)
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


def sweep(amplitude: float, drift: float, fall: float) -> MapSweep:
    boundaries = {Region.B: Boundary(drift, False), Region.D: Boundary(fall, False)}
    return MapSweep(amplitude, boundaries, (), fall, 1000)


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> Path:
    region_map = RegionMap(
        MapSettings(amplitude_low=10e-6, amplitude_high=100e-6),
        (sweep(10e-6, 1000.0, 4000.0), sweep(100e-6, 60.0, 100.0)),
    )
    time = np.arange(2000.0)[:, np.newaxis] * np.ones(2)
    record = LoopRecord(0, 1e-4, 0.0 * time, 1e-5 * np.sin(0.01 * time), 0.0 * time)
    report = Report(
        "Shaken too fast",
        "What a bearing does then.",
        [FigureBlock(map_chart(region_map).page())],
        [
            Section("Fig. 14: response", [Prose("A sine."), FigureBlock(response_chart(record).page(), "Response")]),
            Section("Claims", [Verdict("It moves.", "It does.", "agrees"), TABLE]),
        ],
        strip=VerdictStrip(
            Badge("not validated", "bad", "Claims"), "It fell.", [("order", Badge("10", section="Claims"))]
        ),
    )
    path = tmp_path_factory.mktemp("report") / "index.html"
    write_report(report, path)
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


class Visit:
    """The page, opened, with everything that it complained of and asked for."""

    def __init__(self, browser, document: Path, **options) -> None:
        self.page = browser.new_page(**options)
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(document.as_uri())
        self.wait_until("document.querySelectorAll('.plotly-graph-div .main-svg').length >= 4")

    def wait_until(self, condition: str) -> None:
        """Until a condition in the page holds; the page's policy forbids playwright's own way of asking again."""
        while not self.page.evaluate(condition):
            self.page.wait_for_timeout(20)


@pytest.fixture(scope="module", params=[{}, {"color_scheme": "dark"}, PHONE], ids=["light", "dark", "phone"])
def visit(request, browser, document: Path) -> Iterator[Visit]:
    visit = Visit(browser, document, **request.param)
    yield visit
    visit.page.close()


def test_figures_are_drawn_without_complaints_and_without_a_request(visit: Visit, document: Path) -> None:
    for chart in visit.page.query_selector_all(".plotly-graph-div"):
        assert chart.query_selector_all(".trace path, .hm image")
    assert visit.complaints == []
    assert visit.requests == [document.as_uri()]


def test_nothing_is_wider_than_the_screen(visit: Visit) -> None:
    assert visit.page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_text_stands_out_from_the_page(visit: Visit) -> None:
    shades = visit.page.evaluate(
        """() => [getComputedStyle(document.body).color, getComputedStyle(document.body).backgroundColor]
            .map(text => text.match(/[0-9]+/g).slice(0, 3).reduce((sum, part) => sum + Number(part), 0) / 765)"""
    )
    assert abs(shades[0] - shades[1]) > 0.6


def test_pointing_at_the_map_tells_amplitude_frequency_and_region(browser, document: Path) -> None:
    visit = Visit(browser, document)
    plot = visit.page.locator(".plotly-graph-div").first.locator(".nsewdrag").first
    box = plot.bounding_box()
    visit.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.8 * box["height"])
    hover = visit.page.locator(".hoverlayer .hovertext").first
    hover.wait_for()
    text = hover.text_content()
    assert "µm" in text and "Hz" in text and "A steady bias" in text
    visit.page.close()


def test_lines_on_the_map_do_not_hide_what_it_tells(browser, document: Path) -> None:
    visit = Visit(browser, document)
    plot = visit.page.locator(".plotly-graph-div").first.locator(".nsewdrag").first
    visit.page.evaluate("document.querySelector('.plotly-graph-div').scrollIntoView({block: 'end'})")
    box = plot.bounding_box()
    hover = visit.page.locator(".hoverlayer .hovertext").first
    told = []
    for share in np.linspace(0.1, 0.9, 15):  # down across the boundaries
        visit.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + share * box["height"])
        visit.page.wait_for_timeout(150)  # plotly waits for the pointer to rest
        told.append(hover.text_content() if hover.count() else "")
    assert all(" µm, " in text and " Hz" in text for text in told), told
    visit.page.close()


def test_a_table_fits_a_phone(browser, document: Path) -> None:
    visit = Visit(browser, document, **PHONE)
    fits = visit.page.evaluate(
        "[...document.querySelectorAll('main > div.numbers, section > div.numbers')]"
        ".map(table => table.scrollWidth <= table.clientWidth)"
    )
    assert fits and all(fits)
    visit.page.close()


def test_the_keyboard_reaches_content_links_and_tables(browser, document: Path) -> None:
    visit = Visit(browser, document)
    visit.page.keyboard.press("Tab")
    assert visit.page.evaluate("document.activeElement.textContent") == "Skip to the content"
    reached = set()
    for _ in range(40):
        visit.page.keyboard.press("Tab")
        reached.add(
            visit.page.evaluate("document.activeElement.getAttribute('href') || document.activeElement.tagName")
        )
    assert {"#fig-14-response", "#claims", "DIV", "SUMMARY"} <= reached
    visit.page.close()


def test_a_badge_of_the_verdict_leads_to_what_shows_it(browser, document: Path) -> None:
    visit = Visit(browser, document)
    strip = visit.page.locator(".strip")
    assert "not validated" in strip.inner_text() and "It fell." in strip.inner_text()
    strip.locator("a", has_text="not validated").click()
    assert visit.page.evaluate("location.hash") == "#claims"
    assert visit.page.locator("#claims").is_visible()
    visit.page.close()


def test_a_table_shows_the_rows_that_a_reader_chooses(browser, document: Path) -> None:
    visit = Visit(browser, document)
    rows, count = visit.page.locator("#claims ~ .numbers tbody tr:visible"), visit.page.locator("form.filters output")
    assert (rows.count(), count.inner_text()) == (3, "3 rows")
    visit.page.get_by_role("combobox", name="verdict").select_option("agrees")
    assert (rows.count(), count.inner_text()) == (2, "2 of 3 rows")
    visit.page.get_by_role("combobox", name="paper").select_option("Section 2.2")
    assert rows.count() == 0
    visit.page.get_by_role("combobox", name="verdict").select_option("")
    assert rows.count() == 1
    visit.page.close()


def test_the_contents_stay_in_sight_and_mark_what_is_read(browser, document: Path) -> None:
    visit = Visit(browser, document, viewport={"width": 1400, "height": 700})
    visit.page.locator("#claims").scroll_into_view_if_needed()
    visit.page.evaluate("document.querySelector('#claims').scrollIntoView()")
    visit.wait_until("document.querySelector('nav a[aria-current]') !== null")
    assert visit.page.locator("nav").bounding_box()["y"] >= 0.0
    visit.page.close()
