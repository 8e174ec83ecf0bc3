"""From data to a validated model in one call: what it tells, how it is called off, and how it refuses bad data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from amb_core.data.experiments import detrend, merge
from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, IdentificationProgress, estimate_uncertainty, identify
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord

NOISE, FORCE = 2e-8, 0.1  # m, N: rms on sensors and rotor


@pytest.fixture(scope="module")
def record(bearing) -> LoopRecord:
    """6000 samples of squares of 20 Hz on x, then on y."""
    return bearing.experiment(NOISE, force=FORCE, frequency=20.0, duration=0.6)


@pytest.fixture(scope="module")
def data(record: LoopRecord) -> IdentificationData:
    return IdentificationData.from_record(record, source="bearing")


def test_progress_tells_every_stage_in_order_and_the_cost_of_the_search(data: IdentificationData) -> None:
    told: list[IdentificationProgress] = []
    identify(data, "auto", orders=(2, 3), progress=told.append)
    stages = ["checks", "order", "subspace", "pem", "validation", "uncertainty"]
    assert list(dict.fromkeys(now.stage for now in told)) == stages
    assert all(0 <= now.done <= now.total for now in told)
    costs = [now.cost for now in told if now.stage == "pem"]
    assert all(later <= earlier for earlier, later in pairwise(costs))


@pytest.mark.parametrize("stage", ["checks", "order", "subspace", "pem", "validation", "uncertainty"])
def test_it_ends_in_the_stage_in_which_it_is_called_off(data: IdentificationData, stage: str) -> None:
    reached: list[str] = []

    def cancelled() -> bool:
        return stage in reached

    with pytest.raises(IdentificationError, match=f"^identification cancelled in {stage}$"):
        order = "auto" if stage == "order" else 2
        identify(data, order, orders=(2,), progress=lambda now: reached.append(now.stage), cancelled=cancelled)


def test_experiments_are_simulated_each_and_fitted_together(bearing, data: IdentificationData) -> None:
    other = bearing.experiment(NOISE, force=FORCE, frequency=15.0, duration=0.4)
    both = merge([data.window(1_000, 6_000), IdentificationData.from_record(other, source="another")])
    result = identify(both, 6)
    assert [simulation.steps for simulation in result.simulations if simulation] == [5_000, other.steps]
    assert result.model.fit.min() > 99.0 and result.stable
    assert result.model.source == "bearing; another"
    assert result.model.samples == both.samples


def test_where_the_reference_is_unknown_the_model_is_not_simulated(data: IdentificationData) -> None:
    blind = replace(data, experiments=(replace(data.experiments[0], reference=None),))
    result = identify(blind, 6, "ssarx")
    assert result.simulations == (None,) and result.model.fit.size == 0
    assert result.stable, "the poles of the loop need no reference"
    assert "no reference" in result.summary
    assert result.verdict == "validated with reservations"


def test_a_simulation_that_diverges_at_the_current_limit_is_told(data: IdentificationData) -> None:
    result = identify(data, 6, "ssarx", ControllerParameters(current_limit=0.05))
    assert result.stable and not np.isfinite(result.model.fit).any()
    assert "the simulated closed loop diverges" in result.summary
    assert result.verdict == "not validated"
    assert result.summary.endswith("closed loop stable while the control currents are within their limit")


def test_detrended_data_give_the_same_model_about_the_same_operating_point(data: IdentificationData) -> None:
    plain, detrended = (identify(given, 4, "ssarx") for given in (data, detrend(data)))
    np.testing.assert_allclose(detrended.model.input_offset, plain.model.input_offset, rtol=1e-9)
    np.testing.assert_allclose(detrended.model.output_offset, plain.model.output_offset, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(detrended.model.fit, plain.model.fit, atol=1e-4)


def test_other_plants_are_identified_without_a_loop_and_keep_their_names(data: IdentificationData) -> None:
    motor = replace(
        data, input_names=("u1", "u2"), output_names=("y1", "y2"), input_units=("V", "V"), output_units=("", "")
    )
    result = identify(motor, 2, "ssarx")
    assert (result.model.input_names, result.model.output_names) == (("u1", "u2"), ("y1", "y2"))
    assert result.closed_loop_poles is None and not result.stable
    with pytest.raises(IdentificationError, match="does not suit data in V, V, unknown, unknown; give the data their"):
        identify(motor, 6, "ssarx", ControllerParameters())
    with pytest.raises(IdentificationError, match="simulation focus needs data of the bearing's loop"):
        identify(motor, 6, focus="simulation")


def test_the_uncertainty_is_that_of_the_prediction_errors_only(data: IdentificationData) -> None:
    assert identify(data, 6, "ssarx").uncertainty is None
    identification = identify(data, 6)
    assert identification.uncertainty is not None and identification.uncertainty.model is identification.model
    assert not identification.uncertainty.robust


def test_where_the_innovations_are_not_white_the_uncertainty_is_robust(data: IdentificationData) -> None:
    identification = identify(data, 3)
    assert identification.uncertainty is not None and identification.uncertainty.robust
    assert "innovations are not white and are taken as they are" in identification.uncertainty.summary
    deviations = estimate_uncertainty(identification.model, data).pole_deviations()
    assert identification.uncertainty.pole_deviations().max() > 1.5 * deviations.max()


@pytest.mark.slow
def test_simulation_focus_does_not_make_the_closed_loop_worse(data: IdentificationData) -> None:
    start = identify(data, 6, "ssarx")
    identification = identify(data, 6, "ssarx", focus="simulation")
    assert identification.stable and np.all(identification.model.fit >= start.model.fit - 1e-6)
    assert identification.uncertainty is None


def test_auto_finds_the_order_of_the_bearing_and_judges_the_data_for_it(data: IdentificationData) -> None:
    result = identify(data, "auto", "ssarx", orders=(5, 6))
    assert result.model.order == 6
    assert result.order_selection is not None and result.order_selection.chosen == 6
    assert "of order 6" in result.report.finding("amount").what


def edited(data: IdentificationData, change: Callable[[np.ndarray, np.ndarray], None]) -> IdentificationData:
    """The data with inputs and outputs changed in place."""
    item = data.experiments[0]
    inputs, outputs = item.inputs.copy(), item.outputs.copy()
    change(inputs, outputs)
    return replace(data, experiments=(replace(item, inputs=inputs, outputs=outputs),))


def put(column: int, value: Any, *, output: bool = False, rows: slice = slice(None)) -> Any:
    """An edit that sets samples of a channel."""

    def change(inputs: np.ndarray, outputs: np.ndarray) -> None:
        (outputs if output else inputs)[rows, column] = value

    return change


def copy_first_input(inputs: np.ndarray, outputs: np.ndarray) -> None:
    inputs[:, 1] = 2.0 * inputs[:, 0]


def copy_first_output(inputs: np.ndarray, outputs: np.ndarray) -> None:
    outputs[:, 1] = outputs[:, 0]


REFUSED = {
    "NaN": (
        lambda data: edited(data, put(1, np.nan, output=True, rows=slice(700, 710))),
        {},
        "y, first at step 700 of experiment 0: 10 of 6000 samples hold NaN .* leave them out with --repair split",
    ),
    "infinite": (lambda data: edited(data, put(0, np.inf, rows=slice(9, 10))), {}, "i_x, first at step 9"),
    "constant input": (lambda data: edited(data, put(1, 1.5)), {}, "i_y: constant; excite every input"),
    "constant output": (lambda data: edited(data, put(0, 0.0, output=True)), {}, "output 1 is constant"),
    "collinear inputs": (
        lambda data: edited(data, copy_first_input),
        {},
        "one is a sum of multiples of the others; excite them one after another",
    ),
    "collinear outputs": (lambda data: edited(data, copy_first_output), {}, "not independent"),
    "too few samples": (
        lambda data: data.window(0, 60),
        {},
        "60 samples are too few for order 10; at least 134 are needed; record longer, or ask for a lower order",
    ),
    "too few samples for auto": (lambda data: data.window(0, 12), {"order": "auto"}, "12 samples are too few"),
    "wrong sample time": (
        lambda data: replace(data, sample_time=5e-5),
        {},
        "5e-05 s, but 0.0001 s is expected; decimate by 2",
    ),
    "order 0": (lambda data: data, {"order": 0}, "order 0 is not allowed; allowed: 1 to 40"),
    "order above the limit": (lambda data: data, {"order": 41}, "order 41 is not allowed; allowed: 1 to 40"),
    "order that is no number": (lambda data: data, {"order": "best"}, "order 'best' is not allowed; .* or 'auto'"),
    "order to try above the limit": (
        lambda data: data, {"order": "auto", "orders": (4, 41)}, "order 41 is not allowed; allowed: 1 to 40",
    ),
    "no orders to try": (lambda data: data, {"order": "auto", "orders": ()}, "no orders to choose from"),
    "unknown method": (lambda data: data, {"method": "magic"}, "unknown method 'magic'; allowed: pem, ssarx, pbsid"),
    "unknown focus": (lambda data: data, {"focus": "magic"}, "unknown focus 'magic'; allowed: prediction, simulation"),
    "several experiments for n4sid": (
        lambda data: merge([data, data]), {"method": "n4sid"}, "n4sid takes one experiment; ssarx, pbsid, cva and pem",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_determines_no_model_is_refused_in_one_line_that_says_what_to_do(
    data: IdentificationData, case: str
) -> None:
    spoil, arguments, message = REFUSED[case]
    with pytest.raises(IdentificationError, match=message) as refusal:
        identify(spoil(data), **arguments)
    assert "\n" not in str(refusal.value)


WARNED = {
    "clipped input": (lambda u, y: np.clip(u, -0.15, 0.15, out=u), "clipping", "reduce the excitation"),
    "clipped output": (lambda u, y: np.clip(y, -4e-5, 4e-5, out=y), "clipping", "the sensor cannot see these samples"),
    "drift": (
        lambda u, y: np.add(y, np.linspace(0.0, 5e-4, len(y))[:, np.newaxis], out=y), "offsets", "detrend",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WARNED)
def test_what_makes_the_model_worse_is_a_warning_that_says_what_to_do(data: IdentificationData, case: str) -> None:
    spoil, check, advice = WARNED[case]
    result = identify(edited(data, spoil), 2, "ssarx")
    (finding,) = [finding for finding in result.report.warnings if finding.check == check]
    assert advice in finding.advice
