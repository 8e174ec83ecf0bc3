"""What a certificate is asked for: wrong inputs are refused before anything long, unusual ones stand in the verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError, ParameterError, RobustnessError
from amb_core.ground.parameters import validate
from amb_core.identification import ModelUncertainty, closed_loop_poles
from amb_core.identification.validation import Validation
from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.robustness import Recorded, RobustnessSettings, certify, certify_from_data, feedback_of
from tests.lqg_loop import rotor

FEW = {"frequencies": 60.0}
NOWHERE = Recorded(object.__new__(IdentificationData), None)  # data without anything that one could look at


@pytest.fixture(scope="module")
def loop():
    plant = rotor(2)
    return plant.model, LinearControl(plant.lqg(), LinearControllerParameters())


def named(control: LinearControl, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> LinearControl:
    return LinearControl(replace(control.model, input_names=inputs, output_names=outputs), control.parameters)


@pytest.mark.parametrize(
    ("inputs", "outputs", "what"),
    [
        (("e_y", "e_x"), ("i_x", "i_y"), "inputs e_y, e_x"),
        (("e_x", "e_y"), ("i_y", "i_x"), "outputs i_y, i_x"),
        (("y", "x"), ("first", "second"), "inputs y, x"),
    ],
)
def test_channels_in_another_order_are_refused_by_name(loop, inputs, outputs, what: str) -> None:
    model, control = loop
    for loop_of in (feedback_of, closed_loop_poles):
        with pytest.raises(ParameterError, match=f"{what}; the axes of the machine are x, y"):
            loop_of(model, named(control, inputs, outputs))


@pytest.mark.parametrize("inputs", [("e_x", "e_y"), ("x", "y"), ("u1", "u2"), ("position_x", "second")])
def test_channels_in_order_or_without_one_are_taken(loop, inputs) -> None:
    model, control = loop
    assert feedback_of(model, named(control, inputs, ("a", "b"))).stable


def test_references_and_positions_have_an_order_each(loop) -> None:
    model = loop[0]
    control = LinearControl(rotor(2).lqg(of_errors=False), LinearControllerParameters())
    outputs = ("i_x", "i_y")
    assert feedback_of(model, named(control, ("r_x", "r_y", "x", "y"), outputs)).stable
    with pytest.raises(ParameterError, match="r_x, r_y, y, x"):
        feedback_of(model, named(control, ("r_x", "r_y", "y", "x"), outputs))


@pytest.mark.parametrize("kind", ["zone", "displacement"])
def test_limits_that_fall_are_refused_as_settings(kind: str) -> None:
    with pytest.raises(ParameterError, match=f"{kind}_a, {kind}_b and {kind}_c = .* they must rise"):
        validate(RobustnessSettings, {f"{kind}_a": 1.0, f"{kind}_b": 2.0 if kind == "zone" else 0.4, f"{kind}_c": 1.0})


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"zone_c": 9.0}, "zones end at 3, 4, 9, not at the 3, 4, 5 of ISO 14839-3"),
        ({"displacement_a": 0.2}, "zones end at 0.2, 0.4, 0.5, not at the 0.3, 0.4, 0.5 of ISO 14839-2"),
        ({"confidence": 0.9}, "the confidence is 90 % only"),
        ({"needed_zone": "C"}, "zone C is taken as enough"),
    ],
)
def test_what_is_not_usual_stands_in_the_verdict(loop, settings, text: str) -> None:
    assert text in certify(*loop, settings=RobustnessSettings(**FEW, **settings)).verdict
    assert "own limits" not in certify(*loop, settings=RobustnessSettings(**FEW, confidence=0.95)).verdict


def test_an_unstable_loop_and_wrong_units_are_found_without_the_data(loop) -> None:
    model, control = loop
    wrong = LinearControl(replace(control.model, c=-control.model.c), control.parameters)
    certificate = certify_from_data(model, wrong, NOWHERE, NOWHERE, swept=NOWHERE)
    assert [check.name for check in certificate.checks] == ["the loop is stable"]
    with pytest.raises(RobustnessError, match=r"outputs in um, um.*in m"):
        certify_from_data(replace(model, output_units=("um", "um")), control, NOWHERE)
    with pytest.raises(RobustnessError, match=r"units of the model's inputs are not known.*--units A,um"):
        certify_from_data(replace(model, input_units=("", ""), output_units=("", "")), control, NOWHERE)


def test_a_sweep_without_a_controller_is_refused_without_the_other_data(loop) -> None:
    with pytest.raises(RobustnessError, match="controller of the swept sine is not known"):
        certify_from_data(*loop, NOWHERE, NOWHERE, swept=NOWHERE)


def results_of(model) -> dict[str, Validation | ModelUncertainty]:
    """A validation and an uncertainty of a model, of which only the model is looked at."""
    validation = object.__new__(Validation)
    object.__setattr__(validation, "model", model)
    rows = sum(matrix.size for matrix in (model.a, model.b, model.c, model.k))
    return {"validation": validation, "uncertainty": ModelUncertainty(model, np.full((rows, 1), 1e-9), 1.0, 0.0, True)}


@pytest.mark.parametrize("what", ["validation", "uncertainty"])
@pytest.mark.parametrize("part", ["a", "b", "c", "sample_time"])
def test_a_validation_or_uncertainty_of_another_model_is_refused_without_the_data(loop, what: str, part: str) -> None:
    model, control = loop
    other = replace(model, **{part: 0.75 * getattr(model, part)})
    given = {what: results_of(other)[what]}
    for call in (lambda: certify(model, control, **given), lambda: certify_from_data(model, control, NOWHERE, **given)):
        with pytest.raises(RobustnessError, match=f"{what} is of another model"):
            call()


def test_an_uncertainty_of_the_model_after_a_file_or_with_a_gain_from_data_is_of_this_model(loop, tmp_path) -> None:
    model, control = loop
    model.save(tmp_path / "model.json")
    for same in (type(model).load(tmp_path / "model.json"), replace(model, k=0.5 * model.k, source="elsewhere")):
        settings, given = RobustnessSettings(**FEW), results_of(same)["uncertainty"]
        assert certify(model, control, settings=settings, uncertainty=given).assessment.bounds is not None


def test_a_plant_of_ones_own_is_certified_on_data_that_validate_it(bearing) -> None:
    """It has no gain, which its predictions need: the data give it one, and its verdict says so."""
    data, other = (bearing.experiment(2e-8, force=0.1, kind=kind, duration=0.6) for kind in ("multisine", "square"))
    model = bearing.model
    plant = LinearSystem(model.a, model.b, model.c, model.d, model.sample_time).to_control()
    settings = RobustnessSettings(**FEW)
    certificate = certify_from_data(plant, ControllerParameters(), data, other, settings=settings)
    checks = {check.name: check for check in certificate.checks}
    assert checks["the model is validated"].finding.startswith("validated with reservations")
    assert all(check.passed for name, check in checks.items() if name == "the uncertainty of the model is known")
    with pytest.raises(IdentificationError, match="has no operating point of its own; give data of its loop"):
        certify_from_data(plant, ControllerParameters())
