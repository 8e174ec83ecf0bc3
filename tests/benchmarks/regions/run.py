"""Counts behind the words of region monitor, excitation design and identification, on cases drawn at random.

Every subject is a module of its name with `measure() -> dict` (counts and seeds); the cases of a subject run in
processes, as many as there are cores. Prints a table and writes results/bench_regions.json, each subject as soon as it
is measured; keys of earlier runs that this run does not measure are kept.

    make bench-regions
    python -m tests.benchmarks.regions.run constant_line dead_time    # some subjects only
"""

from __future__ import annotations

import argparse
import importlib
import json
import time

from rich.console import Console
from rich.table import Table

from tests.front_door.results import ROOT, results_file
from tests.synthetic_telemetry import FAMILIES

SUBJECTS: dict[str, dict[str, float]] = {
    "constant_line": {"cases": 1},
    "constant_line_drift": {"cases": 1},
    "slow_line": {"cases": 1},
    "light_damping": {"cases": 1},
    "planted": {"cases": len(FAMILIES)},
    "design": {"bearings": 1, "new_seeds": 1, "duration": 0.1},
    "turning_map": {"amplitudes": 1, "sweep_end": 100.0},
    "drift_identification": {"seeds": 1, "steps": 3_000, "every": 4},
    "dead_time": {"bearings": 3, "steps": 1_000},
    "lamination": {"terms": 1, "plants": 1},
    "paper_sweeps": {"amplitudes": 1, "sweep_end": 100.0},
}
"""The subjects, each with its smallest size, which `--quick` takes; see `figures.BenchRegions`."""


def main() -> None:
    """Measure and report."""
    arguments = _arguments()
    file = results_file("bench_regions.json", arguments.quick)
    console = Console()
    results = json.loads(file.read_text()) if file.exists() else {}
    table = Table("subject", "counts", "seconds", title="make bench-regions")
    for name in arguments.subjects or SUBJECTS:
        began = time.monotonic()
        with console.status(f"measuring {name}"):
            measure = importlib.import_module(f"tests.benchmarks.regions.{name}").measure
            measured = measure(**SUBJECTS[name] if arguments.quick else {})
        results[name] = measured
        file.write_text(json.dumps(results, indent=2) + "\n")
        counts = ", ".join(f"{key} {value}" for key, value in measured.items())
        table.add_row(name, counts, f"{time.monotonic() - began:.0f}")
    console.print(table)
    console.print(f"written to {file.relative_to(ROOT)}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subjects", nargs="*", choices=[*SUBJECTS, []], help="subjects to measure; default: all")
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    return parser.parse_args()


if __name__ == "__main__":
    main()
