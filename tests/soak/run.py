"""The rig under stress: `make soak`. Writes results/soak.json after every part; a part that fails is named there.

`python -m tests.soak.run --parts link same` runs some parts, `--short` all of them in short forms.
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

from tests.fuzz import target
from tests.soak import parts, trips

RESULTS = Path("results/soak.json")


def target_fuzz(frames: int) -> dict[str, Any]:
    """Hostile frames against the C target under sanitizers, forged commands among them."""
    return fuzz_figures(target.run(frames, seed=1, jobs=2))


def fuzz_figures(found: dict[str, Any]) -> dict[str, Any]:
    """What a run against the target has found, as in the results of the soak."""
    return {
        "fuzz": {"target_frames": found["frames"], "target_findings": len(found["findings"])},
        "forged": {"tried": found["forged"], "accepted": found["accepted"]},
    }


def main() -> int:
    """Run what the command line asks for; 1 if a part could not be run to its end."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--parts", nargs="*", help="only these")
    options.add_argument("--short", action="store_true", help="short forms")
    options.add_argument("--seconds", type=float, help="duration of the soak itself, by default 600")
    given = options.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # nodes are stopped then, too
    short = given.short
    with tempfile.TemporaryDirectory(prefix="amb_soak") as name:
        folder = Path(name)
        every: dict[str, Callable[[], dict[str, Any]]] = {
            "pace": lambda: parts.pace(5.0 if short else 60.0),
            "soak": lambda: parts.soak(folder, given.seconds or (30.0 if short else 600.0)),
            "link": parts.link,
            "same": lambda: parts.same(folder),
            "lifecycle": lambda: parts.lifecycle(folder),
            "trips": lambda: trips.trips(folder, parts.PAPER, 1 if short else 50),
            "kills": lambda: parts.kills(folder, 1 if short else 20),
            "bridge_fuzz": lambda: parts.bridge_fuzz(folder, 20_000 if short else 1_000_000),
            "target_fuzz": lambda: target_fuzz(200_000 if short else 10_000_000),
        }
        failed = 0
        for part in given.parts or every:
            began = time.monotonic()
            try:
                found = every[part]()
            except Exception:
                traceback.print_exc()
                found, failed = {f"{part}_failed": traceback.format_exc(limit=1)}, 1
            _write(found, f"{part}_failed")
            print(f"{part}, {time.monotonic() - began:.0f} s: {json.dumps(found)}", flush=True)
    return failed


def _write(found: dict[str, Any], failure: str) -> None:
    """Add figures to the results; parts that were run before stay, but for a failure that is mended."""
    known: dict[str, Any] = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    known.pop(failure, None)
    for key, value in found.items():
        known[key] = {**known.get(key, {}), **value} if isinstance(value, dict) else value
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(known, indent=2) + "\n")


if __name__ == "__main__":
    raise SystemExit(main())
