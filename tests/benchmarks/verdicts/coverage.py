"""The part `coverage`: how often the 95 % bands of an identified response contain the truth.

Linear loops of random bearings with 1 or 2 axes, whose noise is white, coloured or drifts. A model of the order of the
plant is identified from each run. The share of a run is that of the points of its response, from 10 Hz to 1 kHz and of
all entries, whose band contains the true magnitude. A kind has the mean over the runs that have a band.

    python -m tests.benchmarks.verdicts.coverage --seed 2
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from amb_core.ground.errors import IdentificationError
from amb_core.identification import Identification, IdentificationData, identify
from amb_core.identification.frequency_response import response_of
from amb_core.linear.model.state_space import StateSpaceModel
from tests.benchmarks.ident.linear_loop import SAMPLE_TIME
from tests.benchmarks.verdicts.alone import start_alone
from tests.benchmarks.verdicts.bearings import Bearing, draw_bearing, excitation

Arrays = NDArray[np.float64]
Noise = Callable[[Bearing, np.random.Generator, int], tuple[Arrays, Arrays]]

RUNS, STEPS, SEED = 200, 10_000, 61
LEVEL = 0.95
FREQUENCIES = np.geomspace(10.0, 1_000.0, 50)  # Hz


def _white(bearing: Bearing, random: np.random.Generator, steps: int) -> tuple[Arrays, Arrays]:
    shape = steps, bearing.axes
    return (
        random.normal(scale=bearing.sensor_noise, size=shape),
        random.normal(scale=bearing.force_noise, size=shape),
    )


def _process(bearing: Bearing, random: np.random.Generator, steps: int) -> tuple[Arrays, Arrays]:
    errors, pushes = _white(bearing, random, steps)
    return 0.1 * errors, 3.0 * pushes


def _coloured(forces: bool, *poles: complex) -> Noise:
    """White noise through a filter with these poles and gain 1 of its rms, of forces or of sensors."""
    by_past = np.poly(poles).real

    def noise(bearing: Bearing, random: np.random.Generator, steps: int) -> tuple[Arrays, Arrays]:
        errors, pushes = _white(bearing, random, steps + 2_000)
        part = pushes if forces else errors
        size = np.std(part)
        coloured = lfilter([1.0], by_past, part, axis=0)
        part[:] = coloured * (size / np.std(coloured))
        return errors[2_000:], pushes[2_000:]

    return noise


def _drift(size: float) -> Noise:
    """White noise and drift of the sensors whose range is so many times the rms of their noise."""

    def noise(bearing: Bearing, random: np.random.Generator, steps: int) -> tuple[Arrays, Arrays]:
        errors, pushes = _white(bearing, random, steps)
        time = np.arange(steps) / steps
        for axis in range(bearing.axes):
            kind = random.integers(3)
            if kind == 0:
                slow = np.cumsum(random.normal(size=steps))
            elif kind == 1:
                slow = time * random.choice([-1.0, 1.0])
            else:
                slow = np.sin(2.0 * np.pi * (random.uniform(0.3, 3.0) * time + random.random()))
            errors[:, axis] += size * bearing.sensor_noise * slow / np.ptp(slow)
        return errors, pushes

    return noise


KINDS: dict[str, Noise] = {
    "white": _white,
    "process_noise": _process,
    "forces_slow": _coloured(True, 0.97),
    "forces_humming": _coloured(True, *(0.995 * np.exp(2j * np.pi * 100.0 * SAMPLE_TIME * np.array([1.0, -1.0])))),
    "sensors_slow": _coloured(False, 0.9),
    "drift_0_3": _drift(0.3),
    "drift_1": _drift(1.0),
    "drift_3": _drift(3.0),
    "drift_10": _drift(10.0),
}


def run(quick: bool, progress: Callable[[int, int], None], seed: int = SEED, runs: int = RUNS) -> dict[str, Any]:
    """Shares of each kind; None where no run has a band."""
    runs = 1 if quick else runs
    shares: dict[str, float | None] = {}
    poles: dict[str, float | None] = {}
    withheld: dict[str, int] = {}
    for place, kind in enumerate(KINDS):
        inside = [
            share
            for number in range(runs)
            if (share := one_run(kind, np.random.default_rng([seed, place, number]))) is not None
        ]
        magnitudes, of_poles = np.mean(inside, axis=0).round(4).tolist() if inside else (None, None)
        shares[kind], poles[kind], withheld[kind] = magnitudes, of_poles, runs - len(inside)
        progress((place + 1) * runs, len(KINDS) * runs)
    return {"coverage": shares, "poles": poles, "withheld": withheld, "runs": runs}


def one_run(kind: str, random: np.random.Generator) -> tuple[float, float] | None:
    """Shares of the true magnitudes and poles that are inside; None without a band."""
    try:
        identification, true = draw(kind, random)
    except IdentificationError:  # data that do not excite every input
        return None
    if identification.uncertainty is None:
        return None
    band = identification.uncertainty.response(FREQUENCIES).magnitude_band(LEVEL)
    assert band is not None
    magnitude = response_of(true, FREQUENCIES).magnitude
    unstable = [pole for pole in true.poles() if abs(pole) > 1.0]
    groups = identification.uncertainty.unstable_poles
    inside = [any(group.holds(complex(pole), LEVEL) for group in groups) for pole in unstable]
    return float(np.mean((band[0] <= magnitude) & (magnitude <= band[1]))), float(np.mean(inside))


def draw(kind: str, random: np.random.Generator) -> tuple[Identification, StateSpaceModel]:
    """The result of `identify` on a run, and the true model."""
    bearing = draw_bearing(random, axes=int(random.integers(1, 3)))
    loop, true = bearing.loop(), bearing.true_model()
    rms = 1e-6 * 10.0 ** random.uniform(0.0, np.log10(20.0))
    shape = str(random.choice(["squares", "multisine", "sweep"]))
    reference = rms * excitation(shape, bearing.axes, STEPS, random)
    errors, pushes = KINDS[kind](bearing, random, STEPS)
    inputs, outputs = loop.respond(reference, errors, pushes)
    data = IdentificationData.from_arrays(
        inputs, outputs, SAMPLE_TIME, reference=reference, input_names=true.input_names,
        output_names=true.output_names, input_units=true.input_units, output_units=true.output_units,
    )  # fmt: skip
    return identify(data, true.order, controller=bearing.controller), true


if __name__ == "__main__":
    start_alone(run)
