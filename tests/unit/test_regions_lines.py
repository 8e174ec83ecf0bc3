"""Analytic lines of the frequency-amplitude graph, against values worked out by hand for the paper's bearing."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.errors import RegionError
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters, describe
from amb_core.regions import lines

CONTROLLER = ControllerParameters()
K_I, K_S, BIAS, INDUCTANCE = 66.0, 3.30e5, 3.0, 7.15e-3


def test_command_gain_at_100_hz() -> None:
    # |20000 + j 2 pi 100 * 38| = sqrt(20000^2 + 23876^2)
    assert lines.command_gain(100.0, CONTROLLER, sampled=False) == pytest.approx(31_146.0, rel=1e-4)


def test_sampled_law_has_a_smaller_derivative_at_high_frequency() -> None:
    # backward difference: 2 sin(w T / 2) / T = 16180 /s instead of 18850 /s at 3 kHz, delayed by half a sample
    gain = 20_000.0 + 38.0 * 16_180.3 * 1j * np.exp(-0.3j * math.pi)
    assert lines.command_gain(3_000.0, CONTROLLER) == pytest.approx(abs(gain), rel=1e-5)


def test_sampled_law_is_what_the_controller_does() -> None:
    from amb_core.loop.control import PdController

    law = PdController(ControllerParameters(current_limit=100.0, derivative_filter=1e-4))
    reference = 1e-6 * np.sin(2.0 * np.pi * 700.0 * np.arange(4_000) / 10_000.0)
    current = np.array([law.update((0.0, 0.0), (0.0, r))[1] for r in reference])[1_000:]
    gain = lines.command_gain(700.0, law.parameters)
    assert math.sqrt(2.0) * current.std() / 1e-6 == pytest.approx(float(gain), rel=1e-3)


def test_with_the_derivative_on_measurement_only_the_proportional_gain_counts() -> None:
    on_measurement = ControllerParameters(derivative_on="measurement")
    assert np.all(lines.command_gain([10.0, 5_000.0], on_measurement) == 20_000.0)
    assert lines.bias_limit(1_000.0, on_measurement, BIAS) == pytest.approx(150e-6)


def test_bias_limit_falls_with_frequency() -> None:
    limits = lines.bias_limit([100.0, 1_000.0], CONTROLLER, BIAS, sampled=False)
    np.testing.assert_allclose(limits, [96.32e-6, 12.52e-6], rtol=1e-3)


def test_slew_limit_of_the_paper() -> None:
    rate = 150.0 / INDUCTANCE
    assert rate == pytest.approx(2.098e4, rel=1e-3)
    # 20979 A/s / (2 pi 1000 /s * 239600 A/m)
    assert lines.slew_limit(1_000.0, CONTROLLER, rate, sampled=False) == pytest.approx(13.94e-6, rel=1e-3)


def test_gain_loss_limit() -> None:
    # k_s / (k_i K_P) = 0.25, so the dither is 3 A / sin(22.5 deg) = 7.839 A
    limit = lines.gain_loss_limit(1_000.0, CONTROLLER, BIAS, K_I, K_S, sampled=False)
    assert limit == pytest.approx(7.839 / 239_600.0, rel=1e-3)


def test_a_loop_that_cannot_levitate_has_no_lines() -> None:
    weak = ControllerParameters(proportional_gain=4_000.0)
    with pytest.raises(RegionError, match="must exceed the negative stiffness"):
        lines.gain_loss_limit(1_000.0, weak, BIAS, K_I, K_S)


@pytest.mark.parametrize("frequency", [0.0, -1.0, math.nan, math.inf])
def test_frequencies_must_be_positive(frequency: float) -> None:
    with pytest.raises(RegionError, match=r"frequency = .* must be positive"):
        lines.bias_limit(frequency, CONTROLLER, BIAS)


@pytest.mark.parametrize("page", ["region-maps.md", "excitation.md"])
def test_pages_tell_the_static_current_of_the_papers_bearing(page: str) -> None:
    current = CONTROLLER.proportional_gain * abs(describe(PlantParameters(), CONTROLLER).sag)
    text = (Path(__file__).parents[2] / "docs" / "explanation" / page).read_text()
    assert re.findall(r"(?:\(|with )(\d\.\d\d) A(?:\),| of 3 A)", text) == [f"{current:.2f}"]
