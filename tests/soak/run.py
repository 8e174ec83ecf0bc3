"""The rig under stress: `make soak`. Writes results/soak.json after every part; a part that fails is named there.

`python -m tests.soak.run --parts link same` runs some parts, `--quick` all of them at their smallest size.
"""

from __future__ import annotations

import argparse
import json
import signal
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.front_door.results import Results, results_file
from tests.fuzz import target
from tests.soak import board_model, commissioning, conformance, parts, recovery, safety, same, trips

Part = Callable[..., dict[str, Any]]
PARTS: dict[str, tuple[Part, dict[str, float]]] = {
    "pace": (lambda folder, **size: parts.pace(**size), {"seconds": 1.0}),
    "soak": (parts.soak, {"seconds": 9.0}),
    "link": (lambda folder, **size: parts.link(**size), {"samples": 2_000}),
    "same": (same.same, {"duration": 0.2, "frequency_start": 20.0}),
    "lifecycle": (parts.lifecycle, {"count": 9}),
    "trips": (lambda folder, **size: trips.trips(folder, parts.PAPER, **size), {"each": 1}),
    "kills": (parts.kills, {"rounds": 1}),
    "safety": (lambda folder, **size: safety.safety(**size), {"sequences": 2_000}),
    "recovery": (lambda folder, **size: recovery.recovery(**size), {"rounds": 1}),
    "commissioning": (
        lambda folder, **size: commissioning.commissioning(**size),
        {"kinds": 5, "each": 1, "healthy": 1},
    ),
    "conformance": (lambda folder, **size: conformance.conformance(**size), {"most": 3}),
    "board": (lambda folder, **size: board_model.board(**size), {"excited": 20, "multisine_steps": 1_000}),
    "bridge_fuzz": (parts.bridge_fuzz, {"frames": 2_000}),
    "target_fuzz": (lambda folder, **size: target_fuzz(**size), {"frames": 20_000}),
}
"""The parts by name, each with its smallest size, which `--quick` takes; see `figures.Soak`."""


def target_fuzz(frames: int = 10_000_000) -> dict[str, Any]:
    """Hostile frames against the C target under sanitizers, forged commands among them."""
    return fuzz_figures(target.run(frames, seed=1, jobs=2))


def fuzz_figures(fuzzed: dict[str, Any]) -> dict[str, Any]:
    """What a run against the target has found, as in the results of the soak."""
    return {
        "fuzz": {"target_frames": fuzzed["frames"], "target_findings": len(fuzzed["findings"])},
        "forged": {"tried": fuzzed["forged"], "accepted": fuzzed["accepted"]},
    }


def main() -> int:
    """Run what the command line asks for; 1 if a part could not be run to its end."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--parts", nargs="*", choices=list(PARTS), help="only these")
    options.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    options.add_argument("--seconds", type=float, help="duration of the soak itself, by default 600")
    options.add_argument("--runs", type=int, help="most rigs of the part commissioning in this call; the next resumes")
    given = options.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # nodes are stopped then, too
    results = Results("soak.json", given.quick)
    with tempfile.TemporaryDirectory(prefix="amb_soak") as name:
        folder = Path(name)
        failed = 0
        for part in given.parts or PARTS:
            measure, smallest = PARTS[part]
            size: dict[str, Any] = dict(smallest) if given.quick else {}
            if part == "soak" and given.seconds:
                size = {"seconds": given.seconds}
            if part == "commissioning" and not given.quick:
                size = {"file": results_file("commissioning_rigs.jsonl"), "most": given.runs}
            began = time.monotonic()
            try:
                figures = measure(folder, **size)
            except Exception:
                traceback.print_exc()
                figures, failed = {f"{part}_failed": traceback.format_exc(limit=1)}, 1
            results.keep(part, figures)
            print(f"{part}, {time.monotonic() - began:.0f} s: {json.dumps(figures)}", flush=True)
    if not given.parts:
        results.drop_others(PARTS)
    return failed


if __name__ == "__main__":
    raise SystemExit(main())
