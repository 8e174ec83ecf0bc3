"""Results name the code, machine and date of each of their parts, and measured figures are taken with these."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from docs.generators import measured
from docs.generators.measured import Measured, load
from tests.benchmarks import run as bench
from tests.benchmarks.figures import PeerRoss, Skipped
from tests.benchmarks.skipped import Skipped as NotMeasured
from tests.front_door import results as module
from tests.front_door.figures import Figures, problems
from tests.front_door.results import Results, unstamped

GIT = ("git", "-c", "user.name=nobody", "-c", "user.email=nobody@example.org")


class Speed(Figures):
    """Figures of the example."""

    ns: float


class Example(Figures):
    """All of them."""

    plant: Speed
    loop: Speed


def git(folder: Path, *words: str) -> str:
    return subprocess.run([*GIT, *words], cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout with a room, a module elsewhere, and a file of figures that `take example` fills."""
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(measured, "ROOT", tmp_path)
    monkeypatch.setattr(measured, "FOLDER", tmp_path / "docs" / "measured")
    (tmp_path / ".gitignore").write_text("results\n")
    (tmp_path / "README.md").write_text("No tables.\n")
    (tmp_path / "room.py").write_text("step = 1\n")
    (tmp_path / "elsewhere.py").write_text("page = 1\n")
    (tmp_path / "docs" / "measured").mkdir(parents=True)
    old = Measured(
        command="make bench", machine="", date="2026-01-01", commit="0" * 40, exact=True, programs=["room.py"],
        rooms=["room.py"], results="example.json", declared=f"{__name__}:Example", figures={}, tables={},
    )  # fmt: skip
    (tmp_path / "docs" / "measured" / "example.json").write_text(old.model_dump_json())
    monkeypatch.setattr(measured, "declaration_problems", lambda declared, figures: problems(Example, figures))
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "Start"]):
        git(tmp_path, *words)
    return tmp_path


def commit(folder: Path, name: str, text: str) -> str:
    (folder / name).write_text(text)
    git(folder, "add", ".")
    git(folder, "commit", "-qm", "Change")
    return git(folder, "rev-parse", "HEAD")


def measure(*parts: str) -> None:
    results = Results("example.json")
    for part in parts or ("plant", "loop"):
        results.keep(part, {part: {"ns": 1.0}})


@pytest.fixture
def take(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    monkeypatch.setattr("sys.argv", ["measured", "take", "example"])
    return measured.main


# -- taking figures


def test_figures_have_the_commit_on_which_they_were_measured(folder: Path, take: Callable[[], None]) -> None:
    start = git(folder, "rev-parse", "HEAD")
    measure()
    commit(folder, "elsewhere.py", "page = 2\n")
    take()
    taken = load("example")
    assert taken.commit == start
    assert taken.figures == {"plant": {"ns": 1.0}, "loop": {"ns": 1.0}}
    assert taken.machine.endswith("cores")
    assert taken.age() == "current"


def test_figures_of_an_older_commit_whose_code_has_changed_are_refused(folder: Path, take: Callable[[], None]) -> None:
    measure("plant")
    commit(folder, "room.py", "step = 2\n")
    measure("loop")
    with pytest.raises(
        SystemExit, match=r"part plant of example\.json was measured at commit \w{7}, .*room\.py.* since"
    ):
        take()
    measure("plant")
    take()


def test_a_change_of_comments_since_is_none(folder: Path, take: Callable[[], None]) -> None:
    measure()
    commit(folder, "room.py", "step = 1  # always\n")
    take()


def test_figures_measured_on_code_that_was_not_committed_are_refused(folder: Path, take: Callable[[], None]) -> None:
    (folder / "room.py").write_text("step = 3\n")
    measure()
    git(folder, "checkout", "-q", "room.py")
    with pytest.raises(SystemExit, match=r"part plant of example\.json .* while room\.py differed from commit"):
        take()


def test_a_change_while_it_was_measured_is_refused_too(folder: Path, take: Callable[[], None]) -> None:
    results = Results("example.json")
    commit(folder, "room.py", "step = 4\n")
    for part in ("plant", "loop"):
        results.keep(part, {part: {"ns": 1.0}})
    with pytest.raises(SystemExit, match=r"while room\.py differed"):
        take()


def test_figures_of_unknown_code_are_refused(folder: Path, take: Callable[[], None]) -> None:
    with pytest.raises(SystemExit, match=r"there is no .*example\.json; run: make bench"):
        take()
    (folder / "results").mkdir()
    (folder / "results" / "example.json").write_text('{"plant": {"ns": 1.0}, "loop": {"ns": 1.0}}')
    measure("plant")
    with pytest.raises(SystemExit, match=r"example\.json does not name the code on which loop was measured"):
        take()


def test_without_a_checkout_nothing_is_taken(
    folder: Path, take: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Path("/usr/bin")
    monkeypatch.setenv("PATH", "")
    measure()
    monkeypatch.setenv("PATH", f"{path}:/bin")
    with pytest.raises(SystemExit, match=r"part plant of example\.json was measured outside of a checkout"):
        take()


# -- files of results


def figures(folder: Path) -> Any:
    return json.loads((folder / "results" / "example.json").read_text())


def test_a_part_that_is_measured_again_loses_what_it_no_longer_writes(folder: Path) -> None:
    Results("example.json").keep("plant", {"plant": {"ns": 1.0, "old": 2.0}, "gone": 1})
    Results("example.json").keep("loop", {"loop": {"ns": 1.0}})
    Results("example.json").keep("plant", {"plant": {"ns": 3.0}})
    assert figures(folder) == {"plant": {"ns": 3.0}, "loop": {"ns": 1.0}}
    assert unstamped(folder / "results" / "example.json") == []


def test_parts_may_share_a_key(folder: Path) -> None:
    Results("example.json").keep("sweep", {"swept": {"worst": 1.0}})
    Results("example.json").keep("emulator", {"swept": {"emulator": {"worst": 2.0}}})
    Results("example.json").keep("sweep", {"swept": {"worst": 3.0}})
    assert figures(folder) == {"swept": {"worst": 3.0, "emulator": {"worst": 2.0}}}


def test_a_full_run_drops_what_no_part_writes_any_longer(folder: Path) -> None:
    (folder / "results").mkdir()
    (folder / "results" / "example.json").write_text('{"plant": {"ns": 1.0}, "renamed": {"ns": 1.0}}')
    assert unstamped(folder / "results" / "example.json") == ["plant", "renamed"]
    results = Results("example.json")
    results.keep("plant", {"plant": {"ns": 2.0}})
    assert "renamed" in figures(folder)
    results.drop_others(["plant", "loop"])
    assert figures(folder) == {"plant": {"ns": 2.0}}


def test_a_part_that_cannot_be_measured_here_keeps_what_was_measured_before(folder: Path) -> None:
    Results("example.json").skip("plant", "no compiler")
    assert figures(folder) == {"plant": {"skipped": "no compiler"}}
    Results("example.json").keep("plant", {"plant": {"ns": 1.0}})
    Results("example.json").skip("plant", "no compiler")
    assert figures(folder) == {"plant": {"ns": 1.0}}


def test_a_bench_without_ross_after_one_with_it_has_the_declared_keys(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def skipped() -> dict[str, float]:
        raise NotMeasured("ROSS is not installed")

    monkeypatch.setattr("sys.argv", ["bench"])
    monkeypatch.setattr(bench, "ROOT", folder)
    monkeypatch.setattr(
        bench, "BENCHMARKS", {"peer_ross": [(lambda: {"ratio": 2.0, "ross_us": 2.0, "ours_us": 1.0}, {})]}
    )
    bench.main()
    monkeypatch.setattr(bench, "BENCHMARKS", {"peer_ross": [(skipped, {})]})
    bench.main()
    known = json.loads((folder / "results" / "bench.json").read_text())
    assert problems(PeerRoss, known["peer_ross"]) == []
    (folder / "results" / "bench.json").unlink()
    bench.main()
    assert problems(Skipped, json.loads((folder / "results" / "bench.json").read_text())["peer_ross"]) == []
