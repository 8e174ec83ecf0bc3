"""Figures of the pages that explain, each page a subject: tables of docs/explanation that show what a bearing does.

Every subject is a module of its page's name, or of a part of it, with `measure() -> dict`, its figures and its smallest
size. Prints a table and writes results/bench_explained.json, each subject as soon as it is measured; keys of earlier
runs that this run does not measure are kept.

    make bench-explained
    python -m tests.benchmarks.explained.run distortion plant    # some subjects only
"""

from __future__ import annotations

from tests.benchmarks.explained import (
    distortion,
    excitation,
    identification,
    map_lines,
    map_rates,
    plant,
    region_maps,
    subharmonics,
)
from tests.benchmarks.subjects import run_subjects

PAGES = (distortion, excitation, identification, map_lines, map_rates, plant, region_maps, subharmonics)


def main() -> None:
    """Measure and report."""
    subjects = {page.__name__.rpartition(".")[2]: page.SMALLEST for page in PAGES}
    run_subjects("tests.benchmarks.explained", subjects, "bench_explained.json", __doc__ or "")


if __name__ == "__main__":
    main()
