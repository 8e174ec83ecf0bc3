"""Region maps of the paper's bearing: its sweep of Fig. 5 on the full plant with linear iron."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import MapSettings, RegionMap, analytic_lines, build_map, compare

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

PLANT, CONTROLLER = PlantParameters(), ControllerParameters()
EIGHT = MapSettings(initial_sweeps=8, max_sweeps=8)


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> RegionMap:
    return build_map(EIGHT, PLANT, CONTROLLER, cache=tmp_path_factory.mktemp("cache"))


def test_boundaries_are_ordered_and_fall_with_amplitude(paper: RegionMap) -> None:
    for sweep in paper.sweeps:
        frequencies = [sweep.boundaries[region].frequency for region in sorted(sweep.boundaries)]
        assert frequencies == sorted(frequencies)
    for region in Region.B, Region.D:
        frequencies = paper.frequencies(region)
        frequencies = frequencies[np.isfinite(frequencies)]
        assert len(frequencies) >= 6
        assert np.all(np.diff(frequencies) < 0.0)


def test_the_largest_amplitude_delevitates_by_ordinary_resonance(paper: RegionMap) -> None:
    largest = paper.sweeps[-1]
    assert largest.amplitude == 100e-6
    assert list(largest.boundaries) == [Region.D]
    assert largest.boundaries[Region.D].resonance
    assert 30.0 < largest.boundaries[Region.D].frequency < 63.0
    assert not any(sweep.boundaries[Region.D].resonance for sweep in paper.sweeps[:-2])


def test_drift_under_gravity_begins_where_the_current_peaks_are_cut_on_one_side(paper: RegionMap) -> None:
    lines = analytic_lines(PLANT, CONTROLLER)
    load = next(one for one in compare(paper, lines) if (one.line, one.region) == ("static-load limit", Region.B))
    ratio = load.ratio[load.amplitude < 40e-6]
    assert len(ratio) >= 5
    assert np.all((ratio > 0.95) & (ratio < 1.1))


def test_without_gravity_nothing_drifts_before_the_centre_loses_its_stability(tmp_path: Path) -> None:
    """Then the rotor leaves it to one side; at small amplitudes it delevitates in a beat before."""
    plant = validate(PlantParameters, {"rotor.gravity": 0.0})
    region_map = build_map(EIGHT, plant, CONTROLLER, cache=tmp_path)
    drift = region_map.frequencies(Region.B)
    assert np.all(np.isnan(drift[region_map.amplitudes < 15e-6]))
    lines = {line.name: line for line in analytic_lines(plant, CONTROLLER)}
    assert "static-load limit" not in lines
    drifting = np.isfinite(drift)
    ratio = drift[drifting] / lines["bias limit"].frequency_at(region_map.amplitudes[drifting])
    assert np.all(ratio > 1.3)


def test_derivative_on_measurement_keeps_amplitudes_linear_that_it_does_not_on_the_error(tmp_path: Path) -> None:
    controller = ControllerParameters(derivative_on="measurement")
    settings = MapSettings(amplitude_low=10e-6, amplitude_high=50e-6, initial_sweeps=3, max_sweeps=3)
    region_map = build_map(settings, PLANT, controller, cache=tmp_path)
    assert all(not sweep.boundaries for sweep in region_map.sweeps)
    assert all(sweep.highest_frequency > 4999.0 for sweep in region_map.sweeps)
    largest = region_map.sweeps[-1]
    assert any(low < 10_000.0 / 3.0 < high for low, high in largest.beats), "beats at a third of the sample rate"
