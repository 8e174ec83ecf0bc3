"""Runs what `make test` runs again and again: alone, beside four busy loops, and with the lowest priority.

`make stress` repeats the claim that it passes on any machine, `make test-graph COUNT=10` runs a part of it. Each run is
a process of its own. Its output goes to results/stress, and after every run results/stress.json holds

    {"commit": "0123456789ab", "failures": 0,
     "runs": [{"kind": "idle", "passed": 129, "failed": [], "skipped": 0, "seconds": 210.0}, ...]}

A call that was interrupted, or is followed by one for more runs, resumes on the same commit; --anew begins again.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.front_door.figures import Figures
from tests.front_door.results import ROOT, results_file
from tests.kept_outcomes import KeptOutcomes, checkout

QUICK = (
    "tests/docs/test_how_to.py::test_what_is_left_out_has_a_reason"  # in place of the graph tests, at the smallest size
)
BUSY_LOOPS = 4


class Run(Figures):
    """One run of the tests."""

    kind: str
    passed: int
    failed: list[str]
    skipped: int
    seconds: float


class Stress(Figures):
    """What is written to results/stress.json."""

    commit: str  # with a + where files were changed
    failures: int
    runs: list[Run]


KINDS = ("idle", "loaded", "nice")
SCHEDULE = ("--numprocesses", "4", "--dist", "loadfile", "--no-loadscope-reorder")  # as `make test` runs them


@contextlib.contextmanager
def load(loops: int) -> Iterator[None]:
    """Programs that take all the time of as many cores."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(loops)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def run_once(kind: str, name: str, selection: list[str], folder: Path) -> Run:
    """One run of the tests; what came out of it."""
    report = folder / f"{name}.xml"
    report.unlink(missing_ok=True)
    priority = ["nice", "-n", "19"] if kind == "nice" else []
    tests = [sys.executable, "-m", "pytest", "-m", "not slow", "-p", "no:cacheprovider", f"--junit-xml={report}"]
    tests += SCHEDULE
    began = time.monotonic()
    with report.with_suffix(".txt").open("w") as output, load(BUSY_LOOPS if kind == "loaded" else 0):
        code = subprocess.call([*priority, *tests, *selection], cwd=ROOT, stdout=output, stderr=subprocess.STDOUT)
    passed, failed, skipped = read_report(report)
    if code and not failed:
        failed = [f"pytest ended with exit code {code}, see {report.with_suffix('.txt').relative_to(ROOT)}"]
    return Run(kind=kind, passed=passed, failed=failed, skipped=skipped, seconds=round(time.monotonic() - began, 1))


def read_report(path: Path) -> tuple[int, list[str], int]:
    """How many tests passed, which failed, and how many were skipped, from a JUnit file."""
    cases = ElementTree.parse(path).getroot().iter("testcase") if path.is_file() else ()
    passed, skipped, failed = 0, 0, set()
    for case in cases:
        if case.find("failure") is not None or case.find("error") is not None:
            failed.add(f"{case.get('classname')}::{case.get('name')}")
        elif case.find("skipped") is not None:
            skipped += 1
        else:
            passed += 1
    return passed, sorted(failed), skipped


def write(file: Path, commit: str, runs: list[Run]) -> Counter[str]:
    """Write the results; the failures, by test."""
    failures = Counter(test for run in runs for test in run.failed)
    stress = Stress(commit=commit, failures=failures.total(), runs=runs)
    file.write_text(stress.model_dump_json(indent=2) + "\n")
    return failures


def show(run: Run) -> None:
    """Print what a run came to."""
    print(f"{run.passed} passed, {len(run.failed)} failed, {run.skipped} skipped in {run.seconds} s", flush=True)
    for test in run.failed:
        print(f"  {test}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--idle", type=int, default=0, help="runs alone on the machine")
    parser.add_argument("--loaded", type=int, default=0, help=f"runs beside {BUSY_LOOPS} busy loops")
    parser.add_argument("--nice", type=int, default=0, help="runs with the lowest priority")
    parser.add_argument("tests", nargs="*", help="what to run, as pytest takes it; without them all")
    parser.add_argument("--anew", action="store_true", help="also what has been run on this commit")
    parser.add_argument("--quick", action="store_true", help="one small run of each kind, into results/quick")
    settings = parser.parse_args()
    if settings.quick:
        settings.idle, settings.loaded, settings.nice, settings.tests = 1, 1, 1, [QUICK]
    file = results_file("stress.json", settings.quick)
    folder = file.with_suffix("")
    folder.mkdir(exist_ok=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # through the ends of the processes that run beside
    commit = checkout()
    file_of_runs = folder / "runs.jsonl" if commit and not settings.quick else None
    kept = KeptOutcomes(file_of_runs, " ".join([commit, *settings.tests]), Run.model_dump, Run.model_validate)
    if settings.anew:
        kept.forget()
    runs = kept.load()
    have = Counter(run.kind for run in runs)
    plan = [kind for kind in KINDS for _ in range(getattr(settings, kind) - have[kind])]
    if runs:
        print(f"{len(runs)} runs of this commit are there; {len(plan)} are left")
    total = len(runs) + len(plan)
    failures = write(file, commit, runs)
    for number, kind in enumerate(plan, len(runs) + 1):
        if checkout() != commit:
            sys.exit(f"the checkout is no longer at {commit}; {number - 1} of {total} runs are in {file}")
        print(f"run {number} of {total}, {kind}: ", end="", flush=True)
        run = run_once(kind, f"{number:02d}_{kind}", settings.tests, folder)
        runs.append(run)
        kept.add(run)
        show(run)
        failures = write(file, commit, runs)
    print(f"{len(runs)} runs, {failures.total()} failures; see {file.relative_to(ROOT)}")
    for test, count in failures.most_common():
        print(f"  {count} times {test}")
    return 1 if failures else 0


if __name__ == "__main__":
    raise SystemExit(main())
