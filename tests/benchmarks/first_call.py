"""How long a fresh process takes until the plant has moved for the first time, compiled code coming from the cache."""

from __future__ import annotations

import statistics
import subprocess
import sys

REPETITIONS = 3
PROGRAM = """
import time
started = time.perf_counter()
from amb_core.plant import Plant
imported = time.perf_counter()
Plant().advance((0.0, 0.0))
print(imported - started, time.perf_counter() - imported)
"""


def measure(repetitions: int = REPETITIONS) -> dict[str, float | bool]:
    """Medians of the times (s) of importing the plant, and of making one and advancing it by a sample."""
    _times()  # leaves a warm cache
    imports, calls = zip(*(_times() for _ in range(repetitions)), strict=True)
    return {"import_s": statistics.median(imports), "first_call_s": statistics.median(calls)}


def _times() -> tuple[float, float]:
    output = subprocess.run([sys.executable, "-c", PROGRAM], check=True, capture_output=True, text=True).stdout
    imported, called = output.split()
    return float(imported), float(called)


if __name__ == "__main__":
    print(measure())
