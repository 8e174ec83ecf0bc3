"""Sensitivity measured by injection: right where a swept sine is short of low frequencies, and honest about noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.errors import RobustnessError
from amb_core.excitation import Sweep, generate
from amb_core.identification.data import IdentificationData
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.model import StateSpaceModel
from amb_core.robustness import Feedback, feedback_of, measured_sensitivity

RATE = 10_000.0  # Hz
STIFFNESS, GAIN = 3.3e5 / 6.25, 66.0 / 6.25  # k_s / m (1/s^2), k_i / m (m/(A s^2))
SWEEP = Sweep(amplitude=5e-6, duration=6.0, frequency_start=3.0, frequency_end=1_200.0, spacing="logarithmic")


def bearing() -> StateSpaceModel:
    """The linear bearing of both axes: two unstable poles."""
    rate, t = np.sqrt(STIFFNESS), 1.0 / RATE
    cosh, sinh = np.cosh(rate * t), np.sinh(rate * t)
    a = np.kron(np.eye(2), [[cosh, sinh / rate], [rate * sinh, cosh]])
    b = np.kron(np.eye(2), [[GAIN * (cosh - 1.0) / STIFFNESS], [GAIN * sinh / rate]])
    c, zero = np.kron(np.eye(2), [[1.0, 0.0]]), np.zeros(2)
    return StateSpaceModel(
        a, b, c, np.zeros((2, 2)), np.zeros((4, 2)), 1e-18 * np.eye(2), zero, zero, np.zeros(4), 1.0 / RATE
    )


def recorded(law: ControllerParameters, noise: float, sweep: Sweep = SWEEP) -> IdentificationData:
    """The loop under a sweep; it starts from rest and is cut off while it still moves."""
    model, controller, random = bearing(), PdController(law), np.random.default_rng(3)
    reference = generate(sweep, RATE).samples
    position, current = np.empty_like(reference), np.empty_like(reference)
    state = np.zeros(4)
    for step, wanted in enumerate(reference):
        position[step] = model.c @ state + noise * random.normal(size=2)
        current[step] = controller.update(position[step], wanted)
        state = model.a @ state + model.b @ current[step]
    return IdentificationData.from_record(LoopRecord(0, 1.0 / RATE, reference, position, current))


def loop_of(law: ControllerParameters) -> Feedback:
    return feedback_of(bearing(), law)


@pytest.mark.parametrize("on", ["error", "measurement"])
def test_without_noise_a_sweep_gives_the_sensitivity_of_the_loop_at_every_frequency(on: str) -> None:
    law = ControllerParameters(derivative_on=on)
    found = measured_sensitivity(recorded(law, 0.0), law)
    assert found.frequency.min() < 6.0
    assert found.frequency.max() > 1_000.0
    assert np.abs(found.difference_db(loop_of(law))).max() < 0.01


@pytest.mark.parametrize("on", ["error", "measurement"])
def test_the_error_is_of_the_size_of_the_deviation(on: str) -> None:
    law = ControllerParameters(derivative_on=on)
    loop = loop_of(law)
    found = measured_sensitivity(recorded(law, 2e-8), law)
    true = loop.output_sensitivity.response(found.frequency)
    error = np.abs(np.abs(found.own) - np.abs(np.diagonal(true, axis1=1, axis2=2))) / found.deviation
    # The magnitude of one complex normal error of known variance; bands of neighbouring frequencies overlap.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(1.0, abs=0.25)


def test_more_noise_means_less_coherence_and_larger_deviations() -> None:
    law = ControllerParameters()
    quiet, loud = (measured_sensitivity(recorded(law, noise), law) for noise in (1e-9, 1e-6))
    assert np.median(loud.coherence) < np.median(quiet.coherence)
    assert np.median(loud.deviation) > 30.0 * np.median(quiet.deviation)


def test_one_excited_axis_does_not_determine_it() -> None:
    law = ControllerParameters()
    data = recorded(law, 0.0, short_sweep("x"))
    with pytest.raises(RobustnessError, match="excite each axis"):
        measured_sensitivity(data, law)


def short_sweep(axes: str) -> Sweep:
    return Sweep(**(SWEEP.model_dump() | {"axes": axes, "duration": 1.0}))


def test_data_without_reference_are_refused() -> None:
    law = ControllerParameters()
    data = recorded(law, 0.0, short_sweep("in_turn"))
    without = replace(data, experiments=tuple(replace(item, reference=None) for item in data.experiments))
    with pytest.raises(RobustnessError, match="needs data with the reference"):
        measured_sensitivity(without, law)
