"""Benchmark of the verdict on models; `make bench-verdicts` writes results/bench_verdicts.json.

Each part draws its own population from seeds and returns its numbers. A part that is not run keeps its last ones.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from typing import Any

from tests.benchmarks.verdicts import after_stop, bad_data, controllers, coverage, distortion
from tests.benchmarks.verdicts.models import true_models, wrong_models
from tests.benchmarks.verdicts.size import SMALLEST, Size
from tests.front_door.results import Results

PARTS: dict[str, Callable[[Size], dict[str, Any]]] = {
    "true": true_models,
    "wrong": wrong_models,
    "controllers": lambda size: controllers.run(size == SMALLEST, quietly),
    "bad_data": lambda size: bad_data.run(size == SMALLEST, quietly),
    "after_stop": lambda size: after_stop.run(size == SMALLEST, quietly),
    "coverage": lambda size: coverage.run(size == SMALLEST, quietly)["coverage"],
    "distortion": lambda size: distortion.run(size == SMALLEST, quietly),
}
"""What is measured, by the name of its key; see `figures.BenchVerdicts`."""


def quietly(_done: int, _cases: int) -> None:
    """Show no progress: each part prints its line when it is done."""


def main() -> None:
    """Run the parts and write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", nargs="*", default=list(PARTS), choices=list(PARTS))
    parser.add_argument("--models", type=int, default=200, help="true models; twice as many wrong ones")
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    chosen = parser.parse_args()
    size = SMALLEST if chosen.quick else Size(chosen.models)
    results = Results("bench_verdicts.json", chosen.quick)
    for name in chosen.parts:
        figures = PARTS[name](size)
        results.keep(name, {name: figures})
        print(f"{name}: {json.dumps(figures)}", flush=True)
    if set(chosen.parts) == set(PARTS):
        results.drop_others(PARTS)


if __name__ == "__main__":
    main()
