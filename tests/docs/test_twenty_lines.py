"""The page of twenty lines: its code runs as written, from a CSV file to a certificate, with `amb_core` alone."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

import amb_core
from tests.docs.pages import DOCS, blocks, run_cell

PAGE = DOCS / "tutorial" / "twenty-lines.md"


def test_the_way_takes_twenty_lines_of_one_import() -> None:
    way = [block.text for block in blocks(PAGE)][-1]
    assert len([line for line in way.splitlines() if line.strip()]) <= 20
    imports = [node for node in ast.walk(ast.parse(way)) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [ast.unparse(node) for node in imports] == ["import amb_core as amb"]


def test_the_page_names_all_that_the_import_offers() -> None:
    text = PAGE.read_text()
    assert not [name for name in amb_core.__all__ if f"`{name}`" not in text]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_lines_lead_to_a_certificate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks(PAGE):
        run_cell(block.text, names)
    assert names["judged"].validated
    written = json.loads((tmp_path / "certificate" / "certificate.json").read_text())
    assert written["verdict"] == names["certificate"].verdict
    assert "not certified as a whole" in written["verdict"].lower(), "as the page says"
    assert (tmp_path / "model.json").exists()
