"""A user's first hour, in figures: writes results/first_hour.json; keys of parts that are not run stay as they were.

view: the live page in headless Chromium on telemetry of four axes at 10 kHz in real time. latency_ms: from the
publication of a sample until it is drawn, 95 of 100 frames (latency_median_ms: half of them). frames_per_s: frames that
are drawn. core_share: of the server. lost: samples that the page did not get. load_average: of the machine meanwhile,
and its cores. hostile_executed: scripts run, orders carried out and answers given to clients without the token or of
other origins. bit_identical: whether a loop with the page open has the samples of the loop without ROS.
pages: seconds until a report, and the page of the paper's figures, are drawn; null where there is no such page.
"""

from __future__ import annotations

import argparse
import importlib
import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[3]
RESULTS = ROOT / "results" / "first_hour.json"
FOLDER = "tests.benchmarks.first_hour"
PARTS = {"view": "live_page", "pages": "pages", "files": "files", "new": "new"}
"""The module of each key; its `measure()` returns the figures."""


def main() -> None:
    """Measure the parts that are asked for, and keep what is known of the others."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; default: all")
    found: dict[str, Any] = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for part in arguments.parse_args().parts or PARTS:
        module = f"{FOLDER}.{PARTS[part]}"
        if find_spec(module) is None:
            print(f"{part}: there is no {module}")
            continue
        found[part] = importlib.import_module(module).measure()
        print(f"{part}: {json.dumps(found[part])}", flush=True)
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
