"""The list of what the front door offers is complete: see tests/front_door/entries.py, and `make quick`."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.generators.commands import commands
from docs.generators.links import PAGES as PAGES_OF_THE_REPOSITORY
from tests.front_door.commands import name_of, steps
from tests.front_door.entries import COMMANDS_ELSEWHERE, PAGES, PROGRAMS, TARGETS, Covered, Left, Program
from tests.front_door.figures import Figures, problems
from tests.front_door.imports import closure
from tests.front_door.run import files_of

ROOT = Path(__file__).parents[2]
MAKEFILE = (ROOT / "Makefile").read_text()
CODE = re.compile(r"^```(?:bash|python|\{code-cell\} python)$", re.MULTILINE)
FOLDERS = ("benchmarks", "validation", "soak", "fuzz")
OURS = {"tests.front_door.run", "tests.front_door.faults", "tests.target_rig"}
"""What runs the list, what proves it, and what writes the data of a test."""
LISTS = "list it in tests/front_door/entries.py"
ENVIRONMENT = re.compile(r"\$\(RUN\)|\.venv/bin")
MODULES = {program.module for program in PROGRAMS}


def targets() -> set[str]:
    """Those that `make help` lists, and any other."""
    return set(re.findall(r"^([a-z][\w-]*):(?!=)", MAKEFILE, re.MULTILINE))


def recipe(target: str) -> str:
    match = re.search(rf"^{re.escape(target)}:.*\n((?:\t.*\n)*)", MAKEFILE, re.MULTILINE)
    assert match is not None
    return match[1]


# -- what there is


def test_every_target_is_listed() -> None:
    assert targets() == set(TARGETS), LISTS


def test_help_lists_every_target() -> None:
    shown = subprocess.run(["make", "-s", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert {line.split()[0] for line in shown.splitlines()} == set(TARGETS)


def test_what_runs_in_the_environment_waits_until_it_is_set_up_with_several_jobs_too() -> None:
    rules = re.findall(r"^([\w./-]+):(?!=)(.*)\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)
    running = {target: needs.split("##")[0].split() for target, needs, recipe in rules if ENVIRONMENT.search(recipe)}
    assert "test" in running and ".venv-peers/.complete" in running
    assert [target for target, needs in running.items() if "setup" not in needs] == []


DEFAULTS = [
    (line.partition(":")[0], name, value)
    for line in MAKEFILE.splitlines()
    if re.match(r"[a-z-]+:.*## ", line)
    for name, value in re.findall(r"([A-Z]+)=(\d+)", re.sub(r"\(.*?\)", "", line))
]
"""Target, variable and value, of those that its help names outside parentheses: in them are other choices."""


@pytest.mark.parametrize(("target", "name", "value"), DEFAULTS)
def test_a_value_that_help_names_is_the_default_of_its_target(target: str, name: str, value: str) -> None:
    def would_run(*settings: str) -> str:
        command = ["env", "-u", name, "-u", "MAKEFLAGS", "make", "-n", target, *settings]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout

    assert would_run() == would_run(f"{name}={value}") != would_run(f"{name}={value}7")


def test_the_targets_run_the_programs_that_are_listed() -> None:
    for target, how in TARGETS.items():
        started = re.findall(r"python -m (tests[\w.]+)", recipe(target))
        if isinstance(how, tuple) and target != "reproduce":  # a command
            assert tuple(started) == how, target
        assert set(started) <= MODULES | {"tests.front_door.run"}, f"{target}: {LISTS}"


@pytest.mark.parametrize(
    ("command", "known"),
    [
        ("tests.front_door.run nothing", "tests.validation.run"),
        ("tests.front_door.faults nothing", "a command is not on the list"),
        ("tests.front_door.commands --only nothing", "amb plant modes"),
        ("tests.soak.run --parts nothing", "recovery"),
        ("tests.fuzz.files --only nothing", "deep.json"),
        ("tests.benchmarks.explained.run nothing", "subharmonics"),
        ("tests.benchmarks.first_hour.run nothing", "pages"),
    ],
)
def test_a_program_or_part_that_is_not_there_is_refused_with_those_that_are(command: str, known: str) -> None:
    refused = subprocess.run([sys.executable, "-m", *command.split()], cwd=ROOT, capture_output=True, text=True)
    assert refused.returncode == 2
    assert "invalid choice: 'nothing'" in refused.stderr
    assert known in refused.stderr


def test_a_program_that_adds_to_a_file_runs_with_those_that_write_the_rest_of_it() -> None:
    (programs,) = files_of(["tests.benchmarks.robust.emulator"])
    assert [program.module for program in programs] == [
        "tests.benchmarks.robust.run",
        "tests.benchmarks.robust.emulator",
    ]


def test_every_program_is_listed() -> None:
    assert set(startable()) - OURS <= listed(), LISTS


def test_every_module_beside_a_program_is_listed() -> None:
    beside = {module_of(path) for folder in FOLDERS for path in (ROOT / "tests" / folder).glob("**/*.py")}
    declarations = {program.figures.partition(":")[0] for program in PROGRAMS}
    assert {name for name in beside if not name.rpartition(".")[2].startswith("test_")} - declarations == {
        name for name in listed() if name.split(".")[1] in FOLDERS
    } - declarations, LISTS


def test_every_module_that_is_listed_is_run() -> None:
    assert sorted(listed() - {module_of(ROOT / file) for file in run_through()}) == []


def test_every_function_of_a_part_is_called() -> None:
    """A part that its program lacks would be one that is not."""
    texts = [path.read_text() for path in (ROOT / "tests").glob("**/*.py")]
    called = {name for text in texts for name in names_in(ast.parse(text))}
    for program in PROGRAMS:
        for module in {program.module, *beside(program)}:
            tree = ast.parse(ROOT.joinpath(*module.split(".")).with_suffix(".py").read_text())
            functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and node.name[0] != "_"}
            assert functions - called == set(), module


def beside(program: Program) -> set[str]:
    """Modules beside a program that are listed with it."""
    return {f"{program.module.rpartition('.')[0]}.{name}" for name in (*program.parts, *program.shared)}


def listed() -> set[str]:
    """All modules that are listed."""
    return MODULES.union(*(beside(program) for program in PROGRAMS))


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def startable() -> Iterator[str]:
    """Modules that can be started."""
    for path in [path for folder in ("tests", "tests/front_door") for path in (ROOT / folder).glob("*.py")] + [
        path for folder in FOLDERS for path in (ROOT / "tests" / folder).glob("**/*.py")
    ]:
        body = ast.parse(path.read_text()).body
        if any(isinstance(node, ast.If) and "__main__" in ast.unparse(node.test) for node in body):
            yield module_of(path)


def run_through() -> set[str]:
    """Files of the modules that programs run through: what they import, and modules beside them that they name."""
    found: set[str] = set()
    new = {f"{program.module.replace('.', '/')}.py" for program in PROGRAMS}
    while new - found:
        found |= closure(new)
        new = {
            str(path.relative_to(ROOT))
            for file in found
            if file.startswith("tests/")
            for text in names_in(ast.parse((ROOT / file).read_text()), texts=True)
            if (path := (ROOT / file).with_name(text.removesuffix(".py") + ".py")).exists()
        }
    return found


def names_in(tree: ast.AST, texts: bool = False) -> Iterator[str]:
    """Names that code uses, or its texts of one word."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and re.fullmatch(r"[\w.]+", node.value):
            yield node.value
        elif isinstance(node, ast.Name) and not texts:
            yield node.id
        elif isinstance(node, ast.Attribute) and not texts:
            yield node.attr


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.module)
def test_the_figures_of_a_program_are_declared(program) -> None:
    module, _, name = program.figures.partition(":")
    assert getattr(importlib.import_module(module), name).__doc__


def test_every_command_is_listed() -> None:
    called = {name_of(words) for _, _, words in steps(0) if words}
    assert called | set(COMMANDS_ELSEWHERE) == set(dict(commands())), LISTS
    assert not called & set(COMMANDS_ELSEWHERE)


def test_every_page_with_code_is_listed() -> None:
    generated = set(PAGES_OF_THE_REPOSITORY.values())
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("amb_*/*.md"), *ROOT.glob("src/*/*.md")]:
        if page in generated or not CODE.search(page.read_text()):
            continue
        assert any(page in ROOT.glob(pattern) for pattern in PAGES), f"{page.relative_to(ROOT)}: {LISTS}"


@pytest.mark.parametrize("name", [*TARGETS, *COMMANDS_ELSEWHERE, *PAGES])
def test_what_make_quick_does_not_run_is_run_by_a_test_or_has_a_reason(name: str) -> None:
    how = (TARGETS | COMMANDS_ELSEWHERE | PAGES)[name]
    if isinstance(how, Left):
        assert how.reason
    if isinstance(how, Covered):
        file, _, test = how.test.partition("::")
        match = re.search(rf"((?:^@.*\n)*)^def {test}\b", (ROOT / file).read_text(), re.MULTILINE)
        assert match, f"there is no test {how.test}"
        assert bool(how.slow_because) == ("mark.slow" in match[1]), f"{how.test}: say why a slow test is enough"
        assert bool(how.needs) == may_be_skipped(ROOT / file, test), f"{how.test}: say what it needs"
        if how.needs:
            file, _, test = how.without.partition("::")
            assert not may_be_skipped(ROOT / file, test), how.without


def may_be_skipped(file: Path, test: str) -> bool:
    """Whether a test is left out where something is missing: by itself, by a marker, or with its whole file."""
    body = ast.parse(file.read_text()).body
    (own,) = [ast.unparse(node) for node in body if isinstance(node, ast.FunctionDef) and node.name == test]
    shared = [ast.unparse(node) for node in body if isinstance(node, ast.Expr | ast.Assign)]
    markers = {text: text.partition(" = pytest.mark.skipif")[0] for text in shared if " = pytest.mark.skipif" in text}
    used = [text for text in shared if text not in markers or f"@{markers[text]}" in own]
    return any(re.search(r"importorskip|skipif|pytest\.skip", text) for text in (own, *used))


# -- the check of keys


class Example(Figures):
    seconds: float
    counts: dict[str, int]


@pytest.mark.parametrize(
    ("results", "problem"),
    [
        ({"seconds": 1.0, "counts": {"a": 1}}, None),
        ({"seconds": 1.0}, "counts: Field required"),
        ({"seconds": None, "counts": {"a": 1}}, "seconds: Input should be a valid number"),
        ({"seconds": 1.0, "counts": {"a": 1}, "more": 2}, "more: Extra inputs are not permitted"),
        (None, "the file: Input should be a valid dictionary or instance of Example"),
    ],
)
def test_results_have_all_keys_that_are_declared_and_no_others(results: object, problem: str | None) -> None:
    assert problems(Example, results) == ([problem] if problem else [])


def test_old_figures_may_lack_keys() -> None:
    assert problems(Example, {"seconds": 1.0}, partial=True) == []
