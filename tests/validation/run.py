"""Validation of the plant: runs every check, prints a table and writes results/validation.json.

Ends with exit code 1 if a deviation is above its limit.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict

from rich.console import Console
from rich.table import Table

from tests.front_door.results import ROOT, Results
from tests.validation import dynamics, eddy, independent, iron, laminations, paper, rotors, statics
from tests.validation.row import Row

CHECKS: dict[str, tuple[Callable[..., Iterator[Row]], int, dict[str, int]]] = {
    "closed forms": (statics.rows, 8, {}),
    "magnitudes of the paper": (paper.rows, 3, {}),
    "iron": (iron.rows, 25, {}),
    "eddy currents": (eddy.rows, 14, {}),
    "laminations": (laminations.rows, 9, {}),
    "rotors": (rotors.rows, 12, {}),
    "energy": (dynamics.energy, 6, {"samples": 200}),
    "iron loss": (dynamics.iron_loss, 2, {}),
    "order of the integrator": (dynamics.convergence, 3, {}),
    "eq. (3) of the paper": (dynamics.derivative_of_force, 1, {}),
    "independent solution (about three minutes)": (independent.rows, 12, {"longest": 2}),
}
"""The checks by name, each with the number of its rows and its smallest size, which `--quick` takes."""


def main() -> int:
    """Check and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    quick = parser.parse_args().quick
    results = Results("validation.json", quick)
    console = Console()
    rows: list[Row] = []
    for number, (name, (check, count, smallest)) in enumerate(CHECKS.items(), start=1):
        started = time.perf_counter()
        with console.status(f"[{number}/{len(CHECKS)}] {name}"):
            checked = list(check(**smallest if quick else {}))
        if len(checked) != count:
            raise RuntimeError(f"{name} has {len(checked)} rows; declared: {count}")
        rows += checked
        console.print(f"{number}/{len(CHECKS)} {name}: {time.perf_counter() - started:.1f} s")
    results.keep_all([asdict(row) | {"ok": row.ok} for row in rows])
    console.print(_table(rows))
    console.print(f"written to {results.file.relative_to(ROOT)}")
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
