"""The modules of this repository that a program runs through, by their import statements.

A name that a package only passes on leads to the module that defines it, so that `from amb_core.plant import Plant`
means `plant.py` and what that imports, and not all that the package offers. Imports for type checkers are left out.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

from tests.front_door.results import ROOT

PACKAGES = (*sorted(path.parent for path in ROOT.glob("*/setup.py")), *sorted(ROOT.glob("src/*")), ROOT)
"""Folders that modules are imported from."""


def closure(files: Iterable[str], is_followed: Callable[[str], bool] = lambda name: True) -> set[str]:
    """Files with these, relative to the checkout, and all modules of it that they import, directly or not.

    Parameters
    ----------
    files : iterable of str
        Where to begin; these are followed anyway.
    is_followed : callable, optional
        Whether the imports of a module count; by default those of all do.
    """
    found = set(files)
    waiting = list(found)
    while waiting:
        new = imports(waiting.pop()) - found
        found |= new
        waiting += filter(is_followed, new)
    return found


@cache
def imports(name: str) -> frozenset[str]:
    """Files of the modules that one imports, in functions too; none for a file that is no module."""
    if not name.endswith(".py"):
        return frozenset()
    tree = ast.parse((ROOT / name).read_text())
    return frozenset(file for node in _running(tree) for file in _files(node))


def file_of(module: str) -> str | None:
    """The file of a module of this repository."""
    place = Path(*module.split("."))
    for root in PACKAGES:
        for path in (root / place.with_suffix(".py"), root / place / "__init__.py"):
            if path.is_file():
                return str(path.relative_to(ROOT))
    return None


def _running(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes but those for type checkers."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from _running(node)


def _files(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from filter(None, (file_of(alias.name) for alias in node.names))
    if isinstance(node, ast.ImportFrom) and node.module:
        yield from filter(None, (_home(node.module, alias.name) for alias in node.names))


def _home(module: str, name: str) -> str | None:
    """The file that defines a name of a module, which may be a module itself, or be passed on."""
    file = file_of(f"{module}.{name}") or file_of(module)
    if file is None or file != file_of(module) or not file.endswith("__init__.py"):
        return file
    for node in ast.walk(ast.parse((ROOT / file).read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _home(node.module, alias.name)
    return file
