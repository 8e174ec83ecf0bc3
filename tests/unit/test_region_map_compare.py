"""Analytic lines of a bearing against the boundaries of a map, and the command that prints them."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region
from amb_core.regions.lines import command_gain
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep, RegionMap, analytic_lines, compare
from amb_core.regions.region_map.compare import AnalyticLine

CONTROLLER = ControllerParameters()


def test_a_line_tells_the_frequency_at_which_an_amplitude_reaches_it():
    frequency = np.geomspace(10.0, 5000.0, 2000)
    line = AnalyticLine("line", frequency, 5e-3 / frequency)
    reached = line.frequency_at(np.array([1e-3, 50e-6, 5e-6, 1e-7]))
    assert reached[1:3] == pytest.approx([100.0, 1000.0], rel=1e-6)
    assert np.isnan(reached[[0, 3]]).all(), "beyond the limit at every frequency, or at none"


def test_each_boundary_is_compared_but_not_those_of_ordinary_resonance():
    frequency = np.geomspace(10.0, 5000.0, 2000)
    line = AnalyticLine("line", frequency, 5e-3 / frequency)
    sweeps = [
        MapSweep(10e-6, {Region.D: Boundary(250.0, False)}, (), 250.0, 1),
        MapSweep(20e-6, {Region.B: Boundary(50.0, False), Region.D: Boundary(100.0, False)}, (), 100.0, 1),
        MapSweep(40e-6, {Region.D: Boundary(40.0, True)}, (), 40.0, 1),
    ]
    drift, touch = compare(RegionMap(MapSettings(), tuple(sweeps)), [line])
    assert (drift.region, touch.region) == (Region.B, Region.D)
    assert drift.ratio == pytest.approx([5.0], rel=1e-6)
    assert touch.ratio == pytest.approx([2.0, 2.5], rel=1e-6)
    assert touch.median == pytest.approx(2.25)
    assert touch.spread == pytest.approx(0.25 / 2.25)


def test_the_lines_are_those_of_the_bearing():
    lines = {line.name: line for line in analytic_lines(PlantParameters(), CONTROLLER)}
    assert list(lines) == ["static-load limit", "bias limit", "slew limit", "gain-loss limit"]
    gain = command_gain(lines["bias limit"].frequency, CONTROLLER)
    assert lines["bias limit"].amplitude * gain == pytest.approx(3.0)
    sag = 68.2e-6  # m, of the paper's bearing with the bending of the force
    assert lines["static-load limit"].amplitude * gain == pytest.approx(3.0 - 20e3 * sag, rel=0.01)


@pytest.mark.parametrize(
    ("plant", "axes", "missing"),
    [
        ({"rotor.gravity": 0.0}, "y", "static-load limit"),
        ({}, "x", "static-load limit"),
        ({"amplifier.unipolar": False}, "y", "bias limit"),
        ({"amplifier.limits": False, "amplifier.switching": False}, "y", "slew limit"),
    ],
)
def test_a_limit_that_the_bearing_does_not_have_has_no_line(plant, axes, missing):
    names = {line.name for line in analytic_lines(validate(PlantParameters, plant), CONTROLLER, axes)}
    assert missing not in names
    assert "gain-loss limit" in names
