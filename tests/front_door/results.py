"""Where programs write their figures: results, and results/quick those of the smallest size."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]


def results_file(name: str, quick: bool = False) -> Path:
    """The file of a program, in a folder that exists; see `tests.front_door.entries` for what it must hold."""
    folder = ROOT / "results" / "quick" if quick else ROOT / "results"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / name
