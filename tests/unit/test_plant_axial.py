"""The rotor along its axis: running thrust bearing against closed forms, apart from the radial axes."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate

AXIAL = {"rotor.axial": True}
RIGID = {"rotor.model": "rigid"}
HEAVY = {**AXIAL, "rotor.mass": 1e5, "rotor.gravity": 0.0}  # nothing moves within the tests


def plant(**changes: object) -> Plant:
    return Plant(validate(PlantParameters, {**AXIAL, **changes}))


def controller(axes: int) -> PdController:
    return PdController(ControllerParameters(derivative_gains=(*[38.0] * (axes - 1), 80.0)), axes)


def component(signal: np.ndarray, frequency: float, step: float) -> complex:
    """Complex amplitude at a frequency of a signal of whole periods."""
    return complex(2.0 * np.mean(signal * np.exp(-2j * np.pi * frequency * step * np.arange(len(signal)))))


@pytest.mark.parametrize(
    ("frequency", "rate", "switching"),
    [(25.0, 1e4, False), (200.0, 1e4, True), (1000.0, 1e5, True), (10e3, 1e5, True), (20e3, 1e5, True)],
)
def test_force_per_coil_current_is_the_closed_form(frequency, rate, switching):
    changes = {"amplifier.switching": switching, "integration.sample_rate": rate}
    held = Plant(validate(PlantParameters, {**HEAVY, **changes}))
    step = held.parameters.integration.internal_step
    periods = max(4, round(0.01 * frequency))  # the flux settles slowly: half order
    traces = []
    for sample in range(round(2 * periods * rate / frequency)):
        current = 0.1 * np.sin(2.0 * np.pi * frequency * sample / rate)
        if sample < periods * rate / frequency:
            held.advance((0.0, 0.0, current))
        else:
            traces.append(held.trace((0.0, 0.0, current)).axial)
    force = np.concatenate([trace.force[:, 0] - trace.force[:, 1] for trace in traces])
    current = np.concatenate([trace.current[:, 0] - trace.current[:, 1] for trace in traces]) / 2.0
    # Forces belong to the start of a step, currents are means over it.
    late = np.exp(1j * np.pi * frequency * step)
    measured = component(force, frequency, step) * late / component(current, frequency, step)
    wanted = held.axial.circuit.force_response(3.0, np.array([frequency]))[0]
    assert abs(measured / wanted) == pytest.approx(1.0, abs=0.01)
    assert np.degrees(np.angle(measured / wanted)) == pytest.approx(0.0, abs=1.0)


def test_the_force_keeps_its_square_law_and_its_gap():
    held = Plant(validate(PlantParameters, {**HEAVY, "rotor.initial_z": 100e-6, "thrust_bearing.eddy_currents": False}))
    for _ in range(2000):
        held.advance((0.0, 0.0, -1.0))
    seen = held.snapshot().axial
    assert seen.coil_current == pytest.approx([2.0, 4.0], rel=2e-3)
    assert seen.position > 75e-6  # it weighs 100 t
    assert seen.force == pytest.approx(held.axial.circuit.force(seen.coil_current, seen.position), rel=2e-3)
    flux = seen.flux_density * np.array(held.axial.circuit.pole_areas)
    np.testing.assert_allclose(flux[:, 0], flux[:, 1], rtol=1e-12)


@pytest.mark.parametrize("eddy_currents", [True, False])
def test_bias_currents_hold_a_centred_disc_still(eddy_currents):
    still = plant(**{"thrust_bearing.eddy_currents": eddy_currents})
    assert {still.advance((0.0, 0.0, 0.0))[2] for _ in range(50)} == {0.0}
    current = still.trace((0.0, 0.0, 0.0)).axial.current
    np.testing.assert_array_equal(current[:, 0], current[:, 1])
    assert current[:, 0].mean() == pytest.approx(3.0, rel=1e-3)


def test_a_free_disc_falls_to_the_nearer_magnet_at_the_rate_of_its_negative_stiffness():
    still = {"rotor.gravity": 0.0, "thrust_bearing.eddy_currents": False, "amplifier.switching": False}
    free = plant(**still, **{"rotor.initial_z": 1e-6, "thrust_bearing.proportional_gain": 10.0})
    rate = np.sqrt(free.axial.circuit.negative_stiffness(3.0) / free.axial.mass)
    positions = [free.advance((0.0, 0.0, 0.0))[2] for _ in range(100)]
    # The disc induces a voltage, against which the amplifiers hold the current almost constant.
    assert positions[-1] == pytest.approx(1e-6 * np.cosh(rate * 0.01), rel=0.01)


def test_an_external_force_accelerates_the_whole_rotor():
    pushed = plant(
        **RIGID,
        **{"rotor.external_force_z": 12.5, "thrust_bearing.bias_current": 1e-3, "amplifier.switching": False},
    )
    assert pushed.axial.mass == pytest.approx(12.5)
    for _ in range(50):
        pushed.advance([0.0] * 5)
    assert pushed.position[4] == pytest.approx(0.5 * 1.0 * 0.005**2, rel=1e-3)


def test_the_mass_of_a_flexible_rotor_is_that_of_its_translation(tmp_path):
    from amb_core.plant import uniform_shaft

    uniform_shaft(0.9, 0.048, (-0.3, 0.3), bending_modes=2).save(tmp_path / "shaft.npz")
    flexible = plant(**{"rotor.model": "flexible", "flexible_rotor.modal_data": str(tmp_path / "shaft.npz")})
    assert flexible.axial.mass == pytest.approx(7850.0 * np.pi * 0.024**2 * 0.9, rel=0.01)


def test_touching_the_axial_backup_bearing_delevitates():
    falling = plant(**{"rotor.initial_z": 200e-6})
    while not falling.delevitated:
        falling.advance((0.0, 0.0, 0.0))
        assert falling.samples < 1000
    assert abs(falling.position[2]) >= 250e-6
    assert falling.snapshot().axial.contact
    with pytest.raises(PlantError, match="delevitated at sample"):
        falling.advance((0.0, 0.0, 0.0))
    falling.reset()
    assert falling.position[2] == 200e-6


def test_with_contact_the_rotor_rests_on_the_axial_backup_bearing():
    resting = plant(**{"rotor.initial_z": 200e-6, "backup_bearing.contact": True, "rotor.gravity": 0.0})
    for _ in range(3000):
        resting.advance((0.0, 0.0, 0.0))
    assert not resting.delevitated
    assert resting.contact
    seen = resting.snapshot().axial
    assert seen.position == pytest.approx(250e-6 + seen.force / 2e7, rel=1e-3)
    assert seen.contact_force == pytest.approx(-seen.force, rel=1e-3)


def test_a_disc_that_reaches_the_poles_is_reported_in_one_line():
    soft = plant(
        **{"rotor.initial_z": 200e-6, "rotor.gravity": 0.0},
        **{"backup_bearing.contact": True, "backup_bearing.stiffness": 1e3},
    )
    with pytest.raises(PlantError, match="the disc reached the poles of the thrust bearing at sample"):
        for _ in range(3000):
            soft.advance((0.0, 0.0, 0.0))


@pytest.mark.parametrize("model", ["point_mass", "rigid"])
def test_z_at_rest_leaves_the_radial_axes_bit_for_bit(model):
    common = {"rotor.model": model, "sensor.noise": 1e-7, "converters.computation_delay": 0.5}
    without = Plant(validate(PlantParameters, common))
    record = simulate(without, PdController(ControllerParameters(), len(without.machine.axes)), 300)
    noisy = plant(**common)
    other = simulate(noisy, controller(len(noisy.machine.axes)), 300)
    assert other.position[:, :-1].tobytes() == record.position.tobytes()
    assert other.current[:, :-1].tobytes() == record.current.tobytes()
    silent = plant(**{**common, "sensor.noise": 0.0})
    assert not simulate(silent, controller(len(silent.machine.axes)), 300).position[:, -1].any()


def test_noise_of_z_is_independent_of_that_of_the_other_axes_and_repeats_after_a_reset():
    noisy = plant(**{"sensor.noise": 1e-6, **HEAVY})
    first = np.array([noisy.advance((0.0, 0.0, 0.0)) for _ in range(2000)])
    assert np.std(first[:, 2]) == pytest.approx(1e-6, rel=0.05)
    assert abs(np.corrcoef(first.T)[2, :2]).max() < 0.08
    noisy.reset()
    assert noisy.advance((0.0, 0.0, 0.0)) == tuple(first[0])


def test_the_sensor_s_low_pass_and_the_converters_act_on_z_too():
    quantised = plant(**{"converters.position_resolution": 3e-6, "rotor.initial_z": 1e-5})
    assert quantised.advance((0.0, 0.0, 0.0))[2] == pytest.approx(9e-6)
    falling = {"rotor.initial_z": 1e-4, "rotor.gravity": 0.0}
    ideal, filtered = plant(**falling), plant(**falling, **{"sensor.bandwidth": 100.0})
    for _ in range(30):
        ideal.advance((0.0, 0.0, 0.0))
        filtered.advance((0.0, 0.0, 0.0))
    assert 1e-4 < filtered.position[2] < ideal.position[2]
    assert filtered.snapshot().axial.position == ideal.snapshot().axial.position


@pytest.mark.parametrize("delay", [0.0, 0.5, 1.0])
def test_a_trace_of_z_is_what_advance_computes(delay):
    traced, advanced = (plant(**{"converters.computation_delay": delay}) for _ in range(2))
    axial = traced.trace((0.0, 0.0, 0.5), samples=3).axial
    for _ in range(3):
        advanced.advance((0.0, 0.0, 0.5))
    assert axial.position.shape == (600,)
    assert axial.current.shape == (600, 2)
    assert traced.position == advanced.position
    late = int(200 * delay)
    assert np.ptp(axial.voltage[: max(late, 1), 0] - axial.voltage[: max(late, 1), 1]) == 0.0
    force = axial.force[:, 0] - axial.force[:, 1]
    assert np.flatnonzero(force)[0] >= late


def test_a_copy_goes_its_own_way():
    original = plant(**{"rotor.initial_z": 1e-5})
    other = copy.deepcopy(original)
    original.advance((0.0, 0.0, 1.0))
    assert other.position[2] == 1e-5
    assert other.advance((0.0, 0.0, 1.0)) == original.position


def test_the_wrong_number_of_currents_names_the_axes():
    with pytest.raises(PlantError, match="4 control current references; allowed: 5, x_a, y_a, x_b, y_b, z"):
        plant(**RIGID).advance([0.0] * 4)
    with pytest.raises(PlantError, match="2 control current references; allowed: 3, x, y, z"):
        plant().advance([0.0] * 2)


def test_terms_faster_than_a_step_leave_the_motion_as_it_is():
    """The fastest terms decay within a tenth of a step of 1 us; the drops are means over the step."""
    fine, coarse = (
        simulate(plant(**{"rotor.initial_z": 5e-5, "integration.internal_step": step}), controller(3), 200)
        for step in (0.25e-6, 1e-6)
    )
    assert np.abs(fine.position[:, 2] - coarse.position[:, 2]).max() < 0.5e-9
