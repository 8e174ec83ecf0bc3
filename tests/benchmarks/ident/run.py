"""Accuracy, time and memory of identification, next to other packages, on a known unstable bearing in closed loop.

Every identification runs in a process of its own with one BLAS thread. Those of other packages run with the interpreter
of an environment in which peers.txt is installed; without it, and in the smallest size, they are left out. Finished
runs are kept in results/bench_ident and not repeated as long as code and packages are the same. Prints a table per data
set and writes results/bench_ident.json: medians of the scores (see `scores`), seconds and peak_mb over the runs that
gave a model, and counts of runs, unstable_poles_right, closed_loop_stable and failures. The row `bound` is what no
unbiased method can beat.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import math
import os
import resource
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.benchmarks.ident import ours, peers, plant, real_data
from tests.benchmarks.ident.bound import bound
from tests.benchmarks.ident.cases import CASES
from tests.benchmarks.ident.scores import innovation_ratio, score
from tests.front_door.imports import closure
from tests.front_door.results import Results

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[2]
PEERS_PYTHON = ROOT / ".venv-peers" / "bin" / "python"
MEMORY_LIMIT = 8 * 1024**3  # bytes
_TABLE_WIDTH = 180
_NOT_DONE = "not done after"  # how the reason of a run begins that took too long
COUNTED = ("unstable_poles_right", "closed_loop_stable")

Run = dict[str, float] | str  # scores of a run, or why it failed
Summary = dict[str, float | str | None]  # medians and counts of a method, and the reason of its first failure


@dataclass(frozen=True)
class Size:
    """How much is measured: samples of an experiment, processor seconds of a run; and where finished runs are kept."""

    folder: Path
    steps: int = plant.STEPS
    limit: int = 120


SMALLEST = {"steps": 6_000}
"""What `--quick` takes, of one seed."""


@dataclass(frozen=True)
class Method:
    """A method, the module that runs it, and the interpreter that has its package."""

    name: str
    module: str
    python: Path


def main() -> None:
    """Measure and report."""
    arguments = arguments_of()
    kept = Results("bench_ident.json", arguments.quick)
    size = Size(kept.file.with_suffix(""), **SMALLEST if arguments.quick else {"limit": arguments.limit})
    if arguments.quick:
        shutil.rmtree(size.folder, ignore_errors=True)
    console = Console()
    console = Console(width=max(console.width, _TABLE_WIDTH))
    methods = methods_of(arguments.peers)
    if arguments.peers is None and not arguments.quick:
        console.print(f"no peers: {PEERS_PYTHON} does not exist; make it a venv with {FOLDER / 'peers.txt'}")
    if arguments.methods:
        methods = [method for method in methods if method.name in arguments.methods]
    for data_set in arguments.data:
        results = _measure(data_set, methods, 1 if arguments.quick else arguments.seeds, size, arguments.patience)
        if not arguments.methods or "bound" in arguments.methods:
            results["bound"] = dict(bound(data_set, size.steps))
        console.print(_table(data_set, results))
        _keep(kept, data_set, results)
    if (path := real_data.find(ROOT)) is not None:
        results = {method.name: _real(method, path, size) for method in methods}
        console.print(_table("cd_player", results))
        _keep(kept, "cd_player", results)
    if not arguments.methods and set(arguments.data) == set(CASES):
        names = [*ours.NAMES, *peers.NAMES, "bound"]
        kept.drop_others(_part(data_set, name) for data_set in (*CASES, "cd_player") for name in names)


def methods_of(peers_python: Path | None) -> list[Method]:
    """Ours, and those of other packages where an interpreter has them."""
    ours_ = [Method(name, "ours", Path(sys.executable)) for name in ours.NAMES]
    return ours_ + [Method(name, "peers", peers_python) for name in peers.NAMES if peers_python]


def arguments_of(words: list[str] | None = None) -> argparse.Namespace:
    """Of the command line; `peers` is None where the other packages are not run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="runs per data set and method")
    parser.add_argument("--data", nargs="*", default=list(CASES), choices=list(CASES))
    parser.add_argument(
        "--methods", nargs="*", choices=[*ours.NAMES, "bound", *peers.NAMES],
        help="only these; `bound` for the bound of Cramer and Rao",
    )  # fmt: skip
    parser.add_argument(
        "--peers", type=Path, help="interpreter that has the other packages, by default that of .venv-peers if it is "
        "there; the smallest size runs them only where one is given",
    )  # fmt: skip
    parser.add_argument("--limit", type=int, default=120, help="processor seconds after which a run counts as failed")
    parser.add_argument(
        "--patience", type=int, default=3, help="runs over the limit after which a method is given up on a data set"
    )
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    arguments = parser.parse_args(words)
    if arguments.peers is None and not arguments.quick and PEERS_PYTHON.exists():
        arguments.peers = PEERS_PYTHON
    if arguments.peers is not None and not arguments.peers.exists():
        parser.error(f"--peers: {arguments.peers} does not exist; make it a venv with {FOLDER / 'peers.txt'}")
    if arguments.peers is None and (lacking := set(arguments.methods or ()) & set(peers.NAMES)):
        parser.error(f"{', '.join(sorted(lacking))}: of other packages; --peers names the interpreter that has them")
    return arguments


def _measure(data_set: str, methods: list[Method], seeds: int, size: Size, patience: int) -> dict[str, Summary]:
    """Scores of each method; one that is over the limit `patience` times is not run with the other seeds."""
    runs: dict[str, list[Run]] = {method.name: [] for method in methods}
    with Progress(transient=True) as progress:
        task = progress.add_task(data_set, total=seeds * len(methods))
        for seed in range(seeds):
            for method in methods:
                progress.update(task, advance=1, description=f"{data_set}, seed {seed}: {method.name}")
                late = [run for run in runs[method.name] if isinstance(run, str) and run.startswith(_NOT_DONE)]
                if len(late) < patience:
                    runs[method.name].append(_run(data_set, seed, method, size))
    return {name: _summary(scores) for name, scores in runs.items()}


def _run(data_set: str, seed: int, method: Method, size: Size) -> Run:
    """Scores of one run, or why it failed; from the disk where it has been made before."""
    described = {"data": data_set, "seed": seed, "method": method.name, "limit": size.limit}
    described["code"] = _version(method.module)
    path = size.folder / f"{hashlib.sha256(json.dumps(described).encode()).hexdigest()[:32]}.json"
    if path.exists():
        kept: Run = json.loads(path.read_text())["run"]
        return kept
    case = CASES[data_set]
    identified = _identify(method, *case.data(seed, size.steps), case.true.order, size.limit)
    run: Run = identified if isinstance(identified, str) else _scores(identified, data_set)
    size.folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(described | {"run": run}))
    return run


def _scores(identified: dict[str, NDArray[np.float64]], data_set: str) -> dict[str, float]:
    scores = {name: float(identified[name]) for name in ("seconds", "peak_mb")}
    scores |= score((identified["a"], identified["b"], identified["c"]), data_set)
    if "innovation_covariance" in identified:
        scores["innovation_ratio"] = innovation_ratio(identified["innovation_covariance"], data_set)
    return {name: float(value) for name, value in scores.items()}


@functools.cache
def _version(module: str) -> str:
    """Checksum of what decides the scores of a module's methods."""
    return hashlib.sha256(b"".join((ROOT / name).read_bytes() for name in sorted(code_of(module)))).hexdigest()


def code_of(module: str) -> set[str]:
    """Files that decide the scores of a module's methods: data, methods and scores, with all that they import."""
    names = [f"{name}.py" for name in (module, "cases", "real_data", "scores", "worker")]
    names += ["peers.txt"] if module == "peers" else []
    return closure(str((FOLDER / name).relative_to(ROOT)) for name in names)


def _real(method: Method, path: Path, size: Size) -> Summary:
    """Fit on the second half of a real experiment after identification from the first half."""
    data = real_data.load(path)
    identified = _identify(method, *data.first_half, real_data.ORDER, size.limit)
    if isinstance(identified, str):
        return _summary([identified])
    scores = {name: float(identified[name]) for name in ("seconds", "peak_mb")}
    return _summary(
        [scores | real_data.score((identified["a"], identified["b"], identified["c"]), identified.get("k"), data)]
    )


def _identify(
    method: Method, inputs: NDArray[np.float64], outputs: NDArray[np.float64], order: int, limit: int
) -> dict[str, NDArray[np.float64]] | str:
    """What the worker saves; the reason where it fails or takes too long."""
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        data, result = Path(folder) / "data.npz", Path(folder) / "result.npz"
        np.savez(data, inputs=inputs, outputs=outputs, sample_time=plant.SAMPLE_TIME, order=order)
        try:
            subprocess.run(
                [method.python, FOLDER / "worker.py", method.module, method.name, data, result],
                env=os.environ | threads, check=True, capture_output=True, preexec_fn=partial(_limit, limit),
            )  # fmt: skip
        except subprocess.CalledProcessError as problem:
            if problem.returncode == -signal.SIGXCPU:
                return f"{_NOT_DONE} {limit} s"
            lines = problem.stderr.decode(errors="replace").strip().splitlines()
            return lines[-1] if lines else f"ended by signal or status {problem.returncode}"
        with np.load(result) as archive:
            return dict(archive)


def _limit(processor_seconds: int) -> None:
    """Bound a worker by the processor's time, not the clock's, which other programs on the machine would lengthen."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    resource.setrlimit(resource.RLIMIT_CPU, (processor_seconds, processor_seconds + 5))


def _summary(runs: list[Run]) -> Summary:
    """Medians over the runs that gave a model, counts, and the reason of the first failure."""
    good = [run for run in runs if not isinstance(run, str)]
    summary: Summary = {}
    for name in good[0] if good else ():
        if name not in COUNTED:
            median = statistics.median(run[name] for run in good)
            summary[name] = median if math.isfinite(median) else None  # JSON has no infinity
    counts = {name: sum(bool(run[name]) for run in good) for name in COUNTED if good and name in good[0]}
    summary |= {"runs": len(runs)} | counts | {"failures": len(runs) - len(good)}
    reasons = [run for run in runs if isinstance(run, str)]
    return summary | ({"reason": reasons[0]} if reasons else {})


def _table(title: str, results: dict[str, Summary]) -> Table:
    columns = list(dict.fromkeys(name for summary in results.values() for name in summary))
    table = Table("method", *(column.replace("_", " ") for column in columns), title=title)
    for method, summary in results.items():
        table.add_row(method, *(_cell(summary.get(name, "-")) for name in columns))
    return table


def _cell(value: float | str | None) -> str:
    return "diverges" if value is None else value if isinstance(value, str) else f"{value:.5g}"


def _keep(kept: Results, data_set: str, results: dict[str, Summary]) -> None:
    """Write the results of a data set, each method a part; those of other methods and data sets stay."""
    for method, summary in results.items():
        kept.keep(_part(data_set, method), {data_set: {method: summary}})


def _part(data_set: str, method: str) -> str:
    return f"{data_set}, {method}"


if __name__ == "__main__":
    main()
