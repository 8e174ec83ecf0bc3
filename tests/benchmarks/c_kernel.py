"""The plant's kernel against the same equations in plain C (kernel.c): equal states, and which one is faster."""

from __future__ import annotations

import ctypes
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.control import ControllerParameters, PdController
from amb_core.plant import Plant, kernel

SOURCE = Path(__file__).with_name("kernel.c")
COMPILER = ["gcc", "-std=c11", "-O3", "-march=native", "-shared", "-fPIC"]
# Strict IEEE arithmetic as in the kernel, and with the fused multiply-adds that C compilers may use.
BUILDS = {"c": "-ffp-contract=off", "c_fused": "-ffp-contract=fast"}

SAMPLES = 200  # 20 ms of closed loop
STEPS = 2_000  # of a timed call, so that calling does not count
REPETITIONS = 1_000
TOLERANCE = 1e-9

Advance = Callable[[NDArray[np.float64], float, float, int], int]


def measure() -> dict[str, float | bool]:
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
        ours_ns, *plain_ns = _nanoseconds_per_step(plant, ours, *builds.values())
    results: dict[str, float | bool] = {}
    for name, time_ns in zip(builds, plain_ns, strict=True):
        results |= {f"{name}_ns_per_step": time_ns, f"{name}_ratio": ours_ns / time_ns}
    return results


def _kernel(plant: Plant) -> Advance:
    constants, matrices, work, no_trace = plant._constants, plant._matrices, plant._work, np.empty((0, 30))

    def advance(state: NDArray[np.float64], current_x: float, current_y: float, steps: int) -> int:
        return kernel.advance(state, constants, matrices, work, current_x, current_y, steps, no_trace)

    return advance


def _compiled(plant: Plant, library: Path, option: str) -> Advance:
    subprocess.run([*COMPILER, option, "-o", library, SOURCE, "-lm"], check=True)
    function = ctypes.CDLL(str(library)).advance
    function.argtypes = [ctypes.c_void_p] * 3 + [ctypes.c_double] * 2 + [ctypes.c_long]
    constants, matrices = plant._constants, plant._matrices

    def advance(state: NDArray[np.float64], current_x: float, current_y: float, steps: int) -> int:
        return function(state.ctypes.data, constants.ctypes.data, matrices.ctypes.data, current_x, current_y, steps)

    return advance


def _difference(plant: Plant, *kernels: Advance) -> float:
    """Largest difference of the states over 20 ms, relative to the largest magnitude of each kind of state."""
    ours, plain = (_closed_loop(plant, advance) for advance in kernels)
    starts = [kernel.FLUX, kernel.MMF, kernel.X, kernel.VX, kernel.AX, kernel.INTEGRAL, kernel.CURRENT_SUM]
    kinds = np.split(np.arange(kernel.STATE_SIZE), [*starts[1:], kernel.DUTY, kernel.CURRENT_START, kernel.PHASE])
    return max(float(np.abs(ours - plain)[:, kind].max() / np.abs(ours)[:, kind].max()) for kind in kinds)


def _closed_loop(plant: Plant, advance: Advance) -> NDArray[np.float64]:
    """States after every sample under a 100 um square wave: duties at their limits, currents blocked by the diodes."""
    plant.reset()
    state, controller = plant._state, PdController(ControllerParameters())
    states = np.empty((SAMPLES, kernel.STATE_SIZE))
    for sample in range(SAMPLES):
        target = 100e-6 if (sample // 50) % 2 == 0 else -100e-6
        current = controller.update(state[kernel.X], state[kernel.Y], target, 0.0)
        status = advance(state, *current, plant.parameters.steps_per_sample)
        if status != kernel.OK:
            raise RuntimeError(f"kernel ended with status {status} at sample {sample}; expected: {kernel.OK}")
        states[sample] = state
    return states


def _nanoseconds_per_step(plant: Plant, *kernels: Advance) -> list[float]:
    """Median time of an internal step of each kernel, called in turn from the same levitated state."""
    plant.reset()
    controller = PdController(ControllerParameters())
    for _ in range(2_000):
        current = controller.update(*plant.position, 0.0, 0.0)
        plant.advance(*current)
    durations: list[list[float]] = [[] for _ in kernels]
    for _ in range(REPETITIONS):
        for advance, times in zip(kernels, durations, strict=True):
            state = plant._state.copy()
            started = time.perf_counter()
            advance(state, *current, STEPS)
            times.append(time.perf_counter() - started)
    return [statistics.median(times) / STEPS * 1e9 for times in durations]


if __name__ == "__main__":
    print(measure())
