"""The notebooks and the gallery of the documentation run from top to bottom, with the library alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.docs.pages import DOCS, blocks, run_cell

PAGES = [*sorted((DOCS / "tutorial" / "notebooks").glob("*.md")), DOCS / "gallery.md"]


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_cells_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    cells = [block for block in blocks(page) if block.language == "{code-cell} python"]
    assert len(cells) >= 4
    for cell in cells:
        run_cell(cell.text, names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_cells_need_no_ros(page: Path) -> None:
    text = "".join(block.text for block in blocks(page))
    assert not {name for name in ("rclpy", "amb_msgs", "amb_ros", "amb_bringup") if name in text}
