"""Eddy currents of the paper's bearing with both models of its laminations: force, loss, ripple and motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core import plant as machine
from amb_core.excitation import Excitation, Square, Sweep, generate
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant.eddy import eddy_bandwidth, lamination_terms, lamination_time_constant
from amb_core.plant.simulation import simulate
from tests.front_door.figures import Figures
from tests.validation.laminations import switching_losses

MODELS = ("thin", "diffusion")
SETTLING = 5_000  # samples until the rotor has come to rest
DURATION = 0.8  # s, of a motion, whole periods on x, then on y
IN_TURN = "in_turn"
AMPLITUDE = 50e-6  # m
SINES = (5.0, 20.0, 80.0)  # Hz
BEYOND = (2e6, 5e6, 10e6)  # Hz, above the band for which the terms are made
HIGHEST = 1e6  # Hz, end of that band
SMALLEST: dict[str, Any] = {"settling": 20, "duration": 0.005, "loss_samples": 5, "frequencies": 50}


class Model(Figures):
    """A model of the laminations; force bandwidths (kHz) with shared flux and with separate circuits.

    The loss by the switching (W) is that of the closed form and that of the running plant; the least and the largest
    ripple of the coil currents (A) are those at rest, peak to peak; `hangs_um` is how far the rotor rests below the
    centre.
    """

    bandwidth_khz: float
    bandwidth_separate_khz: float
    loss_w: float
    running_loss_w: float
    least_ripple_a: float
    largest_ripple_a: float
    hangs_um: float


class Terms(Figures):
    """The decaying terms of `diffusion`: their number, and errors of the drop (%) in their band and above it."""

    number: int
    error_percent: float
    beyond_mhz: list[float]
    beyond_percent: list[float]


class Apart(Figures):
    """How far apart the rotor is with both models (nm): at rest, and at most under sines and squares of 50 um."""

    rest_nm: float
    sine_hz: list[float]
    sine_nm: list[float]
    squares_nm: float


class Plant(Figures):
    """Both models; `thin` is valid below the frequency (Hz)."""

    valid_below_hz: float
    thin: Model
    diffusion: Model
    terms: Terms
    apart: Apart


def measure(
    settling: int = SETTLING, duration: float = DURATION, loss_samples: int = 200, frequencies: int = 5_000
) -> dict[str, object]:
    """Both models, with as many samples to come to rest, motions of a duration (s) and frequencies of the terms."""
    models = {name: _model(name, settling, loss_samples) for name in MODELS}
    hangs = [float(one["hangs_um"]) for one in models.values()]
    return {
        "valid_below_hz": 1.0 / (2.0 * np.pi * lamination_time_constant(machine.PlantParameters())),
        **models,
        "terms": _terms(frequencies),
        "apart": {"rest_nm": 1e3 * (hangs[1] - hangs[0]), **_motions_apart(settling, duration)},
    }


def _parameters(laminations: str, coupling: bool = True) -> machine.PlantParameters:
    names = {"iron.laminations": laminations, "magnetic_circuit.coupling": coupling}
    return validate(machine.PlantParameters, names)


def _model(name: str, settling: int, loss_samples: int) -> dict[str, Any]:
    parameters = _parameters(name)
    loss, running_loss = switching_losses(parameters, loss_samples)
    bearing, controller = machine.Plant(parameters), PdController(ControllerParameters())
    for _ in range(settling):
        bearing.advance(controller.update(bearing.position, (0.0, 0.0)))
    hangs = -1e6 * bearing.position[1]
    ripple = np.ptp(bearing.trace(controller.update(bearing.position, (0.0, 0.0))).current, axis=0)
    return {
        "bandwidth_khz": 1e-3 * eddy_bandwidth(parameters),
        "bandwidth_separate_khz": 1e-3 * eddy_bandwidth(_parameters(name, coupling=False)),
        "loss_w": loss,
        "running_loss_w": running_loss,
        "least_ripple_a": float(ripple.min()),
        "largest_ripple_a": float(ripple.max()),
        "hangs_um": hangs,
    }


def _terms(frequencies: int) -> dict[str, object]:
    terms = lamination_terms(machine.PlantParameters())
    error = 100.0 * np.abs(terms.error(np.geomspace(1.0, HIGHEST, frequencies)))
    return {
        "number": len(terms.rates),
        "error_percent": float(error.max()),
        "beyond_mhz": [1e-6 * frequency for frequency in BEYOND],
        "beyond_percent": (100.0 * np.abs(terms.error(np.array(BEYOND)))).tolist(),
    }


def _motions_apart(settling: int, duration: float) -> dict[str, object]:
    sines = [
        Sweep(amplitude=AMPLITUDE, duration=duration, axes=IN_TURN, frequency_start=frequency, frequency_end=frequency)
        for frequency in SINES
    ]
    squares = Square(amplitude=AMPLITUDE, duration=duration, axes=IN_TURN)
    *sine_nm, squares_nm = [_apart(motion, settling) for motion in (*sines, squares)]
    return {"sine_hz": list(SINES), "sine_nm": sine_nm, "squares_nm": squares_nm}


def _apart(excitation: Excitation, settling: int) -> float:
    thin, diffusion = (_positions(name, excitation, settling) for name in MODELS)
    return 1e9 * float(np.abs(diffusion - thin).max())


def _positions(laminations: str, excitation: Excitation, settling: int) -> NDArray[np.float64]:
    controller = ControllerParameters()
    signal = generate(excitation, controller.sample_rate)
    bearing, steps = machine.Plant(_parameters(laminations)), settling + signal.steps
    return simulate(bearing, PdController(controller), steps, signal.samples, settling).position
