"""The subharmonic test on the simulated bearing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.errors import ExcitationError, ParameterError, SpectrumError
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.simulation.parameters import with_values
from amb_core.regions.subharmonics import (
    VARIANTS,
    SubharmonicSettings,
    SubharmonicSpectrum,
    SurfaceSettings,
    run_subharmonics,
    subharmonic_surface,
)
from amb_core.regions.subharmonics.run import excitation

UM = 1e-6
# Ten times as coarse as the defaults, to be fast: 0.1 s of blocks on which the shifted tones too have whole periods.
FAST = SubharmonicSettings(
    block_duration=0.1, offset_1=10.0, offset_2=-10.0, offset_3=70.0, rest=0.4, fade_in=0.2, longest_run=1.2
)
LOOP = PlantParameters(), ControllerParameters()
LIMIT_10_A = PlantParameters(), ControllerParameters(current_limit=10.0)


def difference(spectrum: SubharmonicSpectrum) -> float:
    line = spectrum.line(-1, 1)
    assert line is not None
    return abs(line.amplitude)


def test_the_papers_tones_delevitate_the_paper_bearing_with_the_controllers_limit_of_3_a() -> None:
    spectrum = run_subharmonics(*LOOP)
    assert spectrum.state == "delevitated"
    assert "before the tones had their full amplitude" in spectrum.reason
    assert spectrum.steps == 0


def test_two_tones_alone_make_a_difference_product() -> None:
    spectrum = run_subharmonics(*LOOP, FAST.changed(inducing_amplitude=0.0))
    assert spectrum.state == "steady"
    assert difference(spectrum) == pytest.approx(0.578 * UM, rel=0.02)


def test_without_gravity_the_symmetric_bearing_makes_no_difference_product() -> None:
    plant, controller = with_values(*LOOP, {"rotor.gravity": 0.0})
    spectrum = run_subharmonics(plant, controller, FAST.changed(inducing_amplitude=0.0).shifted())
    assert spectrum.state == "steady"
    assert difference(spectrum) < 1e-3 * UM


def test_in_steady_state_the_papers_tones_leave_nothing_slow() -> None:
    spectrum = run_subharmonics(*LIMIT_10_A, FAST)
    assert spectrum.state == "steady"
    assert difference(spectrum) == pytest.approx(1.0 * UM, rel=0.1)
    assert spectrum.slow is not None
    assert spectrum.slow.rms < 0.05 * UM


@pytest.mark.slow
def test_shifted_tones_show_that_the_slow_component_is_made_by_sampling() -> None:
    settings = SubharmonicSettings(inducing_amplitude=5e-6).shifted()
    spectrum = run_subharmonics(*LIMIT_10_A, settings)
    assert spectrum.state == "steady"
    assert spectrum.slow is not None
    assert spectrum.slow.amplitude > 1.0 * UM
    assert spectrum.slow.product is not None
    assert spectrum.slow.product.label == "10f3 - 3fs"


def test_a_bearing_in_which_the_rotor_bounces_counts_as_delevitated_too() -> None:
    plant, controller = with_values(*LOOP, {"backup_bearing.contact": True})
    assert run_subharmonics(plant, controller, FAST).state == "delevitated"


def test_the_tones_fade_in_on_their_axis_alone() -> None:
    samples = excitation(FAST, 4000, 10_000.0)
    assert not samples[:, 0].any()
    assert np.abs(samples[:200, 1]).max() < 0.03 * np.abs(samples[2000:, 1]).max()
    full = sum(
        amplitude * np.sin(2 * np.pi * frequency * np.arange(2000, 4000) / 10_000.0)
        for frequency, amplitude in zip(FAST.frequencies, FAST.amplitudes, strict=True)
    )
    np.testing.assert_allclose(samples[2000:, 1], full, atol=1e-15)


@pytest.mark.parametrize(
    ("values", "test", "error", "message"),
    [
        ({}, {"inducing_amplitude": 240e-6}, ExcitationError, "add up to 260 um; allowed: below .* 250 um"),
        ({"magnetic_circuit.actuators": "differential"}, {"axis": "x"}, ExcitationError, "allowed: y"),
        ({}, {"inducing_frequency": 5000.0}, SpectrumError, "below the Nyquist frequency, 5000 Hz"),
    ],
)
def test_tests_that_do_not_suit_the_loop_are_refused(
    values: dict[str, object], test: dict[str, float], error: type[Exception], message: str
) -> None:
    plant, controller = with_values(*LOOP, values)
    with pytest.raises(error, match=message):
        run_subharmonics(plant, controller, FAST.changed(**test))


def test_values_of_unknown_parameters_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"unknown parameter 'rotor.gravty' = 0; did you mean 'rotor.gravity'"):
        with_values(*LOOP, {"rotor.gravty": 0})


def test_every_variant_makes_a_loop() -> None:
    for variant in VARIANTS:
        plant, controller = with_values(*LOOP, variant.values)
        assert (plant, controller) != LOOP or not variant.values


@pytest.mark.slow
def test_a_surface_has_the_results_of_its_runs_and_runs_none_twice(tmp_path: Path) -> None:
    settings = FAST.changed(rest=0.3)
    grid = SurfaceSettings(
        amplitude_low=0.0, amplitude_high=40e-6, amplitude_count=2, frequency_low=3000.0, frequency_high=4000.0,
        frequency_count=2, shifted=True,
    )  # fmt: skip
    progress: list[tuple[int, int]] = []
    surface = subharmonic_surface(
        *LOOP,
        settings,
        grid,
        cache=tmp_path,
        workers=1,
        progress=lambda _stage, done, total: progress.append((done, total)),
    )
    assert surface.inducing_frequency.tolist() == [3070.0, 4070.0]
    assert surface.state.tolist() == [["steady", "steady"], ["delevitated", "delevitated"]]
    assert np.isnan(surface.difference[1]).all()
    alone = run_subharmonics(*LOOP, settings.changed(inducing_amplitude=0.0).shifted())
    assert surface.difference[0, 0] == difference(alone)
    assert progress == [(done, 4) for done in range(5)]
    written = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert len(written) == 4
    missing = sorted(written)[0]
    missing.unlink()
    again = subharmonic_surface(*LOOP, settings, grid, cache=tmp_path, workers=1)
    assert repr(again) == repr(surface)
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert {path for path in written if kept[path] != written[path]} == {missing}


def test_a_surface_is_refused_before_anything_is_run() -> None:
    with pytest.raises(ParameterError, match="same frequency"):
        subharmonic_surface(*LOOP, FAST, SurfaceSettings(frequency_low=200.0, frequency_high=3000.0))
    with pytest.raises(SpectrumError, match="Nyquist"):
        subharmonic_surface(*LOOP, FAST, SurfaceSettings(frequency_high=5000.0))
