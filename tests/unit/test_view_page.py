"""The live page's own code, in a browser without a server: what it shows of region states and maps.

Needs Chromium, as Debian packages it; without it these tests are left out.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import amb_bringup.view

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")

FOLDER = Path(amb_bringup.view.__file__).parent / "page"
ORIGIN = "http://page.test"
AXIS: dict[str, Any] = {
    "name": "x", "region": "A", "bias": 0.0, "trend": 0.0, "oscillation": [0.0, 0.0], "input": [1e-6, 100.0],
    "response": 0.0, "even": None, "steady": [0.0, 0.0], "frozen": False, "not_judged": "",
}  # fmt: skip


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    def answer(route: Any) -> None:
        name = route.request.url.rpartition("/")[2]
        if name.endswith(".js"):
            route.fulfill(body=(FOLDER / name).read_text(), content_type="text/javascript")
        else:
            route.fulfill(body="<p></p><ul></ul><canvas></canvas>", content_type="text/html")

    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        opened = chromium.new_page()
        opened.route(f"{ORIGIN}/**", answer)
        opened.goto(f"{ORIGIN}/")
        yield opened
        chromium.close()


def lamps(page: Any, axes: list[dict[str, Any]]) -> Any:
    """Region of each lamp, and the text of its axis."""
    return page.evaluate(
        """async (region) => {
            const list = document.querySelector("ul");
            (await import("./regions.js")).showRegions(list, region);
            return [...list.querySelectorAll("li")].map((item) => [item.children[0].dataset.region, item.textContent]);
        }""",
        {"axes": axes, "settled": True},
    )


def test_the_lamp_of_a_sensor_that_stands_still_shows_no_region(page: Any) -> None:
    shown = lamps(page, [AXIS | {"frozen": True}, AXIS | {"name": "y"}])
    assert shown[0] == ["none", "–x sensor stands still"]
    assert shown[1][0] == "A" and shown[1][1].startswith("Ay steady bias")


def test_a_lamp_says_region_a_only_where_the_other_regions_were_looked_for(page: Any) -> None:
    shown = lamps(page, [AXIS | {"not_judged": "BD"}, AXIS | {"name": "y", "region": "C", "not_judged": "B"}])
    assert shown[0][0] == "none" and shown[0][1].startswith("–x none found, B and D not judged")
    assert shown[1][0] == "C" and shown[1][1].startswith("Cy slow oscillation")


@pytest.mark.parametrize(
    ("sections", "reason"),
    [
        ({"plant": {"what": "simulator", "mode": "paused", "run": 7}}, ""),
        ({"plant": {"what": "simulator", "mode": "paused", "run": 8}}, "new run"),
        ({"plant": {"what": "rig", "mode": "off", "run": 7}}, "off"),
        ({"plant": {"what": "simulator", "mode": "paused", "run": 8}, "away": ["plant"]}, "simulator away"),
        ({}, ""),
    ],
)
def test_lamps_are_put_out_when_their_regions_hold_no_longer(page: Any, sections: dict[str, Any], reason: str) -> None:
    shown = page.evaluate(
        "async (sections) => (await import('./regions.js')).outdatedBecause(sections)",
        {"region": {"run": 7}} | sections,
    )
    assert shown == reason


def boundary(page: Any, amplitude: list[float], frequencies: list[float | None]) -> Any:
    region_map = {"amplitude": amplitude, "boundaries": {"C": frequencies}}
    return page.evaluate("async (map) => (await import('./map.js')).boundaryOf(map, 'C')", region_map)


def test_sweeps_without_a_region_are_not_in_its_area_on_the_map(page: Any) -> None:
    runs = boundary(page, [1.0, 4.0, 16.0, 64.0, 256.0], [10.0, None, None, None, 20.0])
    assert [[amplitude for _, amplitude in run] for run in runs] == [[1.0, 1.0, 2.0], [128.0, 256.0, 256.0]]
    assert [{frequency for frequency, _ in run} for run in runs] == [{10.0}, {20.0}]


def test_a_region_of_one_sweep_reaches_half_way_to_its_neighbours_on_the_map(page: Any) -> None:
    assert boundary(page, [1.0, 4.0, 16.0], [None, 10.0, None]) == [[[10, 2], [10, 4], [10, 8]]]
