"""`make fuzz`: hostile messages against the whole graph, with and without field checks; writes results/fuzz.json."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tests.front_door.results import results_file
from tests.fuzz.attacked_graph import open_graph
from tests.fuzz.campaign import Campaign, Outcome

QUICK = 20  # cases of a campaign at its smallest size


def attack(check_fields: bool, seed: int, share: Callable[[int], float], first: int = 0) -> Outcome:
    """One campaign, from its first case until its share is 1."""
    outcome = Outcome(seed, check_fields)
    name = "with field checks" if check_fields else "without field checks"
    with tempfile.TemporaryDirectory(prefix="fuzz") as folder, open_graph(Path(folder), check_fields) as graph:
        campaign = Campaign(graph, Path(folder), outcome)
        campaign.run(share, first, lambda line: print(f"{name}: {line}", flush=True))
    for finding in outcome.findings:
        print(f"{finding.kind} of {finding.node}, case {finding.case}: {finding.target}\n{finding.what}\n", flush=True)
    return outcome


def for_minutes(minutes: float) -> Callable[[int], float]:
    """The share of a campaign that takes a time, which begins now."""
    began = time.monotonic()
    return lambda _sent: (time.monotonic() - began) / (60.0 * minutes)


def summary(outcomes: list[Outcome], seed: int) -> dict[str, object]:
    """The counts of all campaigns together, and each of them."""
    total = {name: sum(getattr(item, name) for item in outcomes) for name in ("requests", "messages", "parameters")}
    return total | {
        "deaths": sum(item.count("death") for item in outcomes),
        "internal_errors": sum(item.count("internal_error") for item in outcomes),
        "memory_growth_percent": max(item.memory_growth_percent for item in outcomes),
        "seed": seed,
        "seconds": sum(item.seconds for item in outcomes),
        "campaigns": [item.as_dict() for item in outcomes],
    }


def main() -> int:
    """Run the campaigns that the command line asks for; 1 if anything was found."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--minutes", type=float, default=10.0, help="for both campaigns together")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--quick", action="store_true", help=f"{QUICK} cases, into results/quick")
    options.add_argument("--case", type=int, help="send this case alone, to look into a finding")
    chosen = options.parse_args()
    signal.signal(signal.SIGTERM, lambda number, _frame: sys.exit(128 + number))  # so that the nodes are ended
    outcomes = []
    for check_fields in (False, True):
        if chosen.quick:
            outcomes.append(attack(check_fields, chosen.seed, lambda sent: sent / QUICK))
        elif chosen.case is None:
            outcomes.append(attack(check_fields, chosen.seed, for_minutes(0.5 * chosen.minutes)))
        else:
            outcomes.append(attack(check_fields, chosen.seed, float, chosen.case))
    figures = summary(outcomes, chosen.seed)
    results_file("fuzz.json", chosen.quick).write_text(json.dumps(figures, indent=1) + "\n")
    print(json.dumps({name: value for name, value in figures.items() if name != "campaigns"}))
    return 1 if figures["deaths"] or figures["internal_errors"] else 0


if __name__ == "__main__":
    raise SystemExit(main())
