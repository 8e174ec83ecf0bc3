"""Region maps of a rotor in two bearings: any axis or rigid mode is swept, every axis is watched."""

from __future__ import annotations

import pytest

from amb_core.ground.errors import RegionError
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters, RotorParameters
from amb_core.plant.machine import machine_of
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map.build import MapJob
from amb_core.regions.region_map.compare import analytic_lines
from amb_core.regions.region_map.dwell_run import DwellTask
from amb_core.regions.region_map.excited_axes import axes_of_first_bearing
from amb_core.regions.region_map.map_sweep import MapSweep
from amb_core.regions.region_map.settings import ConfirmationSettings, MapSettings

ONE = PlantParameters()
TWO = PlantParameters(rotor=RotorParameters(model="rigid"))  # twice the mass of ONE in two bearings like that of ONE


def swept(plant: PlantParameters, axes: str, amplitude: float = 80e-6) -> MapSweep:
    settings = MapSettings(axes=axes, duration=2.0, frequency_end=500.0, rest=0.5)
    return MapJob(settings, plant, ControllerParameters()).task(amplitude).run()


def test_a_rotor_swept_in_translation_has_the_boundaries_of_half_its_mass_in_one_bearing():
    assert swept(TWO, "translate_y") == swept(ONE, "y")


def test_a_tilting_rotor_touches_at_another_frequency_than_a_translating_one():
    tilting, translating = swept(TWO, "tilt_y"), swept(TWO, "translate_y")
    assert Region.D in tilting.boundaries
    assert tilting.boundaries[Region.D].frequency != translating.boundaries[Region.D].frequency


@pytest.mark.parametrize(("axes", "names"), [("x", "x_a"), ("y", "y_a"), ("both", "x_a,y_a"), ("y_b", "y_b")])
def test_x_and_y_are_those_of_the_first_bearing(axes, names):
    assert axes_of_first_bearing(axes, machine_of(TWO)) == names
    assert axes_of_first_bearing(axes, machine_of(ONE)) == axes
    assert MapJob(MapSettings(axes=axes), TWO, ControllerParameters()).task(1e-6).sweep.axes == names


def test_dwells_excite_the_axes_of_their_sweep():
    settings = ConfirmationSettings(dwell=1.0)
    dwells = []
    for plant, axes in ((ONE, "y"), (TWO, "translate_y")):
        sweep = MapJob(MapSettings(axes=axes, rest=0.5), plant, ControllerParameters()).task(20e-6)
        dwells.append(DwellTask(sweep, 30.0, 30.0, settings).run())
    assert dwells[0].region is dwells[1].region
    assert dwells[0].displacement == pytest.approx(dwells[1].displacement, rel=1e-9)


@pytest.mark.parametrize(("axes", "loaded"), [("x_a", False), ("tilt_x", False), ("y_b", True), ("all", True)])
def test_gravity_loads_what_moves_along_y(axes, loaded):
    names = {line.name for line in analytic_lines(TWO, ControllerParameters(), axes)}
    assert ("static-load limit" in names) is loaded


def test_a_signal_on_both_axes_of_a_bearing_reaches_its_clearance_at_45_degrees():
    MapJob(MapSettings(axes="y_a,y_b", amplitude_high=200e-6), TWO, ControllerParameters(), RegionParameters())
    with pytest.raises(RegionError, match="45 degrees"):
        MapJob(MapSettings(axes="bearing_b", amplitude_high=200e-6), TWO, ControllerParameters())
