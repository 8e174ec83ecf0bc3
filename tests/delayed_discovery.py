"""A library that lets processes leave the graph at the worst moment; see `delayed_discovery.c`."""

from __future__ import annotations

import subprocess
from pathlib import Path


def build_delayed_discovery(library: Path) -> None:
    """Compile it."""
    source = Path(__file__).with_name("delayed_discovery.c")
    subprocess.run(["gcc", "-O1", "-Wall", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)


def delays(library: Path, each: float, held: float, wait: float) -> dict[str, str]:
    """Environment of processes in which each callback, and one that comes while the process leaves, takes longer (s).

    While it leaves, the process waits at most `wait` (s) for one to come.
    """
    times = {"DISCOVERY_DELAY_MS": each, "DISCOVERY_HOLD_MS": held, "DISCOVERY_WAIT_MS": wait}
    return {"LD_PRELOAD": str(library)} | {name: f"{1e3 * value:.0f}" for name, value in times.items()}
