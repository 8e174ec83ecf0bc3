"""The region map: boundaries between sweeps, regions, the linear limit, and its file."""

from __future__ import annotations

import json

import numpy as np
import pytest

from amb_core.ground.errors import ParameterError, RegionError
from amb_core.ground.parameters import validate
from amb_core.regions import Region
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep, RegionMap


def sweep(amplitude, **frequencies):
    boundaries = {Region[name]: Boundary(frequency, False) for name, frequency in frequencies.items()}
    return MapSweep(amplitude, boundaries, ((1240.0, 1260.0),), 5000.0, 210_000)


MAP = RegionMap(
    MapSettings(),
    (sweep(10e-6), sweep(20e-6, B=800.0, D=1600.0), sweep(40e-6, B=200.0, D=400.0)),
    {"code": "abc"},
    complete=False,
)


def test_a_boundary_is_a_straight_line_in_logarithms_between_sweeps():
    assert MAP.boundary(Region.B, np.sqrt(20e-6 * 40e-6)) == pytest.approx(400.0)
    assert MAP.boundary(Region.D, [20e-6, 40e-6]) == pytest.approx([1600.0, 400.0])


def test_a_boundary_ends_half_way_to_the_sweep_that_lacks_it():
    middle = np.sqrt(10e-6 * 20e-6)
    assert np.isinf(MAP.boundary(Region.B, 0.999 * middle))
    assert MAP.boundary(Region.B, 1.001 * middle) == pytest.approx(800.0)
    assert np.isinf(MAP.boundary(Region.C, 30e-6))


def test_beyond_the_outer_amplitudes_the_nearest_sweep_holds():
    assert MAP.boundary(Region.D, 90e-6) == pytest.approx(400.0)
    assert np.isinf(MAP.boundary(Region.D, 1e-6))


def test_the_region_is_the_highest_that_has_begun():
    assert MAP.region_at([100.0, 300.0, 500.0], 40e-6).tolist() == [Region.A, Region.B, Region.D]


def test_a_map_survives_its_file(tmp_path):
    MAP.save(tmp_path / "map.json")
    assert RegionMap.load(tmp_path / "map.json") == MAP


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"format": 1}', '{"format": 1, "settings": {"axes": "z"}}'])
def test_a_file_that_is_no_map_is_refused_by_name(tmp_path, text):
    path = tmp_path / "map.json"
    path.write_text(text)
    with pytest.raises(RegionError, match=r"map\.json: is no region map"):
        RegionMap.load(path)


def test_a_map_of_another_format_or_a_missing_file_is_refused(tmp_path):
    path = tmp_path / "map.json"
    with pytest.raises(RegionError, match="cannot be read: No such file"):
        RegionMap.load(path)
    MAP.save(path)
    path.write_text(json.dumps({**json.loads(path.read_text()), "format": 99}))
    with pytest.raises(RegionError, match=r"map\.json: has format 99, this version reads 1"):
        RegionMap.load(path)


def test_a_file_without_sweeps_is_refused_by_name(tmp_path):
    path = tmp_path / "map.json"
    MAP.save(path)
    path.write_text(json.dumps({**json.loads(path.read_text()), "sweeps": []}))
    with pytest.raises(RegionError, match=r"map\.json: a region map needs at least one sweep"):
        RegionMap.load(path)


def test_sweeps_must_be_in_order_of_amplitude():
    with pytest.raises(RegionError, match="in order of amplitude"):
        RegionMap(MapSettings(), (sweep(20e-6), sweep(10e-6)))
    with pytest.raises(RegionError, match="at least one sweep"):
        RegionMap(MapSettings(), ())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"amplitude_low": 50e-6, "amplitude_high": 20e-6}, "amplitude_low = 5e-05 m must be below amplitude_high"),
        ({"frequency_start": 900.0, "frequency_end": 90.0}, "frequency_start = 900 Hz must be below frequency_end"),
        ({"initial_sweeps": 30}, "initial_sweeps = 30 must not exceed max_sweeps = 24"),
    ],
)
def test_settings_that_make_no_map_are_refused(values, message):
    with pytest.raises(ParameterError, match=message):
        validate(MapSettings, values)
