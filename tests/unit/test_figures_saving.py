"""What is written: small files, alt texts, and pages that need nothing from anywhere else."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from amb_core.ground.errors import AmbError
from amb_core.loop.records import LoopRecord
from amb_core.report.figures import page_fragment, response_chart
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel, Table
from amb_core.report.figures.style import BLUE, REGIONS, Stroke

TITLE = "Response <of> the rotor"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Figure and page of a minute of telemetry."""
    folder = tmp_path_factory.mktemp("figures") / "new"
    noise = np.random.default_rng(1).normal(scale=1e-5, size=(600_000, 2))
    record = LoopRecord(0, 1e-4, np.zeros_like(noise), noise, np.zeros_like(noise))
    response_chart(record, title=TITLE).save(folder, "response")
    return folder


def test_files_stay_small_whatever_the_length_of_the_record(folder: Path) -> None:
    assert (folder / "response.html").stat().st_size < 300_000
    assert (folder / "response.png").stat().st_size < 300_000


def test_the_script_is_beside_the_pages_once(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == ["plotly.min.js", "response.html", "response.png"]
    script = folder / "plotly.min.js"
    before = script.stat().st_mtime_ns
    EMPTY.save(folder, "empty")
    assert script.stat().st_mtime_ns == before
    (folder / "empty.html").unlink()
    (folder / "empty.png").unlink()


def test_a_page_asks_nothing_from_the_network(folder: Path) -> None:
    text = (folder / "response.html").read_text()
    assert "http:" not in text and "https:" not in text
    assert re.findall(r'(?:src|href)="([^"]*)"', text) == ["plotly.min.js"]


def test_title_and_alt_text_are_in_page_and_picture(folder: Path) -> None:
    alt = "Reference and position of the rotor on x and y from 0.00 s to 60.00 s."
    text = (folder / "response.html").read_text()
    assert f'role="img" aria-label="{alt}"' in text
    assert "<h1>Response &lt;of&gt; the rotor</h1>" in text
    assert '<html lang="en">' in text and 'name="viewport"' in text
    picture = (folder / "response.png").read_bytes()
    assert b"Title\x00Response <of> the rotor" in picture
    assert b"Description\x00" + alt.encode() in picture


EMPTY = Chart(
    "T",
    'alt "quoted"',
    (Panel(Axis("x"), Axis("y"), (Curve(np.zeros(2), np.zeros(2), "a", Stroke(BLUE)),)),),
    table=Table(("a < b", "c"), (("1", "<2>"),)),
)


def test_the_numbers_of_a_chart_are_a_table() -> None:
    fragment = page_fragment(EMPTY.page())
    assert '<th scope="col">a &lt; b</th>' in fragment
    assert "<td>1</td><td>&lt;2&gt;</td>" in fragment
    assert 'aria-label="alt &#34;quoted&#34;"' in fragment


def test_what_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(AmbError, match=r"figure a in .*file: cannot be written"):
        EMPTY.save(tmp_path / "file", "a")


def test_regions_differ_by_more_than_colour() -> None:
    looks = list(REGIONS.values())
    for trait in ("colour", "hatch", "marker"):
        assert len({getattr(look, trait) for look in looks}) == len(looks)
    assert len({(look.dash, look.hatch) for look in looks}) == len(looks)


def test_lines_stand_out_from_light_and_dark_pages() -> None:
    def luminance(colour: str) -> float:
        channels = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
        return float(np.dot((0.2126, 0.7152, 0.0722), channels))

    for look in REGIONS.values():
        assert (1.0 + 0.05) / (luminance(look.colour) + 0.05) > 2.0
        assert (luminance(look.colour) + 0.05) / (luminance("#16181c") + 0.05) > 3.0
