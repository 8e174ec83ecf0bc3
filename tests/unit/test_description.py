"""The description of a plant: the constants of the paper's bearing, and the command that prints them."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import ParameterError, PlantError
from amb_core.ground.parameters import load_parameters, validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import (
    AmplifierParameters,
    IntegrationParameters,
    MagneticCircuitParameters,
    PlantDescription,
    PlantParameters,
    RotorParameters,
    describe,
)

PAPER_FILE = Path(__file__).parents[2] / "src" / "amb_bringup" / "config" / "paper.yaml"


@pytest.fixture(scope="module")
def paper() -> PlantDescription:
    return describe(PlantParameters())


@pytest.mark.parametrize(("coupling", "stiffness"), [(True, 3.57e5), (False, 3.05e5)])
def test_ideal_iron_gives_the_values_of_the_closed_forms(coupling, stiffness):
    circuit = MagneticCircuitParameters(relative_permeability=1e12, coupling=coupling)
    description = describe(PlantParameters(magnetic_circuit=circuit))
    assert description.current_gain == pytest.approx(66.0, abs=0.1)
    assert description.negative_stiffness == pytest.approx(stiffness, rel=2e-3)
    assert description.bias_flux_density == pytest.approx(0.314, abs=1e-3)
    assert description.peak_force == pytest.approx(3.0 * description.current_gain, rel=1e-9)


def test_inductance_and_slew_rate_are_those_of_two_gaps_in_series():
    circuit = MagneticCircuitParameters(relative_permeability=1e12, coupling=False)
    description = describe(PlantParameters(magnetic_circuit=circuit))
    assert description.coil_inductance == pytest.approx(7.15e-3, rel=1e-3)
    left = 150.0 - 0.2 * (3.0 + 6.25 * 9.81 / 66.0)  # V, less what the resistance takes at rest
    assert description.slew_rate == pytest.approx(left / 7.15e-3, rel=2e-3)


def test_the_slew_rate_of_a_resistive_coil_is_that_of_the_voltage_that_the_current_at_rest_leaves():
    ideal, resistive = (
        describe(PlantParameters(magnetic_circuit=MagneticCircuitParameters(coil_resistance=resistance)))
        for resistance in (0.0, 20.0)
    )
    at_rest = 3.0 + ControllerParameters().proportional_gain * resistive.sag
    assert ideal.slew_rate * ideal.coil_inductance == pytest.approx(150.0)
    assert resistive.slew_rate * resistive.coil_inductance == pytest.approx(150.0 - 20.0 * at_rest)


def test_paper_bearing_has_its_natural_frequency_damping_and_sag(paper):
    assert paper.natural_frequency_x == pytest.approx(63.0, abs=1.0)
    assert paper.damping_ratio_x == pytest.approx(0.5, abs=0.02)
    assert paper.natural_frequency_y < paper.natural_frequency_x  # the sag moves y towards the stronger magnet
    assert paper.sag == pytest.approx(66e-6, abs=4e-6)
    assert paper.stable


def test_iron_lowers_gain_and_stiffness_by_less_than_a_tenth(paper):
    assert 60.0 < paper.current_gain < 66.0
    assert 0.9 * 3.57e5 < paper.negative_stiffness < 3.57e5


def test_eddy_currents_lag_in_proportion_to_the_conductivity(paper):
    twice = describe(PlantParameters(magnetic_circuit=MagneticCircuitParameters(iron_conductivity=4.0e6)))
    assert twice.eddy_time_constant == pytest.approx(2.0 * paper.eddy_time_constant, rel=1e-9)


def test_peak_force_is_limited_by_amplifier_and_controller():
    strong = ControllerParameters(current_limit=100.0)
    by_amplifier = describe(PlantParameters(), strong).peak_force
    assert by_amplifier == describe(PlantParameters(), ControllerParameters(current_limit=7.0)).peak_force
    assert by_amplifier > describe(PlantParameters(), ControllerParameters(current_limit=3.0)).peak_force


def test_overdamped_loop_has_the_natural_frequency_of_its_rigid_mode():
    stiff = describe(PlantParameters(), ControllerParameters(derivative_gain=110.0))
    assert stiff.stable
    assert stiff.natural_frequency_x == pytest.approx(64.0, abs=3.0)
    assert stiff.damping_ratio_x == pytest.approx(1.5, abs=0.1)


def test_loop_whose_rotor_and_amplifiers_swing_together_has_no_natural_frequency():
    slow = PlantParameters(amplifier=AmplifierParameters(proportional_gain=0.1))
    coupled = describe(slow, ControllerParameters(proportional_gain=5e4, derivative_gain=150.0, derivative_filter=1e-4))
    assert coupled.stable
    assert coupled.natural_frequency_x is coupled.damping_ratio_x is None


def test_unstable_loop_has_no_sensitivity():
    undamped = describe(PlantParameters(), ControllerParameters(derivative_gain=0.0))
    assert not undamped.stable
    assert undamped.peak_sensitivity is None


PAPER_EFFECTS = {"coupling", "linear_iron", "eddy_currents", "switching", "limits", "unipolar", "gravity"}


def effects_that_are_on(**values) -> set[str]:
    description = describe(
        validate(PlantParameters, {name.replace("__", "."): value for name, value in values.items()})
    )
    return {entry.name for entry in description.effects.entries if entry.value}


@pytest.mark.parametrize(
    ("values", "switched"),
    [
        ({}, set()),
        ({"magnetic_circuit__coupling": False}, {"coupling"}),
        ({"iron__saturation": True}, {"linear_iron", "saturation"}),
        ({"iron__saturation": True, "iron__hysteresis": True}, {"linear_iron", "saturation", "hysteresis"}),
        ({"iron__eddy_currents": False}, {"eddy_currents"}),
        ({"iron__solid_journal": True}, {"solid_journal"}),
        ({"amplifier__switching": False}, {"switching"}),
        ({"amplifier__switching": False, "amplifier__limits": False}, {"switching", "limits"}),
        ({"amplifier__carriers": "interleaved"}, {"interleaved_carriers"}),
        ({"amplifier__dead_time": 1e-6}, {"dead_time"}),
        ({"amplifier__unipolar": False}, {"unipolar"}),
        ({"rotor__gravity": 0.0}, {"gravity"}),
        ({"rotor__model": "rigid"}, {"two_bearings"}),
        ({"rotor__model": "rigid", "rotor__running_speed": 50.0}, {"two_bearings", "gyroscopic"}),
        ({"rotor__running_speed": 50.0, "rotor__unbalance": 1e-5}, {"unbalance"}),
        ({"rotor__external_force_x": 5.0}, {"external_force"}),
        ({"backup_bearing__contact": True}, {"contact"}),
        ({"sensor__bandwidth": 5e3}, {"sensor_bandwidth"}),
        ({"sensor__noise": 1e-8}, {"sensor_noise"}),
        ({"converters__position_resolution": 1e-8}, {"quantisation"}),
        ({"converters__computation_delay": 0.5}, {"computation_delay"}),
    ],
)  # fmt: skip
def test_every_effect_is_switched_by_name(values, switched):
    assert effects_that_are_on(**values) == PAPER_EFFECTS ^ switched


def test_the_rig_is_the_paper_s_bearing_twice_under_a_rotor_of_twice_the_mass():
    rig = describe(load_parameters(PlantParameters, PAPER_FILE.with_name("rig.yaml"), "simulator"))
    assert {"two_bearings", "hysteresis", "contact"} < {entry.name for entry in rig.effects.entries if entry.value}
    assert rig.sag == pytest.approx(66e-6, abs=2e-6)
    assert rig.natural_frequency_y == pytest.approx(62.0, abs=2.0)


def test_without_gravity_the_rotor_does_not_sag():
    assert describe(PlantParameters(rotor=RotorParameters(gravity=0.0))).sag == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("actuators", "gain"), [("differential", 66.0), ("top_coil", 33.0)])
def test_bearing_with_one_degree_of_freedom_has_constants_along_y_alone(actuators, gain):
    circuit = MagneticCircuitParameters(relative_permeability=1e12, coupling=False, actuators=actuators)
    description = describe(PlantParameters(magnetic_circuit=circuit))
    assert description.current_gain == pytest.approx(gain, rel=2e-3)
    assert description.natural_frequency_x is None
    assert description.natural_frequency_y is not None
    assert description.bias_flux_density == pytest.approx(0.314, abs=1e-3)


def test_every_entry_has_unit_and_meaning(paper):
    for entry in [*paper.entries, *paper.effects.entries]:
        assert entry.unit
        assert entry.meaning


def test_default_controller_runs_at_the_rate_of_the_plant():
    assert describe(PlantParameters(integration=IntegrationParameters(sample_rate=20_000.0))).stable


def test_rotor_that_cannot_be_held_is_refused():
    with pytest.raises(PlantError, match="cannot hold the rotor of 1000 kg inside the backup bearing"):
        describe(PlantParameters(rotor=RotorParameters(mass=1_000.0)))


# -- the command


def test_command_prints_json_of_the_paper_bearing(paper):
    result = CliRunner().invoke(app, ["plant", "describe", "--params", str(PAPER_FILE), "--json"])
    assert result.exit_code == 0
    printed = json.loads(result.stdout)
    assert printed["constants"]["sag"]["value"] == paper.sag
    assert printed["constants"]["current_gain"]["unit"] == "N/A"
    assert printed["effects"]["gravity"]["value"] is True


def test_command_prints_tables_with_suitable_units():
    result = CliRunner().invoke(app, ["plant", "describe", "--params", str(PAPER_FILE)], env={"COLUMNS": "140"})
    assert result.exit_code == 0
    cells = {
        row[0]: row[1:3]
        for row in ([cell.strip() for cell in line.strip("│").split("│")] for line in result.stdout.splitlines())
        if len(row) > 2
    }
    assert cells["coil_inductance"] == ["6.997", "mH"]
    assert cells["sag"][1] == "um"
    assert cells["unstable_pole"][1] == "1/s"
    assert cells["gravity"][0] == "on"


def test_command_takes_plant_and_controller_from_the_file(tmp_path):
    file = tmp_path / "light.yaml"
    file.write_text(
        "/amb/simulator: {ros__parameters: {rotor: {gravity: 0.0}}}\n"
        "/amb/pd_controller: {ros__parameters: {proportional_gain: 4000.0}}\n"
    )
    result = CliRunner().invoke(app, ["plant", "describe", "--params", str(file), "--json"])
    printed = json.loads(result.stdout)
    assert printed["effects"]["gravity"]["value"] is False
    assert printed["constants"]["stable"]["value"] is False


def test_command_names_a_wrong_parameter(tmp_path):
    file = tmp_path / "wrong.yaml"
    file.write_text("/amb/simulator: {ros__parameters: {rotor: {mas: 1.0}}}\n")
    result = CliRunner().invoke(app, ["plant", "describe", "--params", str(file)])
    assert isinstance(result.exception, ParameterError)
    assert "did you mean 'rotor.mass'" in str(result.exception)
