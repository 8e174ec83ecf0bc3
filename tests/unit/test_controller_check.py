"""The controller of an experiment is compared with its currents before the fit, and what differs is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.controller_choice import ALLOWED, named_controller
from amb_core.data.experiments import Severity, merge
from amb_core.excitation import Square, generate
from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, identify, validate
from amb_core.identification.controller_check import check_controller
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters, with_anti_windup
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from tests.benchmarks.verdicts.controllers import WORDS, draw, named
from tests.benchmarks.verdicts.drawn_loops import draw_record
from tests.lqg_loop import linear_law, pid, rotor


@pytest.mark.parametrize("kind", WORDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_controller_is_named_for_what_is_wrong_with_it(kind: str, seed: int) -> None:
    case = draw(kind, np.random.default_rng(seed))
    assert named(case), case.finding


def test_the_gains_that_fit_are_shown() -> None:
    record, loop = draw_record(np.random.default_rng(3), 4_000, axes=1)
    (gain,) = loop.controller.proportional_gains
    wrong = loop.controller.model_copy(update={"proportional_gains": (1.2 * gain,)})
    assert f"K_P {gain:.5g} A/m" in check_controller(IdentificationData.from_record(record), wrong).what


def test_nothing_is_said_where_nothing_can_be_compared() -> None:
    record, loop = draw_record(np.random.default_rng(3), 4_000)
    data = IdentificationData.from_record(record)
    still = IdentificationData.from_arrays(
        np.zeros((500, 1)), np.zeros((500, 1)), 1e-4, reference=np.zeros(500), input_units=["A"], output_units=["m"]
    )
    without = IdentificationData.from_arrays(record.current, record.position, 1e-4)
    for finding in (
        check_controller(data, None),
        check_controller(still, ControllerParameters()),
        check_controller(without, loop.controller),
    ):
        assert finding.severity is Severity.INFO and "not checked" in finding.what


def test_identify_and_validate_name_the_derivative() -> None:
    record, loop = draw_record(np.random.default_rng(5), 4_000, axes=1)
    other = "measurement" if loop.controller.derivative_on == "error" else "error"
    wrong = loop.controller.model_copy(update={"derivative_on": other})
    identification = identify(record, 5, "ssarx", wrong)
    assert f"the derivative on the {loop.controller.derivative_on}" in identification.report.finding("controller").what
    judged = validate(identification.model, IdentificationData.from_record(record), wrong)
    assert any(f"the derivative on the {loop.controller.derivative_on}" in one.finding for one in judged.failed)
    assert identify(record, 5, "ssarx", loop.controller).report.finding("controller").severity is Severity.INFO


def test_the_derivative_of_named_gains_can_be_chosen() -> None:
    assert named_controller("pd:20000,38").derivative_on == "error"
    assert named_controller("pd:20000,38,measurement").derivative_on == "measurement"
    assert "pd:K_P,K_D,measurement" in ALLOWED
    with pytest.raises(IdentificationError, match="the signal that is derived"):
        named_controller("pd:20000")


@pytest.mark.parametrize(("factor", "words"), [(-1.0, "with the sign of i_x reversed"), (1.1, "with other gains: i_x")])
def test_the_state_of_an_integrator_is_no_constant_in_the_currents(factor: float, words: str) -> None:
    law = pid(1)
    record = rotor(1).record(linear_law(with_anti_windup(law), 1), 4_000)
    wrong = LinearControl(replace(law, c=factor * law.c, d=factor * law.d), LinearControllerParameters())
    finding = check_controller(IdentificationData.from_record(record), wrong)
    assert finding.severity is Severity.WARNING
    assert words in finding.what and "constant" not in finding.what


def test_a_law_without_a_limit_is_not_accused_of_that_of_the_currents() -> None:
    law = with_anti_windup(pid(2))
    record = rotor(2).record(linear_law(law, 2, limit=1.0), 8_000, amplitude=10e-6)
    assert np.abs(record.current).max() == 1.0
    finding = check_controller(IdentificationData.from_record(record), LinearControl.of(law))
    assert finding.what == "it computes the recorded currents from the recorded positions"


def test_a_law_that_explains_nothing_is_not_named() -> None:
    """Gains near zero leave all of a noise, which is a fraction of what the given ones leave."""
    record, loop = draw_record(np.random.default_rng(3), 4_000)
    noise = 1e-3 * np.random.default_rng(4).normal(size=record.current.shape)
    finding = check_controller(IdentificationData.from_record(replace(record, current=noise)), loop.controller)
    assert finding.severity is Severity.WARNING
    assert "but for" not in finding.what and "give the controller of this experiment" in finding.advice


def test_gains_that_leave_much_unexplained_are_not_offered() -> None:
    record, loop = draw_record(np.random.default_rng(3), 4_000)
    noise = 0.1 * record.current.std(axis=0) * np.random.default_rng(4).normal(size=record.current.shape)
    gains = tuple(3.0 * gain for gain in loop.controller.proportional_gains)
    wrong = loop.controller.model_copy(update={"proportional_gains": gains})
    finding = check_controller(IdentificationData.from_record(replace(record, current=record.current + noise)), wrong)
    assert finding.severity is Severity.WARNING and "other gains" not in finding.what


# -- at the limit


@pytest.fixture(scope="module")
def squares() -> LoopRecord:
    """Squares of 50 um on x, then y: at most edges the paper's law asks for more than its limit of 3 A."""
    signal = generate(Square(amplitude=50e-6, frequency=20.0, duration=0.4), 1e4).samples
    noisy = Plant(PlantParameters.model_validate({"sensor": {"noise": 5e-8}}))
    record = simulate(noisy, PdController(ControllerParameters()), 5_000, signal, excitation_step=1_000)
    return record.window(1_000, 4_000)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"current_limit": 1.6}, "with another limit: the currents end at 3 A, the controller's is 1.6 A"),
        ({"current_limit": 10.0}, "with another limit: the currents end at 3 A, the controller's is 10 A"),
        ({"derivative_on": "measurement"}, "with the derivative on the error"),
        ({"derivative_on": "measurement", "current_limit": 100.0}, "with the derivative on the error"),
        (
            {"derivative_on": "measurement", "current_limit": 10.0},
            "with the derivative on the error; another limit: the currents end at 3 A, the controller's is 10 A",
        ),
    ],
)
def test_the_samples_at_the_limit_show_what_others_do_not(squares: LoopRecord, wrong: dict, words: str) -> None:
    finding = check_controller(IdentificationData.from_record(squares), ControllerParameters(**wrong))
    assert finding.severity is Severity.WARNING and finding.what.endswith(words)


@pytest.mark.parametrize("limit", [3.0, 100.0])
@pytest.mark.parametrize("kind", ["as computed", "rounded", "scaled by 1 %", "two experiments"])
def test_the_controller_of_an_experiment_at_its_limit_is_not_accused(
    squares: LoopRecord, kind: str, limit: float
) -> None:
    currents = {"rounded": np.round(squares.current, 2), "scaled by 1 %": 1.01 * squares.current}
    data = IdentificationData.from_record(replace(squares, current=currents.get(kind, squares.current)))
    if kind == "two experiments":
        data = merge([data.window(1_000, 3_000), data.window(3_100, 4_600)])
    assert check_controller(data, ControllerParameters(current_limit=limit)).severity is Severity.INFO


def test_measured_currents_at_a_known_limit_are_no_other_limit(squares: LoopRecord) -> None:
    noise = 3e-3 * np.random.default_rng(1).normal(size=squares.current.shape)
    data = IdentificationData.from_record(replace(squares, current=squares.current + noise))
    assert check_controller(data, ControllerParameters()).severity is Severity.INFO
