"""A report is one file: it needs no network, escapes what it is told, and reads without its figures."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.errors import AmbError
from amb_core.loop.records import LoopRecord
from amb_core.report.figures import response_chart
from amb_core.report.pages import (
    Badge,
    FigureBlock,
    Listing,
    Picture,
    Prose,
    Report,
    Section,
    TableBlock,
    Verdict,
    write_report,
)


class Page(HTMLParser):
    """Tags with attributes, and the text outside of scripts and styles."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._silent = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._silent = tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        self._silent = False

    def handle_data(self, data: str) -> None:
        if not self._silent:
            self.text += data

    def attributes(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture
def chart() -> FigureBlock:
    steps = np.arange(200.0)[:, np.newaxis] * np.ones(2)
    return FigureBlock(
        response_chart(LoopRecord(0, 1e-4, 0.0 * steps, 1e-6 * np.sin(steps), 0.0 * steps), None).page(), "Response"
    )


@pytest.fixture
def report(chart: FigureBlock, tmp_path: Path) -> Report:
    image = tmp_path / "image.png"
    response_chart(
        LoopRecord(0, 1e-4, np.zeros((50, 2)), np.outer(np.arange(50.0), [1e-6, 1e-6]), np.zeros((50, 2))), None
    ).figure().savefig(image)
    evidence = Section(
        "Fig. 2: a sweep",
        [Prose("Below <100> Hz & more."), chart, Verdict("a < b", "a = b", "does not agree", "iron & more")],
    )
    numbers = Section(
        "Numbers", [TableBlock(("what", "value"), [("k_i", "66 N/A")], "Constants"), Listing("a  b", "Text")]
    )
    return Report("A bearing", "Shaken <fast>.", [Picture(image, "Two curves")], [evidence, numbers], "Made of a bag.")


@pytest.fixture
def page(report: Report, tmp_path: Path) -> Page:
    write_report(report, tmp_path / "new" / "index.html")
    return Page(tmp_path / "new" / "index.html")


def test_nothing_is_loaded_from_elsewhere(page: Page) -> None:
    for attributes in (attributes for _, attributes in page.tags):
        for name in ("src", "href"):
            assert (attributes.get(name) or "#").startswith(("#", "data:"))
    policy = next(tag["content"] for tag in page.attributes("meta") if tag.get("http-equiv"))
    assert policy is not None and "default-src 'none'" in policy and "http" not in policy


def test_texts_are_shown_as_they_are(page: Page) -> None:
    for text in ("Shaken <fast>.", "Below <100> Hz & more.", "a < b", "iron & more", "k_i", "66 N/A", "Made of a bag."):
        assert text in page.text


def test_structure_is_there_for_screen_readers_and_keyboards(page: Page) -> None:
    assert [tag for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)] == ["h1", "h2", "h3", "h2"]
    assert page.attributes("html")[0]["lang"] == "en"
    assert [image["alt"] for image in page.attributes("img")] == ["Two curves"]
    assert any(tag.get("role") == "img" and "Reference" in (tag["aria-label"] or "") for tag in page.attributes("div"))
    ids = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    targets = [(link["href"] or "")[1:] for link in page.attributes("a")]
    assert targets == ["content", "fig-2-a-sweep", "numbers"]
    assert set(targets) <= ids


def test_headings_that_do_not_differ_are_refused(tmp_path: Path) -> None:
    sections = [Section("Fig. 2", []), Section("Fig 2!", [])]
    with pytest.raises(AmbError, match="headings must differ"):
        write_report(Report("Two", "", [], sections), tmp_path / "index.html")


def test_a_badge_that_links_to_no_section_is_refused(tmp_path: Path) -> None:
    table = TableBlock(("what", "found"), [("fit", Badge("99 %", "good", "Validation"))], "Numbers")
    with pytest.raises(AmbError, match="badge '99 %' links to no section 'Validation'"):
        write_report(Report("A page", "", [], [Section("One", [table])]), tmp_path / "index.html")


def test_missing_image_and_unwritable_file_are_told(tmp_path: Path) -> None:
    with pytest.raises(AmbError, match=r"none\.png: cannot be read"):
        write_report(Report("A", "", [Picture(tmp_path / "none.png", "")], []), tmp_path / "index.html")
    (tmp_path / "file").write_text("")
    with pytest.raises(AmbError, match="cannot be written"):
        write_report(Report("A", "", [], []), tmp_path / "file" / "index.html")


def test_a_page_written_anew_removes_the_pdf_of_the_page_before_and_no_other(tmp_path: Path) -> None:
    page, printed = tmp_path / "report.html", tmp_path / "report.pdf"
    printed.write_bytes(b"of another program")
    write_report(Report("A", "", [], []), page)
    assert printed.exists()
    write_report(Report("B", "", [], []), page)
    assert not printed.exists()


def test_names_of_files_that_are_not_utf_8_stand_in_a_page_as_escapes(tmp_path: Path) -> None:
    write_report(Report("Bag b\udcffg", "", [], []), tmp_path / "page.html")
    assert r"Bag b\udcffg" in (tmp_path / "page.html").read_text(encoding="utf-8")
