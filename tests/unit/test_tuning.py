"""Gains of a bearing that is known by a few numbers: they hold it with their margins, or the reason is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_core.designs.tuning import (
    HIGHEST_PEAK,
    Bearing,
    BearingDesign,
    design_bearing,
    lift_off,
    lift_off_current,
    parameter_file_of,
    plant_of,
    reason,
    tune,
)
from amb_core.designs.tuning.current_loop import CurrentLoop
from amb_core.designs.tuning.dynamic_stiffness import dynamic_stiffness, stiffness_and_damping
from amb_core.designs.tuning.loop_family import LoopFamily, gain_margins
from amb_core.designs.tuning.sizing import sizing_of
from amb_core.designs.tuning.stability_chart import stability_chart
from amb_core.ground.errors import ParameterError, PlantError
from amb_core.ground.parameters import flatten, load_parameters, validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters, describe, linearize
from amb_core.plant.averaged import coil_references
from amb_core.plant.closed_forms import current_gain, negative_stiffness
from amb_core.plant.operating_point import static_force
from amb_core.plant.simulation import simulate
from amb_core.report.figures import stability_figure
from tests.benchmarks.first_hour import new, wishes

SMALL = Bearing(gap=0.4e-3, turns=60, mass=4.0, bias_current=2.5, voltage=150.0, delay=1.0, sensor_bandwidth=5e3)


@pytest.fixture(scope="module")
def design() -> BearingDesign:
    return design_bearing(SMALL)


def test_the_rotor_lifts_off_and_is_held_in_the_centre_with_margins(design: BearingDesign) -> None:
    assert design.lift_off.levitated
    assert design.lift_off.farthest < 1e-6
    assert design.tuned.peak_sensitivity <= HIGHEST_PEAK
    model = linearize(Plant(design.plant), design.tuned.controller)
    assert model.stable
    assert np.abs(model.point.position).max() < 1e-8
    # exact, against the largest value on a dense grid of frequencies
    assert design.tuned.peak_sensitivity == pytest.approx(model.peak_sensitivity, rel=1e-4)
    assert design.tuned.peak_sensitivity >= model.peak_sensitivity * (1.0 - 1e-8)


def test_at_the_gain_margins_the_loop_is_at_the_limit_of_stability(design: BearingDesign) -> None:
    family = LoopFamily(design.tuned.model)
    gains = design.tuned.controller.proportional_gain, design.tuned.controller.derivative_gain
    low, high = gain_margins(family, *gains)
    assert low < 1.0 < high
    for factor, outwards in ((low, 0.99), (high, 1.01)):
        assert family.stable(*(factor * gain for gain in gains))
        assert not family.stable(*(outwards * factor * gain for gain in gains))


def test_the_gains_of_the_papers_current_loop_are_the_papers() -> None:
    paper = PlantParameters()
    bearing = Bearing(gap=0.6e-3, turns=50, mass=6.25, bias_current=3.0, voltage=300.0, pole_width=13.89e-3)
    amplifier = plant_of(bearing).amplifier
    assert amplifier.proportional_gain == paper.amplifier.proportional_gain
    assert amplifier.integral_gain == paper.amplifier.integral_gain


@pytest.mark.parametrize(
    "change",
    [
        {"gap": 0.1e-3, "bias_current": 1.0},
        {"switching_frequency": 400e3},
        {"resistance": 10.0, "voltage": 30.0, "bias_current": 0.5, "switching_frequency": 20e3},
    ],
)
def test_coil_currents_settle_at_their_references(change: dict[str, float]) -> None:
    """Of a rotor that is too heavy to move; 1 % of the current is what the paper's loop may leave to resistance."""
    wish = SMALL.model_copy(update=change | {"mass": 1e5, "gravity": 0.0})
    plant = Plant(plant_of(wish))
    plant.trace([0.0, 0.0], 1000)
    period = plant.parameters.steps_per_period
    means = plant.trace([0.0, 0.0], 20).current.reshape(-1, period, 4).mean(axis=1)
    assert np.abs(means / wish.bias_current - 1.0).max() < 0.01
    assert np.abs(np.diff(means, axis=0)).max() < 1e-6 * wish.bias_current


@pytest.mark.parametrize(("gap", "frequency"), [(0.1e-3, 100e3), (0.4e-3, 400e3), (0.5e-3, 100e3), (1e-3, 10e3)])
def test_current_loops_are_stable_with_twice_their_gains(gap: float, frequency: float) -> None:
    wish = SMALL.model_copy(update={"gap": gap, "switching_frequency": frequency})
    parameters = plant_of(wish)
    loop, amplifier = CurrentLoop(Plant(parameters)), parameters.amplifier
    for factor in (1.0, 2.0):
        assert loop.radius(factor * amplifier.proportional_gain, factor * amplifier.integral_gain) < 1.0


def test_a_slow_rotor_has_the_time_that_its_loop_needs() -> None:
    """Unstable pole of 4.7 1/s: nothing but its mass makes it slow."""
    slow = design_bearing(SMALL.model_copy(update={"gravity": 0.0, "mass": 5e4}))
    assert slow.lift_off.levitated
    assert len(slow.lift_off.record.position) / SMALL.sample_rate > 1.0


def test_noise_does_not_hide_a_rotor_that_stays_on_the_backup_bearing(design: BearingDesign) -> None:
    noisy = validate(PlantParameters, {**flatten(design.plant.model_dump()), "sensor.noise": 200e-6})
    limp = design.tuned.controller.model_copy(update={"proportional_gain": 0.0, "derivative_gain": 0.0})
    risen = lift_off(noisy, limp)
    assert risen is not None
    assert not risen.levitated
    assert risen.farthest > 0.9 * design.plant.rotor.backup_bearing_radius


def test_a_rotor_that_keeps_moving_is_not_at_rest(design: BearingDesign) -> None:
    """A force of 22 N moves it by 10 um to either side, a twentieth of the clearance."""
    force = {"rotor.external_force_x": 22.0, "rotor.external_force_frequency": 20.0}
    shaken = validate(PlantParameters, {**flatten(design.plant.model_dump()), **force})
    risen = lift_off(shaken, design.tuned.controller)
    assert risen is not None
    assert 5e-6 < risen.farthest < 20e-6
    assert not risen.levitated


def test_the_bearing_that_carries_most_decides_on_the_lift_off_current() -> None:
    """Bearing A carries two thirds of the rotor, as a point mass of that weight."""
    mass, place = 9.0, {"rigid_rotor.bearing_a": -0.1, "rigid_rotor.bearing_b": 0.2}
    rotor = validate(PlantParameters, {"rotor.model": "rigid", "rigid_rotor.mass": mass, **place})
    point = validate(PlantParameters, {"rotor.mass": 2.0 / 3.0 * mass})
    assert lift_off_current(rotor) == pytest.approx(lift_off_current(point), rel=1e-6)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_stiffness_and_damping_are_those_of_the_nonlinear_simulation(axis: str) -> None:
    """A slow force of 5 N moves the rotor by 10 um; distortion and eddy currents beyond the averaged plant make 1 %."""
    frequency, force, given = 50.0, 5.0, {"sensor.bandwidth": 1000.0, "converters.computation_delay": 1.0}
    shaken = {f"rotor.external_force_{axis}": force, "rotor.external_force_frequency": frequency}
    controller = validate(ControllerParameters, {"proportional_gain": 14_000.0, "derivative_gain": 30.0})
    record = simulate(Plant(validate(PlantParameters, given | shaken)), PdController(controller), 3000).window(
        2000, 1000
    )
    place = "xy".index(axis)
    turning = np.exp(-2j * np.pi * frequency * record.time)
    sensed = 2.0 * np.mean((record.position[:, place] - record.position[:, place].mean()) * turning)
    moved = sensed * (1.0 + 1j * frequency / given["sensor.bandwidth"])
    plant = Plant(validate(PlantParameters, given))
    stiffness = dynamic_stiffness(plant, linearize(plant, controller), 2.0 * np.pi * frequency)
    assert stiffness[place, place] == pytest.approx(force / moved, rel=0.01)


def test_stiffness_and_damping_are_those_of_the_band_in_which_the_rotor_moves() -> None:
    """The integral parts of the paper's current loops drift for seconds: what they take at 0.1 Hz is no damping."""
    plant, controller = Plant(PlantParameters()), ControllerParameters()
    model = linearize(plant, controller)
    stiffness, damping = stiffness_and_damping(plant, model)
    omega = 2.0 * np.pi * 10.0
    along_axes = np.diag(dynamic_stiffness(plant, model, omega))
    mass = plant.parameters.rotor.mass
    assert stiffness == pytest.approx((along_axes.real + mass * omega**2).min(), rel=2e-3)
    assert damping == pytest.approx(along_axes.imag.min() / omega, rel=1e-2)


def test_stiffness_and_damping_of_an_ideal_magnet_are_the_closed_forms() -> None:
    """The lag of sampling and amplifiers takes 0.2 % of the damping at 100 kHz."""
    ideal = {
        "magnetic_circuit.relative_permeability": 1e9,
        "magnetic_circuit.coil_resistance": 0.0,
        "iron.eddy_currents": False,
        "rotor.gravity": 0.0,
        "integration.sample_rate": 1e5,
    }
    parameters = validate(PlantParameters, ideal)
    gains = {"proportional_gain": 14_000.0, "derivative_gain": 30.0, "sample_rate": 1e5}
    plant = Plant(parameters)
    stiffness, damping = stiffness_and_damping(plant, linearize(plant, validate(ControllerParameters, gains)))
    circuit, bias = parameters.magnetic_circuit, parameters.amplifier.bias_current
    k_i, k_s = current_gain(circuit, bias), negative_stiffness(circuit, bias)
    assert stiffness == pytest.approx(k_i * gains["proportional_gain"] - k_s, rel=1e-4)
    assert damping == pytest.approx(k_i * gains["derivative_gain"], rel=3e-3)


def test_the_lift_off_current_is_the_one_whose_force_carries_the_weight(design: BearingDesign) -> None:
    current = lift_off_current(design.plant)
    plant = Plant(design.plant)
    lowest = np.array([0.0, -design.plant.rotor.backup_bearing_radius])
    force = static_force(plant, coil_references(np.array([0.0, current]), plant), lowest)
    assert force[1] == pytest.approx(SMALL.mass * SMALL.gravity, rel=1e-2)


def test_the_file_gives_the_nodes_what_was_designed_with_a_comment_on_every_value(
    design: BearingDesign, tmp_path: Path
) -> None:
    text = parameter_file_of(design)
    file = tmp_path / "bearing.yaml"
    file.write_text(text)
    assert load_parameters(PlantParameters, file, "simulator", part=True) == design.plant
    loaded = load_parameters(ControllerParameters, file, "pd_controller", part=True)
    assert loaded.model_dump() == design.tuned.controller.model_dump()
    values = [line for line in text.splitlines() if ": " in line and not line.startswith("#")]
    assert all(" # " in line for line in values)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"mass": 200.0}, r"static load beyond the force: lifting the rotor off .* allowed: less than 2\.5 A"),
        ({"sample_rate": 1e3, "turns": 120, "mass": 1.0}, r"no PD gains .*sampling too slow \(1000 Hz"),
        ({"sensor_bandwidth": 50.0}, r"no PD gains .*sensor too slow \(50 Hz\)"),
    ],
)
def test_a_bearing_that_no_pd_gains_hold_is_refused_with_the_reason(change: dict[str, float], problem: str) -> None:
    with pytest.raises(PlantError, match=problem):
        design_bearing(SMALL.model_copy(update=change))


def test_a_bias_that_saturates_the_iron_is_refused_with_what_would_do() -> None:
    wish = {"gap": 0.35e-3, "turns": 180, "mass": 4.0, "bias_current": 3.0, "voltage": 48.0, "sample_rate": 20_000.0}
    with pytest.raises(PlantError, match=r"flux density of 1\.94 T.*allowed: up to 1 T, .* of 1\.55 A, 92 turns or"):
        design_bearing(Bearing(**wish))
    assert design_bearing(Bearing(**wish | {"turns": 92, "voltage": 150.0})).lift_off.levitated


def test_a_light_rotor_lifts_off_from_a_backup_bearing_as_soft_as_its_internal_step_needs() -> None:
    magnets = {"gap": 0.3e-3, "turns": 100, "pole_width": 2e-3, "length": 4e-3, "journal_diameter": 8e-3}
    design = design_bearing(Bearing(**magnets, mass=1e-3, bias_current=0.2, voltage=30.0, sample_rate=20_000.0))
    stiff = {**flatten(design.plant.model_dump()), "backup_bearing.damping": 1e4}
    with pytest.raises(PlantError, match=r"too long for backup_bearing\.damping = 10000 N s/m"):
        Plant(validate(PlantParameters, {**stiff, "backup_bearing.contact": True}))
    assert lift_off(validate(PlantParameters, stiff), design.tuned.controller).levitated


def test_closed_forms_are_those_of_the_plant(design: BearingDesign) -> None:
    sizing, described = design.sizing, describe(design.plant, design.tuned.controller)
    assert sizing.bias_flux_density == pytest.approx(described.bias_flux_density, rel=0.05)  # without the iron
    assert sizing.unstable_pole == pytest.approx(described.unstable_pole, rel=0.1)
    assert sizing.remarks == []


def test_the_slew_rate_of_the_force_is_that_of_the_simulation() -> None:
    """The duty cycle is limited: a coil gets half of the supply. Iron takes 5 % of the flux."""
    parameters = plant_of(SMALL.model_copy(update={"mass": 1e5, "gravity": 0.0, "delay": 0.0}))
    force = Plant(parameters).trace([0.0, 2.0], 1).force[:: parameters.steps_per_period, 1]
    slew = (force[8] - force[3]) / 5.0 * parameters.amplifier.switching_frequency
    assert sizing_of(parameters).force_slew == pytest.approx(slew, rel=0.06)


@pytest.mark.parametrize(
    ("change", "remark"),
    [
        ({"switching_frequency": 10e3, "voltage": 300.0}, "current ripple of"),
        ({"sample_rate": 1e3, "switching_frequency": 100e3}, "samples to respond"),
        ({"switching_frequency": 10e3, "mass": 0.01}, "is hardly faster than the unstable pole"),
    ],
)
def test_what_is_little_or_much_is_named(change: dict[str, float], remark: str) -> None:
    assert any(remark in text for text in sizing_of(plant_of(SMALL.model_copy(update=change))).remarks)


def test_no_wish_gets_a_text_of_the_simulator() -> None:
    figures = wishes.measure(8)
    assert figures["texts"] == []
    assert figures["levitated"] + figures["explained"] == 8


def test_a_machine_with_a_thrust_bearing_gets_radial_gains_and_keeps_the_axial_ones() -> None:
    rig = validate(PlantParameters, {"rotor.model": "rigid", "rotor.axial": True})
    given = validate(ControllerParameters, {"proportional_gain": 16_000.0, "derivative_gain": 90.0})
    tuned = tune(rig, given)
    assert tuned is not None
    assert tuned.peak_sensitivity <= HIGHEST_PEAK
    assert len(tuned.controller.proportional_gains) == 5
    assert (tuned.controller.proportional_gains[4], tuned.controller.derivative_gains[4]) == (16_000.0, 90.0)
    chart = stability_chart(rig, given, points=8)
    assert np.isfinite(chart.peak).any()


def test_gains_of_the_current_loops_are_named_if_others_would_do() -> None:
    slow = validate(PlantParameters, {"amplifier.proportional_gain": 5e-4})
    tuned = tune(slow)
    assert tuned is None or tuned.peak_sensitivity > HIGHEST_PEAK
    said = reason(slow, ControllerParameters())
    assert "current loops, K_P = 0.0005 1/A" in said
    assert "K_P = 1 1/A and K_I = 0.01 1/(A s) would do" in said


def test_slow_switching_is_named_only_where_faster_switching_helps() -> None:
    slow = {"mass": 0.05, "sample_rate": 10e3, "switching_frequency": 10e3, "delay": 0.0}
    with pytest.raises(PlantError, match=r"amplifier too slow \(150 V, 10000 Hz\)"):
        design_bearing(SMALL.model_copy(update=slow | {"sensor_bandwidth": 0.0}))
    with pytest.raises(PlantError) as refusal:  # the sensor would still be too slow
        design_bearing(SMALL.model_copy(update=slow))
    assert "amplifier too slow" not in str(refusal.value)


def test_a_narrow_gap_is_not_blamed_on_sampling_or_eddy_currents() -> None:
    """With the paper's loop gain the current loops of this bearing were unstable."""
    wish = {"gap": 0.11e-3, "turns": 30, "mass": 1.5, "bias_current": 1.5, "voltage": 120.0}
    assert design_bearing(Bearing(**wish, switching_frequency=330e3)).tuned.peak_sensitivity < 2.0


def test_a_rotor_that_no_single_part_lifts_is_not_blamed_on_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("amb_core.designs.tuning.design.lift_off", lambda *_: None)
    with pytest.raises(PlantError, match="does not rise from the backup bearing: no part alone is the reason"):
        design_bearing(SMALL)


def test_a_voltage_that_is_too_low_to_lift_is_named_and_ten_times_as_much_lifts() -> None:
    wish = {"gap": 0.87e-3, "turns": 313, "mass": 3.19, "bias_current": 1.1, "voltage": 30.0, "resistance": 9.6}
    size = {"journal_diameter": 51e-3, "length": 16e-3, "sample_rate": 5e3, "switching_frequency": 57e3}
    with pytest.raises(PlantError, match=r"does not rise .* amplifier too slow: 30 V do not change") as refusal:
        design_bearing(Bearing(**wish, **size))
    assert "control current is limited" not in str(refusal.value)
    assert design_bearing(Bearing(**wish | {"voltage": 300.0}, **size)).lift_off.levitated


def test_coils_of_high_resistance_get_the_currents_that_lift() -> None:
    """With the paper's share of integral action the resistance kept 7 % of them away, and the rotor down."""
    wish = {"gap": 0.19e-3, "turns": 17, "mass": 0.727, "bias_current": 1.9, "voltage": 210.0, "resistance": 2.4}
    size = {"journal_diameter": 34e-3, "length": 32e-3, "sample_rate": 16e3, "switching_frequency": 54e3}
    assert design_bearing(Bearing(**wish, **size, delay=1.0, sensor_bandwidth=5e3)).lift_off.levitated


@pytest.mark.parametrize(
    ("change", "problem"),
    [({"clearance": 1e-3}, "clearance = 0.001 m must be smaller than gap"), ({"current_limit": 1.0}, "must be larger")],
)
def test_numbers_that_make_no_bearing_are_refused(change: dict[str, float], problem: str) -> None:
    with pytest.raises(ParameterError, match=problem):
        validate(Bearing, {**SMALL.model_dump(), **change})


def test_switching_slower_than_the_controller_is_refused() -> None:
    slow = {**SMALL.model_dump(), "sample_rate": 50e3, "switching_frequency": 10e3}
    with pytest.raises(ParameterError, match="switching_frequency = 10000 Hz must be at least sample_rate = 50000 Hz"):
        validate(Bearing, slow)


@pytest.mark.parametrize(("rate", "used"), [(95e3, 950e3), (1e6 / 11.0, 1e6), (1e6 / 49.0, 1e6), (1e5, 1e6)])
def test_the_fastest_switching_is_of_whole_periods_within_its_range(rate: float, used: float) -> None:
    bearing = SMALL.model_copy(update={"sample_rate": rate, "switching_frequency": 1e6})
    assert plant_of(bearing).amplifier.switching_frequency == pytest.approx(used)


def test_another_switching_frequency_than_the_given_one_is_named(design: BearingDesign) -> None:
    assert not any("switching frequency is" in remark for remark in design.remarks)
    odd = design_bearing(SMALL.model_copy(update={"sample_rate": 12e3, "switching_frequency": 20e3}))
    assert "the switching frequency is 24000 Hz instead of 20000 Hz: whole periods in a sample" in odd.remarks


def test_slow_switching_and_odd_rates_make_a_plant() -> None:
    plant = plant_of(SMALL.model_copy(update={"sample_rate": 12e3, "switching_frequency": 20e3}))
    assert plant.amplifier.switching_frequency == 24e3
    assert plant.steps_per_sample % plant.steps_per_period == 0


@pytest.mark.parametrize("model", ["point_mass", "rigid"])
def test_a_chart_has_the_peaks_of_the_loops_that_its_gains_make(model: str) -> None:
    parameters = validate(PlantParameters, {"rotor.model": model})
    chart = stability_chart(parameters, ControllerParameters(), points=12)
    assert chart.chosen_peak <= HIGHEST_PEAK
    assert 0.0 < np.isfinite(chart.peak).mean() < 1.0
    row, column = np.unravel_index(np.argmin(chart.peak), chart.peak.shape)
    gains = {"proportional_gain": chart.proportional[column], "derivative_gain": chart.derivative[row]}
    best = linearize(Plant(parameters), validate(ControllerParameters, gains), np.zeros(2))
    assert best.stable
    # the chart has 66 frequencies in a decade
    assert chart.peak[row, column] == pytest.approx(best.peak_sensitivity, rel=5e-3)


@pytest.mark.parametrize("derivative", [4.0, 0.5])
def test_the_peak_of_a_chart_is_that_of_the_given_controller_with_gains_of_its_axes(derivative: float) -> None:
    own = ControllerParameters(proportional_gains=(20e3, 15e3), derivative_gains=(38.0, derivative))
    chart = stability_chart(PlantParameters(), own, points=8)
    loop = linearize(Plant(), own, np.zeros(2))
    assert chart.chosen_peak == pytest.approx(loop.peak_sensitivity if loop.stable else np.inf)
    assert chart.chosen_peak > 10.0
    assert not chart.alike
    assert (chart.axis, *chart.chosen) == ("x", 20e3, 38.0)
    figure = stability_figure(chart)
    assert not any(getattr(item, "label", "").startswith("chosen") for item in figure.panels[0].items)
    assert "The axes have gains of their own" in figure.alt


def test_the_figure_shows_the_lines_and_the_chosen_gains() -> None:
    figure = stability_figure(stability_chart(PlantParameters(), ControllerParameters(), points=16))
    labels = [getattr(item, "label", "") for item in figure.panels[0].items]
    assert {"peak sensitivity 2", "peak sensitivity 3", "peak sensitivity 4"} <= set(labels)
    assert "chosen: peak sensitivity 1.49" in labels
    assert "% of the gains shown are stable" in figure.alt
    assert figure.figure().axes
    assert figure.page().data


def test_random_bearings_levitate_or_the_reason_is_named() -> None:
    figures = new.measure(bearings=3, seed=7)
    assert figures["levitated"] + figures["explained"] == figures["bearings"] == 3
    assert figures["levitated"] >= 2


@pytest.mark.slow
@pytest.mark.timeout(1_800)
def test_97_of_100_random_bearings_levitate_and_the_others_have_a_reason() -> None:
    figures = new.measure()
    assert figures["levitated"] >= 97, figures["reasons"]
    assert figures["levitated"] + figures["explained"] == figures["bearings"] == 100
    assert figures["worst_peak_sensitivity"] <= HIGHEST_PEAK
