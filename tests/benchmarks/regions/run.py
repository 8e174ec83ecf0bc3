"""Counts behind the words of region monitor, excitation design and identification, on cases drawn at random.

Every subject is a module of its name with `measure() -> dict` (counts and seeds); the cases of a subject run in
processes, as many as there are cores. Prints a table and writes results/bench_regions.json, each subject as soon as it
is measured; keys of earlier runs that this run does not measure are kept.

    make bench-regions
    python -m tests.benchmarks.regions.run constant_line dead_time    # some subjects only
"""

from __future__ import annotations

from tests.benchmarks.subjects import run_subjects
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
    run_subjects("tests.benchmarks.regions", SUBJECTS, "bench_regions.json", __doc__ or "")


if __name__ == "__main__":
    main()
