"""Sensitivity measured by injection: right where a swept sine is short of low frequencies, and honest about noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import RobustnessError
from amb_core.loop.control import ControllerParameters
from amb_core.robustness import SweepSettings, feedback_of, measured_sensitivity

SWEEP = SweepSettings(sweep_amplitude=5e-6, sweep_duration=6.0)
LAWS = {on: ControllerParameters(derivative_on=on) for on in ("error", "measurement")}


def swept(bearing: Any, law: ControllerParameters, noise: float, **changes: Any) -> IdentificationData:
    """The loop under a swept sine, from rest; the record ends while it still moves."""
    settings = SWEEP.excitation.model_dump() | changes
    return IdentificationData.from_record(bearing.experiment(noise, "sweep", controller=law, **settings))


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_without_noise_a_sweep_gives_the_sensitivity_of_the_loop_at_every_frequency(bearing, law) -> None:
    measured = measured_sensitivity(swept(bearing, law, 0.0), law)
    compared = measured.frequency[measured.comparable()]
    assert compared.min() < 2.0 * SWEEP.sweep_start
    assert compared.max() > 950.0
    difference = np.abs(measured.difference_db(feedback_of(bearing.model, law)))
    assert difference.max() < 0.1, "as exact as comparable values are said to be"
    assert np.median(difference) < 0.005


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_error_is_of_the_size_of_the_deviation(bearing, law) -> None:
    measured = measured_sensitivity(swept(bearing, law, 2e-8), law)
    true = feedback_of(bearing.model, law).output_sensitivity.response(measured.frequency)
    error = np.abs(np.abs(measured.own) - np.abs(np.diagonal(true, axis1=1, axis2=2))) / measured.deviation
    # Bands of neighbouring frequencies overlap, so there are far fewer independent errors than values.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(1.0, abs=0.25)


def test_more_noise_means_less_coherence_larger_deviations_and_a_higher_upper_end_of_the_peak(bearing) -> None:
    law = LAWS["error"]
    quiet, loud = (measured_sensitivity(swept(bearing, law, noise), law) for noise in (1e-9, 1e-6))
    assert np.median(loud.coherence) < np.median(quiet.coherence)
    assert np.median(loud.deviation) > 30.0 * np.median(quiet.deviation)
    assert loud.peak(0)[0] > loud.peak(0, 0.5)[0]
    assert loud.comparable().sum() < quiet.comparable().sum()


def test_one_excited_axis_does_not_determine_it(bearing) -> None:
    law = LAWS["error"]
    with pytest.raises(RobustnessError, match="excite each axis"):
        measured_sensitivity(swept(bearing, law, 0.0, axes="x", duration=1.0), law)


def test_data_without_reference_are_refused(bearing) -> None:
    law = LAWS["error"]
    data = swept(bearing, law, 0.0, duration=1.0)
    without = replace(data, experiments=tuple(replace(item, reference=None) for item in data.experiments))
    with pytest.raises(RobustnessError, match="needs data with the reference"):
        measured_sensitivity(without, law)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [({}, "needs an amplitude"), ({"sweep_amplitude": 1e-6, "sweep_start": 900.0, "sweep_end": 90.0}, "must exceed")],
)
def test_a_sweep_without_amplitude_or_range_is_refused(settings: dict[str, float], reason: str) -> None:
    with pytest.raises(RobustnessError, match=reason):
        assert SweepSettings(**settings).excitation
