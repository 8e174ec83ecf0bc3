"""Positions or references of other rows than the currents are named, and a right controller is never accused of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.experiments import Severity
from amb_core.identification import IdentificationData, identify, validate
from amb_core.identification.controller_check import check_controller
from amb_core.identification.validation.verdict import Verdict
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_control import LinearControllerParameters, pd_as_linear, with_anti_windup
from amb_core.loop.records import LoopRecord
from tests.benchmarks.verdicts.drawn_loops import draw_record
from tests.lqg_loop import linear_law, pid, rotor
from tests.sensor_loop import SensorLoop


def moved(record: LoopRecord, signal: str, samples: int, axes: slice | int = slice(None)) -> LoopRecord:
    """A record that holds a signal of some axes so many samples later than it was (earlier if negative)."""
    changed = getattr(record, signal).copy()
    changed[:, axes] = np.roll(changed, samples, axis=0)[:, axes]
    return replace(record, **{signal: changed}).window(record.first_step + 2, record.steps - 4)


def of_pd(axes: int, rate: float, seed: int) -> tuple[LoopRecord, ControllerParameters]:
    """A record of a random bearing at a rate (Hz), with its PD law."""
    random = np.random.default_rng(seed)
    while True:
        record, loop = draw_record(random, 4_000, axes)
        if loop.controller.sample_rate == rate:
            return record, loop.controller


def of_state_space(axes: int, seed: int, noise: float = 1.0) -> tuple[LoopRecord, LinearControl]:
    law = with_anti_windup(pid(axes))
    record = rotor(axes).record(linear_law(law, axes), 4_000, seed=seed, noise=noise)
    return record, LinearControl(law, LinearControllerParameters())


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("samples", [-2, -1, 1, 2])
@pytest.mark.parametrize("kind", ["pd", "state space"])
def test_positions_of_other_samples_are_named_with_how_to_move_them(axes: int, samples: int, kind: str) -> None:
    record, controller = of_pd(axes, 1e4, 3) if kind == "pd" else of_state_space(axes, 3)
    finding = check_controller(IdentificationData.from_record(moved(record, "position", samples)), controller)
    number = f"{abs(samples)} sample{'s' if abs(samples) > 1 else ''}"
    names = "x, y" if axes > 1 else "x"
    assert finding.severity is Severity.WARNING
    assert f"with the positions {names} {number} {'late' if samples > 0 else 'early'}" in finding.what
    assert f"move the positions {names} by {-samples:+d} sample" in finding.advice
    assert "move the currents" not in finding.advice


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("samples", [-2, -1, 1, 2])
@pytest.mark.parametrize("kind", ["pd", "state space"])
def test_references_of_other_samples_are_named_with_how_to_move_them(axes: int, samples: int, kind: str) -> None:
    record, controller = of_pd(axes, 1e4, 3) if kind == "pd" else of_state_space(axes, 3)
    finding = check_controller(IdentificationData.from_record(moved(record, "reference", samples)), controller)
    names = "x, y" if axes > 1 else "x"
    assert finding.severity is Severity.WARNING
    assert f"with the references {names} {abs(samples)} sample" in finding.what
    assert f"move the references {names} by {-samples:+d} sample" in finding.advice
    assert "move the currents" not in finding.advice


@pytest.mark.parametrize("kind", ["pd", "state space"])
def test_a_single_position_of_another_sample_is_named_alone(kind: str) -> None:
    record, controller = of_pd(2, 1e4, 3) if kind == "pd" else of_state_space(2, 3)
    finding = check_controller(IdentificationData.from_record(moved(record, "position", -1, 1)), controller)
    assert finding.severity is Severity.WARNING
    assert finding.advice.startswith("move the positions y by +1 sample")


@pytest.mark.parametrize("axes", [1, 2])
def test_early_positions_are_named_also_where_they_hardly_change_the_currents(axes: int) -> None:
    """A row written in the next interrupt: the new position beside the old reference and current."""
    loop = SensorLoop(axes)
    record = moved(loop.record(1.0), "position", -1)
    finding = check_controller(IdentificationData.from_record(record), loop.controller)
    assert finding.severity is Severity.WARNING and "early" in finding.what
    share = float(finding.what.split("compute ")[1].split(" %")[0])
    assert 1.0 < share < 5.0, "below what is accepted of a controller that is otherwise right"


def test_a_model_of_early_positions_is_not_validated_without_reservation() -> None:
    loop = SensorLoop(1)
    early = [IdentificationData.from_record(moved(loop.record(2.0, seed), "position", -1)) for seed in (1, 2)]
    model = identify(early[0], 3, controller=loop.controller).model
    judged = validate(model, early[1], loop.controller)
    (condition,) = (one for one in judged.failed if one.key == "controller")
    assert "move the positions x by +1 sample" in condition.advice
    assert judged.verdict is not Verdict.VALIDATED


def disturbed(record: LoopRecord, kind: str, random: np.random.Generator) -> LoopRecord:
    """A record as it is measured beside the controller: nothing of it is wrong."""
    spread = {name: getattr(record, name).std(axis=0) for name in ("position", "current")}
    if kind == "noise of the currents":
        noise = 0.02 * spread["current"] * random.normal(size=record.current.shape)
        return replace(record, current=record.current + noise)
    if kind == "noise of the positions":
        noise = 0.003 * spread["position"] * random.normal(size=record.position.shape)
        return replace(record, position=record.position + noise)
    if kind == "quantised":
        steps = {name: size / 100.0 for name, size in spread.items()}
        return replace(record, **{name: np.round(getattr(record, name) / step) * step for name, step in steps.items()})
    return record


KINDS = ("as computed", "noise of the currents", "noise of the positions", "quantised")


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_a_right_controller_is_not_accused_of_a_shift(kind: str, axes: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    of_laws = [of_pd(axes, rate, seed) for rate in (1e4, 2e4)]
    limit = LinearControllerParameters(current_limit=3.0)
    slow = SensorLoop(axes, 2e3)
    cases: list[tuple[LoopRecord, KnownController]] = [
        *of_laws,
        *((record, LinearControl(pd_as_linear(law, axes), limit)) for record, law in of_laws[:1]),
        (slow.record(seed=seed), slow.controller),
        of_state_space(axes, seed),
    ]
    for record, controller in cases:
        finding = check_controller(IdentificationData.from_record(disturbed(record, kind, random)), controller)
        assert "sample" not in finding.what and "move" not in finding.advice, finding


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_a_right_controller_at_its_limit_is_not_accused_of_a_shift(kind: str, axes: int) -> None:
    law = with_anti_windup(pid(axes))
    record = rotor(axes).record(linear_law(law, axes, limit=0.5), 4_000, amplitude=8e-6)
    assert np.mean(np.abs(record.current) >= 0.5) > 0.01
    record = disturbed(record, kind, np.random.default_rng(1))
    finding = check_controller(
        IdentificationData.from_record(record), LinearControl(law, LinearControllerParameters(current_limit=0.5))
    )
    assert "sample" not in finding.what and "move" not in finding.advice, finding
