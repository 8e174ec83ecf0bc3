"""Starts one part of the verdicts by itself, with a seed of one's own: its population is then another one."""

from __future__ import annotations

import argparse
import sys
from typing import Protocol

from rich.console import Console


class Part(Protocol):
    """A part: `quick` takes few cases, `progress` is called with the cases done and all of them."""

    def __call__(self, quick: bool, progress: object, seed: int) -> dict[str, int]: ...


def start_alone(run: Part) -> None:
    """Measure and print the counts."""
    description = (sys.modules["__main__"].__doc__ or "").split("\n")[0]
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--quick", action="store_true", help="few cases")
    parser.add_argument("--seed", type=int, help="of the population; that of the results file by default")
    arguments = parser.parse_args()
    console = Console()
    with console.status("measuring") as status:

        def progress(done: int, cases: int) -> None:
            status.update(f"{done} of {cases} cases")

        seed = {} if arguments.seed is None else {"seed": arguments.seed}
        counts = run(arguments.quick, progress, **seed)
    console.print(", ".join(f"{name} {value}" for name, value in counts.items()))
