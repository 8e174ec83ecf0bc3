"""The tutorial, from an empty folder to a certificate: its commands as written, and what it states that they show."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.pages import blocks, reader
from tests.docs.tutorial import PAGE, PICTURES, STATEMENTS, follow, numbers_in, text_of

MOST_COMMANDS = 12


@pytest.mark.slow
@pytest.mark.timeout(1800)  # ten minutes on two cores that do nothing else
def test_a_reader_arrives_at_a_certificate_and_sees_what_the_page_states(
    tmp_path: Path, domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with reader(tmp_path, domain) as somebody:
        walk = follow(somebody)
    assert (tmp_path / "results" / "model" / "model.json").exists()
    assert (tmp_path / "results" / "certificate" / "certificate.html").exists()
    assert not walk.missed
    assert walk.commands <= MOST_COMMANDS


def test_nothing_of_the_tutorial_is_left_out() -> None:
    assert {block.language for block in blocks(PAGE)} == {"bash", "output", "python"}
    assert {block.how for block in blocks(PAGE) if block.how} <= {"code ends 4"}


def test_every_number_of_the_prose_is_compared() -> None:
    """What a reader chooses stands in the commands; every other number with a unit is a statement."""
    text = text_of()
    words = " ".join(text.split())
    assert not [statement.text for statement in STATEMENTS if words.count(statement.text) != 1]
    assert not [picture for picture in PICTURES if picture not in text]
    compared = [statement.text for statement in STATEMENTS]
    chosen = ("An air gap of 0.5 mm", "How large may a multisine up to 500 Hz be")
    others = [one for one in numbers_in(text) if not one.startswith(chosen)]
    assert not [one for one in others if not any(text in one or one in text for text in compared)]
