"""The plant's configuration: defaults are the paper's, wrong values are refused with the reason."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import declarations, flatten, load_parameters, validate
from amb_core.plant import PlantParameters

DECLARED = {declaration.name: declaration for declaration in declarations(PlantParameters)}
NUMBERS = [name for name, declaration in DECLARED.items() if declaration.type is float]


def test_every_number_has_unit_range_and_description():
    for declaration in DECLARED.values():
        assert declaration.description
        if declaration.type in (float, int):
            assert declaration.unit
            assert declaration.minimum is not None
            assert declaration.minimum <= declaration.default <= declaration.maximum


@given(name=st.sampled_from(NUMBERS), data=st.data())
def test_values_out_of_range_are_refused_with_name_value_and_range(name, data):
    declaration = DECLARED[name]
    value = data.draw(
        st.one_of(
            st.floats(max_value=declaration.minimum, exclude_max=True, allow_nan=False),
            st.floats(min_value=declaration.maximum, exclude_min=True, allow_nan=False),
            st.just(float("nan")),
        )
    )
    with pytest.raises(ParameterError) as caught:
        validate(PlantParameters, {name: value})
    message = str(caught.value)
    assert name in message
    assert repr(value) in message
    assert declaration.allowed in message
    assert "\n" not in message


@given(name=st.sampled_from(NUMBERS))
def test_defaults_survive_a_round_trip_through_dotted_names(name):
    flat = flatten(PlantParameters().model_dump())
    assert validate(PlantParameters, flat) == PlantParameters()
    assert flat[name] == DECLARED[name].default


def test_unknown_parameter_is_refused_and_the_nearest_name_offered():
    with pytest.raises(ParameterError, match=r"unknown parameter 'rotor\.mas' = 3; did you mean 'rotor\.mass'"):
        validate(PlantParameters, {"rotor.mas": 3})


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"magnetic_circuit.pole_radius": 0.07}, "pole_radius = 0.07 m must be smaller than back_iron_inner_radius"),
        ({"magnetic_circuit.pole_width": 0.028}, "lets neighbouring poles overlap; allowed: less than 0.02725 m"),
        ({"rotor.backup_bearing_radius": 700e-6}, "must be smaller than the air gap"),
        ({"rotor.initial_y": -300e-6}, "inside the backup bearing"),
        ({"integration.internal_step": 0.3e-6}, "whole number of internal steps"),
        ({"amplifier.bias_current": 12.0}, "must not exceed current_limit"),
        ({"amplifier.carriers": "interleaved", "integration.internal_step": 0.2e-6}, "allowed: a multiple of four"),
        ({"amplifier.limits": False}, "limits are off and switching is on"),
        ({"amplifier.dead_time": 5e-6}, "must not exceed the shortest pulse"),
        ({"iron.hysteresis": True}, "hysteresis is on and saturation off"),
        ({"iron.bh_table": "steel.csv"}, "is given and saturation is off"),
        ({"iron.saturation": True, "iron.hysteresis": True, "iron.bh_table": "steel.csv"}, "which is a single curve"),
        ({"iron.solid_journal": True, "iron.eddy_currents": False}, "its lag is eddy currents"),
        ({"rotor.model": "flexible"}, "needs flexible_rotor.modal_data"),
        ({"rotor.model": "rigid", "magnetic_circuit.actuators": "top_coil"}, "pull along y only"),
        ({"rigid_rotor.bearing_a": 0.2}, "A is the side of -z"),
        ({"rigid_rotor.polar_inertia": 1.0}, "cannot exceed twice its transverse_inertia"),
    ],
)
def test_parameters_that_contradict_each_other_are_refused(values, reason):
    with pytest.raises(ParameterError, match=re.escape(reason)):
        validate(PlantParameters, values)


def test_parameter_file_of_the_nodes_serves_scripts_too(tmp_path: Path):
    path = tmp_path / "parameters.yaml"
    path.write_text(
        "/amb/simulator:\n  ros__parameters:\n    rotor:\n      mass: 5.0\n"
        "/amb/pd_controller:\n  ros__parameters:\n    rotor:\n      mass: 7.0\n"
    )
    assert load_parameters(PlantParameters, path, "simulator").rotor.mass == 5.0


@pytest.mark.parametrize("text", ["rotor: 3", "- a", "/amb/simulator: {mass: 3}", "a: [", ""])
def test_file_that_is_no_parameter_file_is_refused_by_name(tmp_path: Path, text: str):
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=r"wrong\.yaml"):
        load_parameters(PlantParameters, path, "simulator")


def test_missing_file_is_refused_by_name(tmp_path: Path):
    with pytest.raises(ParameterError, match=r"nowhere\.yaml.*cannot be read"):
        load_parameters(PlantParameters, tmp_path / "nowhere.yaml", "simulator")
