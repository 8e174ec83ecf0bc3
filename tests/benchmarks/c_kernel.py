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

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.kernel import layout
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

Advance = Callable[[NDArray[np.float64], int], int]
"""Moves the plant on with control current references x, y (A) over a number of internal steps; returns a status."""


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
    table, no_trace = plant._table, plant._no_trace

    def advance(references: NDArray[np.float64], steps: int) -> int:
        return kernel_advance(table, references, steps, no_trace)

    return advance


def _compiled(plant: Plant, library: Path, option: str) -> Advance:
    """The C kernel on the plant's own arrays, so that neither has better ones."""
    places = {name: value for name, value in vars(layout).items() if isinstance(value, int)}
    places |= {"POLES": POLES, "COILS": COILS}
    macros = [f"-D{name}={value}" for name, value in places.items()]
    subprocess.run([*COMPILER, option, *macros, "-o", library, SOURCE, "-lm"], check=True)
    function = ctypes.CDLL(str(library)).advance
    function.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_long]
    arrays = plant._arrays
    addresses = [array.ctypes.data for array in (arrays.state, arrays.constants, arrays.matrices)]

    def advance(references: NDArray[np.float64], steps: int) -> int:
        return function(*addresses, references.ctypes.data, steps)

    return advance


def _difference(plant: Plant, *kernels: Advance) -> float:
    """Largest difference of the states over 20 ms, relative to the largest magnitude of each kind of state."""
    ours, plain = (_closed_loop(plant, advance) for advance in kernels)
    return max(
        float(np.abs(ours[:, kind] - plain[:, kind]).max() / np.abs(ours[:, kind]).max()) for kind in _kinds_of_state()
    )


def _kinds_of_state() -> list[slice]:
    head = [(layout.PHASE, 3)]  # with counters; the phase is zero after a sample
    rotor = [(layout.POSITION, 2), (layout.VELOCITY, 2), (layout.ACCELERATION, 2)]
    poles = [(layout.FLUX, POLES), (layout.MMF, POLES)]
    coils = [(start, COILS) for start in (layout.INTEGRAL, layout.CURRENT_SUM, layout.DUTY, layout.CURRENT_START)]
    block = [(layout.HEAD_SIZE + start, size) for start, size in poles + coils]
    return [slice(start, start + size) for start, size in head + rotor + block]


def _closed_loop(plant: Plant, advance: Advance) -> NDArray[np.float64]:
    """States after every sample under a 100 um square wave: duties at their limits, currents blocked by the diodes."""
    plant.reset()
    state, controller = plant._arrays.state, PdController(ControllerParameters())
    states = np.empty((SAMPLES, len(state)))
    for sample in range(SAMPLES):
        target = 100e-6 if (sample // 50) % 2 == 0 else -100e-6
        x, y = state[layout.POSITION], state[layout.POSITION + 1]
        references = np.array(controller.update(x, y, target, 0.0))
        status = advance(references, plant.parameters.steps_per_sample)
        if status != layout.OK:
            raise RuntimeError(f"kernel ended with status {status} at sample {sample}; expected: {layout.OK}")
        states[sample] = state
    return states


def _nanoseconds_per_step(plant: Plant, *kernels: Advance) -> list[float]:
    """Median time of an internal step of each kernel, called in turn from the same levitated state."""
    plant.reset()
    controller = PdController(ControllerParameters())
    for _ in range(2_000):
        current = controller.update(*plant.position, 0.0, 0.0)
        plant.advance(*current)
    references, levitated = np.array(current), plant._arrays.state.copy()
    durations: list[list[float]] = [[] for _ in kernels]
    for _ in range(REPETITIONS):
        for advance, times in zip(kernels, durations, strict=True):
            plant._arrays.state[:] = levitated
            started = time.perf_counter()
            advance(references, STEPS)
            times.append(time.perf_counter() - started)
    return [statistics.median(times) / STEPS * 1e9 for times in durations]


if __name__ == "__main__":
    print(measure())
