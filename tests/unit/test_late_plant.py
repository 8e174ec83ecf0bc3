"""A delay of part of a sample in a certificate: exact for a plant of continuous time, in model and uncertainty."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import RobustnessError
from amb_core.identification import estimate_uncertainty
from amb_core.linear import LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.linear.sampling import discretised
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.robustness import RobustnessSettings, assess, classical_margins, feedback_of
from amb_core.robustness.late_plant import late_model, late_uncertainty
from tests.lqg_loop import linear_law, rotor

AT = np.geomspace(5.0, 4_900.0, 40)  # Hz
FEW = {"frequencies": 60.0}


@pytest.fixture(scope="module")
def loop():
    plant = rotor(2)
    return plant.model, LinearControl(plant.lqg(), LinearControllerParameters())


def continuous_plant() -> LinearSystem:
    """Mass on negative stiffness behind an amplifier, and a bending mode: 1/s, A to m."""
    a = np.zeros((5, 5))
    a[0, 1] = a[2, 3] = 1.0
    a[1, [0, 4]], a[3, [2, 3, 4]], a[4, 4] = (5e4, 10.0), (-4e7, -60.0, 2.0), -9e3
    return LinearSystem(a, np.eye(5)[:, 4:] * 9e3, np.array([[1.0, 0.0, 1.0, 0.0, 0.0]]), np.zeros((1, 1)), 0.0)


def model_of(system: LinearSystem) -> StateSpaceModel:
    n, one = system.order, np.zeros(1)
    return StateSpaceModel(
        system.a, system.b, system.c, system.d, np.zeros((n, 1)), np.eye(1), one, one, np.zeros(n), 1e-4, ("i_x",),
        ("x",),
    )  # fmt: skip


@pytest.mark.parametrize("fraction", [0.1, 0.5, 0.93])
def test_a_late_model_is_the_plant_sampled_with_the_delay(fraction: float) -> None:
    plant = continuous_plant()
    response = late_model(model_of(discretised(plant, 1e-4)), fraction).response(AT)
    assert response == pytest.approx(discretised(plant, 1e-4, fraction * 1e-4).response(AT), rel=1e-9)


def test_half_a_step_of_delay_is_not_taken_as_none(loop) -> None:
    """At low frequencies a delay turns the phase margin by the same angle, in steps of half a sample."""
    phases = [
        classical_margins(feedback_of(*loop, steps))[0].phase
        for steps in (0.0, 0.5, 1.0)
    ]  # fmt: skip
    first, second = (before.value - after.value for before, after in itertools.pairwise(phases))
    assert first > 0.0
    assert first == pytest.approx(second, rel=0.15)
    assert first == pytest.approx(np.pi * 1e-4 * phases[0].frequency, rel=0.15)


def test_whole_and_part_of_a_delay_meet(loop) -> None:
    almost, whole = (feedback_of(*loop, steps).output_sensitivity.response(AT) for steps in (2.0 - 1e-9, 2.0))
    assert almost == pytest.approx(whole, rel=1e-5, abs=1e-9)


def test_the_uncertainty_moves_with_the_model(loop) -> None:
    """The change of the response along each direction, against the late models of both sides."""
    record = rotor(2).record(linear_law(loop[1].model, 2), 2_000)
    uncertainty = estimate_uncertainty(loop[0], IdentificationData.from_record(record))
    late = late_uncertainty(uncertainty, 0.4)
    changes, of_late, model = uncertainty.deviations, late.deviations, loop[0]
    number, small = 3, 1e-3
    up, down = (
        late_model(replace(model, a=model.a + sign * changes.a[number], b=model.b + sign * changes.b[number],
                           c=model.c + sign * changes.c[number]), 0.4).response(AT)
        for sign in (small, -small)
    )  # fmt: skip
    moved = replace(
        late.model,
        a=late.model.a + small * of_late.a[number],
        b=late.model.b + small * of_late.b[number],
        c=late.model.c + small * of_late.c[number],
    )
    wanted = (up - down) / 2.0
    assert moved.response(AT) - late.model.response(AT) == pytest.approx(wanted, rel=2e-2, abs=1e-3 * abs(wanted).max())
    bounds = assess(*loop, RobustnessSettings(extra_delay=0.4, **FEW), uncertainty).bounds
    for axis in bounds.axes:
        assert axis.replayed == pytest.approx(axis.sensitivity.value, rel=0.05)


def with_pole(model: StateSpaceModel, pole: float) -> StateSpaceModel:
    """A model with a real pole more."""
    n = model.order
    return replace(
        model,
        a=np.block([[model.a, np.zeros((n, 1))], [np.zeros((1, n)), pole * np.eye(1)]]),
        b=np.vstack([model.b, np.ones((1, 2))]),
        c=np.hstack([model.c, 1e-9 * np.ones((2, 1))]),
        k=np.vstack([model.k, np.zeros((1, 2))]),
        initial_state=np.zeros(n + 1),
    )


def test_an_alternating_pole_is_a_pair_of_modes_at_half_the_sample_rate() -> None:
    """In the coordinates of x' = s x + s/(e^(s T) - 1) u, whose real part the samples show."""
    s = (np.log(0.3) + 1j * np.pi) / 1e-4
    b = s / (np.exp(s * 1e-4) - 1.0)
    a = np.array([[s.real, -s.imag], [s.imag, s.real]])
    pair = LinearSystem(a, np.array([[b.real], [b.imag]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)), 0.0)
    one = model_of(LinearSystem(-0.3 * np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)), 1e-4))
    assert one.response(AT) == pytest.approx(discretised(pair, 1e-4).response(AT), rel=1e-9)
    assert late_model(one, 0.4).response(AT) == pytest.approx(discretised(pair, 1e-4, 0.4e-4).response(AT), rel=1e-9)


def test_dead_time_in_the_model_is_refused_with_the_way_out(loop) -> None:
    with pytest.raises(RobustnessError, match=r"pole at z = 0.*whole number of steps"):
        feedback_of(with_pole(loop[0], 0.0), loop[1], 0.5)
    for pole, delay in ((0.0, 1.0), (-0.3, 0.5)):
        assert feedback_of(with_pole(loop[0], pole), loop[1], delay).stable
