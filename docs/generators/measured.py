"""Measured figures: tables of the pages from the files of `docs/measured`, and how old they are.

A file holds figures, the tables made of them, date, commit, machine and command of the measurement, and the rooms of
the code on which it depends. `python -m docs.generators.measured` (`make measured`) lists the files and what is stale;
`... write` writes the tables into the pages; `... take NAME` takes figures of `results`, with the commit, date and
machine that the program wrote beside them, unless the code on which they depend has changed since; `... confirm NAME
--part TEXT` keeps that a part of them, measured again on this code, is the same. Comments and docstrings of Python are
not code, nor are pages.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import re
import subprocess
import sys
from datetime import date
from pathlib import Path
from string import Formatter
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from docs.generators.links import PAGES

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "measured"
MARK = re.compile(r"(<!-- measured: (\w+) (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
AGES = {
    "current": "The code on which they depend has not changed since.",
    "stale": "**The code on which they depend has changed since.**",
    "unknown": "Whether the code on which they depend has changed since is not known here.",
}
Age = Literal["current", "stale", "unknown"]
UNMOVED = {
    "src/amb_core/amb_core/ground": "errors, declarations, files, cards, processes: it refuses, reads, prints, spreads",
    "src/amb_core/amb_core/report": "draws figures and pages",
    "tests/front_door": "writes and checks files of results",
    "tests/benchmarks/skipped.py": "a reason",
    "tests/benchmarks/regions/spread.py": "spreads cases over processes",
    **{str(path.relative_to(ROOT)): "declares keys of results" for path in ROOT.glob("tests/**/figures.py")},
}
"""Folders and files that move no figures, unless a file of figures names them as rooms; with the reason."""


class Table(BaseModel):
    """A table of a page, or without columns the lines of a paragraph.

    Cells may name figures, as `{lockstep[ratio]:.2f}`; `!p` makes a share percent.
    """

    model_config = ConfigDict(extra="forbid")

    columns: list[str]
    rows: list[list[str]]


class Confirmation(BaseModel):
    """That a part of the figures was measured again on later code, and is the same.

    Attributes
    ----------
    part : str
        What was measured again, of how much, and how closely it agrees.
    commit, date : str
        The code that was measured, and when.
    """

    model_config = ConfigDict(extra="forbid")

    part: str
    commit: str
    date: str


class Measured(BaseModel):
    """A file of measured figures.

    Attributes
    ----------
    command, machine, date : str
        How, where (empty where that does not matter) and when it was measured.
    commit : str
        The code that was measured.
    exact : bool
        Whether it was that commit; otherwise that one or an earlier one.
    confirmed : Confirmation, optional
        The latest code on which a part was measured again and is the same.
    programs : list of str
        Files of the programs that measure, also of those that run as processes of their own: what they import is in the
        rooms or apart.
    rooms : list of str
        Folders and files on which the figures depend.
    apart : dict
        Folders and files that the programs import or the rooms have, and that cannot move these figures, each with the
        reason. Where rooms and these contain each other, the smaller counts. `UNMOVED` has those of all figures.
    results : str
        File below `results` that the command writes.
    part : str
        Key of that file under which the figures are; empty for all of it.
    declared : str
        MODULE:CLASS of the keys of the figures; empty where cells hold the figures themselves.
    figures : dict
        What was measured.
    tables : dict
        Tables by name.
    """

    model_config = ConfigDict(extra="forbid")

    command: str
    machine: str
    date: str
    commit: str
    exact: bool
    confirmed: Confirmation | None = None
    programs: list[str]
    rooms: list[str]
    apart: dict[str, str] = {}
    results: str
    part: str = ""
    declared: str = ""
    figures: dict[str, Any] = {}
    tables: dict[str, Table]

    def rendered(self, name: str) -> str:
        """A table in Markdown, and the line that says when it was measured."""
        table = self.tables[name]
        rows = [[self._cell(cell) for cell in row] for row in table.rows]
        if not table.columns:
            return "\n".join([*(" ".join(row) for row in rows), "", self.origin, ""])
        head, *body = (
            "|" + "".join(f" {cell} |" if cell else " |" for cell in row)
            for row in [[self._cell(column) for column in table.columns], *rows]
        )
        return "\n".join([head, "|" + "---|" * len(table.columns), *body, "", self.origin, ""])

    def _cell(self, text: str) -> str:
        return _Cells().vformat(text, (), self.figures)

    @property
    def origin(self) -> str:
        """When, where and how."""
        when = f"on {self.date} at commit {self.commit[:7]}" if self.exact else f"at commit {self.commit[:7]} or before"
        where = f", on {self.machine}" if self.machine else ""
        measured = f"Measured {when} by `{self.command}`{where}."
        if self.confirmed is None:
            return measured
        one = self.confirmed
        return f"{measured} Measured again on {one.date} at commit {one.commit[:7]}: {one.part}."

    def age(self) -> Age:
        """Whether the rooms are those that were measured, as far as git knows."""
        commit = self.confirmed.commit if self.confirmed else self.commit
        exact = self.exact or self.confirmed is not None
        if _git("cat-file", "-e", f"{commit}^{{commit}}") != 0:
            return "unknown"
        if self.changed_since(commit):
            return "stale"
        return "current" if exact else "unknown"

    def changed_since(self, commit: str) -> list[str]:
        """Files on which the figures depend and that compute otherwise than those of a commit."""
        names = _output_of_git("diff", "--name-only", "--no-renames", commit, "--", *self.rooms).splitlines()
        return [name for name in names if self.is_moved_by(name) and _computes_otherwise(commit, name)]

    def is_moved_by(self, name: str) -> bool | None:
        """Whether a file can move the figures, by the smallest folder that has it; None if none is declared."""
        declared = dict.fromkeys([*UNMOVED, *self.apart], False) | dict.fromkeys(self.rooms, True)
        having = [place for place in declared if name == place or name.startswith(f"{place}/")]
        return declared[max(having, key=len)] if having else None


class _Cells(Formatter):
    """`str.format` with a conversion to percent; what there is none of, is a dash."""

    def convert_field(self, value: Any, conversion: Any) -> Any:
        """As in the base class; p multiplies by 100."""
        if value is None or conversion != "p":
            return super().convert_field(value, None if value is None else conversion)
        return 100.0 * value

    def format_field(self, value: Any, format_spec: str) -> str:
        """As in the base class; None is a dash."""
        return "-" if value is None else super().format_field(value, format_spec)


def load(name: str) -> Measured:
    """The file of a name."""
    return Measured.model_validate_json((FOLDER / f"{name}.json").read_text())


def names() -> list[str]:
    """Names of all files."""
    return sorted(path.stem for path in FOLDER.glob("*.json"))


def with_measured_tables(text: str) -> str:
    """A page with its measured tables made anew."""
    return MARK.sub(lambda match: match[1] + load(match[2]).rendered(match[3]) + match[4], text)


def with_ages(text: str) -> str:
    """A page of the site, which says below each measured table whether its code has changed."""

    def render(match: re.Match[str]) -> str:
        measured = load(match[2])
        return f"{match[1]}{measured.rendered(match[3]).rstrip()} {AGES[measured.age()]}\n\n{match[4]}"

    return MARK.sub(render, text)


def pages() -> list[Path]:
    """README, guide to the target and pages with measured tables; not those that the site makes of these."""
    all_pages = {ROOT / "README.md", *ROOT.glob("target/*.md"), *ROOT.glob("docs/**/*.md")} - {*PAGES.values()}
    return [page for page in sorted(all_pages) if MARK.search(page.read_text())]


def _git(*arguments: str) -> int:
    """Exit code of git in this checkout; 128 where there is none."""
    try:
        return subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True).returncode
    except OSError:
        return 128


def _output_of_git(*arguments: str) -> str:
    """What git prints in this checkout."""
    return subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=True).stdout


def _computes_otherwise(commit: str, name: str) -> bool:
    """Whether a file that differs from that of a commit computes otherwise; pages, comments and docstrings do not."""
    file = ROOT / name
    if file.suffix == ".md":
        return False
    if file.suffix != ".py" or not file.exists() or _git("cat-file", "-e", f"{commit}:{name}") != 0:
        return True
    return _statements(_output_of_git("show", f"{commit}:{name}")) != _statements(file.read_text())


def _statements(text: str) -> str:
    """The syntax tree of a module without its docstrings."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            has_docstring = ast.get_docstring(node, clean=False) is not None
            node.body = node.body[1:] if has_docstring else node.body
    return ast.dump(tree)


def _take(name: str) -> None:
    """Take the figures of `results`, measured on code that computes as it is committed now."""
    measured = load(name)
    if not measured.declared:
        sys.exit(f"{name}: the cells of its tables hold the figures; write them, the commit and the date there by hand")
    _refuse_uncommitted(name, measured)
    file = ROOT / "results" / measured.results
    if not file.exists():
        sys.exit(f"{name}: there is no {file}; run: {measured.command}")
    figures = json.loads(file.read_text())
    figures = figures[measured.part] if measured.part else figures
    wrong = declaration_problems(measured.declared, figures)
    if wrong:
        sys.exit(f"{file}: {'; '.join(wrong)}")
    origin = _origin(name, measured, file)
    _keep(name, measured.model_copy(update={"figures": figures, **origin, "exact": True, "confirmed": None}))


def _origin(name: str, measured: Measured, file: Path) -> dict[str, str]:
    """Commit, date and machine of figures; ends unless all of them were measured on code that computes as it is now."""
    from tests.front_door.results import stamps_of, unstamped

    unknown = [key for key in unstamped(file) if measured.part in ("", key)]
    if unknown:
        sys.exit(f"{name}: {file} does not name the code on which {', '.join(unknown)} was measured; measure it again")
    stamps = {
        part: stamp
        for part, stamp in stamps_of(file).items()
        if not measured.part or any(place[0] == measured.part for place in stamp.wrote)
    }
    for part, stamp in stamps.items():
        what = f"{name}: part {part} of {file.name} was measured"
        if not stamp.commit:
            sys.exit(f"{what} outside of a checkout of git; measure it again in one")
        if _git("cat-file", "-e", f"{stamp.commit}^{{commit}}") != 0:
            sys.exit(f"{what} at commit {stamp.commit[:7]}, which is not known here; measure it again")
        if differed := [place for place in stamp.changed if measured.is_moved_by(place)]:
            sys.exit(f"{what} while {', '.join(differed)} differed from commit {stamp.commit[:7]}; measure it again")
        if changed := measured.changed_since(stamp.commit):
            sys.exit(f"{what} at commit {stamp.commit[:7]}, and {', '.join(changed)} changed since; measure it again")
    oldest = min(stamps.values(), key=lambda stamp: int(_output_of_git("show", "-s", "--format=%ct", stamp.commit)))
    return {
        "commit": oldest.commit,
        "date": ", ".join(sorted({stamp.date for stamp in stamps.values()})),
        "machine": "; ".join(sorted({stamp.machine for stamp in stamps.values()})),
    }


def _confirm(name: str, part: str) -> None:
    """Keep that a part was measured again on the code as it is committed now, and is the same."""
    measured = load(name)
    _refuse_uncommitted(name, measured)
    commit = _output_of_git("rev-parse", "HEAD").strip()
    again = Confirmation(part=part, commit=commit, date=str(date.today()))
    _keep(name, measured.model_copy(update={"confirmed": again}))


def _refuse_uncommitted(name: str, measured: Measured) -> None:
    """End if code on which figures depend is not as committed."""
    if changed := measured.changed_since("HEAD"):
        sys.exit(f"{name}: {', '.join(changed)} has changes that are not committed; commit, measure, then take")


def _keep(name: str, measured: Measured) -> None:
    (FOLDER / f"{name}.json").write_text(measured.model_dump_json(indent=1, exclude_none=True) + "\n")


def declaration_problems(declared: str, figures: Any, partial: bool = False) -> list[str]:
    """What is wrong with figures by their declaration, MODULE:CLASS."""
    from tests.front_door.figures import problems

    module, _, kind = declared.partition(":")
    return problems(getattr(importlib.import_module(module), kind), figures, partial)


def main() -> None:
    """List, write, take or confirm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", choices=["list", "write", "take", "confirm"], default="list")
    parser.add_argument("name", nargs="*", help="files to take or confirm")
    parser.add_argument("--part", help="what was measured again and is the same, as `40 of 400 bearings, bit for bit`")
    chosen = parser.parse_args()
    if chosen.what == "list":
        for name in names():
            measured = load(name)
            print(f"{measured.age():8} {name:16} {measured.origin}")
        return
    if chosen.what == "confirm" and not chosen.part:
        parser.error("confirm needs --part: what was measured again")
    for name in chosen.name:
        if chosen.what == "confirm":
            _confirm(name, chosen.part)
        else:
            _take(name)
    for page in pages():
        page.write_text(with_measured_tables(page.read_text()))


if __name__ == "__main__":
    main()
