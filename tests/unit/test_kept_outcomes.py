"""A long measurement resumes after an interruption, and not with outcomes of other code."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.soak import commissioning
from tests.soak.commissioning import Outcome, Rig, rigs
from tests.soak.kept_outcomes import KeptOutcomes


def kept(folder: Path, code: str = "one") -> KeptOutcomes[int]:
    module = folder / "module.py"
    module.write_text(code)
    return KeptOutcomes(folder / "kept.jsonl", module, lambda value: {"value": value}, lambda row: int(row["value"]))


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


def test_nothing_is_kept_without_a_file(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text("")
    none: KeptOutcomes[int] = KeptOutcomes(None, tmp_path / "module.py", lambda value: {}, lambda row: 0)
    none.add(1)
    assert none.load() == []


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
