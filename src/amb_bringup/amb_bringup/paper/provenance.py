"""Which files of this package a result depends on: a module's own, and those of all that it imports of it."""

from __future__ import annotations

import ast
import importlib.util
from functools import cache
from pathlib import Path


@cache
def source_files(module: str) -> tuple[Path, ...]:
    """Files of a module and of what it imports, directly or not, of the package that it belongs to; sorted."""
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in found or (file := _file(name)) is None:
            continue
        found[name] = file
        waiting += [other for other in _imports(file) if other.split(".")[0] == module.split(".")[0]]
    return tuple(sorted(set(found.values())))


def _file(name: str) -> Path | None:
    """File of a module; None for what is not a module, such as a function that was imported by name."""
    try:
        spec = importlib.util.find_spec(name)
    except ModuleNotFoundError:
        return None
    return None if spec is None or spec.origin is None else Path(spec.origin)


def _imports(file: Path) -> list[str]:
    """Modules that a file imports, and names from modules, which may be modules themselves."""
    names: list[str] = []
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return names
