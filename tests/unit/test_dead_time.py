"""Dead time is distinguished from the slow start of a mass behind an amplifier, in noisy closed-loop data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.checks import Severity, check_delay
from amb_core.data.experiments.checks.dead_time import dead_times
from amb_core.excitation import excitation_from_request, generate
from amb_core.loop.control import ControllerParameters, PdController

RATE = 10_000.0
STEPS = 10_000
NOISE = 0.05e-6  # m
MULTISINE = {"amplitude": 5e-6, "frequency_start": 1.0, "frequency_end": 2_000.0, "seed": 1}
PRBS = {"amplitude": 2e-6, "seed": 1}


def bearing(bandwidth: float, mode: float | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One axis: amplifier of a bandwidth (Hz), negative stiffness and mass of the paper, a bending mode (Hz)."""
    lag = 2.0 * np.pi * bandwidth
    a, b, c = np.zeros((5, 5)), np.zeros((5, 1)), np.array([[1.0, 0.0, 1.0, 0.0, 0.0]])
    a[0, 1] = a[2, 3] = 1.0
    a[1, [0, 2, 4]] = 3.30e5 / 6.25, 3.30e5 / 6.25, 66.0 / 6.25
    if mode is not None:
        omega = 2.0 * np.pi * mode
        a[3, [2, 3, 4]] = -(omega**2), -0.01 * omega, 0.2 * 66.0 / 6.25
    a[4, 4], b[4] = -lag, lag
    return (*cont2discrete((a, b, c, np.zeros((1, 1))), 1.0 / RATE)[:2], c)


def closed_loop(
    kind: str,
    request: dict[str, object],
    delay: int = 0,
    bandwidth: float = 1_500.0,
    mode: float | None = None,
    noise: float = NOISE,
) -> IdentificationData:
    """Both axes alike under the PD controller, whose currents take effect later by the delay (samples)."""
    a, b, c = bearing(bandwidth, mode)
    reference = generate(excitation_from_request(kind, request | {"duration": STEPS / RATE}), RATE).samples
    law, state = PdController(ControllerParameters(current_limit=100.0)), np.zeros((len(a), 2))
    errors = noise * np.random.default_rng(2).normal(size=reference.shape)
    position, current = np.empty_like(reference), np.zeros((STEPS + delay, 2))
    for step, wanted in enumerate(reference):
        position[step] = (c @ state)[0] + errors[step]
        current[step + delay] = law.update(position[step], wanted)
        state = a @ state + b * current[step]
    current = current[delay:]
    return IdentificationData.from_arrays(current, position, 1.0 / RATE, reference=reference)


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize(("kind", "request_"), [("multisine", MULTISINE), ("prbs", PRBS)])
def test_a_flexible_rotor_behind_a_slow_amplifier_has_no_dead_time(kind, request_, noise):
    finding = check_delay(closed_loop(kind, request_, mode=900.0, noise=noise))
    assert finding.severity is Severity.INFO
    assert "no dead time found" in finding.what
    assert not finding.advice


@pytest.mark.parametrize("delay", [1, 2, 3])
@pytest.mark.parametrize(("kind", "request_"), [("multisine", MULTISINE), ("prbs", PRBS)])
def test_dead_time_in_the_loop_is_found(kind, request_, delay):
    assert dead_times(closed_loop(kind, request_, delay)) == [delay, delay]


def test_the_finding_says_what_to_do_about_a_long_dead_time():
    finding = check_delay(closed_loop("prbs", PRBS, delay=3))
    assert finding.severity is Severity.WARNING
    assert "samples of dead time: u1 3, u2 3" in finding.what
    assert "advance_inputs(data, [3, 3])" in finding.advice


def test_noise_that_hides_the_first_samples_proves_no_dead_time():
    assert dead_times(closed_loop("multisine", MULTISINE, noise=40.0 * NOISE)) == [0, 0]


def test_too_few_samples_are_not_judged():
    assert dead_times(closed_loop("prbs", PRBS).window(0, 60)) is None
