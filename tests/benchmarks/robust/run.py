"""Benchmark of the robustness certificate; `make bench-robust` writes results/bench_robust.json.

Random stable and unstable loops, bounds of the structured singular value and their replay, peaks against a fine search,
coverage of the bounds by identification on known plants, measured sensitivity of the nonlinear simulator, time, and the
disk margins of python-control on the same loops.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from amb_core.ground.errors import RobustnessError
from amb_core.identification import IdentificationData, estimate_uncertainty
from amb_core.linear import LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import KnownController
from amb_core.robustness import Block, Feedback, RobustnessSettings, assess, feedback_of, mu_peak, peak_gain
from amb_core.robustness.assessment import assess_loop
from amb_core.robustness.margins import disk_margin_of_axis
from amb_core.robustness.replay import distance_from_circle
from amb_core.robustness.structure import uncertain_loop
from tests.benchmarks.robust.again import again
from tests.benchmarks.robust.hidden_modes import hidden_modes
from tests.benchmarks.robust.loops import SAMPLE_TIME, random_loop
from tests.benchmarks.robust.misfit import demo, misfit, over_refusal
from tests.benchmarks.robust.monte_carlo import Bearing, Rotor, coverage, multisine, rotor4, rotor_controller
from tests.benchmarks.robust.records import Size, records, say
from tests.benchmarks.robust.swept import swept
from tests.front_door.results import Results

GRID = np.geomspace(0.5, 4_999.0, 300)
SMALLEST: dict[str, Any] = {
    "runs": 1, "steps": 2_000, "sampled": 4, "repetitions": 1, "frequencies": 50, "identification": 1.0, "sweep": 1.0,
}  # fmt: skip
"""What `--quick` takes."""


def unstable(size: Size) -> dict[str, int]:
    """Unstable loops for which margins are given."""

    def one(seed: int) -> dict[str, bool]:
        try:
            assess(*random_loop(seed, False))
        except RobustnessError:
            return {"certified": False}
        return {"certified": True}

    certified = [item["certified"] for item in records("unstable", size, size.runs, one)]
    return {"loops": size.runs, "certified": sum(certified)}


def mu(size: Size) -> dict[str, float]:
    """Bounds of mu for complex perturbations of all inputs and outputs, and for the mixed ones of a certificate."""
    settings = RobustnessSettings()

    def bounded(system: LinearSystem, blocks: Sequence[Block]) -> dict[str, float]:
        peak = mu_peak(system, blocks, GRID)
        replayed = len(peak.perturbation) > 0
        apart = distance_from_circle(system, peak.perturbation, peak.lower_frequency) if replayed else math.inf
        return {"gap": 100.0 * (peak.upper - peak.lower) / peak.upper, "found": replayed, "on_circle": apart < 1e-6}

    def one(seed: int) -> dict[str, object]:
        feedback = feedback_of(*random_loop(seed, True))
        axes = len(feedback.closed.c)
        of_all = uncertain_loop(feedback, settings)
        return {
            "complex": bounded(feedback.closed.plus(-0.5 * np.eye(axes)), [Block(f"f{n}") for n in range(axes)]),
            "mixed": bounded(of_all.system, of_all.blocks),
        }

    kept = records("mu", size, size.runs, one)
    gaps, mixed = ([item[kind]["gap"] for item in kept] for kind in ("complex", "mixed"))
    return {
        "loops": size.runs,
        "median_gap_percent": float(np.median(gaps)),
        "worst_gap_percent": float(np.max(gaps)),
        "replayed": sum(item["complex"]["found"] for item in kept),
        "on_circle": sum(item["complex"]["on_circle"] for item in kept),
        "ordered": sum(gap >= -1e-7 for gap in gaps + mixed),
        "mixed_loops": len(mixed),
        "median_mixed_gap_percent": float(np.median(mixed)),
        "worst_mixed_gap_percent": float(np.max(mixed)),
        "mixed_on_circle": sum(item["mixed"]["on_circle"] for item in kept),
    }


def peaks(size: Size) -> dict[str, float]:
    """Largest relative error of peaks against a search that is fine everywhere and finer at its top."""

    def one(seed: int) -> dict[str, float]:
        system = feedback_of(*random_loop(seed, True)).output_sensitivity
        return {"error": abs(peak_gain(system).value / _fine_search(system) - 1.0)}

    loops = min(size.runs, 50)
    return {"loops": loops, "error": max(item["error"] for item in records("peak", size, loops, one))}


def _fine_search(system: LinearSystem) -> float:
    grid = np.unique(np.concatenate([np.linspace(0.0, 5_000.0, 20_001), np.geomspace(0.01, 5_000.0, 20_000)]))
    for _ in range(4):
        sizes = np.linalg.norm(system.response(grid), 2, axis=(1, 2))
        top = int(np.argmax(sizes))
        grid = np.linspace(grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)], 2_001)
    return float(sizes.max())


def seconds(size: Size) -> dict[str, float]:
    """Everything with 500 frequencies: order 10, two axes; order 16, four axes; wall clock and processor."""
    bearing = Bearing()
    cases = {
        "two_by_two": (bearing.true, bearing.feedback, bearing.data(0, size.steps)),
        "four_by_four": _order_16(size.steps),
    }
    results = {}
    for name, (model, feedback, record) in cases.items():
        uncertainty = estimate_uncertainty(model, IdentificationData.from_arrays(*record, model.sample_time))
        used, spent = [], []
        for _ in range(size.repetitions):
            start, at = time.perf_counter(), time.process_time()
            assess_loop(feedback(model), RobustnessSettings(frequencies=float(size.frequencies)), uncertainty)
            spent.append(time.perf_counter() - start)
            used.append(time.process_time() - at)
        results[name], results[f"{name}_cpu"] = min(spent), min(used)
    return results


def _order_16(steps: int):
    """The rotor with two bending modes more, seen and moved alike at both bearings, and a record of its loop."""
    rotor = rotor4()
    angle = 2.0 * np.pi * 800.0 * SAMPLE_TIME
    mode = 0.998 * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    shape = np.kron(np.array([[1.0], [0.7]]), np.eye(2))  # of the ends, in x and y
    by_force = np.kron(np.eye(2), [[0.0], [1.0]])
    loop = replace(
        rotor,
        a=block_diag(rotor.a, mode, mode),
        b=np.vstack([rotor.b, by_force @ shape.T * 2e-8]),
        c=np.hstack([rotor.c, shape @ np.kron(np.eye(2), [[1.0, 0.0]])]),
        force=np.vstack([rotor.force, by_force @ shape.T @ np.ones((4, rotor.force.shape[1])) * 1e-10]),
    )
    record = loop.run(multisine(4, steps, np.random.default_rng(0)), np.random.default_rng(1))

    def feedback(model: StateSpaceModel) -> Feedback:
        return Feedback(model, rotor_controller())

    return loop.true_model, feedback, record


def peers(size: Size) -> list[dict[str, object]]:
    """Disk margins of the first axis, all others closed: wrong answers for unstable and stable loops, and seconds.

    One axis, since python-control needs the GPL package slycot for several at once and gives no answer without it.
    Wrong for an unstable loop is any margin above 0, the margin of a loop that bears nothing. Wrong for a stable one is
    a margin that a replayed perturbation disproves: one larger, by 0.1 %, than that at which a pole lies on the circle.
    """
    import control

    def ours(plant: StateSpaceModel, law: KnownController) -> float:
        return disk_margin_of_axis(feedback_of(plant, law), 0).guaranteed

    def python_control(plant: StateSpaceModel, law: KnownController) -> float:
        loop = feedback_of(plant, law).at_axis(0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return float(control.disk_margins(control.ss(loop.a, loop.b, loop.c, loop.d, loop.sample_time), omega)[0])

    omega = 2.0 * np.pi * GRID
    methods = (("amb_core.robustness", ours), (f"python-control {control.__version__}", python_control))

    def one(seed: int) -> dict[str, object]:
        record: dict[str, object] = {}
        broken = disk_margin_of_axis(feedback_of(*random_loop(seed, True)), 0).broken
        for name, method in methods:
            results = {"margin": _margin(method, seed, False)}
            start = time.process_time()
            results["stable_margin"] = _margin(method, seed, True)
            results["seconds"] = time.process_time() - start
            record[name] = {**results, "broken": broken}
        return record

    kept = records("peers", size, size.runs, one)
    rows: list[dict[str, object]] = []
    for name, _ in methods:
        results = [item[name] for item in kept]
        of_unstable = sum((item["margin"] or 0.0) > 0.0 for item in results)
        of_stable = sum((item["stable_margin"] or 0.0) > item["broken"] * 1.001 for item in results)
        rows.append({
            "name": name, "loops": 2 * size.runs, "wrong": of_unstable + of_stable,
            "wrong_unstable": of_unstable, "wrong_stable": of_stable,
            "no_answer_stable": sum(item["stable_margin"] is None for item in results),
            "seconds": sum(item["seconds"] for item in results),
            "median_of_exact": float(np.median([
                item["stable_margin"] / item["broken"] for item in results if item["stable_margin"] is not None
            ])),
        })  # fmt: skip
    return rows


def _margin(method: Callable[[StateSpaceModel, KnownController], float], seed: int, stable: bool) -> float | None:
    """The margin that a method gives a loop; None where it gives none."""
    try:
        value = method(*random_loop(seed, stable))
    except Exception as problem:  # of a peer: any kind
        if not isinstance(problem, RobustnessError):
            say(f"peers, loop {seed}: {type(problem).__name__}: {problem}")
        return None
    return value if math.isfinite(value) else None


def main() -> None:
    """Run the parts and write the file; parts that are not run keep their last numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200, help="loops, and experiments on each plant")
    parser.add_argument("--parts", nargs="*", default=list(PARTS), choices=list(PARTS))
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    chosen = parser.parse_args()
    results = Results("bench_robust.json", chosen.quick)
    size = Size(results.file.with_suffix(""), chosen.runs)
    if chosen.quick:
        size = replace(size, **SMALLEST)
        shutil.rmtree(size.folder, ignore_errors=True)
    for name in chosen.parts:
        figures = PARTS[name](size)
        results.keep(name, {name: figures})
        say(f"{name}: {json.dumps(figures)}")
    if set(chosen.parts) == set(PARTS):
        results.drop_others([*PARTS, "emulator"])  # which `emulator.py` measures


def _coverage(size: Size) -> dict[str, object]:
    cases = {case.name: coverage(case, size) for case in (Bearing(), Rotor())}
    return {
        "runs": size.runs,
        "inside": min(one["inside"] for one in cases.values()),
        "width_ratio": max(one["width_ratio"] for one in cases.values()),
        "plants": cases,
    }


PARTS: dict[str, Callable[[Size], Any]] = {
    "unstable": unstable,
    "mu": mu,
    "peak": peaks,
    "swept": lambda size: swept(say, size),
    "seconds": seconds,
    "peers": peers,
    "coverage": _coverage,
    "misfit": misfit,
    "over_refusal": over_refusal,
    "demo": demo,
    "hidden_modes": hidden_modes,
    "again": again,
}
"""What is measured by name; see `figures.BenchRobust`."""


if __name__ == "__main__":
    main()
