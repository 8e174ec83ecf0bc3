"""Lightly damped modes that nobody knows of, swept: found, or the band says that it was not looked there.

Linear rotors of two axes with one bending mode each, from 10 Hz to 3 kHz, damping 0.001 to 0.02, gain over two decades,
under the PD law of the paper, with noise of sensors and forces. Each is swept from 3 Hz to 2 kHz, then dwelt at.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import cont2discrete

from amb_core.data.experiments import IdentificationData
from amb_core.excitation import Sweep, generate
from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters
from amb_core.robustness import Feedback, MeasuredSensitivity, SweepSettings, measured_sensitivity
from amb_core.robustness.feedback import law_from_positions
from amb_core.robustness.measured import KNOWN
from amb_core.robustness.sweep import HIDDEN, dwells, hidden_in_sensitivity, looked_band, modes_of
from tests.benchmarks.ident.linear_loop import LinearLoop
from tests.benchmarks.robust.records import Size, records

LAW = ControllerParameters(derivative_filter=1e-4, derivative_on="measurement")
STEP = 1.0 / LAW.sample_rate
GAIN, STIFFNESS = 66.0 / 6.25, 3.3e5 / 6.25  # k_i/m (m/(A s^2)), k_s/m (1/s^2)
AMPLIFIER = 2.0 * np.pi * 1_500.0  # 1/s
MODES = 100
CLOSE_DB, CLOSE_FREQUENCY = 0.2, 1e-3
VISIBLE_DB = 0.5  # a peak that stands out less has no frequency


def in_si(inputs: np.ndarray, outputs: np.ndarray, sample_time: float, reference: np.ndarray) -> IdentificationData:
    """Data of currents (A) and positions (m)."""
    units = {"input_units": ("A",) * inputs.shape[1], "output_units": ("m",) * outputs.shape[1]}
    return IdentificationData.from_arrays(inputs, outputs, sample_time, reference=reference, **units)


def hidden_modes(size: Size) -> dict[str, int]:
    """How many are found or named."""
    count = min(MODES, size.runs)
    kept = records("hidden modes", size, count, lambda seed: one_mode(seed, size.sweep))
    return {"modes": count, "found_or_named": sum(item["found"] or item["named"] for item in kept)}


def one_mode(seed: int, duration: float) -> dict[str, float | bool]:
    """Sweep and dwells on the loop of a mode, and whether it was found or named."""
    random = np.random.default_rng([seed, 32])
    while True:
        hertz = float(np.exp(random.uniform(np.log(10.0), np.log(3_000.0))))
        damping, gain = float(10.0 ** random.uniform(-3.0, -1.7)), float(10.0 ** random.uniform(-2.5, -0.5))
        loop = rotor(hertz, damping, gain)
        truth = Feedback(
            LinearSystem(loop.a, loop.b, loop.c, np.zeros((2, 2)), STEP), law_from_positions(LAW, 2), ("x", "y")
        )
        if truth.stable:
            break
    settings = SweepSettings(sweep_amplitude=4e-6, sweep_duration=duration)
    first = swept(loop, settings.excitation, random)
    further = [one for dwell in dwells(first, LAW, settings) for one in swept(loop, dwell, random).experiments]
    data = replace(first, experiments=(*first.experiments, *further))
    measured = measured_sensitivity(data, LAW, modes_of(data, LAW))
    rates = np.log(truth.closed.poles().astype(complex)) / STEP
    pole = min(rates[rates.imag > 0.0], key=lambda rate: abs(abs(rate) / (2.0 * np.pi) - hertz))
    at, zeta = float(abs(pole)) / (2.0 * np.pi), float(-pole.real / abs(pole))
    low, high = looked_band(data, max(min(zeta, 1.0), 1e-3))
    height = float(hidden_in_sensitivity(data, LAW, np.array([at]), max(min(zeta, 1.0), 1e-3))[0])
    return {
        "height": min(height, 1e9),
        "hertz": hertz, "damping": damping, "gain": gain, "closed_hertz": at, "closed_damping": zeta,
        "found": is_found(measured, truth, at, zeta), "named": not low <= at <= high or height > HIDDEN,
    }  # fmt: skip


def is_found(measured: MeasuredSensitivity, truth: Feedback, at: float, zeta: float) -> bool:
    """Whether what is known of S about a mode is true, its peak to 0.2 dB and 0.1 % (a broad one to a fifth of it)."""
    reach = 3.0 * zeta
    fine = at * (1.0 + np.linspace(-reach, reach, 2_001))
    fine = fine[(fine > 0.0) & (fine < 0.5 / STEP)]
    true = np.abs(truth.output_sensitivity.response(fine)[:, 0, 0])
    known = measured.deviation[:, 0] <= KNOWN * np.abs(measured.own[:, 0])
    near = known & (measured.frequency >= fine[0]) & (measured.frequency <= fine[-1])
    if not near.any():
        return False
    frequency, own = measured.frequency[near], np.abs(measured.own[near, 0])
    difference = 20.0 * np.log10(own / np.abs(truth.output_sensitivity.response(frequency)[:, 0, 0]))
    peak, place = int(true.argmax()), int(own.argmax())
    if 20.0 * np.log10(true[peak] / max(true[0], true[-1])) < VISIBLE_DB:
        return bool(np.abs(difference).max() < CLOSE_DB)
    return bool(
        abs(20.0 * np.log10(own[place] / true[peak])) < CLOSE_DB
        and abs(frequency[place] / fine[peak] - 1.0) < max(CLOSE_FREQUENCY, 0.2 * zeta)
    )


def rotor(hertz: float, damping: float, gain: float) -> LinearLoop:
    """Two axes, each a mass on negative stiffness behind an amplifier; a bending mode at the first."""
    a, b, c, force = np.zeros((8, 8)), np.zeros((8, 2)), np.zeros((2, 8)), np.zeros((8, 2))
    for axis in range(2):
        place = 3 * axis
        a[place, place + 1], a[place + 1, place], a[place + 1, place + 2] = 1.0, STIFFNESS, GAIN
        a[place + 2, place + 2], b[place + 2, axis] = -AMPLIFIER, AMPLIFIER
        c[axis, place], force[place + 1, axis] = 1.0, 1.0 / 6.25
    omega = 2.0 * np.pi * hertz
    a[6, 7], a[7, 6], a[7, 7], a[7, 2], c[0, 6] = 1.0, -(omega**2), -2.0 * damping * omega, GAIN * gain, 1.0
    held = cont2discrete((a, np.hstack([b, force]), c, np.zeros((2, 4))), STEP)
    keep = LAW.derivative_filter / (LAW.derivative_filter + STEP)
    proportional, derivative = np.full(2, LAW.proportional_gain), np.full(2, LAW.derivative_gain)
    return LinearLoop(held[0], held[1][:, :2], c, held[1][:, 2:], proportional, derivative, keep)


def swept(loop: LinearLoop, sweep: Sweep, random: np.random.Generator) -> IdentificationData:
    """The loop under an excitation, from rest."""
    reference = generate(sweep, LAW.sample_rate).samples
    return in_si(*loop.run(reference, random), STEP, reference)
