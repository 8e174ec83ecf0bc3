"""`make stress` resumes after an interruption, on the same commit only."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests import stress
from tests.stress import Run, Stress

Call = Callable[..., tuple[Counter[str], dict[str, Any]]]


class Checkout:
    """The commit, which a test changes, and what the runs come to."""

    commit = "one"
    failed: tuple[str, ...] = ()


@pytest.fixture
def checkout(monkeypatch: pytest.MonkeyPatch) -> type[Checkout]:
    class Here(Checkout):
        pass

    monkeypatch.setattr(stress, "checkout", lambda: Here.commit)
    return Here


@pytest.fixture
def call(checkout: type[Checkout], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Calls the program; the runs that it made, by kind, and its results."""
    done: list[str] = []

    def run_once(kind: str, name: str, selection: list[str], folder: Path) -> Run:
        done.append(kind)
        return Run(kind=kind, passed=7, failed=list(checkout.failed), skipped=0, seconds=1.0)

    def called(*arguments: str) -> tuple[Counter[str], dict[str, Any]]:
        done.clear()
        monkeypatch.setattr(sys, "argv", ["stress", *arguments])
        code = stress.main()
        results = json.loads((tmp_path / "stress.json").read_text())
        assert code == (1 if results["failures"] else 0)
        return Counter(done), results

    monkeypatch.setattr(stress, "ROOT", tmp_path)
    monkeypatch.setattr(stress, "results_file", lambda name, quick=False: tmp_path / name)
    monkeypatch.setattr(stress, "run_once", run_once)
    return called


def test_a_call_runs_what_is_left(call: Call) -> None:
    assert call("--idle", "2")[0] == {"idle": 2}
    done, results = call("--idle", "3", "--loaded", "1")
    assert done == {"idle": 1, "loaded": 1}
    assert [run["kind"] for run in results["runs"]] == ["idle", "idle", "idle", "loaded"]
    assert results["commit"] == "one"
    Stress.model_validate(results)


def test_failures_of_runs_before_count(call: Call, checkout: type[Checkout]) -> None:
    checkout.failed = ("test_x",)
    call("--idle", "1")
    checkout.failed = ()
    assert call("--idle", "2")[1]["failures"] == 1


@pytest.mark.parametrize("arguments", [["--anew"], ["tests/graph"]])
def test_all_begins_again_when_asked_and_for_other_tests(call: Call, arguments: list[str]) -> None:
    call("--idle", "2")
    done, results = call("--idle", "2", *arguments)
    assert done == {"idle": 2}
    assert len(results["runs"]) == 2


def test_runs_of_another_commit_do_not_count(call: Call, checkout: type[Checkout]) -> None:
    call("--idle", "2")
    checkout.commit = "two"
    done, results = call("--idle", "2")
    assert done == {"idle": 2}
    assert (results["commit"], len(results["runs"])) == ("two", 2)


def test_it_ends_when_the_checkout_changes_between_two_runs(
    call: Call, checkout: type[Checkout], monkeypatch: pytest.MonkeyPatch
) -> None:
    def show(run: Run) -> None:
        checkout.commit = "two"

    monkeypatch.setattr(stress, "show", show)
    with pytest.raises(SystemExit, match="no longer at one; 1 of 2 runs are in"):
        call("--idle", "2")
