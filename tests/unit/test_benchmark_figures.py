"""Results of the benchmarks are checked key by key: those of other packages too, and none may go unseen."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from docs.generators.measured import load
from tests.benchmarks.explained.excitation import Excitation
from tests.benchmarks.ident import ours, peers, run
from tests.benchmarks.ident.figures import BenchIdent, Bound
from tests.benchmarks.robust.figures import Coverage, Misfit, Swept
from tests.benchmarks.verdicts.figures import WrongModels
from tests.front_door.commands import CommandSeconds, names
from tests.front_door.figures import Figures, MayBeEmpty, problems
from tests.soak.figures import Soak

ROOT = Path(__file__).parents[2]

OURS = {
    "fit_squares": 99.9, "fit_multisine": 99.8, "frf_max_percent": 1.5, "frf_below_500_percent": 0.1,
    "seconds": 1.8, "peak_mb": 245.0, "innovation_ratio": 1.0, "runs": 20, "unstable_poles_right": 20,
    "closed_loop_stable": 20, "failures": 0,
}  # fmt: skip
BOUND = dict.fromkeys(("fit_squares", "fit_multisine", "frf_max_percent", "frf_below_500_percent"), 1.0)
SETS = ("squares", "multisine", "squares_noise10", "rotor4", "siso")
GOOD = {name: value for name, value in OURS.items() if name != "innovation_ratio"}
FAILED = {"runs": 20, "failures": 20, "reason": "SVD did not converge"}


def ident(**others: Any) -> dict[str, Any]:
    """Results of `make bench-ident` with methods of other packages on each data set."""
    ours = dict.fromkeys(("ours", "ours_ssarx", "ours_pbsid"), OURS)
    return {name: {**ours, "bound": BOUND, **others} for name in SETS}


# -- identification beside other packages


def test_results_with_other_packages_have_the_declared_keys() -> None:
    diverges = GOOD | {"fit_squares": None, "failures": 1, "reason": "ended by signal"}
    assert problems(BenchIdent, ident(**dict.fromkeys(peers.NAMES, GOOD))) == []
    assert problems(BenchIdent, ident(**{"ctrlsys N4SID": diverges, "nfoursid": FAILED})) == []


def test_a_method_of_no_package_is_named() -> None:
    assert problems(BenchIdent, ident(someone=GOOD))[0].startswith("squares: ")
    assert "someone" in problems(BenchIdent, ident(someone=GOOD))[0]


def test_a_peer_without_its_counts_is_named() -> None:
    wrong = ident(nfoursid={"failures": 20})
    assert problems(BenchIdent, wrong)[0] == "squares.nfoursid.runs: Field required"


def test_one_failure_of_ours_does_not_spoil_the_results() -> None:
    failed = ident(ours=OURS | {"failures": 1, "reason": "did not converge"})
    assert problems(BenchIdent, failed) == []


def test_the_smallest_size_runs_ours_only_unless_other_packages_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = tmp_path / "python"
    there.touch()
    monkeypatch.setattr(run, "PEERS_PYTHON", there)
    for words, python in (["--quick"], None), (["--quick", "--peers", str(there)], there), ([], there):
        assert run.arguments_of(words).peers == python
    assert [method.name for method in run.methods_of(None)] == list(ours.NAMES)
    assert [method.name for method in run.methods_of(there)] == [*ours.NAMES, *peers.NAMES]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--methods", "nothing"], "invalid choice: 'nothing' (choose from 'ours', 'ours_ssarx'"),
        (["--data", "nothing"], "invalid choice: 'nothing' (choose from 'squares', 'multisine'"),
        (["--methods", "nfoursid"], "nfoursid: of other packages; --peers names the interpreter that has them"),
        (["--peers", "no/python"], "--peers: no/python does not exist; make it a venv with"),
    ],
)
def test_a_method_or_data_set_that_is_not_there_is_refused_with_those_that_are(words: list[str], reason: str) -> None:
    command = [sys.executable, "-m", "tests.benchmarks.ident.run", "--quick", *words]
    refused = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert refused.returncode == 2
    assert reason in refused.stderr


# -- tables that lost their rows


class Example(Figures):
    plants: dict[str, float]
    peers: list[Bound]
    failed: MayBeEmpty[dict[str, int]]
    trips: list[str]


def test_an_empty_table_or_list_of_records_is_a_problem_unless_it_may_be_empty() -> None:
    full = {"plants": {"2x2": 1.0}, "peers": [BOUND], "failed": {}, "trips": []}
    assert problems(Example, full) == []
    assert problems(Example, full | {"plants": {}}) == ["plants: Value error, is empty"]
    assert problems(Example, full | {"peers": []}) == ["peers: Value error, is empty"]


@pytest.mark.parametrize("name", ["crest_factors", "designs", "largest", "signals"])
def test_every_table_of_the_page_on_excitations_has_rows(name: str) -> None:
    figures = load("excitation").figures
    assert problems(Excitation, figures) == []
    assert problems(Excitation, figures | {name: {}}) != []


def test_every_plant_bearing_kind_and_command_has_its_row() -> None:
    for kind, name in (Coverage, "plants"), (Swept, "bearings"), (Misfit, "kinds"):
        wrong = [text for text in problems(kind, {name: {}}) if text.startswith(name)]
        assert wrong and "lacks" in wrong[0]
    assert "refused_by_kind: Value error, is empty" in problems(WrongModels, {"refused_by_kind": {}})
    assert "lacks amb new" in problems(CommandSeconds, {})[0]
    seconds = dict.fromkeys(names(), 1.0)
    assert problems(CommandSeconds, seconds) == []
    assert "lacks amb jitter" in problems(CommandSeconds, {k: v for k, v in seconds.items() if k != "amb jitter"})[0]


def test_trips_of_a_soak_may_be_none() -> None:
    assert load("soak").figures["soak"]["trips"] == []
    assert problems(Soak, load("soak").figures) == []
