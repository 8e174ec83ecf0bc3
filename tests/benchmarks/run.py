"""Speed of plant and loop: runs every benchmark, prints a table and writes results/bench.json.

Timings depend on the machine and on what else it does; compare ratios of one run, and runs on one machine.
Keys of earlier runs that this run does not measure are kept.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable
from pathlib import Path

import averaged_plant
import c_kernel
import composed
import first_call
import lockstep
import peer_ross
import plant
import region_map
import region_monitor
from rich.console import Console
from rich.table import Table
from skipped import Skipped

RESULTS = Path(__file__).parents[2] / "results" / "bench.json"
BENCHMARKS: dict[str, list[Callable[[], dict[str, float | bool]]]] = {
    "simulator": [plant.measure, c_kernel.measure, averaged_plant.measure, first_call.measure],
    "lockstep": [lockstep.measure],
    "composed": [composed.measure],
    "composed4": [composed.measure_four_axes],
    "lockstep4": [lockstep.measure_four_axes],
    "map": [region_map.measure],
    "monitor": [region_monitor.measure],
    "peer_ross": [peer_ross.measure],
}


def main() -> None:
    """Measure and report."""
    console = Console()
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    table = Table("benchmark", "value", title="make bench")
    for name, measures in BENCHMARKS.items():
        values: dict[str, float | bool] = {}
        try:
            with console.status(f"measuring {name}"):
                for measure in measures:
                    values |= measure()
        except Skipped as reason:
            results.setdefault(name, {})["skipped"] = str(reason)
            table.add_row(name, f"not measured: {reason}")
            continue
        results.get(name, {}).pop("skipped", None)
        results.setdefault(name, {}).update(values)
        for key, value in values.items():
            table.add_row(f"{name}.{key}", f"{value:.4g}" if isinstance(value, float) else str(value))
    results["machine"] = {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
    }
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=2) + "\n")
    console.print(table)
    console.print(f"written to {RESULTS.relative_to(Path.cwd()) if RESULTS.is_relative_to(Path.cwd()) else RESULTS}")


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor()


if __name__ == "__main__":
    main()
