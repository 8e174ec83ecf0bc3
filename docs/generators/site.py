"""The Sphinx extension: writes pages of the repository and of the modules, and fills pages with what is generated."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import GenericAlias
from typing import Any

from docs.generators import links, measured, modules
from docs.generators.commands import command_reference
from docs.generators.messages import message_reference
from docs.generators.results import result_names
from docs.generators.safety import command_table, count_table, hazard_table, step_table
from docs.generators.simulink import telemetry_table
from docs.generators.tables import excitation_table, parameter_reference

MARK = re.compile(r"^<!-- generated: (\w+) -->$", re.MULTILINE)
GENERATED: dict[str, Callable[[], str]] = {
    "commands": command_reference,
    "messages": message_reference,
    "parameters": parameter_reference,
    "excitations": excitation_table,
    "results": result_names,
    "hazards": hazard_table,
    "state_commands": command_table,
    "state_steps": step_table,
    "state_counts": count_table,
    "simulink": telemetry_table,
}


def setup(app: Any) -> dict[str, bool]:
    """Connect to the events of Sphinx."""
    app.connect("config-inited", lambda *_: write_pages())
    app.connect("source-read", _complete)
    app.connect("env-get-outdated", _outdated)
    app.connect("autodoc-skip-member", _is_alias)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_pages() -> None:
    """Write the pages that are not in the tree: modules, and files of the repository outside of `docs`."""
    modules.write_pages()
    for source, page in links.PAGES.items():
        modules.write_if_changed(page, links.for_site(source.read_text(), source, page))


def completed(text: str, page: Path) -> str:
    """A page of `docs` as the site shows it: generated parts in their places, links to other pages of the site."""
    text = links.for_site(measured.with_ages(text), page, page)
    return MARK.sub(lambda match: GENERATED[match[1]](), text)


def _complete(app: Any, name: str, content: list[str]) -> None:
    page = Path(app.env.doc2path(name))
    if page.suffix == ".md":
        content[0] = completed(content[0], page)


def _outdated(app: Any, env: Any, added: set[str], changed: set[str], removed: set[str]) -> list[str]:
    return [name for name in env.found_docs if _changes(Path(env.doc2path(name)).read_text())]


def _changes(text: str) -> bool:
    """Whether a page has parts that may be other ones than when it was read last."""
    return bool(MARK.search(text) or measured.MARK.search(text))


def _is_alias(app: Any, what: str, name: str, item: object, skip: bool, options: Any) -> bool | None:
    """Names of types in annotations, such as `dict[str, int]`, have no signature of their own."""
    return True if isinstance(item, GenericAlias) else None
