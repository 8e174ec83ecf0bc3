"""A user's first hour, in figures: writes results/first_hour.json; keys of parts that are not run stay as they were.

view: the live page in headless Chromium on telemetry of four axes at 10 kHz in real time. latency_ms: from the
publication of a sample until it is drawn, 95 of 100 frames (latency_median_ms: half of them). frames_per_s: frames that
are drawn. core_share: of the server. lost: samples that the page did not get. load_average: of the machine meanwhile,
and its cores. hostile_executed: scripts run, orders carried out and answers given to clients without the token or of
other origins. bit_identical: whether a loop with the page open has the samples of the loop without ROS.
wishes: drawn over all that `amb new` allows; internal are texts of the simulator, and must be none.
tutorial: what its page states, what of that came out when it was followed, its commands and the time that they took.
pages: seconds until a report, and the page of the paper's figures, are drawn; null where there is no such page.
pages: seconds until a report, and the page of the paper's figures, are drawn (load), and until the figures in the
window are (ready); null where there is no such page. sizes: widths (pixels) at which these pages and one of everything
that reports hold are opened, light and dark. overflow: how often one of them was wider than its window; must be 0.
"""

from __future__ import annotations

import argparse
import importlib
import json
from typing import Any

from tests.benchmarks.skipped import Skipped
from tests.front_door.results import Results, results_file

FOLDER = "tests.benchmarks.first_hour"
PARTS: dict[str, tuple[str, dict[str, Any]]] = {
    "view": ("live_page", {"seconds": 1.0, "warm_up": 0.5, "steps": 1_000}),
    "pages": ("pages", {"folder": results_file("pages", quick=True)}),
    "files": ("files", {"cases": 2}),
    "new": ("new", {"bearings": 1}),
    "wishes": ("wishes", {"wishes": 4}),
    "tutorial": ("tutorial", {"sections": 1}),
}
"""The module of each key, whose `measure()` returns the figures, and its smallest size, which `--quick` takes.

See `figures.FirstHour`.
"""


def main() -> None:
    """Measure the parts that are asked for, and keep what is known of the others."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument(
        "parts", nargs="*", choices=[*PARTS, []], metavar="PART", help=f"of {', '.join(PARTS)}; default: all"
    )
    arguments.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    chosen = arguments.parse_args()
    results = Results("first_hour.json", chosen.quick)
    for part in chosen.parts or PARTS:
        module, smallest = PARTS[part]
        try:
            figures = importlib.import_module(f"{FOLDER}.{module}").measure(**smallest if chosen.quick else {})
        except Skipped as reason:
            results.skip(part, str(reason))
            print(f"{part}: not measured: {reason}", flush=True)
            continue
        results.keep(part, {part: figures})
        print(f"{part}: {json.dumps(figures)}", flush=True)
    if not chosen.parts:
        results.drop_others(PARTS)


if __name__ == "__main__":
    main()
