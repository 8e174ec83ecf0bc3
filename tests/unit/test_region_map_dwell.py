"""A dwell: the excitation is smooth, and the region is that of the settled motion of the paper's bearing."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map import ConfirmationSettings, MapSettings
from amb_core.regions.region_map.dwell_run import Dwell, DwellTask, dwell_signal
from amb_core.regions.region_map.sweep_run import SweepTask

SHORT = ConfirmationSettings(dwell=1.0, ramp=0.2)


def task(
    frequency: float,
    start: float | None = None,
    amplitude: float = 25e-6,
    settings: ConfirmationSettings = SHORT,
    **plant,
) -> DwellTask:
    parameters = validate(PlantParameters, plant)
    sweep = SweepTask(MapSettings().sweep(amplitude), 0.5, parameters, ControllerParameters(), RegionParameters())
    return DwellTask(sweep, frequency, start or frequency, settings)


def test_the_sine_starts_and_moves_without_a_jump_and_ends_at_its_frequency() -> None:
    samples, frequency = dwell_signal(80.0, 100.0, 2000, 5000, 10e3)
    assert frequency[0] == pytest.approx(80.0)
    assert frequency[-5000:] == pytest.approx(100.0)
    # The steepest slope of a sine is 2 pi f a; a jump of amplitude or phase would exceed it.
    assert np.abs(np.diff(samples)).max() <= 2.0 * np.pi * 100.0 / 10e3
    assert np.abs(samples[:20]).max() < 1e-3
    assert np.abs(samples[-100:]).max() == pytest.approx(1.0, abs=1e-3)


def test_a_start_at_the_final_frequency_is_a_plain_sine() -> None:
    samples, _ = dwell_signal(100.0, 100.0, 100, 1000, 10e3)
    step = np.arange(200, 1200)
    assert samples[200:] == pytest.approx(np.sin(2.0 * np.pi * 100.0 * step / 10e3), abs=1e-9)


@pytest.mark.parametrize(
    ("frequency", "region"),
    # In the sweep of 25 um B begins at 242 Hz and D at 684 Hz (docs/explanation/regions.md); the equilibria of the mean
    # position lie 3.3 um and 13.4 um below the one at rest at 200 and 300 Hz.
    [(200.0, Region.A), (300.0, Region.B), (900.0, Region.D)],
)
def test_a_fixed_sine_is_in_the_region_that_the_sweep_shows_there(frequency: float, region: Region) -> None:
    dwell = task(frequency).run()
    assert dwell.region is region
    assert dwell.started


def test_the_displacement_is_that_of_the_mean_position() -> None:
    assert task(200.0).run().displacement == pytest.approx(3.3e-6, abs=0.1e-6)


def test_within_the_bandwidth_a_displaced_mean_is_no_drift() -> None:
    """At 70 Hz the response is larger than the input, and its size alone moves the mean by more than the threshold."""
    dwell = task(70.0, amplitude=50e-6).run()
    assert dwell.displacement > 4e-6
    assert dwell.region is Region.A


def test_a_rotor_that_falls_where_the_sine_starts_was_not_started() -> None:
    """At 900 Hz 25 um fall at once; 600 Hz itself would hold (it does when approached from below)."""
    from_above = task(600.0, start=900.0).run()
    assert (from_above.region, from_above.started) == (Region.D, False)
    assert task(600.0, start=500.0).run().region is Region.B


def test_the_key_depends_on_all_that_the_result_depends_on() -> None:
    others = [
        task(301.0, 300.0),
        task(300.0, 301.0),
        task(300.0, amplitude=26e-6),
        task(300.0, settings=SHORT.model_copy(update={"dwell": 2.0})),
        task(300.0, settings=SHORT.model_copy(update={"ramp": 0.3})),
        task(300.0, **{"rotor.gravity": 0.0}),
    ]
    keys = {one.key() for one in others} | {task(300.0).key()}
    assert len(keys) == len(others) + 1
    assert task(300.0, settings=SHORT.model_copy(update={"rate_factor": 0.1})).key() == task(300.0).key()


def test_a_dwell_survives_its_file() -> None:
    dwell = Dwell(300.0, Region.C, True, 4.5e-6, 1234)
    assert DwellTask.from_json(DwellTask.to_json(dwell)) == dwell
