"""What could not be checked leaves reservations and is named; what does not apply to a model holds nothing back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from amb_core.identification import Identification, IdentificationData, StateSpaceModel, Validation, identify, validate
from amb_core.identification.estimate.reduction import reduce_balanced
from amb_core.identification.progress import SearchEnd
from amb_core.identification.validation import Condition, Verdict
from amb_core.identification.validation.overlap import fingerprint_of
from amb_core.loop.control import ControllerParameters
from amb_core.recording.messages.state_space_model import fill_model, model_from_message
from amb_core.report.pages.validation import validation_reason, validation_section

CONTROLLER = ControllerParameters()
KNOWN = np.ones(20)  # a fingerprint of other data


class Message:
    """The fields of a StateSpaceModel message."""


def condition(validation: Validation, key: str) -> Condition:
    (one,) = (one for one in validation.conditions if one.key == key)
    return one


def reserved(validation: Validation) -> list[str]:
    return [one.key for one in validation.failed]


def from_pem(model: StateSpaceModel, data: IdentificationData) -> StateSpaceModel:
    """As `identify` leaves a model of `pem` whose search converged and whose poles are decided."""
    fingerprint = fingerprint_of(data, np.sqrt(np.diag(model.innovation_covariance)))
    return replace(
        model, method="pem", samples=6_000, fingerprint=fingerprint, search=SearchEnd(9, 1e-9, True).values,
        undecided=("",),
    )  # fmt: skip


@pytest.fixture(scope="module")
def fresh(bearing) -> IdentificationData:
    """Data of the bearing that no model here was estimated from."""
    return IdentificationData.from_record(bearing.experiment(2.02e-8, force=0.1, frequency=20.0, duration=0.6))


def test_a_model_whose_conditions_are_all_known_is_validated(
    model: StateSpaceModel, data: IdentificationData, fresh: IdentificationData
) -> None:
    validation = validate(from_pem(model, data), fresh, CONTROLLER)
    assert validation.verdict == "validated" and all(one.checked for one in validation.conditions)


@pytest.mark.parametrize(("lacks", "key"), [
    ({"fingerprint": np.empty(0)}, "fresh_data"),
    ({"search": np.empty(0)}, "convergence"),
    ({"undecided": ()}, "poles"),
])  # fmt: skip
def test_what_a_model_should_hold_and_does_not_leaves_reservations_and_is_named(
    model: StateSpaceModel, data: IdentificationData, fresh: IdentificationData, lacks: dict[str, object], key: str
) -> None:
    validation = validate(replace(from_pem(model, data), **lacks), fresh, CONTROLLER)
    one = condition(validation, key)
    assert validation.verdict == "validated with reservations" and reserved(validation) == [key]
    assert not one.checked and one.finding.startswith("not checked: ") and one.advice
    assert f"    RESERVED {one.name}: not checked" in validation.report()
    assert one.name in validation_reason(validation)
    assert "not checked" in str(validation_section(validation).blocks[1])


def test_a_model_of_unknown_origin_has_reservations(model: StateSpaceModel, fresh: IdentificationData) -> None:
    validation = validate(replace(model, method=""), fresh, CONTROLLER)
    assert set(reserved(validation)) == {"fresh_data", "convergence", "poles"}


@pytest.mark.parametrize("method", ["ssarx", "cva", "pem, reduced from order 12"])
def test_what_does_not_apply_to_a_method_holds_nothing_back_and_is_not_said_to_hold(
    model: StateSpaceModel, fresh: IdentificationData, method: str
) -> None:
    validation = validate(replace(model, method=method, samples=6_000, fingerprint=KNOWN), fresh, CONTROLLER)
    assert validation.verdict == "validated", validation.report()
    for key in ("convergence", "poles"):
        one = condition(validation, key)
        assert one.passed and not one.checked and one.finding.startswith("does not apply: ")
        assert f"    -        {one.name}: does not apply" in validation.report()
    assert f"{len(validation.conditions) - 2} conditions that apply hold" in validation_reason(validation)


def test_a_response_is_not_said_to_be_linear_where_nothing_measured_it(bearing, model: StateSpaceModel) -> None:
    record = bearing.experiment(2e-8, force=0.1, kind="multisine", duration=0.3, amplitude=1e-5)
    validation = validate(model, IdentificationData.from_record(record), CONTROLLER)
    assert not validation.evidence.measured
    one = condition(validation, "distortion")
    assert not one.checked and one.level is Verdict.RESERVATIONS and "needed" in one.finding
    assert f"ok       {one.name}" not in validation.report() and validation.verdict != "validated"


@pytest.fixture(scope="module")
def identified(data: IdentificationData) -> Identification:
    """A model of too high an order, some of whose poles the data do not decide."""
    return identify(data, 8, controller=CONTROLLER)


@pytest.mark.parametrize("form", ["json", "npz", "mat", "message"])
@pytest.mark.parametrize("undecided", ["", "the 99 % interval of pole z = 0.999 holds 1"])
@pytest.mark.parametrize("converged", [True, False])
def test_a_verdict_is_the_same_after_a_model_was_saved(
    identified: Identification, fresh: IdentificationData, tmp_path: Path, form: str, undecided: str, converged: bool
) -> None:
    search = SearchEnd(20, 0.01, converged)
    model = replace(identified.model, search=search.values, undecided=(undecided,))
    if form == "message":
        again = model_from_message(fill_model(Message(), model))
    else:
        model.save(tmp_path / f"model.{form}")
        again = StateSpaceModel.load(tmp_path / f"model.{form}")
    assert again.undecided == model.undecided and SearchEnd.of(again) == search
    before = validate(replace(identified, model=model, search=search, uncertainty=None), fresh, CONTROLLER)
    after = validate(again, fresh, CONTROLLER)
    assert after.verdict == before.verdict
    assert [(one.key, one.finding) for one in after.conditions] == [(one.key, one.finding) for one in before.conditions]
    assert condition(after, "convergence").passed is converged and condition(after, "poles").passed is not undecided


def test_an_identification_leaves_in_its_model_what_is_known_of_search_and_poles(identified: Identification) -> None:
    assert identified.uncertainty is not None and identified.search is not None
    assert identified.model.undecided == (identified.uncertainty.at_one,)
    assert SearchEnd.of(identified.model) == identified.search


def test_simulation_focus_states_how_its_own_search_ended(data: IdentificationData) -> None:
    result = identify(data, 6, controller=CONTROLLER, focus="simulation")
    assert result.search is not None and result.search == SearchEnd.of(result.model)
    assert condition(result.validated(), "convergence").checked


def test_a_file_of_an_earlier_version_is_read_and_its_conditions_are_not_known(
    model: StateSpaceModel, data: IdentificationData, fresh: IdentificationData
) -> None:
    content = from_pem(model, data).to_json()
    del content["search"], content["undecided"]
    validation = validate(StateSpaceModel.from_json(content), fresh, CONTROLLER)
    assert set(reserved(validation)) == {"convergence", "poles"}


def test_a_reduced_model_holds_nothing_of_the_search_of_the_model_it_came_from(
    model: StateSpaceModel, data: IdentificationData
) -> None:
    reduced = reduce_balanced(from_pem(model, data), 5).model
    assert SearchEnd.of(reduced) is None and reduced.undecided == ()
