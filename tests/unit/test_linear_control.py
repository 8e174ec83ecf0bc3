"""Linear controllers: the PD law as a special case, limits, anti-windup, and what does not fit a machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.excitation import Square, generate
from amb_core.ground.errors import ParameterError
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.linear_control import LinearController, LinearControllerParameters, pd_as_linear, with_anti_windup
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate

RATE = 10_000.0


def law(model: StateSpaceModel, axes: int = 2, **parameters: float) -> LinearController:
    return LinearController(model, LinearControllerParameters(**parameters), axes, RATE)


def controller(a: list, b: list, c: list, d: list) -> StateSpaceModel:
    """One axis, from the position error."""
    return StateSpaceModel(
        *(np.array(part, dtype=float) for part in (a, b, c, d)), np.zeros((len(a), 1)), np.zeros((1, 1)), np.zeros(1),
        np.zeros(1), np.zeros(len(a)), 1.0 / RATE, ("e",), ("i",), input_units=("m",), output_units=("A",),
    )  # fmt: skip


INTEGRATOR = controller([[1.0]], [[1.0]], [[100.0]], [[2e4]])


@pytest.mark.parametrize("settings", [{}, {"derivative_filter": 1e-4}, {"derivative_on": "measurement"}])
@pytest.mark.parametrize("axes", [1, 2, 4])
def test_the_pd_law_is_a_special_case(settings: dict[str, object], axes: int) -> None:
    random = np.random.default_rng(1)
    parameters = ControllerParameters(current_limit=100.0, **settings)
    pd, linear = PdController(parameters, axes), law(pd_as_linear(parameters, axes), axes, current_limit=100.0)
    for position, reference in random.normal(scale=1e-6, size=(50, 2, axes)):
        np.testing.assert_allclose(linear.update(position, reference), pd.update(position, reference), rtol=1e-9)


def test_the_bearing_levitates_and_answers_as_under_the_pd_law() -> None:
    signal = generate(Square(amplitude=10e-6, duration=0.1, frequency=20.0), RATE).samples
    parameters = ControllerParameters()
    expected = simulate(Plant(), PdController(parameters), 2_000, signal, 1_000)
    record = simulate(Plant(), law(pd_as_linear(parameters)), 2_000, signal, 1_000)
    # The amplifiers' switching instants multiply rounding: not bit for bit.
    np.testing.assert_allclose(record.position, expected.position, atol=1e-8)


def test_an_integrator_takes_the_sag_away() -> None:
    pd = pd_as_linear(ControllerParameters())
    one, none = np.eye(2), np.zeros((2, 2))
    pid = replace(
        pd, a=np.block([[pd.a, none], [none, one]]), b=np.vstack([pd.b, np.hstack([one, -one])]),
        c=np.hstack([pd.c, 50.0 * one]), k=np.zeros((4, 2)), initial_state=np.zeros(4),
    )  # fmt: skip
    record = simulate(Plant(), law(with_anti_windup(pid)), 8_000)
    assert abs(record.position[-100:, 1].mean()) < 1e-6
    sag = simulate(Plant(), law(pd), 8_000).position[-100:, 1].mean()
    assert sag == pytest.approx(-68.2e-6, abs=1e-6)


def test_currents_stay_within_their_limit() -> None:
    assert law(INTEGRATOR, 1, current_limit=0.5).update([-1.0], [0.0]) == [0.5]
    assert law(INTEGRATOR, 1, current_limit=0.5).update([1.0], [0.0]) == [-0.5]


def test_with_anti_windup_the_current_leaves_its_limit_at_once() -> None:
    """After a long error of one sign the wound-up integrator must first unwind."""

    def steps_at_the_limit(model: StateSpaceModel) -> int:
        controller = law(model, 1)
        controller.update([0.0], [0.0])
        for _ in range(2_000):
            controller.update([-200e-6], [0.0])
        answers = [controller.update([10e-6], [0.0])[0] for _ in range(2_000)]
        return sum(answer > 0.0 for answer in answers)

    assert steps_at_the_limit(INTEGRATOR) == 2_000
    assert steps_at_the_limit(with_anti_windup(INTEGRATOR)) <= 1_000


def test_the_anti_windup_gain_makes_the_controller_forget() -> None:
    unstable = controller([[1.01, 0.1], [0.0, 0.5]], [[1.0], [1.0]], [[1.0, 1.0]], [[0.0]])
    model = with_anti_windup(unstable)
    assert np.abs(np.linalg.eigvals(model.a - model.k @ model.c)).max() < 1.0
    given = replace(unstable, k=np.array([[0.3], [0.1]]))
    assert with_anti_windup(given) is given
    stable = pd_as_linear(ControllerParameters(derivative_filter=1e-4))
    assert with_anti_windup(stable) is stable


def test_a_hidden_integrator_is_refused() -> None:
    hidden = controller([[1.0, 0.0], [0.0, 0.5]], [[1.0], [1.0]], [[0.0, 1.0]], [[0.0]])
    with pytest.raises(ParameterError, match="no anti-windup gain is found"):
        with_anti_windup(hidden)


@pytest.mark.parametrize(
    ("model", "axes", "reason"),
    [
        (INTEGRATOR, 2, "1 inputs and 1 outputs, the machine 2 axes; allowed: 2 outputs, and 2 inputs"),
        (
            replace(INTEGRATOR, sample_time=1e-3),
            1,
            "made for a sample time of 0.001 s; that of the machine is 0.0001 s",
        ),
        (replace(INTEGRATOR, input_units=("A",), output_units=("m",)), 1, "takes A and gives m; allowed: m and A"),
    ],
)
def test_a_controller_that_does_not_fit_the_machine_is_refused(model: StateSpaceModel, axes: int, reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        law(model, axes)
