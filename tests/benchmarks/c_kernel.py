"""The plant's kernel against the same equations in plain C (kernel.c): equal states, and which one is faster.

Compared is the paper's plant: one bearing, linear iron, coupling, eddy currents, switching, point mass. C has that
alone; the kernel also asks at every step which effects beyond it are on.
"""

from __future__ import annotations

import ctypes
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.kernel import records
from amb_core.plant.kernel.advance import advance as kernel_advance
from amb_core.plant.network import COILS, POLES

SOURCE = Path(__file__).with_name("kernel.c")
COMPILER = ["gcc", "-std=c11", "-O3", "-march=native", "-shared", "-fPIC"]
# Strict IEEE arithmetic as in the kernel, and with the fused multiply-adds that C compilers may use.
BUILDS = {"c": "-ffp-contract=off", "c_fused": "-ffp-contract=fast"}

SAMPLES = 200  # 20 ms of closed loop
STEPS = 2_000  # of a timed call, so that calling does not count
REPETITIONS = 1_000
TOLERANCE = 1e-9
STATES = ("position", "velocity", "acceleration", "flux", "previous_drop")
STATES += ("integral", "current_sum", "current_start", "duty")

Advance = Callable[[NDArray[np.float64], int], int]
"""Moves the plant on with control current references x, y (A) over a number of internal steps; returns a status."""


def measure(repetitions: int = REPETITIONS) -> dict[str, float | bool]:
    """Time of an internal step in C (ns), and that of the kernel over it, for both builds.

    Raises
    ------
    RuntimeError
        If the states differ by more than 1e-9 of the largest of their kind.
    """
    plant = Plant()
    ours = _kernel(plant)
    with tempfile.TemporaryDirectory() as folder:
        builds = {name: _compiled(plant, Path(folder) / f"{name}.so", option) for name, option in BUILDS.items()}
        for name, advance in builds.items():
            difference = _difference(plant, ours, advance)
            if not difference <= TOLERANCE:
                raise RuntimeError(f"states of kernel and {name} differ by {difference:.3g}; allowed: {TOLERANCE:g}")
        ours_ns, *plain_ns = _nanoseconds_per_step(plant, repetitions, ours, *builds.values())
    results: dict[str, float | bool] = {}
    for name, time_ns in zip(builds, plain_ns, strict=True):
        results |= {f"{name}_ns_per_step": time_ns, f"{name}_ratio": ours_ns / time_ns}
    return results


def _kernel(plant: Plant) -> Advance:
    arrays, no_trace = plant._arrays, plant._no_trace

    def advance(references: NDArray[np.float64], steps: int) -> int:
        return kernel_advance(*arrays, references, steps, no_trace)

    return advance


def _compiled(plant: Plant, library: Path, option: str) -> Advance:
    """The C kernel on the plant's own records, so that neither has better ones."""
    numbers = ("OK", "DELEVITATED", "NOT_FINITE")
    macros = [f"-D{name}={getattr(records, name)}" for name in numbers] + [f"-DPOLES={POLES}", f"-DCOILS={COILS}"]
    kinds = {"Constants": records.CONSTANTS, "State": records.STATE, "Bearing": records.BEARING}
    declarations = "\n".join(f"typedef {_c_type(kind)} {name};" for name, kind in kinds.items())
    library.with_name("records.h").write_text(f"#include <stdbool.h>\n#include <stdint.h>\n{declarations}\n")
    command = [*COMPILER, option, *macros, f"-I{library.parent}", "-o", library, SOURCE, "-lm"]
    subprocess.run(command, check=True)
    function = ctypes.CDLL(str(library)).advance
    function.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_long]
    arrays = plant._arrays
    addresses = [array.ctypes.data for array in (arrays.state, arrays.bearings, arrays.constants)]

    def advance(references: NDArray[np.float64], steps: int) -> int:
        return function(*addresses, references.ctypes.data, steps)

    return advance


def _c_type(kind: np.dtype[Any]) -> str:
    """A record's type in C, where its fields lie at the same places."""
    if kind.fields is None:
        return {"f": "double", "i": "int64_t", "b": "bool"}[kind.kind]
    members = []
    for name, (field, *_) in kind.fields.items():
        sizes = "".join(f"[{size}]" for size in field.shape)
        members.append(f"{_c_type(field.base)} {name}{sizes};")
    return f"struct {{ {' '.join(members)} }}"


def _difference(plant: Plant, *kernels: Advance) -> float:
    """Largest difference of the states over 20 ms, relative to the largest magnitude of each kind of state."""
    ours, plain = (_closed_loop(plant, advance) for advance in kernels)
    return max(float(np.abs(ours[name] - plain[name]).max() / np.abs(ours[name]).max()) for name in STATES)


def _closed_loop(plant: Plant, advance: Advance) -> NDArray[Any]:
    """States after every sample under a 100 um square wave: duties at their limits, currents blocked by the diodes."""
    plant.reset()
    bearings, controller = plant._arrays.bearings, PdController(ControllerParameters())
    states = np.empty(SAMPLES, bearings.dtype)
    for sample in range(SAMPLES):
        target = 100e-6 if (sample // 50) % 2 == 0 else -100e-6
        x, y = bearings["position"][0]
        references = np.array(controller.update((x, y), (target, 0.0)))
        status = advance(references, plant.parameters.steps_per_sample)
        if status != records.OK:
            raise RuntimeError(f"kernel ended with status {status} at sample {sample}; expected: {records.OK}")
        states[sample] = bearings[0]
    return states


def _nanoseconds_per_step(plant: Plant, repetitions: int, *kernels: Advance) -> list[float]:
    """Median time of an internal step of each kernel, called in turn from the same levitated state."""
    plant.reset()
    controller = PdController(ControllerParameters())
    for _ in range(2_000):
        current = controller.update(plant.position, (0.0, 0.0))
        plant.advance(current)
    references, arrays = np.array(current), plant._arrays
    levitated = arrays.state.copy(), arrays.bearings.copy()
    durations: list[list[float]] = [[] for _ in kernels]
    for _ in range(repetitions):
        for advance, times in zip(kernels, durations, strict=True):
            arrays.state[:], arrays.bearings[:] = levitated
            started = time.perf_counter()
            advance(references, STEPS)
            times.append(time.perf_counter() - started)
    return [statistics.median(times) / STEPS * 1e9 for times in durations]


if __name__ == "__main__":
    print(measure())
