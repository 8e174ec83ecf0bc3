"""The how-to guides work: their commands and lines run one after another, in a checkout after `make demo`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.pages import DOCS, ROOT, Reader, blocks

ELSEWHERE = {
    "commission-a-rig": "tests/graph/test_commission.py",
    "own-controller": "tests/graph/test_identify_from_a_node.py",
}
"""Pages of which a test of the graph runs the rest."""

PAGES = [
    page
    for page in sorted((DOCS / "how-to").glob("*.md"))
    if any(not block.how.startswith("not") for block in blocks(page))
]
LEFT_OUT = ("commission-a-rig", "test-the-workbench")


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("page", [page for page in PAGES if page.stem not in LEFT_OUT], ids=lambda page: page.stem)
def test_a_reader_gets_through(page: Path, page_reader: Reader) -> None:
    page_reader.follow(page)


@pytest.mark.parametrize("page", ELSEWHERE)
def test_what_is_left_out_is_run_by_another_test(page: str) -> None:
    assert f'"{page}.md"' in (ROOT / ELSEWHERE[page]).read_text()


def test_what_is_left_out_has_a_reason() -> None:
    ways = [block.how for page in PAGES for block in blocks(page) if block.how.startswith("not")]
    assert not [way for way in ways if not way.startswith("not, ")]
