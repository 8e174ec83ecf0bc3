"""Data files of others: each is identified with the poles of its loop, or refused with the option that helps."""

from __future__ import annotations

import pytest

from tests.benchmarks.first_hour.files import CASES, FOLDER, TOLERANCE, Case, attempt, pole_error


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_file_is_identified_or_refused_with_the_option_that_helps(case: Case) -> None:
    outcome = attempt(case)
    assert not outcome.traceback
    if case.helps:
        assert case.helps in outcome.refusal
        assert "\n" not in outcome.refusal
    else:
        assert outcome.model is not None, outcome.refusal
        assert pole_error(outcome.model) < TOLERANCE
        assert "role" in outcome.shown  # the preview


def test_the_files_are_small() -> None:
    files = [path for path in FOLDER.rglob("*") if path.is_file()]
    assert max(path.stat().st_size for path in files) < 55_000
    assert sum(path.stat().st_size for path in files) < 1_000_000
    assert len({case.file for case in CASES}) >= 20
