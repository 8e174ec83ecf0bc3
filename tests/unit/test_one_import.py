"""`import amb_core as amb`: the names of the way from data to a certificate, loaded when they are used."""

from __future__ import annotations

import html
import subprocess
import sys

import control
import numpy as np
import pytest

import amb_core as amb
from amb_core.data.experiments import RecordedLoop
from amb_core.ground.errors import AmbError, IdentificationError
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.known_controller import LinearControl, limited
from amb_core.loop.linear_control import linear_law
from amb_core.loop.records import LoopRecord
from amb_core.robustness import RobustnessSettings, assess

NOISE, FORCE = 2e-8, 0.1


@pytest.fixture(scope="module")
def record(bearing) -> LoopRecord:
    return bearing.experiment(NOISE, force=FORCE)


@pytest.fixture(scope="module")
def other(bearing) -> LoopRecord:
    return bearing.experiment(NOISE, "multisine", force=FORCE, amplitude=20e-6, frequency_end=1500.0)


@pytest.fixture(scope="module")
def loop(record: LoopRecord) -> RecordedLoop:
    return RecordedLoop(amb.IdentificationData.from_record(record), ControllerParameters())


@pytest.fixture(scope="module")
def identification(loop: RecordedLoop):
    return amb.identify(loop, order=6)


def test_the_import_loads_nothing_else() -> None:
    heavy = "('amb_core.', 'numpy', 'scipy')"
    code = f"import amb_core, sys; print([name for name in sys.modules if name.startswith({heavy})])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_every_name_is_there_and_is_that_of_its_home() -> None:
    assert set(amb.__all__) <= set(dir(amb))
    for name in amb.__all__:
        assert callable(getattr(amb, name)), name
    with pytest.raises(AttributeError, match="no attribute 'identfy'"):
        _ = amb.identfy


def test_identify_takes_a_loop_with_its_controller(identification) -> None:
    assert identification.controller == ControllerParameters()
    assert identification.stable


def test_validate_takes_what_identify_takes(identification, record: LoopRecord, other: LoopRecord) -> None:
    """A record says nothing of its controller, a loop does; a model knows of its search."""
    known = RecordedLoop(amb.IdentificationData.from_record(other), ControllerParameters())
    with_loop, without = amb.validate(identification, known), amb.validate(identification.model, other)
    assert with_loop.closed_loop is not None and with_loop.search is identification.search
    assert without.closed_loop is None and without.search == identification.search
    given = amb.validate(identification.model, known.data, known.controller)
    assert given.fit == pytest.approx(with_loop.fit)


def test_certify_takes_the_same(identification, loop: RecordedLoop, other: LoopRecord) -> None:
    settings = RobustnessSettings(mode_gain=0.02)
    plain = amb.certify(identification.model, ControllerParameters(), loop.data, other, settings=settings)
    whole = amb.certify(identification, validation_data=other, settings=settings)
    assert [check.passed for check in plain.checks] == [check.passed for check in whole.checks]
    assert plain.assessment.bounds is not None, "the uncertainty is computed from the data"
    card = plain._repr_html_()
    assert plain.verdict in repr(plain) and "\n" not in repr(plain)
    assert all(f"<th>{html.escape(check.name)}</th>" in card for check in plain.checks)
    assert card.count("not passed: ") == len([check for check in plain.checks if not check.passed])


def test_compare_has_the_best_model_first(identification, loop: RecordedLoop, other: LoopRecord) -> None:
    poor = amb.identify(loop, order=2, method="ssarx")
    compared = amb.compare({"order 2": poor, "order 6": identification}, other)
    assert list(compared.validations) == ["order 6", "order 2"]
    assert "order 6" in repr(compared) and not compared.refused


@pytest.mark.parametrize("wrong", [np.zeros((100, 2)), "recorded", None])
def test_other_data_are_one_clear_error(identification, wrong: object) -> None:
    calls = [lambda: amb.identify(wrong), lambda: amb.validate(identification, wrong)]
    if wrong is not None:  # certify has defaults
        calls.append(lambda: amb.certify(identification, None, wrong))
    for call in calls:
        with pytest.raises(IdentificationError, match=r"^data: \w+.* is not allowed; allowed: .*from_arrays"):
            call()


def test_a_response_is_estimated_from_what_identify_takes(loop: RecordedLoop, record: LoopRecord) -> None:
    expected = amb.estimate_response(loop.data).response.response
    for data in (loop, record):
        assert np.array_equal(amb.estimate_response(data).response.response, expected)
    with pytest.raises(IdentificationError, match=r"^data: ndarray of shape \(3, 2\) is not allowed"):
        amb.estimate_response(np.ones((3, 2)))


def test_the_response_of_an_identification_is_that_of_its_model(identification) -> None:
    frequencies = [10.0, 100.0]
    expected = amb.response_of(identification.model, frequencies).response
    assert np.array_equal(amb.response_of(identification, frequencies).response, expected)
    with pytest.raises(IdentificationError, match=r"^model: str is not allowed; allowed: the result of identify"):
        amb.response_of("model.json", frequencies)
    with pytest.raises(IdentificationError, match=r"^frequencies: str is not allowed"):
        amb.response_of(identification, "a")


@pytest.mark.parametrize("path", [None, 3, b"first.csv", np.ones(2)])
def test_what_is_no_path_is_one_clear_error(path: object) -> None:
    for call in (amb.read, amb.StateSpaceModel.load):
        with pytest.raises(IdentificationError, match=r"^path = .* is not allowed; allowed: a path$"):
            call(path)


def test_models_to_compare_have_names(identification, loop: RecordedLoop) -> None:
    for models in ([identification, identification], identification.model, "model.json"):
        with pytest.raises(IdentificationError, match=r"^models: \w+ is not allowed; allowed: models by name"):
            amb.compare(models, loop)


def test_another_model_is_one_clear_error(loop: RecordedLoop) -> None:
    for call in (amb.validate, lambda model, data: amb.certify(model, ControllerParameters(), data)):
        with pytest.raises(IdentificationError, match=r"^model: ndarray of shape \(2, 2\) is not allowed; allowed: "):
            call(np.eye(2), loop)


PD = ControllerParameters()
DESIGN = linear_law(PD, 2).to_control()  # of python-control, from references and positions to currents


def test_a_controller_may_be_a_design_or_a_name(identification, other: LoopRecord) -> None:
    data = amb.IdentificationData.from_record(other)
    expected = amb.validate(identification.model, data, PD).fit
    for controller in (DESIGN, linear_law(PD, 2)):
        assert amb.validate(identification.model, data, controller).fit == pytest.approx(expected, abs=1e-6)
    name = f"pd:{PD.proportional_gain},{PD.derivative_gain}"  # the data show its limit
    assert amb.validate(identification.model, data, name).fit == pytest.approx(expected, abs=1e-6)
    assert assess(identification.model, DESIGN).mu.upper == pytest.approx(assess(identification.model, PD).mu.upper)
    identified = amb.identify(data, order=2, method="ssarx", controller=DESIGN)
    assert identified.closed_loop_poles is not None and identified.controller == limited(LinearControl.of(DESIGN), 3.0)


def test_another_controller_is_one_clear_error(identification, loop: RecordedLoop) -> None:
    slower = control.ss(DESIGN.A, DESIGN.B, DESIGN.C, DESIGN.D, 2e-4)
    for wrong, reason in (
        (PdController(PD), "^controller: PdController is not allowed; allowed: ControllerParameters, LinearControl, L"),
        (np.eye(2), r"^controller: ndarray of shape \(2, 2\) is not allowed"),
        (slower, "^the controller is made for 5000 Hz, the data are sampled at 10000 Hz"),
        ("mine.mat", "^controller model mine.mat: cannot be read"),
    ):
        calls = (
            lambda wrong=wrong: amb.identify(loop, 2, controller=wrong),
            lambda wrong=wrong: amb.validate(identification, loop, wrong),
            lambda wrong=wrong: amb.certify(identification, wrong),
            lambda wrong=wrong: assess(identification.model, wrong),
        )
        for call in calls:
            with pytest.raises(AmbError, match=reason):
                call()


@pytest.mark.parametrize(
    ("inputs", "outputs", "reference", "reason"),
    [
        (np.zeros((2, 900)), np.zeros((900, 2)), None, r"^inputs \(2, 900\) .* transpose them"),
        (np.zeros((900, 2, 1)), np.zeros((900, 2)), None, r"inputs.*\(900, 2, 1\)"),
        (np.zeros((900, 2)), np.zeros((900, 2)), np.zeros((899, 2)), r"reference.*\(899, 2\)"),
        (np.zeros((900, 2)), np.zeros((2, 900)), None, r"^outputs \(2, 900\) .* transpose them"),
        (np.zeros((900, 2)), np.zeros((899, 2)), None, r"inputs \(900, 2\) and outputs \(899, 2\)"),
    ],
)
def test_arrays_of_wrong_shapes_are_one_clear_error(inputs, outputs, reference, reason: str) -> None:
    with pytest.raises(IdentificationError, match=reason):
        amb.IdentificationData.from_arrays(inputs, outputs, 1e-4, reference=reference)
