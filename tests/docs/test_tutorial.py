"""The tutorial, from an empty folder to a validated model: its commands as written, and what it says that they show."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.pages import DOCS, blocks, reader

PAGE = DOCS / "tutorial" / "my-bearing.md"


@pytest.mark.slow
@pytest.mark.timeout(1800)  # ten minutes on two cores that do nothing else
def test_a_reader_arrives_at_a_validated_model(tmp_path: Path, domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with reader(tmp_path, domain) as somebody:
        somebody.follow(PAGE)
    assert (tmp_path / "results" / "model" / "model.json").exists()


def test_nothing_of_the_tutorial_is_left_out() -> None:
    assert {block.language for block in blocks(PAGE)} == {"bash", "output", "python"}
    assert not [block.how for block in blocks(PAGE) if block.how]
