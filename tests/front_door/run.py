"""`make quick`: runs the programs of the front door at their smallest size, and checks that they write every key.

`python -m tests.front_door.run tests.validation.run` runs one, with those that write the same file of results. Results,
outputs (.txt) and summary.json are left in results/quick. Three programs run at a time, as they wait more than they
compute. With --again, what fails runs a second time, alone, as continuous integration does on a machine that others
load; the summary names what needed it.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from typing import Any

from domain_coordinator import domain_id

from docs.generators.measured import load, names
from tests.front_door.entries import PROGRAMS, Program
from tests.front_door.figures import problems
from tests.front_door.results import ROOT, results_file, stamps_file, unstamped

AT_A_TIME = 3
LINES = 60  # of the output of a program that fails, which are shown at the end
LONGEST = 900.0  # s, that a program may take on a machine with much other work


@dataclass
class Outcome:
    """What a program came to; skipped are parts that cannot be measured here, with the reason."""

    seconds: float = 0.0
    processor_seconds: float = 0.0
    problems: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    first_run: list[str] = field(default_factory=list)  # problems of a first run, where this is the second


def run_program(program: Program) -> Outcome:
    """Run one program and look at its exit code."""
    outcome, log = Outcome(), results_file(f"{program.module}.txt", quick=True)
    command = [sys.executable, "-m", program.module, "--quick"]
    began = time.monotonic()
    with log.open("w") as output, domain_id() as domain:
        process = subprocess.Popen(
            command, cwd=ROOT, env=os.environ | {"ROS_DOMAIN_ID": str(domain)}, stdout=output,
            stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        stop = threading.Timer(LONGEST, os.killpg, (process.pid, 9))
        stop.start()
        _, status, usage = os.wait4(process.pid, 0)
        stop.cancel()
    outcome.seconds = round(time.monotonic() - began, 1)
    outcome.processor_seconds = round(usage.ru_utime + usage.ru_stime, 1)
    if status:
        outcome.problems.append(f"exit code {os.waitstatus_to_exitcode(status)}")
    return outcome


def run_file(programs: list[Program]) -> dict[str, Outcome]:
    """Run the programs of one file of results, one after the other."""
    file = results_file(programs[0].results, quick=True)
    for old in (file, stamps_file(file)):
        old.unlink(missing_ok=True)
    return {program.module: run_program(program) for program in programs}


def judge(programs: list[Program], outcomes: dict[str, Outcome]) -> None:
    """Check the keys of a file of results and that their code is named, and print what its programs came to.

    In the main thread: the names of commands come from loading these, which handle signals meanwhile.
    """
    file = results_file(programs[0].results, quick=True)
    last = outcomes[programs[-1].module]
    module, _, name = programs[-1].figures.partition(":")
    try:
        results = json.loads(file.read_text())
    except (OSError, ValueError) as problem:
        last.problems.append(f"{file.name}: {problem}")
    else:
        last.problems += [
            f"{file.name}: {text}" for text in problems(getattr(importlib.import_module(module), name), results)
        ]
        if file.name in {load(name).results for name in names()} and (unknown := unstamped(file)):
            last.problems.append(f"{file.name}: the code on which {', '.join(unknown)} was measured is not named")
        last.skipped += [f"{key}: {reason}" for key, reason in _skipped(results)]
    for module, outcome in outcomes.items():
        verdict = "; ".join(outcome.problems) or "right"
        print(f"{module}: {outcome.seconds} s ({outcome.processor_seconds} s of the processor): {verdict}", flush=True)
        for skipped in outcome.skipped:
            print(f"  not run here: {skipped}", flush=True)


def run_again(files: list[list[Program]], before: dict[str, Outcome]) -> dict[str, Outcome]:
    """Run the programs of files a second time, one after the other, and name what failed at the first."""
    outcomes: dict[str, Outcome] = {}
    for programs in files:
        for module in _problems(before, programs):
            print(f"WARNING: {module} failed and runs again; the end of its first output:")
            print(_end_of_output(module), flush=True)
        second = run_file(programs)
        judge(programs, second)
        for module, outcome in second.items():
            outcome.first_run = before[module].problems
        outcomes |= second
    return outcomes


def _problems(outcomes: dict[str, Outcome], programs: list[Program]) -> list[str]:
    return [program.module for program in programs if outcomes[program.module].problems]


def _end_of_output(module: str) -> str:
    log = results_file(f"{module}.txt", quick=True)
    return "\n".join(f"    {line}" for line in log.read_text().splitlines()[-LINES:])


def _skipped(results: Any) -> list[tuple[str, str]]:
    if not isinstance(results, dict):
        return []
    return [
        (key, part["skipped"]) for key, part in results.items() if isinstance(part, dict) and set(part) == {"skipped"}
    ]


def files_of(modules: Sequence[str] = ()) -> list[list[Program]]:
    """The programs of each file of results that one of some modules writes, by default of all."""
    by_file: dict[str, list[Program]] = {}
    for program in PROGRAMS:
        by_file.setdefault(program.results, []).append(program)
    return [
        programs
        for programs in by_file.values()
        if not modules or any(program.module in modules for program in programs)
    ]


def main() -> int:
    """Run what is asked for, by default all; 1 if there is a problem."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    modules = [program.module for program in PROGRAMS]
    parser.add_argument(
        "programs", nargs="*", choices=[*modules, []], metavar="PROGRAM", help=f"of {', '.join(modules)}"
    )
    parser.add_argument("--again", action="store_true", help="run what fails a second time")
    chosen = parser.parse_args()
    files = files_of(chosen.programs)
    files.sort(key=lambda programs: -sum(program.seconds for program in programs))
    began = time.monotonic()
    outcomes: dict[str, Outcome] = {}
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        running = {pool.submit(run_file, programs): programs for programs in files}
        for done in as_completed(running):
            judge(running[done], done.result())
            outcomes |= done.result()
    if chosen.again:
        outcomes |= run_again([file for file in files if _problems(outcomes, file)], outcomes)
    summary = {module: asdict(outcome) for module, outcome in outcomes.items()}
    results_file("summary.json", quick=True).write_text(json.dumps(summary, indent=1) + "\n")
    wrong = [module for module, outcome in outcomes.items() if outcome.problems]
    used = sum(outcome.processor_seconds for outcome in outcomes.values())
    print(f"{len(outcomes)} programs in {time.monotonic() - began:.0f} s, {used:.0f} s of the processor")
    for module in wrong:
        print(f"WRONG: {module}; the end of its output, results/quick/{module}.txt:")
        print(_end_of_output(module))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
