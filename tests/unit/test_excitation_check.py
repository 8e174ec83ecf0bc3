"""Excitation check: spectra on a map, shares of the power, loads, and what the map does not tell.

`data/paper_map.json` has the regions of the paper's bearing that docs/explanation/regions.md lists: seven sweeps on y.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from amb_core.designs.excitation import ExcitationCheck, TrialBench, check_excitation
from amb_core.designs.excitation.notes import made_with
from amb_core.excitation import ExcitationSignal, excitation_from_request, generate
from amb_core.ground.errors import ExcitationError, RegionError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.machine import machine_of
from amb_core.regions import Region
from amb_core.regions.region_map import MapSettings, RegionMap
from amb_core.regions.region_map.build import MapJob

RATE = 10_000.0
MAP = RegionMap.load(Path(__file__).parent / "data" / "paper_map.json")


def signal(kind: str, rate: float = RATE, **values: Any) -> ExcitationSignal:
    if kind != "tones":
        values = {"amplitude": 10e-6, **values}
    return generate(excitation_from_request(kind, {"duration": 2.0, **values}), rate)


def map_of(plant: PlantParameters) -> RegionMap:
    """The map as if it were of another machine."""
    return replace(MAP, provenance={**MAP.provenance, "plant": plant.model_dump()})


def check(kind: str, **values: Any) -> ExcitationCheck:
    return check_excitation(signal(kind, **values), MAP)


def tone(frequency: float, amplitude: float, **values: Any) -> ExcitationCheck:
    return check("tones", frequencies=[frequency], amplitudes=[amplitude], axes="y", **values)


def notes(checked: ExcitationCheck) -> str:
    return "\n".join(checked.notes)


# -- the content of a signal


def test_a_square_wave_has_odd_harmonics_of_4_over_pi_n() -> None:
    axis = check("square", amplitude=50e-6, frequency=5.0).axes[0]
    assert axis.form == "lines"
    number = np.arange(1, 40, 2)
    assert axis.frequency[:20] == pytest.approx(5.0 * number)
    # A sampled square wave has 4 A / (N sin(pi n / N)) with N samples a period: 0.06 % more for the 39th.
    assert axis.amplitude[:20] == pytest.approx(4.0 * 50e-6 / (np.pi * number), rel=1e-3)


def test_tones_are_lines_even_between_the_lines_of_a_transform() -> None:
    axis = check("tones", frequencies=[50.3, 120.7], amplitudes=[10e-6, 20e-6]).axes[0]
    assert axis.frequency.tolist() == [50.3, 120.7]
    assert axis.amplitude.tolist() == [10e-6, 20e-6]
    assert axis.share == pytest.approx([0.2, 0.8])


@pytest.mark.parametrize("spacing", ["linear", "logarithmic"])
def test_a_sweep_keeps_its_amplitude_at_every_frequency(spacing: str) -> None:
    axis = check("sweep", amplitude=25e-6, spacing=spacing, axes="y").axes[0]
    assert axis.form == "instantaneous"
    assert axis.amplitude == pytest.approx(25e-6, rel=1e-3)
    assert axis.frequency[0] == pytest.approx(11.0, abs=1.0)
    assert axis.frequency[-1] == pytest.approx(400.0, abs=2.0)


@pytest.mark.parametrize("kind", ["white_noise", "multisine", "prbs"])
def test_bands_of_broad_signals_have_the_power_of_the_signal(kind: str) -> None:
    axis = check(kind).axes[0]
    assert axis.form == "bands"
    variance = axis.rms**2 - np.mean(signal(kind).samples[:, 0]) ** 2
    assert np.sum(axis.amplitude**2) / 2.0 == pytest.approx(variance)
    assert np.all(np.diff(axis.frequency) > 0.0)


def test_the_amplitude_of_a_band_does_not_depend_on_the_length_of_the_record() -> None:
    short, long = (check("multisine", amplitude=20e-6, duration=duration).axes[0] for duration in (2.0, 16.0))
    scaled = [axis.amplitude / axis.rms for axis in (short, long)]
    # Bands of 20 Hz have 40 lines in 2 s: one more or less is 1 %. Below that, edges of bands fall between lines.
    wide = short.frequency > 80.0
    assert scaled[0][wide] == pytest.approx(scaled[1][long.frequency > 80.0], rel=0.02)


@pytest.mark.parametrize(
    ("spelled", "axes"), [("bearing_a", "all"), ("x,y", "all"), ("both", "all"), ("translate_y", "y")]
)
def test_however_the_axes_are_spelled_the_check_is_of_the_same_signal(spelled: str, axes: str) -> None:
    assert check("white_noise", axes=spelled).verdict == check("white_noise", axes=axes).verdict


def test_orthogonal_experiments_are_checked_as_one_signal_on_each_axis() -> None:
    checked = check("multisine", axes="orthogonal")
    assert [axis.axis for axis in checked.axes] == ["x", "y"]
    assert [axis.rms for axis in checked.axes] == pytest.approx(
        signal("multisine", axes="orthogonal").samples.std(axis=0)
    )


def test_a_signal_for_two_bearings_is_refused() -> None:
    rig = machine_of(validate(PlantParameters, {"rotor.model": "rigid"}))
    four = generate(excitation_from_request("prbs", {"amplitude": 10e-6, "duration": 2.0}), RATE, rig)
    with pytest.raises(ExcitationError, match=r"the signal is for the axes x_a, y_a, x_b, y_b; .* one bearing"):
        check_excitation(four, MAP)


# -- regions, shares and loads


@settings(max_examples=10, deadline=None)
@given(
    kind=st.sampled_from(["sweep", "square", "multisine", "prbs", "white_noise"]),
    amplitude=st.floats(0.1e-6, 300e-6),
    axes=st.sampled_from(["x", "y", "both", "in_turn"]),
)
def test_shares_sum_to_one_on_each_axis_and_together(kind: str, amplitude: float, axes: str) -> None:
    checked = check(kind, amplitude=amplitude, axes=axes)
    for shares in (checked.shares, *(axis.shares for axis in checked.axes)):
        assert sum(shares.values()) == pytest.approx(1.0)
        assert set(shares) == set(Region)
    for axis in checked.axes:
        assert axis.share.sum() == pytest.approx(1.0)


def test_regions_along_a_sweep_are_those_of_the_map() -> None:
    axis = check("sweep", amplitude=25e-6, frequency_start=10.0, frequency_end=1_000.0, axes="y").axes[0]
    point = 990.0 / 400.0  # Hz between points of the sweep
    for region, frequency in ((Region.B, 242.0), (Region.D, 684.0)):
        assert axis.frequency[axis.region >= region].min() == pytest.approx(frequency, rel=0.01, abs=point)
    assert axis.shares[Region.A] == pytest.approx((242.0 - 10.0) / 990.0, abs=0.01)
    assert axis.covered.all()


@pytest.mark.parametrize(
    ("region", "amplitude", "frequency"), [(Region.B, 25e-6, 242.0), (Region.B, 50e-6, 147.0), (Region.D, 25e-6, 684.0)]
)
def test_a_single_sine_has_load_one_where_the_map_says_that_a_region_begins(
    region: Region, amplitude: float, frequency: float
) -> None:
    assert tone(frequency, amplitude).axes[0].load.towards[region] == pytest.approx(1.0, rel=0.03)


def test_two_sines_add_by_their_squares() -> None:
    loads = [tone(frequency, 10e-6).axes[0].load.linear for frequency in (200.0, 320.0)]
    both = check("tones", frequencies=[200.0, 320.0], amplitudes=[10e-6, 10e-6], axes="y").axes[0].load.linear
    assert both == pytest.approx(np.hypot(*loads), rel=0.01)


@pytest.mark.parametrize("kind", ["sweep", "square", "multisine", "prbs", "white_noise"])
def test_the_margin_of_the_map_is_the_factor_to_the_edge_of_region_a(kind: str) -> None:
    checked = check(kind, amplitude=40e-6)
    at_edge = check(kind, amplitude=40e-6 * checked.map_margin)
    assert max(axis.load.linear for axis in at_edge.axes) == pytest.approx(1.0, rel=0.01)


def test_the_load_of_noise_does_not_depend_on_the_length_of_the_record() -> None:
    loads = [check("white_noise", duration=duration).axes[0].load.linear for duration in (2.0, 16.0)]
    # The largest of 127 windows instead of 15, each known to 10 %: one standard deviation more.
    assert loads[0] == pytest.approx(loads[1], rel=0.12)


def test_a_chirp_of_low_crest_factor_loads_more_than_random_phases_of_the_same_power() -> None:
    random, chirp = (check("multisine", phasing=phasing, duration=4.0).axes[0] for phasing in ("random", "schroeder"))
    assert chirp.load.linear / chirp.rms > 1.3 * random.load.linear / random.rms


def test_edges_of_a_square_count_no_more_than_the_current_that_the_controller_allows() -> None:
    axis = check("square", amplitude=50e-6).axes[0]
    # The derivative of the edge, and the gain times the error: the rotor is 1.33 times the amplitude on the other side.
    assert axis.command_peak == pytest.approx(38.0 * 2.0 * 50e-6 * RATE + 20_000.0 * 2.33 * 50e-6, rel=2e-3)
    assert axis.limited == pytest.approx(10.0 / RATE)  # ten edges a second, a sample each
    assert axis.load.linear < 1.0


@pytest.mark.parametrize(("kind", "crest_factor"), [("square", 1.0), ("sweep", np.sqrt(2.0)), ("prbs", 1.0)])
def test_crest_factors(kind: str, crest_factor: float) -> None:
    assert check(kind).axes[0].crest_factor == pytest.approx(crest_factor, rel=1e-2)


# -- limits of current and voltage


def test_the_current_that_carries_the_weight_counts_towards_the_limit() -> None:
    x, y = check("multisine", amplitude=27e-6, frequency_end=700.0).axes
    assert x.static_current == pytest.approx(0.0, abs=1e-9)
    assert y.static_current == pytest.approx(1.363, abs=0.01)  # 61.3 N and 68 um of sag
    assert y.command_peak > 3.0 > y.command_peak - y.static_current  # clipped because of the weight
    assert y.limited > 0.0 == x.limited


def test_what_is_predicted_to_clip_does_so_in_simulation() -> None:
    excitation = signal("multisine", amplitude=40e-6, frequency_end=700.0, duration=1.0)
    predicted = check_excitation(excitation, MAP).axes[1]
    trial = TrialBench(PlantParameters(), ControllerParameters(), rest=0.5).run(excitation)
    assert trial.measures[1].clipped == pytest.approx(predicted.limited, rel=0.5)


def test_a_slew_that_the_voltage_cannot_drive_is_in_the_verdict() -> None:
    slow = validate(PlantParameters, {"amplifier.supply_voltage": 20.0, "magnetic_circuit.coil_resistance": 0.0})
    checked = check_excitation(signal("multisine", amplitude=2e-6, frequency_end=2_000.0), map_of(slow), None, slow)
    assert checked.slew_rate == pytest.approx(10.0 / 7.15e-3, rel=0.01)
    assert all(axis.slewed > 0.01 for axis in checked.axes)
    assert "region A by the map, " in checked.verdict
    assert "on y the control current changes faster than the voltage can drive it in " in checked.verdict
    assert "may be multiplied" not in checked.verdict


def test_the_voltage_that_the_resistance_of_the_coil_takes_drives_no_current() -> None:
    resistive = validate(PlantParameters, {"magnetic_circuit.coil_resistance": 20.0})
    checked = check_excitation(signal("multisine"), map_of(resistive), None, resistive)
    assert checked.slew_rate == pytest.approx((150.0 - 20.0 * (3.0 + 1.363)) / 7.15e-3, rel=0.01)
    assert checked.current_limit == 3.0
    hot = validate(PlantParameters, {"magnetic_circuit.coil_resistance": 30.0})
    assert check_excitation(signal("multisine"), map_of(hot), None, hot).current_limit == pytest.approx(2.0)


# Gap 0.4 mm, 100 turns a pole, 2 A, 3 kg: the voltage drives the current at 1.75 kA/s, a tenth of the paper's bearing.
SLOW_AMPLIFIER = {
    "magnetic_circuit.air_gap": 0.4e-3, "magnetic_circuit.journal_outer_radius": 35.2e-3,
    "magnetic_circuit.turns_per_pole": 100, "amplifier.supply_voltage": 150.0,
    "amplifier.switching_frequency": 20e3, "amplifier.bias_current": 2.0, "rotor.mass": 3.0,
    "integration.sample_rate": 20e3,
}  # fmt: skip


@pytest.mark.parametrize("amplitude", [1e-6, 5e-6, 19e-6])  # A, A with slew, and B by a map that suits 17 um
def test_no_advice_leads_beyond_the_limits_of_current_and_voltage(amplitude: float) -> None:
    plant = validate(PlantParameters, SLOW_AMPLIFIER)
    controller = ControllerParameters(sample_rate=20e3, proportional_gain=12_430.0, derivative_gain=11.0)

    def checked(amplitude: float) -> ExcitationCheck:
        values = {"amplitude": amplitude, "frequency_end": 2_000.0, "duration": 1.0}
        excitation = generate(excitation_from_request("multisine", values), 20e3)
        return check_excitation(excitation, map_of(plant), controller, plant)

    first = checked(amplitude)
    assert f"at most {first.margin:.2f} (by the voltage on" in first.verdict or first.margin > 1.0
    followed = checked(first.margin * amplitude)
    assert max(axis.slewed for axis in followed.axes) == pytest.approx(0.01, rel=0.05)
    assert all(axis.limited <= 0.01 and axis.load.linear < 1.0 for axis in followed.axes)
    assert "by the voltage on" in first.verdict


# -- the verdict


def test_the_verdict_changes_with_the_amplitude() -> None:
    small, medium, large = (check("white_noise", amplitude=amplitude) for amplitude in (5e-6, 25e-6, 150e-6))
    assert [one.predicted for one in (small, medium, large)] == [Region.A, Region.B, Region.D]
    assert small.verdict.startswith("region A: ")
    assert f"multiplied by {small.margin:.2f}" in small.verdict
    assert medium.verdict.startswith("region B on ")
    assert "by all of its content together" in medium.verdict  # none of its bands reaches B alone
    assert f"at most {medium.margin:.2f}" in medium.verdict
    assert small.margin > 1.0 > medium.margin > large.margin


def test_the_verdict_on_a_sweep_names_the_frequencies() -> None:
    assert "region B on y at 242 Hz to 400 Hz" in check("sweep", amplitude=25e-6, axes="y").verdict


def test_where_the_map_shows_no_boundary_region_a_is_called_uncertain() -> None:
    checked = check("square", amplitude=90e-6)  # its fundamental, 115 um at 5 Hz, is larger than any sweep of the map
    assert (checked.predicted, checked.certain) == (Region.A, False)
    assert "not certain" in checked.verdict
    assert "above 100 um" in notes(checked)


# -- what a reader should know


def test_content_outside_of_the_map_is_told() -> None:
    assert "81 % of the power lies outside the map, below 10 Hz" in notes(check("square"))
    narrow = replace(MAP, settings=MAP.settings.model_copy(update={"frequency_end": 300.0}))
    assert "of the power lies outside the map, above 300 Hz" in notes(check_excitation(signal("multisine"), narrow))
    assert "where the map is extrapolated at constant control current" in notes(
        check("multisine", frequency_end=2_000.0)
    )
    assert not check("multisine", amplitude=5e-6, axes="y").notes


def test_a_map_of_another_axis_is_told() -> None:
    assert check("multisine", axes="x").notes == ("x: the map is of sweeps on y",)
    of_both = replace(MAP, settings=MAP.settings.model_copy(update={"axes": "both"}))
    assert not check_excitation(signal("multisine"), of_both).notes


def test_a_map_of_another_loop_is_told() -> None:
    controller = validate(ControllerParameters, {"derivative_gain": 50.0, "current_limit": 10.0})
    plant = validate(PlantParameters, {"sensor.noise": 1e-7})
    text = notes(check_excitation(signal("multisine"), MAP, controller, plant))
    assert "another controller: derivative_gain = 38.0 (here 50.0), current_limit = 3.0 (here 10.0)" in text
    assert "another plant: sensor.noise = 0.0 (here 1e-07)" in text


def test_a_map_of_another_machine_is_refused() -> None:
    other = validate(PlantParameters, {"rotor.mass": 3.0, "magnetic_circuit.turns_per_pole": 60})
    with pytest.raises(ExcitationError, match=r"another machine: magnetic_circuit\.turns_per_pole = 50 \(here 60\), "):
        check_excitation(signal("multisine"), MAP, ControllerParameters(), other)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"integration.sample_rate": 20e3}, r"integration\.sample_rate = 10000.0 \(here 20000.0\)"),
        ({"sensor.bandwidth": 5e3}, r"sensor\.bandwidth = 0.0 \(here 5000.0\)"),
    ],
)
def test_a_map_of_another_sample_rate_or_sensor_bandwidth_is_of_another_machine(
    changed: dict[str, float], told: str
) -> None:
    with pytest.raises(ExcitationError, match=rf"another machine: {told}; draw a map"):
        check_excitation(signal("multisine"), MAP, ControllerParameters(), validate(PlantParameters, changed))


def test_a_map_of_a_machine_whose_backup_bearing_is_modelled_is_a_map_of_that_machine() -> None:
    plant = validate(PlantParameters, {"backup_bearing.contact": True, "backup_bearing.stiffness": 1e7})
    settings = MapSettings(amplitude_low=5e-6, amplitude_high=10e-6, duration=0.2, rest=0.1, frequency_end=1e3)
    job = MapJob(settings, plant, ControllerParameters())
    for amplitude in (5e-6, 10e-6):
        job.refinement.add(job.task(amplitude).run())
    own = job.map()
    noted = notes(check_excitation(signal("multisine", axes="y"), own, ControllerParameters(), plant))
    assert "plant" not in noted


def test_an_unstable_loop_is_not_put_down_to_the_amplitude() -> None:
    undamped = validate(ControllerParameters, {"derivative_gain": 0.0})
    for amplitude in (1e-8, 1e-5):
        with pytest.raises(ExcitationError, match="unstable without any excitation: its largest pole is 1"):
            check_excitation(signal("multisine", amplitude=amplitude), MAP, undamped)


def test_another_sample_rate_is_told() -> None:
    checked = check_excitation(signal("multisine", rate=20_000.0), MAP)
    assert "the signal is sampled at 20000 Hz, the controller at 10000 Hz" in notes(checked)


def test_a_map_that_is_not_complete_is_told() -> None:
    assert "not complete" in notes(check_excitation(signal("multisine"), replace(MAP, complete=False)))


def test_a_map_without_provenance_needs_the_loop() -> None:
    unknown = replace(MAP, provenance={})
    with pytest.raises(RegionError, match="does not contain the parameters of its controller; specify them"):
        check_excitation(signal("multisine"), unknown)
    checked = check_excitation(signal("multisine"), unknown, ControllerParameters(), PlantParameters())
    assert "does not contain the parameters of its plant" in notes(checked)
    with pytest.raises(RegionError, match=r"support the controller of the region map: unknown parameter 'gain' = 3"):
        check_excitation(signal("multisine"), replace(MAP, provenance={"controller": {"gain": 3}}))


def test_a_map_of_version_0_1_keeps_its_controller() -> None:
    recorded = {"proportional_gain": 21_000.0, "nominal_reference_x": 0.0, "nominal_reference_y": 40e-6}
    controller = made_with(replace(MAP, provenance={"controller": recorded}), "controller", ControllerParameters)
    assert controller == ControllerParameters(proportional_gain=21_000.0, nominal_reference=(0.0, 40e-6))


def test_an_empty_map_and_a_silent_signal_are_refused() -> None:
    with pytest.raises(RegionError, match="at least one sweep"):
        replace(MAP, sweeps=())
    with pytest.raises(ExcitationError, match="the signal on y is zero; there is nothing to check"):
        silent = signal("multisine", axes="y")
        check_excitation(replace(silent, samples=np.zeros_like(silent.samples)), MAP)


def test_a_map_of_a_single_sweep_and_a_signal_of_a_few_samples_will_do() -> None:
    checked = check_excitation(signal("prbs", duration=2e-3), replace(MAP, sweeps=MAP.sweeps[2:3]))
    assert sum(checked.shares.values()) == pytest.approx(1.0)
