"""The documentation says what the code says: parameter tables, interfaces and links.

The parameter tables in the READMEs are rendered from the declarations, the table of modes on the page of the plant is
computed; `python -m tests.unit.test_docs` rewrites them.
"""

from __future__ import annotations

import ast
import importlib.util
import inspect
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from amb_core.ground.files.parameter_files import KNOWN_NODES
from amb_ros import topics
from docs.generators.links import PAGES as PAGES_OF_THE_REPOSITORY
from docs.generators.modes import PAGE as PAGE_OF_MODES
from docs.generators.modes import TABLE as TABLE_OF_MODES
from docs.generators.modes import with_current_modes
from docs.generators.modules import FOLDER as GENERATED_PAGES
from docs.generators.tables import TABLE, TABLES, with_current_tables

ROOT = Path(__file__).parents[2]
NODE_PACKAGES = ("amb_sim_node", "amb_controller_node", "amb_ident_node")
PACKAGES = ("amb_msgs", *NODE_PACKAGES, "src/amb_core", "src/amb_ros", "src/amb_bringup", "src/amb_paper")
READMES = [ROOT / "README.md", *(ROOT / package / "README.md" for package in PACKAGES)]
DOCS = [
    page
    for page in sorted((ROOT / "docs").rglob("*.md"))
    if page not in PAGES_OF_THE_REPOSITORY.values() and page.parent != GENERATED_PAGES
]
PAGES = [*READMES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *DOCS]
SECTIONS = ["Purpose", "Design", "Assumptions and known limits", "Inputs and outputs", "Parameters", "Examples"]

TOPIC_NAMES = {
    name: value for name, value in vars(topics).items() if name.isupper() and name not in ("NAMESPACE", "CLOCK")
}


# -- tables from declarations


@pytest.mark.parametrize("readme", READMES, ids=lambda path: path.parent.name)
def test_parameter_tables_are_those_of_the_declarations(readme: Path) -> None:
    text = readme.read_text()
    assert text == with_current_tables(text), (
        f"{readme.relative_to(ROOT)} is out of date; run: python -m tests.unit.test_docs"
    )


def test_every_parameter_set_has_its_table() -> None:
    shown = {match[2] for readme in READMES for match in TABLE.finditer(readme.read_text())}
    assert shown == set(TABLES)


def test_the_modes_of_the_flexible_rotor_on_the_page_of_the_plant_are_those_of_the_code() -> None:
    text = PAGE_OF_MODES.read_text()
    assert len(TABLE_OF_MODES.findall(text)) == 1
    assert text == with_current_modes(text), "out of date; run: python -m tests.unit.test_docs"


# -- shape of the READMEs


@pytest.mark.parametrize("package", PACKAGES)
def test_readmes_of_packages_have_one_order(package: str) -> None:
    headings = re.findall(r"^## (.*)$", (ROOT / package / "README.md").read_text(), re.MULTILINE)
    assert headings == SECTIONS


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if target.startswith("https://"):
            continue
        name, _, section = target.partition("#")
        linked = page.parent / name if name else page
        assert linked.exists(), f"{page.relative_to(ROOT)} links to {target}"
        assert not section or section in _anchors(linked), (
            f"{page.relative_to(ROOT)} links to {target}: no such section"
        )


def _anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_image_is_shown_on_a_page() -> None:
    text = "".join(page.read_text() for page in PAGES)
    assert not {path.name for path in (ROOT / "docs" / "images").iterdir() if path.name not in text}


def test_every_page_is_in_the_tree_of_the_site_once() -> None:
    listed = [entry for page in DOCS for entry in listed_in(page)]
    assert len(listed) == len(set(listed))
    assert set(DOCS) == {path for path in listed if path in DOCS} | {ROOT / "docs" / "index.md"}
    shown = {*DOCS, *PAGES_OF_THE_REPOSITORY.values()}
    assert not {path for path in listed if path not in shown}


def listed_in(page: Path) -> Iterator[Path]:
    """The pages in the tables of contents of a page of the site; a pattern stands for generated pages."""
    for tree in re.findall(r"^```{toctree}\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE):
        for entry in tree.splitlines():
            if not entry.startswith(":") and re.fullmatch(r"[\w./-]+", entry) and "*" not in entry:
                yield Path(os.path.normpath(page.parent / f"{entry}.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_python_examples_are_python(page: Path) -> None:
    for number, example in enumerate(_examples(page)):
        compile(example, f"{page.relative_to(ROOT)} example {number}", "exec")


def test_programs_with_rclpy_end_with_the_wheels_and_wait_for_no_answer_for_ever() -> None:
    """As docs/how-to/troubleshoot.md advises."""
    programs = [example for page in PAGES for example in _examples(page) if "rclpy.init()" in example]
    assert programs
    for program in programs:
        assert 0 < program.find("middleware.configure()") < program.index("rclpy.init()"), program
    for page in PAGES:
        for example in _examples(page):
            for node in ast.walk(ast.parse(example)):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                    waits = node.func.attr in ("wait_for_service", "wait_for_server", "spin_until_future_complete")
                    limit = any(keyword.arg in ("timeout_sec", "timeout") for keyword in node.keywords)
                    assert limit or not waits, f"{page.relative_to(ROOT)}: {ast.unparse(node)}"


def test_examples_without_ros_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for example in _examples(ROOT / "src" / "amb_core" / "README.md"):
        exec(example, names)


def _examples(readme: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```$", readme.read_text(), re.DOTALL | re.MULTILINE)


# -- topics and services


def documented(package: str, kind: str) -> dict[str, str]:
    """Names and types in the tables of a README whose first column is `topic` or `service`."""
    types: dict[str, str] = {}
    in_table = False
    for line in (ROOT / package / "README.md").read_text().splitlines():
        cells = [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            in_table = False
        elif cells[0] == kind:
            in_table = True
        elif in_table and not cells[0].startswith("---"):
            types[cells[0]] = cells[1]
    return types


def sources(package: str) -> dict[str, str]:
    return {path.stem: path.read_text() for path in sorted((ROOT / package).glob("amb_*/*.py"))}


def calls(package: str, kind: str) -> dict[str, str]:
    """Full relative names and types of the services or actions (`kind`) that the nodes of a package create."""
    return {
        f"{node}/{name}": message_type
        for node, text in sources(package).items()
        for message_type, name in re.findall(rf'create_{kind}\(\s*self, (?:\w+\.)?(\w+), "~/(\w+)"', text)
    }


@pytest.mark.parametrize("package", NODE_PACKAGES)
def test_topics_in_the_readme_are_those_of_the_nodes(package: str) -> None:
    code = "\n".join(sources(package).values())
    used = {TOPIC_NAMES[name] for name in re.findall(r"\btopics\.([A-Z_]+)", code) if name in TOPIC_NAMES}
    used |= set(re.findall(r'"(/\w+)"', code))
    if "MachineInput(" in code:
        used.add(topics.MACHINE)
    if "AxisSignalPublishers(" in code:
        used.add(topics.SIGNALS)
    if "ExcitationAnswers(" in code:
        used.add(topics.EXCITATION_STATUS)
    if "topics.clock(" in code:
        used.add(topics.clock(f"/{topics.NAMESPACE}"))
    if "diagnostics." in code:
        used.add("/diagnostics")
    assert set(documented(package, "topic")) == used


@pytest.mark.parametrize("package", NODE_PACKAGES)
def test_message_types_in_the_readme_are_those_of_the_code(package: str) -> None:
    code = "\n".join(sources(package).values())
    for topic, kind in documented(package, "topic").items():
        elsewhere = topic in ("/diagnostics", topics.SIGNALS)  # in amb_ros
        assert re.search(rf"\b{kind.rsplit('/', 1)[-1]}\b", code) or elsewhere


@pytest.mark.parametrize("kind", ["service", "action"])
@pytest.mark.parametrize("package", NODE_PACKAGES)
def test_services_and_actions_in_the_readme_are_those_of_the_nodes(package: str, kind: str) -> None:
    assert documented(package, kind) == calls(package, kind)


def test_names_in_the_top_readme_exist() -> None:
    called = {name for package in NODE_PACKAGES for kind in ("service", "action") for name in calls(package, kind)}
    nodes = "|".join(KNOWN_NODES)
    assert set(re.findall(rf"`((?:{nodes})/\w+)`", _top())) == called | {topics.SIMULATOR_STATE, topics.BRIDGE_STATE}
    for topic in TOPIC_NAMES.values():
        assert f"`{topic}`" in _top()


def _top() -> str:
    return (ROOT / "README.md").read_text()


# -- modules


def promised(readme: Path) -> Iterator[tuple[str, str]]:
    """Modules in the first column of a table and names that the second says they, or their classes, offer."""
    for line in readme.read_text().splitlines():
        row = re.match(r"\| `(amb_[\w.]+)` \| (.*) \|$", line)
        if row is not None:
            yield from ((row[1], name) for name in re.findall(r"`(\w+)`", row[2]))


@pytest.mark.parametrize("package", ["src/amb_core", "src/amb_ros", "src/amb_bringup", "src/amb_paper"])
def test_modules_have_the_names_that_the_readme_promises(package: str) -> None:
    for module, name in promised(ROOT / package / "README.md"):
        classes = [item for item in vars(importlib.import_module(module)).values() if inspect.isclass(item)]
        attribute = any(hasattr(owner, name) for owner in (importlib.import_module(module), *classes))
        chart = hasattr(importlib.import_module(module), f"{name}_chart")
        submodule = importlib.util.find_spec(f"{module}.{name}") if hasattr(sys.modules[module], "__path__") else None
        assert attribute or chart or submodule, f"{package}/README.md: {module} has no {name}"


if __name__ == "__main__":
    for path in READMES:
        path.write_text(with_current_tables(path.read_text()))
    PAGE_OF_MODES.write_text(with_current_modes(PAGE_OF_MODES.read_text()))
