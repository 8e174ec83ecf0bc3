"""A long measurement resumes after an interruption, and not with outcomes of other code."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests import kept_outcomes
from tests.kept_outcomes import KeptOutcomes, checkout, computing_code
from tests.soak import commissioning
from tests.soak.commissioning import Outcome, Rig, rigs

GIT = ("git", "-c", "user.name=nobody", "-c", "user.email=nobody@example.org")


def kept(folder: Path, code: str = "one") -> KeptOutcomes[int]:
    return KeptOutcomes(folder / "kept.jsonl", code, lambda value: {"value": value}, lambda row: int(row["value"]))


def test_what_was_kept_is_there_again(tmp_path: Path) -> None:
    for value in (3, 1, 4):
        kept(tmp_path).add(value)
    assert kept(tmp_path).load() == [3, 1, 4]


def test_a_line_that_was_cut_costs_itself_only(tmp_path: Path) -> None:
    kept(tmp_path).add(3)
    with (tmp_path / "kept.jsonl").open("a") as file:
        file.write('{"code": "0')
    kept(tmp_path).add(4)
    assert kept(tmp_path).load() == [3, 4]


def test_outcomes_of_other_code_do_not_count(tmp_path: Path) -> None:
    kept(tmp_path).add(3)
    assert kept(tmp_path, "two").load() == []


def test_what_is_forgotten_is_that_of_this_code_only(tmp_path: Path) -> None:
    kept(tmp_path).add(3)
    kept(tmp_path, "two").add(4)
    kept(tmp_path).forget()
    assert kept(tmp_path).load() == []
    assert kept(tmp_path, "two").load() == [4]


def test_nothing_is_kept_without_a_file() -> None:
    none: KeptOutcomes[int] = KeptOutcomes(None, "one", lambda value: {}, lambda row: 0)
    none.add(1)
    none.forget()
    assert none.load() == []


def test_the_code_of_a_measurement_includes_its_module(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text("1")
    (tmp_path / "two.py").write_text("2")
    one, two = computing_code(tmp_path / "one.py"), computing_code(tmp_path / "two.py")
    assert one != two
    assert one == computing_code(tmp_path / "one.py")


def test_a_checkout_is_its_commit_and_what_was_changed_since(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_outcomes, "ROOT", tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert checkout() == ""
    (tmp_path / "room").write_text("code")
    for words in (["init", "-q"], ["add", "room"], ["commit", "-qm", "Start"]):
        subprocess.run([*GIT, *words], cwd=tmp_path, check=True)
    committed = checkout()
    assert re.fullmatch("[0-9a-f]{12}", committed)
    (tmp_path / "room").write_text("other code")
    assert checkout().startswith(f"{committed}+")


def test_commissioning_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Here:
        """A pool of this process."""

        def __init__(self, jobs: int) -> None:
            pass

        def __enter__(self) -> Here:
            return self

        def __exit__(self, *problem: object) -> None:
            pass

        map = staticmethod(map)

    done: list[Rig] = []

    def commission(rig: Rig) -> Outcome:
        done.append(rig)
        return Outcome(rig, ("x",), ("said",) if rig.kind else (), True, 0)

    monkeypatch.setattr(commissioning, "ProcessPoolExecutor", Here)
    monkeypatch.setattr(commissioning, "commission", commission)
    for count in (5, 10, 12, 12):
        figures = commissioning.commissioning(4, 2, 4, file=tmp_path / "rigs.jsonl", most=5)["commissioning"]
        assert (figures["rigs"], figures["right"], figures["accused"], figures["silent"]) == (count, count, 0, 0)
    assert sorted(done, key=str) == sorted(rigs(4, 2, 4), key=str)
