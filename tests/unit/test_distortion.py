"""Distortion against loops whose linear part and nonlinearity are known, and of the simulated bearing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import ParameterError, SpectrumError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.linearise import linearize
from amb_core.regions.distortion import (
    Coherence,
    Distortion,
    DistortionSettings,
    PeriodicResponse,
    lines_of,
    measure_distortion,
    reference_of,
    simulate_distortion,
)
from amb_core.report.figures import plot
from amb_core.report.figures.coherence import coherence_chart
from amb_core.report.figures.drawing import Points

RATE = 1_000.0
SETTINGS = DistortionSettings(rms=1.0e-6, frequency_start=2.0, frequency_end=100.0, realisations=6, periods=4)
LINES = lines_of(SETTINGS, RATE)
COUPLING = np.array([[1.0, 0.3], [-0.2, 0.8]])

Signal = NDArray[np.float64]


def respond(
    bend: Callable[[Signal], Signal] = lambda y: 0.0 * y,
    noise: float = 0.0,
    seed: int = 0,
    settings: DistortionSettings = SETTINGS,
) -> Distortion:
    """A loop with a delay of three samples and coupled axes, its position bent, with white noise on the sensors."""
    random = np.random.default_rng(seed)
    responses = []
    for realisation in range(settings.realisations):
        pair = []
        for experiment in range(2):
            reference = reference_of(settings, LINES, realisation, experiment)
            clean = np.roll(reference, 3, axis=0) @ COUPLING.T
            position = np.tile(clean + bend(clean), (settings.periods, 1, 1))
            position += noise * random.normal(size=position.shape)
            pair.append(PeriodicResponse(reference, 2e6 * (reference - position), position))
        responses.append(pair)
    return measure_distortion(responses, LINES, 1.0 / RATE)


def spectrum(signal: Signal) -> Signal:
    return np.asarray(np.abs(np.fft.rfft(signal, axis=0)) * 2.0 / len(signal))


def test_one_odd_line_of_every_four_is_left_out_and_no_even_one_excited() -> None:
    assert set(LINES.excited % 2) == set(LINES.odd % 2) == {1}
    assert set(LINES.even % 2) == {0}
    band = np.arange(3, 100, 2)
    left_out = [set(band[n : n + 4]) - set(LINES.excited) for n in range(0, len(band), 4)]
    assert all(len(lines) == 1 for lines in left_out)
    assert LINES.odd[0] == 1, "slow motion below the band counts"


def test_axes_in_turn_find_the_same_loop_with_one_axis_at_rest() -> None:
    in_turn = SETTINGS.model_copy(update={"axes": "in_turn"})
    for experiment, resting in ((0, 1), (1, 0)):
        assert not reference_of(in_turn, LINES, 0, experiment)[:, resting].any()
    both, separate = (respond(settings=settings) for settings in (SETTINGS, in_turn))
    assert separate.closed_loop == pytest.approx(both.closed_loop, abs=1e-9)
    assert separate.ratio == pytest.approx(0.0, abs=1e-9)


def test_references_have_the_rms_asked_for_and_nothing_but_the_excited_lines() -> None:
    first, second = (reference_of(SETTINGS, LINES, 2, experiment) for experiment in range(2))
    np.testing.assert_allclose(np.sqrt(np.mean(first**2, axis=0)), 1e-6, rtol=1e-12)
    np.testing.assert_array_equal(second, first * [1.0, -1.0])
    amplitudes = spectrum(first)
    np.testing.assert_array_equal(np.flatnonzero(amplitudes[:, 0] > 1e-12), LINES.excited)
    assert not np.allclose(amplitudes, spectrum(reference_of(SETTINGS, LINES, 3, 0)) * 1j)


def test_a_linear_loop_has_no_distortion_and_its_response_is_found() -> None:
    distortion = respond()
    assert np.all(distortion.ratio < 1e-9)
    expected = COUPLING * np.exp(-2j * np.pi * distortion.frequency * 3 / RATE)[:, None, None]
    np.testing.assert_allclose(distortion.closed_loop, expected, atol=1e-9)
    np.testing.assert_allclose(distortion.plant @ (2e6 * (np.eye(2) - expected)), expected, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_not_taken_for_distortion(seed: int) -> None:
    distortion = respond(noise=0.05e-6, seed=seed)
    assert np.all(distortion.ratio < 0.03), "noise of 5 % is"
    np.testing.assert_allclose(np.sqrt(np.mean(distortion.noise**2)), 0.05e-6 * np.sqrt(4.0 / 1_000 / 4), rtol=0.15)
    error = np.abs(
        distortion.closed_loop - COUPLING * np.exp(-2j * np.pi * distortion.frequency * 3 / RATE)[:, None, None]
    )
    assert np.mean(error < 3.0 * distortion.deviation) > 0.97


def test_a_square_shows_at_even_lines_with_its_size() -> None:
    def bend(y: Signal) -> Signal:
        return np.column_stack([4e4 * y[:, 0] ** 2, 0.0 * y[:, 1]])

    distortion = respond(bend)
    powers = [
        spectrum(bend(np.roll(reference_of(SETTINGS, LINES, m, e), 3, axis=0) @ COUPLING.T))[LINES.even, 0] ** 2
        for m in range(6)
        for e in range(2)
    ]
    np.testing.assert_allclose(distortion.even[:, 0], np.sqrt(np.mean(powers, axis=0)), rtol=1e-9)
    assert distortion.odd_ratio[0] < 1e-9
    assert distortion.ratio[1] < 1e-9, "y is linear"
    assert distortion.ratio[0] == pytest.approx(distortion.even_ratio[0])
    assert 0.02 < distortion.ratio[0] < 0.06


def test_a_cube_shows_at_odd_lines_excited_or_not_alike() -> None:
    distortion = respond(lambda y: 2e10 * y**3, noise=0.002e-6)
    assert np.all(distortion.even_ratio < 0.2 * distortion.odd_ratio)
    at_excited, beside = (np.sqrt(np.mean(level[2:] ** 2, axis=0)) for level in (distortion.stochastic, distortion.odd))
    np.testing.assert_allclose(at_excited, beside, rtol=0.35)


def test_distortion_of_the_bearing_grows_with_the_amplitude_and_its_response_is_the_linearised_one() -> None:
    plant, controller = PlantParameters(), ControllerParameters()
    small, large = (
        simulate_distortion(
            plant,
            controller,
            DistortionSettings(rms=rms, frequency_end=400.0, period=0.2, realisations=2, frequency_start=5.0),
        )
        for rms in (0.1e-6, 2e-6)
    )
    assert np.all(small.ratio < 0.2 * large.ratio)
    assert large.even_ratio[1] > 0.01, "the rotor hangs below the centre, where the magnets pull unequally"
    discrete = linearize(Plant(plant), controller).discrete
    expected = discrete.response(small.frequency)
    for axis in range(2):
        np.testing.assert_allclose(
            small.plant[:, axis, axis], expected[:, axis, axis], rtol=0.03
        )  # less the PWM's delay


def test_what_cannot_be_measured_is_refused() -> None:
    reference = reference_of(SETTINGS, LINES, 0, 0)
    periods = np.stack([reference, reference])
    alike, still = PeriodicResponse(reference, periods, periods), PeriodicResponse(reference, periods, 0.0 * periods)
    with pytest.raises(SpectrumError, match="two realisations or more"):
        measure_distortion([[alike, alike]], LINES, 1e-3)
    with pytest.raises(SpectrumError, match="do not excite x and y independently at 3 Hz"):
        measure_distortion([[alike, alike]] * 2, LINES, 1e-3)
    with pytest.raises(SpectrumError, match="the position does not move on x and y while the reference does"):
        measure_distortion([[still, still]] * 2, LINES, 1e-3)
    once = PeriodicResponse(reference, periods[:1], periods[:1])
    with pytest.raises(SpectrumError, match="two periods or more"):
        measure_distortion([[once, once]] * 2, LINES, 1e-3)
    with pytest.raises(SpectrumError, match=r"period = 0\.33335 s has 333\.35 samples"):
        lines_of(DistortionSettings(period=0.33335), RATE)
    with pytest.raises(SpectrumError, match="allowed: less than half the sample rate, 500 Hz"):
        lines_of(DistortionSettings(frequency_end=500.0), RATE)
    with pytest.raises(ParameterError, match="has too few lines"):
        validate(DistortionSettings, {"frequency_end": 5.0})
    with pytest.raises(SpectrumError, match=r"the rotor delevitates at .* s in experiment 1 of realisation 1"):
        simulate_distortion(
            PlantParameters(), ControllerParameters(), DistortionSettings(rms=150e-6, period=0.1, frequency_end=900.0)
        )


def test_the_chart_shows_every_kind_of_line_and_its_share() -> None:
    chart = plot(respond(lambda y: 4e4 * y**2, noise=0.01e-6))
    assert [panel.title.split(":")[0] for panel in chart.panels] == ["x", "y"]
    labels = {item.label for panel in chart.panels for item in panel.items if isinstance(item, Points)}
    assert {"linear response", "even distortion", "noise"} <= labels
    assert "Nonlinear distortion over the linear response" in chart.alt and " dB" in chart.alt
    assert chart.figure().axes


def test_the_command_leaves_numbers_and_figures(tmp_path: Path) -> None:
    out = tmp_path / "distortion"
    options = ["--period", "0.1", "--realisations", "2", "--frequency-end", "400", "--frequency-start", "10"]
    result = CliRunner().invoke(app, ["distortion", *options, "--set", "rotor.gravity=0", "--out", str(out)])
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "summary.json").read_text())
    assert summary["settings"]["realisations"] == 2
    assert 0.0 < summary["x"]["distortion_percent"] < 1.0
    assert summary["x"]["distortion_percent"] < summary["x"]["distortion_upper_percent"] < 5.0
    assert (out / "distortion.png").is_file() and (out / "distortion.html").is_file()


def test_the_command_refuses_a_rotor_that_falls(tmp_path: Path) -> None:
    options = ["--rms", "150e-6", "--period", "0.1", "--frequency-end", "900", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, ["distortion", *options])
    assert isinstance(result.exception, SpectrumError), result.output
    assert "the rotor delevitates at" in str(result.exception)


@pytest.mark.parametrize(("lowest", "end"), [(0.985, 0.9), (0.7, 0.5), (0.2, 0.0)])
def test_the_scale_of_the_coherence_shows_how_far_it_is_from_1(lowest: float, end: float) -> None:
    values = np.column_stack([[1.0, lowest], [1.0, 1.0]])
    known, rest = np.array([1e-6, np.nan]), np.array([1e-7, np.nan])
    coherence = Coherence(("x", "y"), np.array([50.0, 100.0]), values, known, rest, 5.0)
    (panel,) = coherence_chart(coherence).panels
    assert panel.y.limits is not None and panel.y.limits[0] == end and 1.0 < panel.y.limits[1] < 1.06
