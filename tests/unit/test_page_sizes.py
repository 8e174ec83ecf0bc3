"""Reports and certificates at 400, 800 and 1280 pixels, light and dark, and as a PDF.

Needs Chromium; without it these tests are left out. Pictures are compared where browser and fonts are those of the kept
ones: see `tests/page_pictures.py`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import AmbError
from amb_core.report.pages import pdf
from tests.graph.live_page import CHROMIUM, Visit, open_browser
from tests.page_pictures import FITS, KEPT, LOOKS, MADE_WITH, Look, differing_tiles, keep, made_with, picture, visit
from tests.page_specimen import POLE, write_specimen
from tests.unit.test_recording_report import write_bag

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
in_chromium = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")


def amb(*words: object) -> str:
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False).output


@pytest.fixture(scope="module")
def pages(bearing, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A specimen, and the report and the certificate of an experiment."""
    folder = tmp_path_factory.mktemp("pages")
    record = bearing.experiment(
        2e-9, "multisine", force=0.01, amplitude=10e-6, duration=1.2, frequency_start=2.0, frequency_end=4_500.0,
        axes="all",
    )  # fmt: skip
    bag = write_bag(folder / "bag", record)
    amb("report", bag, "--order", 6, "--out", folder / "report.html")
    amb("identify", bag, "--order", 6, "--out", folder / "model.json")
    amb("certify", folder / "model.json", "--bag", bag, "--frequencies", 50, "--out", folder / "certified")
    return {
        "specimen": write_specimen(folder),
        "report": folder / "report.html",
        "certificate": folder / "certified" / "certificate.html",
    }


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with open_browser() as opened:
        yield opened


@pytest.fixture(scope="module", params=["specimen", "report", "certificate"])
def page(request, pages: dict[str, Path]) -> Path:
    return pages[request.param]


@pytest.fixture(scope="module", params=LOOKS, ids=str)
def opened(request, browser, page: Path) -> Iterator[Visit]:
    visited = visit(browser, page, request.param)
    yield visited
    visited.close()


@in_chromium
def test_a_page_is_not_wider_than_its_window_and_complains_of_nothing(opened: Visit) -> None:
    assert opened.value(FITS)
    assert opened.complaints == []


@in_chromium
def test_numbers_are_on_one_line(opened: Visit) -> None:
    lines = opened.value("[...document.querySelectorAll('.number')].map((number) => number.getClientRects().length)")
    assert lines and set(lines) == {1}


@in_chromium
def test_no_word_of_a_table_is_set_letter_by_letter(opened: Visit) -> None:
    """Each cell of a row's name is at least as wide as its longest word, unless that may break."""
    narrow = opened.value(
        """[...document.querySelectorAll('tbody th')].filter((cell) => {
            const word = cell.textContent.split(/\\s+/).reduce((a, b) => (a.length < b.length ? b : a), '');
            return word.length <= 24 && cell.clientWidth < 4 * word.length;
        }).map((cell) => cell.textContent)"""
    )
    assert narrow == []


@in_chromium
@pytest.mark.parametrize("look", LOOKS, ids=str)
def test_the_specimen_looks_as_it_was_kept(look: Look, browser, pages: dict[str, Path]) -> None:
    kept = Image.open(KEPT / f"{look}.png")
    visited = visit(browser, pages["specimen"], look)
    here = made_with(visited)
    if here != kept.info[MADE_WITH]:
        visited.close()
        pytest.skip(f"the kept picture was made with {kept.info[MADE_WITH]}; here is {here}")
    image = picture(visited)
    visited.close()
    assert differing_tiles(image, kept) == [], "if it is meant to: python -m tests.unit.test_page_sizes"


def test_another_look_is_another_picture() -> None:
    light, dark = (Image.open(KEPT / f"400_{scheme}.png") for scheme in ("light", "dark"))
    assert len(differing_tiles(light, dark)) > 100
    moved = light.copy()
    moved.paste(light.crop((0, 0, 40, 200)), (0, 16))
    assert differing_tiles(moved, light)


@in_chromium
def test_columns_of_a_figure_leave_room_for_their_labels(browser, pages: dict[str, Path]) -> None:
    for look in LOOKS[::2]:
        visited = visit(browser, pages["specimen"], look)
        covered = visited.value(
            """[...document.querySelectorAll('.plotly-graph-div')].flatMap((chart) => {
                const boxes = (selector) => [...chart.querySelectorAll(selector)].map((e) => e.getBoundingClientRect());
                const plots = boxes('.cartesianlayer .gridlayer'), titles = boxes('.infolayer [class$=ytitle]');
                return titles.filter((a) => plots.some((b) => a.width && b.width && a.left < b.right - 1 &&
                    a.right > b.left + 1 && a.top < b.bottom && a.bottom > b.top));
            }).length"""
        )
        visited.close()
        assert covered == 0, look


@in_chromium
def test_a_pdf_holds_the_whole_page_on_paper(pages: dict[str, Path]) -> None:
    folder = pages["report"].parent
    out = amb(
        "certify", folder / "model.json", "--controller", "paper", "--frequencies", 50, "--author", "A. Engineer",
        "--pdf", "--out", folder / "signed",
    )  # fmt: skip
    assert "PDF, to be signed" in out
    printed = (folder / "signed" / "certificate.pdf").read_bytes()
    assert printed.startswith(b"%PDF") and 3 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 12


def test_without_a_browser_one_line_names_what_to_install(pages, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(pdf, "BROWSERS", ("no-such-browser",))
    with pytest.raises(AmbError, match=r"PDF needs .*none is installed; install one .*apt-get install chromium"):
        amb("report", tmp_path / "bag", "--pdf", "--out", tmp_path / "new" / "report.html")
    assert not (tmp_path / "new").exists(), "refused before anything is made"


def test_a_pole_is_one_number(pages: dict[str, Path]) -> None:
    assert f'<span class="number">{POLE}</span>' in pages["specimen"].read_text()


if __name__ == "__main__":
    keep()
