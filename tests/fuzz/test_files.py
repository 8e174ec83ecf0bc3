"""The short form of `make fuzz-files`: a fixed set of mutants, and the crafted files that take little time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.fuzz.files import campaign, write_results

MUTANTS = 120
QUICK = (
    "external.mat",
    "virtual.mat",
    "links.mat",
    "pipe.mat",
    "bomb.npz",
    "numbers_as_files",
    "view.db3",
    "generated.db3",
    "deep.json",
)


@pytest.mark.timeout(600)
def test_no_file_ends_a_command_or_reads_elsewhere() -> None:
    tally = campaign(MUTANTS, 1, list(QUICK), print)
    assert not tally.blamed
    assert (tally.mutants, tally.crafted) == (MUTANTS, len(QUICK))


def test_the_results_keep_what_others_wrote(tmp_path: Path) -> None:
    path = tmp_path / "security.json"
    path.write_text(json.dumps({"peers": {"attacks": 3}, "mutants": 1}))
    write_results({"mutants": 5, "escaped": 0}, path)
    assert json.loads(path.read_text()) == {"peers": {"attacks": 3}, "mutants": 5, "escaped": 0}
