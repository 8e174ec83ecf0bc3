"""Counts behind the words of region monitor, excitation design and identification, on cases drawn at random.

Every subject is a module of its name with `measure() -> dict` (counts and seeds); the cases of a subject run in
processes, as many as there are cores. Prints a table and writes results/bench_regions.json, each subject as soon as it
is measured; keys of earlier runs that this run does not measure are kept.

    make bench-regions
    python tests/benchmarks/regions/run.py constant_line dead_time    # some subjects only
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "results" / "bench_regions.json"
SUBJECTS = (
    "constant_line",
    "constant_line_drift",
    "slow_line",
    "light_damping",
    "planted",
    "design",
    "turning_map",
    "drift_identification",
    "dead_time",
    "lamination",
)


def main() -> None:
    """Measure and report."""
    arguments = _arguments()
    sys.path.append(str(ROOT))  # for the cases that benchmarks and tests share
    console = Console()
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    RESULTS.parent.mkdir(exist_ok=True)
    table = Table("subject", "counts", "seconds", title="make bench-regions")
    for name in arguments.subjects or SUBJECTS:
        began = time.monotonic()
        with console.status(f"measuring {name}"):
            measured = importlib.import_module(name).measure()
        results[name] = measured
        RESULTS.write_text(json.dumps(results, indent=2) + "\n")
        counts = ", ".join(f"{key} {value}" for key, value in measured.items())
        table.add_row(name, counts, f"{time.monotonic() - began:.0f}")
    console.print(table)
    console.print(f"written to {RESULTS.relative_to(Path.cwd()) if RESULTS.is_relative_to(Path.cwd()) else RESULTS}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subjects", nargs="*", choices=[*SUBJECTS, []], help="subjects to measure; default: all")
    return parser.parse_args()


if __name__ == "__main__":
    main()
