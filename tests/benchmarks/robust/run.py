"""Benchmark of the robustness certificate; `make bench-robust` writes results/bench_robust.json.

Random stable and unstable loops, bounds of the structured singular value and their replay, peaks against a fine search,
coverage of the bounds by identification on known plants, measured sensitivity of the nonlinear simulator, time, and the
disk margins of python-control on the same loops.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from loops import random_loop
from monte_carlo import Bearing, Rotor, coverage, rotor_controller
from records import records, say
from scipy.linalg import block_diag
from swept import swept

from amb_core.errors import RobustnessError
from amb_core.identification import IdentificationData, estimate_uncertainty
from amb_core.robustness import Block, Feedback, Lti, RobustnessSettings, assess, feedback_of, mu_peak, peak_gain
from amb_core.robustness.assessment import assess_loop
from amb_core.robustness.feedback import plant_of
from amb_core.robustness.replay import distance_from_circle
from amb_core.robustness.structure import uncertain_loop

GRID = np.geomspace(0.5, 4_999.0, 300)


def unstable(loops: int) -> dict[str, int]:
    """Unstable loops for which margins are given."""

    def one(seed: int) -> dict[str, bool]:
        try:
            assess(*random_loop(seed, False))
        except RobustnessError:
            return {"certified": False}
        return {"certified": True}

    return {"loops": loops, "certified": sum(item["certified"] for item in records("unstable", loops, one))}


def mu(loops: int) -> dict[str, float]:
    """Bounds of mu for complex perturbations of all inputs and outputs, and for the mixed ones of a certificate."""
    settings = RobustnessSettings()

    def bounded(system: Lti, blocks: Sequence[Block]) -> dict[str, float]:
        peak = mu_peak(system, blocks, GRID)
        found = len(peak.perturbation) > 0
        apart = distance_from_circle(system, peak.perturbation, peak.lower_frequency) if found else math.inf
        return {"gap": 100.0 * (peak.upper - peak.lower) / peak.upper, "found": found, "on_circle": apart < 1e-6}

    def one(seed: int) -> dict[str, object]:
        feedback = feedback_of(*random_loop(seed, True))
        size = len(feedback.closed.c)
        of_all = uncertain_loop(feedback, settings)
        return {
            "complex": bounded(feedback.closed.plus(-0.5 * np.eye(size)), [Block(f"f{n}") for n in range(size)]),
            "mixed": bounded(of_all.system, of_all.blocks),
        }

    kept = records("mu", loops, one)
    gaps, mixed = ([item[kind]["gap"] for item in kept] for kind in ("complex", "mixed"))
    return {
        "loops": loops,
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


def peaks(loops: int) -> dict[str, float]:
    """Largest relative error of peaks against a search that is fine everywhere and finer at its top."""

    def one(seed: int) -> dict[str, float]:
        system = feedback_of(*random_loop(seed, True)).output_sensitivity
        return {"error": abs(peak_gain(system).value / _fine_search(system) - 1.0)}

    return {"loops": loops, "error": max(item["error"] for item in records("peak", loops, one))}


def _fine_search(system: Lti) -> float:
    grid = np.unique(np.concatenate([np.linspace(0.0, 5_000.0, 20_001), np.geomspace(0.01, 5_000.0, 20_000)]))
    for _ in range(4):
        sizes = np.linalg.norm(system.response(grid), 2, axis=(1, 2))
        top = int(np.argmax(sizes))
        grid = np.linspace(grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)], 2_001)
    return float(sizes.max())


def seconds() -> dict[str, float]:
    """Everything with 500 frequencies: order 10, two axes; order 16, four axes."""
    bearing, rotor = Bearing(), Rotor()
    found = {}
    for name, case, feedback in (
        ("two_by_two", bearing, bearing.feedback(bearing.true)),
        ("four_by_four", rotor, None),
    ):
        inputs, outputs = case.data(0)
        uncertainty = estimate_uncertainty(
            case.true, IdentificationData.from_arrays(inputs, outputs, case.true.sample_time)
        )
        loop = feedback or case.feedback(case.true)
        assess_loop(loop, RobustnessSettings(), uncertainty)  # the first call compiles
        start, used = time.perf_counter(), time.process_time()
        assess_loop(loop, RobustnessSettings(), uncertainty)
        found[name] = time.perf_counter() - start
        found[f"{name}_cpu"] = time.process_time() - used
    found["four_by_four_order_16_without_bounds_cpu"] = _order_16()
    return found


def _order_16() -> float:
    """The rotor with two bending modes more, seen and moved alike at both bearings; no covariance."""
    plant = plant_of(Rotor().true)
    angle = 2.0 * np.pi * 800.0 * plant.sample_time
    mode = 0.998 * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    a = block_diag(plant.a, mode, mode)
    shape = np.kron(np.array([[1.0], [0.7]]), np.eye(2))  # of the ends, in x and y
    b = np.vstack([plant.b, np.kron(np.eye(2), [[0.0], [1.0]]) @ shape.T * 2e-8])
    c = np.hstack([plant.c, shape @ np.kron(np.eye(2), [[1.0, 0.0]])])
    loop = Feedback(Lti(a, b, c, plant.d, plant.sample_time), rotor_controller())
    start = time.process_time()
    assess_loop(loop, RobustnessSettings())
    return time.process_time() - start


def peers(loops: int) -> list[dict[str, object]]:
    """Disk margins at the outputs of unstable loops: who gives a margin, and how long stable ones take."""
    import control

    def ours(plant, law) -> float:
        return assess(plant, law).disks[0].guaranteed

    def python_control(plant, law) -> float:
        feedback = feedback_of(plant, law)
        p, c = ((s.a, s.b, s.c, s.d, s.sample_time) for s in (feedback.plant, feedback.controller))
        loop = control.ss(*p) * control.ss(*c)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return float(control.disk_margins(loop, 2.0 * np.pi * GRID)[0])

    rows: list[dict[str, object]] = []
    for name, method in (("amb certify", ours), (f"python-control {control.__version__}", python_control)):
        wrong, failed, agree, spent = 0, 0, 0, 0.0
        for seed in range(loops):
            try:
                wrong += bool(np.isfinite(method(*random_loop(seed, False))))
            except RobustnessError:
                pass
            except Exception as problem:
                failed += 1
                say(f"{name}: {problem}")
        for seed in range(min(loops, 20)):
            plant, law = random_loop(seed, True)
            start = time.perf_counter()
            try:
                value = method(plant, law)
            except Exception as problem:
                failed += 1
                say(f"{name}: {problem}")
                continue
            spent += time.perf_counter() - start
            agree += abs(value / assess(plant, law).disks[0].guaranteed - 1.0) < 1e-2
        rows.append({"name": name, "loops": loops, "wrong": wrong, "failed": failed, "seconds": spent, "agree": agree})
    return rows


def main() -> None:
    """Run the parts and write the file; parts that are not run keep their last numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200, help="loops, and experiments on each plant")
    parser.add_argument(
        "--parts", nargs="*", default=["unstable", "mu", "peak", "swept", "seconds", "peers", "coverage"]
    )
    chosen = parser.parse_args()
    path = Path("results/bench_robust.json")
    path.parent.mkdir(exist_ok=True)
    results = json.loads(path.read_text()) if path.exists() else {}
    parts = {
        "unstable": lambda: unstable(chosen.runs),
        "mu": lambda: mu(chosen.runs),
        "peak": lambda: peaks(min(chosen.runs, 50)),
        "swept": lambda: swept(say),
        "seconds": seconds,
        "peers": lambda: peers(chosen.runs),
        "coverage": lambda: _coverage(chosen.runs),
    }
    for name in chosen.parts:
        results[name] = parts[name]()
        path.write_text(json.dumps(results, indent=2) + "\n")
        say(f"{name}: {json.dumps(results[name])}")


def _coverage(runs: int) -> dict[str, object]:
    cases = {case.name: coverage(case, runs) for case in (Bearing(), Rotor())}
    return {
        "runs": runs,
        "inside": min(one["inside"] for one in cases.values()),
        "width_ratio": max(one["width_ratio"] for one in cases.values()),
        "plants": cases,
    }


if __name__ == "__main__":
    main()
