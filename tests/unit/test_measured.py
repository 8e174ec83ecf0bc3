"""Measured figures of the documentation come from docs/measured, and say when they are older than their code."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.generators import measured
from docs.generators.measured import MARK, Measured, declaration_problems, load, names, pages, with_measured_tables
from docs.generators.site import completed
from tests.front_door.entries import PROGRAMS, TARGETS
from tests.front_door.imports import closure

ROOT = Path(__file__).parents[2]
GIT = ("git", "-c", "user.name=nobody", "-c", "user.email=nobody@example.org")


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_measured_tables_are_those_of_the_files(page: Path) -> None:
    text = page.read_text()
    assert text == with_measured_tables(text), "out of date; run: python -m docs.generators.measured write"


def test_every_measured_table_is_shown_once() -> None:
    shown = [(match[2], match[3]) for page in pages() for match in MARK.finditer(page.read_text())]
    assert sorted(shown) == sorted((name, table) for name in names() for table in load(name).tables)


@pytest.mark.parametrize("name", names())
def test_a_file_names_rooms_that_exist_and_figures_that_are_declared(name: str) -> None:
    measured = load(name)
    assert measured.programs and measured.rooms
    assert not [
        place for place in (*measured.programs, *measured.rooms, *measured.apart) if not (ROOT / place).exists()
    ]
    assert measured.results in {"", *(program.results for program in PROGRAMS)}
    assert re.fullmatch("[0-9a-f]{40}", measured.commit)
    if measured.declared:
        assert declaration_problems(measured.declared, measured.figures, partial=not measured.exact) == []


@pytest.mark.parametrize("name", names())
def test_what_the_programs_of_a_file_import_is_in_its_rooms_or_cannot_move_its_figures(name: str) -> None:
    measured = load(name)
    imported = closure(measured.programs, measured.is_moved_by)
    unseen = [file for file in imported if measured.is_moved_by(file) is None and not is_empty(file)]
    assert sorted(unseen) == [], "name them as rooms, or apart with a reason"


@pytest.mark.parametrize("name", names())
def test_what_is_apart_is_imported_and_has_a_reason(name: str) -> None:
    measured = load(name)
    imported = closure(measured.programs, measured.is_moved_by)
    for place, reason in measured.apart.items():
        assert reason
        assert any(file == place or file.startswith(f"{place}/") for file in imported), place


@pytest.mark.parametrize("name", names())
def test_the_programs_of_a_file_are_those_of_its_command(name: str) -> None:
    measured = load(name)
    for program in commanded(measured.command):
        folder = program.rpartition("/")[0]
        assert program in measured.programs or any(file.startswith(folder) for file in measured.programs), program


def is_empty(file: str) -> bool:
    """Whether a module has no more than a docstring."""
    return file.endswith("__init__.py") and len(ast.parse((ROOT / file).read_text()).body) <= 1


def commanded(command: str) -> Iterator[str]:
    """Files of the programs that a command starts."""
    for target in re.findall(r"make ([\w-]+)", command):
        yield from (f"{module.replace('.', '/')}.py" for module in TARGETS[target])
    for module in re.findall(r"python -m ([\w.]+)", command):
        yield f"{module.replace('.', '/')}.py"
    for words in re.findall(r"amb (\w+)", command):
        yield f"src/amb_bringup/amb_bringup/commands/{words}.py"


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Measured:
    """A checkout with one room, and figures that were measured on its only commit."""
    (tmp_path / "room").write_text("code")
    (tmp_path / "README.md").write_text("No tables.\n")
    for words in (["init", "-q"], ["add", "room"], ["commit", "-qm", "Start"]):
        subprocess.run([*GIT, *words], cwd=tmp_path, check=True)
    head = subprocess.run([*GIT, "rev-parse", "HEAD"], cwd=tmp_path, check=True, capture_output=True, text=True)
    tables = {"t": {"columns": ["what", ""], "rows": [["a", "{share!p:.0f} %"]]}}
    figures = Measured(
        command="make bench", machine="", date="2026-01-01", commit=head.stdout.strip(), exact=True,
        programs=["room"], rooms=["room"], results="", figures={"share": 0.25}, tables=tables,
    )  # fmt: skip
    folder = tmp_path / "docs" / "measured"
    folder.mkdir(parents=True)
    (folder / "example.json").write_text(figures.model_dump_json())
    monkeypatch.setattr(measured, "ROOT", tmp_path)
    monkeypatch.setattr(measured, "FOLDER", folder)
    return figures


def test_figures_are_stale_when_a_room_changes(checkout: Measured) -> None:
    assert checkout.age() == "current"
    (measured.ROOT / "elsewhere").write_text("code")
    assert checkout.age() == "current"
    (measured.ROOT / "room").write_text("other code")
    assert checkout.age() == "stale"


def test_comments_and_docstrings_make_nothing_stale(checkout: Measured) -> None:
    file = measured.ROOT / "room.py"
    file.write_text('"""A room."""\n\n\ndef one() -> int:\n    """One."""\n    return 1\n')
    subprocess.run([*GIT, "add", "room.py"], cwd=measured.ROOT, check=True)
    subprocess.run([*GIT, "commit", "-qm", "Module"], cwd=measured.ROOT, check=True)
    of_module = checkout.model_copy(update={"rooms": ["room.py"], "commit": "HEAD"})
    file.write_text('"""The room."""\n\n\ndef one() -> int:\n    return 1  # always\n')
    assert of_module.age() == "current"
    file.write_text('"""The room."""\n\n\ndef one() -> int:\n    return 2\n')
    assert of_module.age() == "stale"
    file.unlink()
    assert of_module.age() == "stale"


def test_pages_and_what_is_apart_make_nothing_stale(checkout: Measured) -> None:
    for name in ("read.md", "code.py", "printed.py"):
        (measured.ROOT / "folder").mkdir(exist_ok=True)
        (measured.ROOT / "folder" / name).write_text("")
    subprocess.run([*GIT, "add", "folder"], cwd=measured.ROOT, check=True)
    subprocess.run([*GIT, "commit", "-qm", "Folder"], cwd=measured.ROOT, check=True)
    apart = {"folder/printed.py": "prints"}
    of_folder = checkout.model_copy(update={"rooms": ["folder"], "apart": apart, "commit": "HEAD"})
    (measured.ROOT / "folder" / "read.md").write_text("# A page")
    (measured.ROOT / "folder" / "printed.py").write_text("print(1)")
    assert of_folder.age() == "current"
    (measured.ROOT / "folder" / "code.py").write_text("x = 1")
    assert of_folder.age() == "stale"


def test_a_room_within_what_is_apart_counts(checkout: Measured) -> None:
    within = checkout.model_copy(update={"rooms": ["room", "a/b/c.py"], "apart": {"a": "prints"}})
    assert within.is_moved_by("a/b/c.py") is True
    assert within.is_moved_by("a/b/d.py") is False
    assert within.is_moved_by("ab") is None


def test_what_is_not_measured_is_a_dash(checkout: Measured) -> None:
    assert "| a | - % |" in checkout.model_copy(update={"figures": {"share": None}}).rendered("t")


def test_their_age_is_unknown_without_their_commit_or_git(checkout: Measured, monkeypatch: pytest.MonkeyPatch) -> None:
    assert checkout.model_copy(update={"exact": False}).age() == "unknown"
    assert checkout.model_copy(update={"commit": "0" * 40}).age() == "unknown"
    monkeypatch.setenv("PATH", "")
    assert checkout.age() == "unknown"


def test_figures_whose_part_was_measured_again_on_later_code_say_so(
    checkout: Measured, monkeypatch: pytest.MonkeyPatch
) -> None:
    (measured.ROOT / "room").write_text("other code")
    monkeypatch.setattr("sys.argv", ["measured", "confirm", "example", "--part", "2 of 10, bit for bit"])
    with pytest.raises(SystemExit, match="not committed"):
        measured.main()
    subprocess.run([*GIT, "commit", "-qam", "Change"], cwd=measured.ROOT, check=True)
    measured.main()
    confirmed = load("example")
    assert confirmed.age() == "current"
    assert confirmed.commit == checkout.commit
    assert re.search(r"Measured again on .* at commit [0-9a-f]{7}: 2 of 10, bit for bit\.$", confirmed.origin)
    (measured.ROOT / "room").write_text("still other code")
    assert confirmed.age() == "stale"


def test_make_measured_lists_what_is_stale(
    checkout: Measured, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["measured"])
    (measured.ROOT / "room").write_text("other code")
    measured.main()
    assert re.match(
        r"stale +example +Measured on 2026-01-01 at commit [0-9a-f]{7} by `make bench`", capsys.readouterr().out
    )


def test_the_page_of_the_site_says_so(checkout: Measured) -> None:
    page = measured.ROOT / "docs" / "page.md"
    text = "<!-- measured: example t -->\n<!-- end -->\n"
    assert "| a | 25 % |" in completed(text, page)
    assert "has not changed since" in completed(text, page)
    (measured.ROOT / "room").write_text("other code")
    assert "**The code on which they depend has changed since.**" in completed(text, page)


def test_figures_that_cells_hold_are_not_taken_and_one_line_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.argv", ["measured", "take", "validation"])
    with pytest.raises(SystemExit, match="validation: the cells of its tables hold the figures"):
        measured.main()


def test_every_drawn_bearing_has_two_certificates_or_none() -> None:
    table = load("misfit").tables["kinds"]
    for row in table.rows:
        count = dict(zip(table.columns, row, strict=True))
        stated = ("certified, also with reservations", "predicted", "restricted to a band", "refused")
        with_two = int(count["drawn"]) - int(count["without certificates"])
        assert sum(int(count[name]) for name in stated) == 2 * with_two, row[0]


# -- tables that are typed

FIGURES = re.compile(r"\d ?(?:%|ns|us|ms|s|min|h|kB|MB|GB)(?![\w/])|\d of \d")
"""Of a table that may be measured: shares, times and sizes, and counts of cases."""
STATED = {
    ("amb_controller_node/README.md", "topic"): "how often it is published",
    ("amb_ident_node/README.md", "topic"): "how often it is published",
    ("amb_sim_node/README.md", "topic"): "how often it is published",
    ("amb_sim_node/README.md", "name"): "declared defaults",
    ("src/amb_ros/README.md", "module"): "times that the code sets",
    ("docs/explanation/distortion.md", "shown by"): "a level of confidence",
    ("docs/explanation/excitation.md", "limit"): "declared defaults",
    ("docs/explanation/regions.md", "line"): "computed by the formulas beside them",
    ("docs/explanation/robustness.md", "number"): "a level of confidence",
    ("docs/explanation/validation.md", "condition"): "limits of the verdict",
    ("docs/explanation/validation.md", "part"): "levels of confidence",
    ("docs/how-to/certify-a-loop.md", "a check failed"): "a level of confidence",
    ("docs/how-to/certify-a-loop.md", "part of `certificate.json`"): "the definition of a band",
    ("docs/how-to/measure-distortion.md", "place"): "an example of output, and limits",
    ("docs/how-to/troubleshoot.md", "symptom"): "times and sizes that the code sets",
    ("docs/how-to/watch-live.md", "part"): "times that the page shows",
    (
        "docs/reference/excitations.md",
        "kind",
    ): "sizes follow from 8 bytes a sample; the line below names the commit of the rest",
    ("docs/reference/identification-data.md", "check"): "limits of the checks",
    ("docs/reference/rigs.md", "check"): "limits of the checks",
    ("docs/reference/rigs.md", "event"): "times that the protocol sets",
    ("docs/reference/target-protocol.md", "parameter"): "times that the protocol sets",
}
"""Tables with such numbers that no program measures, by page and first column, with the reason."""


def typed_tables() -> Iterator[tuple[str, str]]:
    """Page and head of each table with figures that does not come from `docs/measured`."""
    patterns = ("*.md", "target/*.md", "*/README.md", "src/*/README.md", "docs/**/*.md")
    for page in [page for pattern in patterns for page in ROOT.glob(pattern)]:
        if "docs/repository/" in str(page) or "docs/reference/api/" in str(page):  # which the site makes
            continue
        for table in re.findall(r"(?:^\|.*\n)+", MARK.sub("", page.read_text()), re.MULTILINE):
            head, _, *rows = table.splitlines()
            if any(FIGURES.search(row) for row in rows):
                yield str(page.relative_to(ROOT)), head.split("|")[1].strip()


def test_a_table_with_figures_comes_from_docs_measured_or_states_them_for_a_reason() -> None:
    assert sorted(set(typed_tables()) - set(STATED)) == [], "put it between marks, or in STATED with the reason"
    assert sorted(set(STATED) - set(typed_tables())) == []
    assert all(STATED.values())
