"""Nonlinear iron and missing eddy currents in the running plant."""

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import validate
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.iron import saturation_curve

SATURATION = {"iron.saturation": True}
HYSTERESIS = {"iron.saturation": True, "iron.hysteresis": True}
AT_ONCE = {"iron.eddy_currents": False}


def plant_with(**values) -> Plant:
    return Plant(validate(PlantParameters, values))


@pytest.mark.parametrize("iron", [SATURATION, HYSTERESIS, SATURATION | AT_ONCE], ids=["curve", "loops", "at once"])
def test_deep_saturation_stays_finite_and_ends_where_the_curve_says(iron):
    current = 20.0
    plant = plant_with(**iron, **{"amplifier.current_limit": 23.0, "rotor.mass": 1e5, "rotor.gravity": 0.0})
    for _ in range(100):
        plant.advance((current, 0.0))
    last = plant.trace((current, 0.0))
    at_rest = plant.magnetostatics.solve(last.current.mean(axis=0), *last.position[-1])
    rates = np.diff(last.flux, axis=0) / plant.parameters.integration.internal_step
    assert np.abs(rates).max() < 10.0  # V per turn, of which the voltage gives 3: nothing runs away
    largest = np.abs(at_rest.flux).max()
    assert largest / plant.network.pole_area > 1.4  # T
    np.testing.assert_allclose(last.flux.mean(axis=0), at_rest.flux, atol=0.05 * largest)


@pytest.mark.parametrize(
    "iron", [{}, SATURATION, {"magnetic_circuit.coupling": False}], ids=["line", "curve", "separate"]
)
def test_without_eddy_currents_the_fluxes_are_those_of_the_currents_at_every_step(iron):
    plant = plant_with(**AT_ONCE, **iron)
    trace = plant.trace((1.0, -0.5), samples=3)
    for row in range(0, len(trace.time), 37):
        at_rest = plant.static_flux(trace.current[row], *trace.position[row])
        np.testing.assert_allclose(trace.flux[row], at_rest, atol=1e-5 * np.abs(at_rest).max())


def test_without_eddy_currents_voltages_move_the_flux_linkages():
    plant = plant_with(**AT_ONCE)
    trace = plant.trace((1.0, 0.0), samples=5)
    linkage = trace.flux @ plant.network.winding
    resistance, step = plant.parameters.magnetic_circuit.coil_resistance, plant.parameters.integration.internal_step
    middle = 0.5 * (trace.current[1:] + trace.current[:-1])
    expected = np.cumsum(step * (trace.voltage[:-1] - resistance * middle), axis=0)
    np.testing.assert_allclose(linkage[1:] - linkage[0], expected, atol=1e-6)


def test_without_eddy_currents_no_current_becomes_negative():
    plant = plant_with(**AT_ONCE)
    trace = plant.trace((3.0, 0.0), samples=5)  # the reference of -x is zero
    assert trace.current[:, 2].min() > -1e-6
    assert trace.current[-1, 2] == pytest.approx(0.0, abs=0.2)  # ripple


@pytest.mark.parametrize("iron", [SATURATION, HYSTERESIS], ids=["curve", "loops"])
def test_circulating_fluxes_appear_with_saturation_in_an_uneven_field(iron):
    plant = plant_with(**iron, **{"amplifier.current_limit": 20.0, "rotor.mass": 1e5, "rotor.gravity": 0.0})
    start = plant.snapshot().flux_density
    assert np.abs(start.sum()) < 1e-9
    for _ in range(60):
        plant.advance((12.0, 6.0))
    at_rest = plant.magnetostatics.solve(plant.snapshot().coil_current[0], 0.0, 0.0)
    assert np.abs(at_rest.circulating).max() > 1e-6


def test_user_table_is_the_curve_of_the_plant(tmp_path):
    table = tmp_path / "steel.csv"
    table.write_text("H,B\n0,0\n100,0.8\n1000,1.4\n20000,1.9\n")
    plant = plant_with(**SATURATION, **{"iron.bh_table": str(table)})
    curve = saturation_curve(plant.parameters.iron)
    np.testing.assert_allclose(curve.field(np.array([0.8, 1.4])), [100.0, 1000.0], rtol=1e-6)
    plant.advance((0.0, 0.0))


def test_table_that_is_not_monotone_is_refused_with_file_and_line(tmp_path):
    table = tmp_path / "steel.csv"
    table.write_text("H,B\n0,0\n100,0.8\n90,1.4\n20000,1.9\n")
    with pytest.raises(PlantError, match=r"steel\.csv.*line 4"):
        plant_with(**SATURATION, **{"iron.bh_table": str(table)})


def test_iron_state_has_all_elements_of_nonlinear_iron():
    density, field = plant_with(**HYSTERESIS).iron_state()
    assert density.shape == field.shape == (1, 24)
    assert np.abs(density[0, :8]).mean() == pytest.approx(0.31, abs=0.01)  # T, bias
    assert (np.sign(density[0, :8]) == np.sign(field[0, :8])).all()
    assert plant_with().iron_state()[0].shape == (0, 24)
