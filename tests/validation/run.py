"""Validation of the plant: runs every check, prints a table and writes results/validation.json.

Ends with exit code 1 if a deviation is above its limit.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import dynamics
import eddy
import independent
import iron
import laminations
import paper
import rotors
import statics
from rich.console import Console
from rich.table import Table
from row import Row

RESULTS = Path(__file__).parents[2] / "results" / "validation.json"
CHECKS: dict[str, Callable[[], Iterator[Row]]] = {
    "closed forms": statics.rows,
    "magnitudes of the paper": paper.rows,
    "iron": iron.rows,
    "eddy currents": eddy.rows,
    "laminations": laminations.rows,
    "rotors": rotors.rows,
    "energy": dynamics.energy,
    "iron loss": dynamics.iron_loss,
    "order of the integrator": dynamics.convergence,
    "eq. (3) of the paper": dynamics.derivative_of_force,
    "independent solution (about three minutes)": independent.rows,
}


def main() -> int:
    """Check and report."""
    console = Console()
    rows: list[Row] = []
    for number, (name, check) in enumerate(CHECKS.items(), start=1):
        started = time.perf_counter()
        with console.status(f"[{number}/{len(CHECKS)}] {name}"):
            rows += check()
        console.print(f"{number}/{len(CHECKS)} {name}: {time.perf_counter() - started:.1f} s")
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps([asdict(row) | {"ok": row.ok} for row in rows], indent=2) + "\n")
    console.print(_table(rows))
    console.print(f"written to {RESULTS.relative_to(Path.cwd()) if RESULTS.is_relative_to(Path.cwd()) else RESULTS}")
    return 0 if all(row.ok for row in rows) else 1


def _table(rows: list[Row]) -> Table:
    table = Table("check", title="make validate")
    for heading in ("measured", "limit"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    table.add_column("ok")
    for row in rows:
        verdict = "yes" if row.ok else "[bold red]NO"
        table.add_row(row.name, f"{row.measured:.3g}", f"{row.limit:.3g}", row.unit, verdict)
    return table


if __name__ == "__main__":
    sys.exit(main())
