"""Identification in the loop of any linear controller: LQG controllers, and the PD law written as one."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from amb_core.ground.errors import ParameterError
from amb_core.identification import IdentificationData, closed_loop_poles, identify, simulate_closed_loop, validate
from amb_core.identification.control_law import Start
from amb_core.identification.controller_state import start_of, unexplained
from amb_core.identification.estimate.local_coordinates import local_directions
from amb_core.identification.focus import focus_simulation
from amb_core.identification.focus.sensitivity import LoopDirections, sensitivity_factor
from amb_core.identification.modes import closed_loop_modes
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters, pd_as_linear
from amb_core.loop.records import LoopRecord
from tests.lqg_loop import linear_law, rotor, with_integrators

if TYPE_CHECKING:
    from conftest import LinearBearing

KINDS = ["errors", "references and positions", "integrators"]
SIZES = [2, 4]


@functools.cache
def controller_of(axes: int, kind: str, limit: float = 3.0) -> LinearControl:
    law = rotor(axes).lqg(kind != "references and positions")
    return LinearControl(
        with_integrators(law) if kind == "integrators" else law, LinearControllerParameters(current_limit=limit)
    )


@functools.cache
def record_of(axes: int, kind: str, noise: float = 1.0, limit: float = 3.0, steps: int = 6_000) -> LoopRecord:
    law = linear_law(controller_of(axes, kind, limit).model, axes, limit)
    return rotor(axes).record(law, steps, noise=noise)


def as_linear(controller: ControllerParameters, axes: int = 2) -> LinearControl:
    limit = LinearControllerParameters(current_limit=controller.current_limit)
    return LinearControl(pd_as_linear(controller, axes), limit)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("axes", SIZES)
def test_a_loop_is_identified_and_validated(axes: int, kind: str) -> None:
    controller, record = controller_of(axes, kind), record_of(axes, kind)
    identification = identify(record, 3 * axes, controller=controller)
    assert identification.stable and len(identification.model.unstable_poles()) == axes
    assert identification.model.fit.min() >= 95.0
    other = rotor(axes).record(linear_law(controller.model, axes), 6_000, seed=2)
    judged = validate(identification.model, IdentificationData.from_record(other), controller)
    assert judged.validated and judged.fit.min() >= 95.0, judged.summary
    assert not any("compute" in note for note in judged.notes)
    closed_loop_modes(identification.model, controller)


@pytest.mark.parametrize("axes", SIZES)
def test_simulation_focus_mends_a_model_of_too_low_an_order(axes: int) -> None:
    controller, record = controller_of(axes, "errors"), record_of(axes, "errors")
    part = record.window(1_000, 2_500)  # amid the run: the controller has a past
    start = identify(part, 2 * axes, "ssarx", controller)
    focused = identify(part, 2 * axes, "ssarx", controller, focus="simulation")
    assert focused.stable and focused.model.fit.min() >= 95.0
    assert focused.model.fit.min() > start.model.fit.min()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("axes", SIZES)
@pytest.mark.parametrize("limit", [3.0, 0.4])
def test_the_true_model_gives_the_samples_of_the_loop_from_any_step(axes: int, kind: str, limit: float) -> None:
    """With currents at their limit too: the anti-windup of the model's controller is that of the loop."""
    controller = controller_of(axes, kind, limit)
    record = record_of(axes, kind, 0.0, limit, 1_000)
    assert (np.abs(record.current).max() == limit) == (limit == 0.4)
    whole = simulate_closed_loop(rotor(axes).model, controller, record.reference, 0, start_of(controller, record))
    assert np.max(np.abs(whole.position - record.position)) < 1e-12
    first = 404
    state = np.zeros(3 * axes)
    for current in record.current[:first]:
        state = rotor(axes).a @ state + rotor(axes).b @ current
    rest = record.window(first, 500)
    start = start_of(controller, rest)
    model = replace(rotor(axes).model, initial_state=state)
    simulated = simulate_closed_loop(model, controller, rest.reference, first, start)
    assert np.max(np.abs(simulated.position - rest.position)) < 1e-10
    assert np.max(np.abs(simulated.current - rest.current)) < 1e-4


def test_data_that_count_their_steps_from_zero_amid_a_run_are_continued_as_well() -> None:
    controller, record = controller_of(2, "integrators"), record_of(2, "integrators")
    assert start_of(controller, record) is None
    part = record.window(1_000, 2_000)
    renumbered = LoopRecord(0, part.sample_time, part.reference, part.position, part.current)
    start, expected = start_of(controller, renumbered), start_of(controller, part)
    assert start is not None and expected is not None
    np.testing.assert_array_equal(start.state, expected.state)


@pytest.mark.parametrize("limit", [3.0, 0.4])
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_those_of_the_simulation(kind: str, limit: float) -> None:
    controller, part = controller_of(2, kind, limit), record_of(2, kind, 1.0, limit).window(1_000, 400)
    model, start = rotor(2).model, start_of(controller, record_of(2, kind, 1.0, limit).window(1_000, 400))
    directions = LoopDirections(*local_directions(model.a, model.b, model.c), np.zeros((2, 0)))
    factor = sensitivity_factor(model, controller, part, start, directions, np.ones(2))
    assert part.current.shape == (400, 2) and start is not None
    step = np.random.default_rng(3).normal(size=directions.count)

    def position(size: float) -> np.ndarray:
        moved = replace(
            model,
            a=model.a + directions.of_a @ (size * step),
            b=model.b + directions.of_b @ (size * step),
            c=model.c + directions.of_c @ (size * step),
        )
        return simulate_closed_loop(moved, controller, part.reference, 1_000, start).position

    # So small that no current reaches or leaves its limit.
    size = 1e-10 * np.linalg.norm(model.b) / np.linalg.norm(step)
    change = (position(size) - position(-size)) / (2.0 * size)
    # The factor has the inner products of derivatives (columns) and errors (last column).
    errors = part.position - position(0.0)
    expected = np.sum(change * errors), np.sum(change * change)
    along = factor[:, model.order : -1] @ step
    assert along @ factor[:, -1] == pytest.approx(expected[0], rel=1e-4)
    assert along @ along == pytest.approx(expected[1], rel=1e-4)


PD = [
    ControllerParameters(),
    ControllerParameters(derivative_filter=3e-4),
    ControllerParameters(derivative_filter=3e-4, derivative_on="measurement", current_limit=2.5),
]


@pytest.mark.parametrize("controller", PD)
@pytest.mark.parametrize("first", [0, 500])
def test_the_pd_law_as_a_linear_controller_gives_the_same_numbers(
    bearing: LinearBearing, controller: ControllerParameters, first: int
) -> None:
    record = bearing.experiment(noise=1e-8, duration=0.4, lead=300, controller=controller)
    record = record.window(first, record.steps - first)
    linear = as_linear(controller)
    model = identify(record, 6, "ssarx", controller).model
    data = IdentificationData.from_record(record)
    mine, theirs = validate(model, data, linear), validate(model, data, controller)
    np.testing.assert_allclose(mine.fit, theirs.fit, rtol=1e-9)
    assert mine.closed_loop is not None and theirs.closed_loop is not None
    for name in ("position", "current"):
        one, two = (getattr(validation.closed_loop.simulated[0], name) for validation in (mine, theirs))
        assert np.max(np.abs(one - two)) < 1e-9 * np.max(np.abs(two))
    slow = np.abs(closed_loop_poles(model, controller)) > 0.5  # the backward difference adds poles at 0
    np.testing.assert_allclose(
        closed_loop_poles(model, linear)[: slow.sum()], closed_loop_poles(model, controller)[slow]
    )


@pytest.mark.parametrize("first", [0, 500])
def test_the_pd_law_as_a_linear_controller_has_the_same_simulation_focus(bearing: LinearBearing, first: int) -> None:
    record = bearing.experiment(noise=1e-8, duration=0.4, lead=300, controller=PD[1])
    record = record.window(first, record.steps - first)
    start, data = identify(record, 4, "ssarx", PD[1]).model, IdentificationData.from_record(record)
    one, two = (focus_simulation(start, data, law, most_iterations=2) for law in (as_linear(PD[1]), PD[1]))
    fits = [validate(model, data, PD[1]).fit for model in (one, two)]
    np.testing.assert_allclose(fits[0], fits[1], rtol=1e-9)


def test_the_first_current_alone_continues_a_law_of_as_many_states(bearing: LinearBearing) -> None:
    record = bearing.experiment(noise=0.0, duration=0.4, lead=300, controller=PD[1]).window(500, 1_000)
    one, two = (
        simulate_closed_loop(bearing.model, law, record.reference, 500, start)
        for law, start in ((as_linear(PD[1]), Start(record.current[0])), (PD[1], record.current[0]))
    )
    assert np.max(np.abs(one.position - two.position)) < 1e-9 * np.max(np.abs(two.position))


def test_a_controller_that_did_not_compute_the_currents_is_noted() -> None:
    record = record_of(2, "errors")
    assert unexplained(controller_of(2, "errors"), record).max() < 1e-9
    foreign = controller_of(2, "integrators")
    stiffer = LinearControl(replace(foreign.model, c=1.2 * foreign.model.c), foreign.parameters)
    judged = validate(rotor(2).model, IdentificationData.from_record(record), stiffer)
    assert "controller" in {one.key for one in judged.failed}
    true = validate(rotor(2).model, IdentificationData.from_record(record), controller_of(2, "errors"))
    assert "controller" not in {one.key for one in true.failed}


def test_a_controller_of_gains_alone_has_no_past(bearing: LinearBearing) -> None:
    record = bearing.experiment(noise=0.0, duration=0.1)
    gains = replace(
        pd_as_linear(PD[0]), a=np.zeros((0, 0)), b=np.zeros((0, 4)), c=np.zeros((2, 0)), k=np.zeros((0, 2)),
        initial_state=np.zeros(0),
    )  # fmt: skip
    controller = LinearControl(gains, LinearControllerParameters())
    assert start_of(controller, record.window(200, 300)) is None
    assert len(closed_loop_poles(bearing.model, controller)) == bearing.model.order


def test_a_controller_for_another_machine_is_refused_before_the_search() -> None:
    with pytest.raises(
        ParameterError, match=r"^the controller has 4 inputs and 4 outputs, the machine 2 axes; allowed"
    ):
        identify(record_of(2, "errors"), 6, controller=controller_of(4, "errors"))
    with pytest.raises(
        ParameterError, match=r"^the controller has 4 inputs and 4 outputs, the machine 2 axes; allowed"
    ):
        validate(rotor(2).model, IdentificationData.from_record(record_of(2, "errors")), controller_of(4, "errors"))
    with pytest.raises(ParameterError, match=r"^the controller is made for 10000 Hz, the data are sampled at 20000 Hz"):
        controller_of(2, "errors").at_rate(20_000.0)
