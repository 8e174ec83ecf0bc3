"""What a record could be judged for: where a drift or a slow oscillation would not be found, it is said."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from amb_core.loop.records import LoopRecord
from amb_core.regions import Region, classify
from tests.unit.test_regions_classifier import PARAMETERS, RATE, seconds, telemetry, tone


def linear_response(reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """A loop of second order with its poles at 60 Hz, damped by half of the critical damping."""
    angular = 2.0 * np.pi * 60.0
    b, a, _ = cont2discrete(([angular, angular**2], [1.0, angular, angular**2]), 1.0 / RATE)
    return lfilter(b.ravel(), a, reference)


def test_a_sine_with_a_little_noise_hides_b_as_a_sine_does() -> None:
    time = seconds(4.0)
    noisy = tone(50.0, 20e-6, time) + 1e-9 * np.random.default_rng(5).standard_normal(len(time))
    judged = [classify(telemetry(0.95 * one, one), PARAMETERS).judged for one in (tone(50.0, 20e-6, time), noisy)]
    assert [one.looked_for("y") for one in judged] == [(Region.C, Region.D)] * 2
    assert judged[1].without_drift_test("y") == pytest.approx(judged[0].without_drift_test("y"), abs=0.05)


def test_each_state_says_which_regions_were_not_looked_for_at_its_update() -> None:
    time = seconds(4.0)
    resonant = np.where(time < 2.0, 0.95, 0.3) * tone(40.0, 10e-6, time)
    classification = classify(telemetry(resonant, tone(40.0, 10e-6, time)))
    said = {round(state.step / RATE, 2): state.axis("y").not_judged for state in classification.states}
    assert (said[0.3], said[1.5], said[3.5]) == ("BCD", "BD", "D"), (
        "before settled, at resonance, after it; no clearance"
    )
    known = classify(telemetry(resonant, tone(40.0, 10e-6, time)), PARAMETERS).states
    assert [state.not_judged for state in known if state.settled][-1] == ""
    assert all(len(state.not_judged) >= 2 for state in known if not state.settled)


def test_updates_too_few_for_a_test_are_no_resonance() -> None:
    time = seconds(4.0)
    reference = np.where(time > 0.5, tone(997.0, 10e-6, time), 0.0)
    judged = classify(telemetry(0.05 * reference, reference), PARAMETERS).judged
    assert judged.complete() and not judged.reservations


@pytest.mark.parametrize(
    "reference",
    [
        lambda time: 10e-6 * time,
        lambda time: tone(0.1, 5e-6, time),
        lambda time: tone(0.5, 20e-6, time),
        lambda time: tone(1.0, 20e-6, time),
        lambda time: 20e-6 * (2.0 * np.abs(2.0 * (time % 1.0) - 1.0) - 1.0),
    ],
    ids=["ramp", "0.1 Hz", "0.5 Hz", "1 Hz", "triangle"],
)
def test_the_response_to_a_slow_reference_is_no_drift(reference: Callable[[NDArray], NDArray]) -> None:
    time = seconds(8.0)
    asked = np.where(time > 1.0, reference(time - 1.0), 0.0)
    classification = classify(telemetry(linear_response(asked), asked), PARAMETERS)
    assert classification.onsets == {}
    assert not classification.judged.complete("y")
    assert "the reference itself moves slowly" in classification.judged.reservations[0]


def multisine(first: float, last: float, time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lines 1 Hz apart, 5 um rms."""
    random = np.random.default_rng(1)
    lines = sum(tone(f, 1.0, time + random.uniform(0.0, 1.0)) for f in np.arange(first, last + 0.5))
    return 5e-6 * lines / np.std(lines)


@pytest.mark.parametrize(
    ("reference", "slow", "may_be"),
    [
        (lambda time: tone(4_930.0, 20e-6, time), 30.0, "a beat of the input"),
        (lambda time: multisine(1.0, 300.0, time), 5.0, "a response"),
        (lambda time: multisine(1.0, 60.0, time), 30.0, "a response"),
        (lambda time: multisine(1.0, 150.0, time), 30.0, "a response"),
    ],
    ids=["near half the rate", "multisine to 300 Hz", "to 60 Hz", "to 150 Hz"],
)
def test_a_slow_line_that_may_have_another_cause_is_said_to_be_not_judged(
    reference: Callable[[NDArray], NDArray], slow: float, may_be: str
) -> None:
    time = seconds(6.0)
    asked = np.where(time > 1.0, reference(time), 0.0)
    oscillating = linear_response(asked) + np.where(time > 2.5, tone(slow, 40e-6, time), 0.0)
    judged = classify(telemetry(oscillating, asked), PARAMETERS).judged
    assert Region.C not in judged.looked_for("y")
    assert any(said.startswith("C not judged in ") and may_be in said for said in judged.reservations)
    alone = classify(telemetry(linear_response(asked), asked), PARAMETERS).judged
    assert Region.C in alone.looked_for("y"), "nothing oscillates that could be one"


@pytest.mark.parametrize("moved", [lambda time: 0.4e-6 * time, lambda time: 3.9e-6 * np.floor(time / 9.0)])
def test_a_bias_that_moves_far_but_too_slowly_for_b_is_not_called_steady(moved: Callable[[NDArray], NDArray]) -> None:
    """At 2 kHz, over 30 s; no test spans more than 7.7 s, within which B moves the bias by 4 um."""
    time = np.arange(60_000) / 2_000.0
    y = 0.02e-6 * np.random.default_rng(3).standard_normal(60_000) + moved(time)
    still = np.zeros((60_000, 1))
    classification = classify(LoopRecord(0, 1.0 / 2_000.0, still, y[:, None], still, ("y",)), clearance={"y": 250e-6})
    assert classification.onsets == {}
    assert classification.judged.absent() == "no C or D"
    (said,) = classification.judged.reservations
    assert said.startswith("slow drifts not judged (y): the bias moved by ") and said.endswith(" um, too slowly for B")


def test_a_slow_drift_that_is_found_is_not_said_to_be_too_slow() -> None:
    time = np.arange(40_000) / 2_000.0
    y = 0.02e-6 * np.random.default_rng(3).standard_normal(40_000) + 0.7e-6 * np.maximum(time - 2.0, 0.0)
    still = np.zeros((40_000, 1))
    classification = classify(LoopRecord(0, 1.0 / 2_000.0, still, y[:, None], still, ("y",)), clearance={"y": 250e-6})
    assert set(classification.onsets) == {Region.B}
    assert classification.judged.complete()
