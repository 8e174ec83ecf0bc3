"""Speed of plant and loop: runs every benchmark, prints a table and writes results/bench.json.

Timings depend on the machine and on what else it does; compare ratios of one run, and runs on one machine.
What cannot be measured here keeps the figures of earlier runs, with their commit in results/bench.measured.json.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Callable

from rich.console import Console
from rich.table import Table

from tests.benchmarks import (
    averaged_plant,
    c_kernel,
    composed,
    first_call,
    lockstep,
    peer_ross,
    plant,
    region_map,
    region_monitor,
)
from tests.benchmarks.skipped import Skipped
from tests.front_door.results import ROOT, Results, processor

Measure = Callable[..., dict[str, float | bool]]
BENCHMARKS: dict[str, list[tuple[Measure, dict[str, float]]]] = {
    "simulator": [
        (plant.measure, {"samples": 200}),
        (c_kernel.measure, {"repetitions": 2}),
        (averaged_plant.measure, {"samples": 10}),
        (first_call.measure, {"repetitions": 1}),
    ],
    "lockstep": [(lockstep.measure, {"rounds": 1, "block": 50})],
    "composed": [(composed.measure, {"steps": 500})],
    "composed4": [(composed.measure_four_axes, {"steps": 500})],
    "lockstep4": [(lockstep.measure_four_axes, {"rounds": 1, "block": 50})],
    "map": [(region_map.measure, {"sweeps": 2, "duration": 0.5})],
    "monitor": [(region_monitor.measure, {"duration": 0.5})],
    "peer_ross": [(peer_ross.measure, {"blocks": 1})],
}
"""What is measured by name, each with the smallest size, which `--quick` takes; see `figures.Bench`."""


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    quick = parser.parse_args().quick
    results = Results("bench.json", quick)
    console = Console()
    table = Table("benchmark", "value", title="make bench")
    for name, measures in BENCHMARKS.items():
        values: dict[str, float | bool] = {}
        try:
            with console.status(f"measuring {name}"):
                for measure, smallest in measures:
                    values |= measure(**smallest if quick else {})
        except Skipped as reason:
            results.skip(name, str(reason))
            table.add_row(name, f"not measured: {reason}")
            continue
        results.keep(name, {name: values})
        for key, value in values.items():
            table.add_row(f"{name}.{key}", f"{value:.4g}" if isinstance(value, float) else str(value))
    machine = {"processor": processor(), "cores": os.cpu_count(), "python": platform.python_version()}
    results.keep("machine", {"machine": machine})
    results.drop_others([*BENCHMARKS, "machine"])
    console.print(table)
    console.print(f"written to {results.file.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
