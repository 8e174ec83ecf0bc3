"""The table of names in files of results, from their declaration."""

from __future__ import annotations

from amb_core.ground.results import NAMES


def result_names() -> str:
    """A row for each name: unit and meaning."""
    rows = [f"| `{name}` | {unit} | {meaning} |" for name, (unit, meaning) in NAMES.items()]
    return "\n".join(["| name | unit | meaning |", "|---|---|---|", *rows]) + "\n"
