"""Hostile names on pages do nothing in Chromium, and a page that does something is seen."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.fuzz.pages import PAYLOADS, does_something, write_pages
from tests.graph.live_page import CHROMIUM, open_browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with open_browser() as opened:
        yield opened


@pytest.mark.parametrize(
    "content", ["<script>globalThis.executed=1</script>", "<script>alert(1)</script>", "<img src=other.png>"]
)
def test_a_page_that_does_something_is_seen(browser: Any, tmp_path: Path, content: str) -> None:
    page = tmp_path / "page.html"
    page.write_text(content)
    assert does_something(browser, page)


def test_a_script_in_every_name_is_text(browser: Any, tmp_path: Path) -> None:
    assert not any(does_something(browser, page) for page in write_pages(PAYLOADS[1], tmp_path))
