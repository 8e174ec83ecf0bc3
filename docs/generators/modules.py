"""Pages of the Python reference: one for each module that the READMEs of the packages offer."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "reference" / "api"
"""Where the pages are written."""

READMES = tuple(ROOT / "src" / package / "README.md" for package in ("amb_core", "amb_ros", "amb_bringup", "amb_paper"))


def offered() -> list[str]:
    """Modules in the first column of the tables of the READMEs, sorted."""
    names_offered: set[str] = set()
    for readme in READMES:
        for cell in re.findall(r"^\| (`amb_[^|]*`) \|", readme.read_text(), re.MULTILINE):
            names = re.findall(r"`([\w.]+)`", cell)
            parent = names[0].rpartition(".")[0]
            names_offered |= {name if name.startswith("amb_") else f"{parent}.{name}" for name in names}
    return sorted(name for name in names_offered if "." in name)


def write_pages(folder: Path = FOLDER) -> None:
    """Write the pages into their folder, and remove those of modules that are no longer offered."""
    folder.mkdir(parents=True, exist_ok=True)
    homes = _homes(offered())
    wanted = {f"{module}.md": _page(module, homes) for module in offered()}
    for path in folder.glob("*.md"):
        if path.name not in wanted:
            path.unlink()
    for name, text in wanted.items():
        write_if_changed(folder / name, text)


def write_if_changed(path: Path, text: str) -> None:
    """Leave a file with the same text alone, so that Sphinx need not read it again."""
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def _page(module: str, pages: dict[str, str]) -> str:
    elsewhere = [name for name in _exported(module) if pages[name] != module]
    options = (
        [f"   :exclude-members: {', '.join(name.rpartition('.')[2] for name in elsewhere)}\n"] if elsewhere else []
    )
    links = [
        f"- {{py:obj}}`{name.rpartition('.')[2]} <{pages[name]}.{name.rpartition('.')[2]}>`\n" for name in elsewhere
    ]
    text = f"# {module}\n\n```{{eval-rst}}\n.. automodule:: {module}\n   :members:\n{''.join(options)}```\n"
    return text + ("\nIt also exports, described on their own pages:\n\n" + "".join(links) if links else "")


def _homes(modules: list[str]) -> dict[str, str]:
    """The page of each exported object, by the name of its definition: that of the deepest module that exports it."""
    homes: dict[str, str] = {}
    for module in sorted(modules, key=lambda name: (name.count("."), name)):
        homes |= dict.fromkeys(_exported(module), module)
    return homes


def _exported(module: str) -> list[str]:
    """Where the objects that a module exports from elsewhere are defined, as full names."""
    loaded = importlib.import_module(module)
    items = [(name, getattr(loaded, name)) for name in getattr(loaded, "__all__", [])]
    return [f"{item.__module__}.{name}" for name, item in items if isinstance(item, type) or callable(item)]
