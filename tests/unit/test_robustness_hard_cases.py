"""Robustness where numbers go wrong silently: bad states and units, long delays, idle axes, wild covariances."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError, RobustnessError
from amb_core.identification import ModelUncertainty, StateSpaceModel, estimate_uncertainty
from amb_core.linear import LinearSystem
from amb_core.linear.sampling import discretised
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.robustness import (
    Block,
    Feedback,
    RobustnessSettings,
    assess,
    assess_loop,
    certificate_values,
    certify,
    feedback_of,
    mu_peak,
    peak_gain,
    sha256_of,
)
from amb_core.robustness.certificate import _not_linear
from amb_core.robustness.mu_lower import lower_bound
from amb_core.robustness.mu_upper import upper_bound
from amb_core.robustness.replay import distance_from_circle
from tests.lqg_loop import linear_law, rotor

SETTINGS = RobustnessSettings(frequencies=100)
STEP = 1e-4  # s
MASS, FORCE, STIFFNESS = 6.25, 66.0, 3.3e5  # kg, N/A, N/m: the paper's bearing


@pytest.fixture(scope="module")
def loop():
    plant = rotor(2)
    return plant.model, LinearControl(plant.lqg(), LinearControllerParameters())


@pytest.fixture(scope="module")
def nominal(loop):
    return assess(*loop, SETTINGS)


@pytest.fixture(scope="module")
def uncertainty(loop):
    record = rotor(2).record(linear_law(loop[1].model, 2), 4_000)
    return estimate_uncertainty(loop[0], IdentificationData.from_record(record))


def first_order(pole: float, gains: list[float], feedback: list[float], delay: int = 0) -> Feedback:
    """Axes that do not see each other: g/(z - pole) under a constant gain and a delay."""
    axes = len(gains)
    plant = LinearSystem(pole * np.eye(axes), np.diag(gains), np.eye(axes), np.zeros((axes, axes)), STEP)
    if not delay:
        none = np.zeros((0, 0))
        return Feedback(plant, LinearSystem(none, np.zeros((0, axes)), np.zeros((axes, 0)), np.diag(feedback), STEP))
    shift = np.kron(np.eye(delay, k=-1), np.eye(axes))
    b, c = np.eye(delay * axes, axes), np.eye(axes, delay * axes, (delay - 1) * axes)
    return Feedback(plant, LinearSystem(shift, b, np.diag(feedback) @ c, np.zeros((axes, axes)), STEP))


def fast_sampled(proportional: float, derivative: float) -> Feedback:
    """Two axes of the paper's bearing at 100 kHz, over-damped: the stiffness limits them, so S is largest at rest."""
    step, decay, axes = 1e-5, 2e-5, np.eye(2)
    bearing = np.array([[0.0, 1.0], [STIFFNESS / MASS, 0.0]]), np.array([[0.0], [FORCE / MASS]])
    a, b = (np.kron(axes, matrix) for matrix in bearing)
    plant = discretised(LinearSystem(a, b, np.kron(axes, [[1.0, 0.0]]), np.zeros((2, 2)), 0.0), step)
    pole, slope = decay / (decay + step), derivative / (decay + step)
    law = [[[pole, -slope], [0.0, 0.0]], [[slope], [1.0]], [[pole, -slope]], [[proportional + slope]]]
    return Feedback(plant, LinearSystem(*(np.kron(axes, matrix) for matrix in law), step), ("x", "y"))


def same_axes(assessment, expected) -> None:
    """All numbers of each axis."""
    for one, other in zip(assessment.axes, expected.axes, strict=True):
        assert one.sensitivity.value == pytest.approx(other.sensitivity.value, rel=1e-6)
        assert one.complementary.value == pytest.approx(other.complementary.value, rel=1e-6)
        assert one.margins.gain_up.value == pytest.approx(other.margins.gain_up.value, rel=1e-6)
        assert one.margins.delay.value == pytest.approx(other.margins.delay.value, rel=1e-6)
        assert one.disk.guaranteed == pytest.approx(other.disk.guaranteed, rel=1e-6)


# -- states and units


def test_states_of_very_different_size_change_nothing(loop, nominal) -> None:
    model, control = loop
    scale = np.geomspace(1e-8, 1e8, model.order)
    moved = replace(
        model,
        a=model.a * scale[:, np.newaxis] / scale,
        b=model.b * scale[:, np.newaxis],
        c=model.c / scale,
        k=model.k * scale[:, np.newaxis],
    )
    assessment = assess(moved, control, SETTINGS)
    same_axes(assessment, nominal)
    assert assessment.mu.upper == pytest.approx(nominal.mu.upper, rel=1e-3)


def test_axes_in_different_units_have_the_same_numbers(loop, nominal) -> None:
    """A second axis in um: all numbers of one axis and all structured ones stay; only norms over axes change."""
    feedback = feedback_of(*loop)
    unit = np.array([1.0, 1e6])
    plant, law = feedback.plant.scaled(unit, 1.0), feedback.controller.scaled(1.0, 1.0 / unit)
    assessment = assess_loop(Feedback(plant, law, feedback.axes), SETTINGS)
    same_axes(assessment, nominal)
    assert assessment.mu.upper == pytest.approx(nominal.mu.upper, rel=1e-3)
    assert assessment.disks[0].guaranteed == pytest.approx(nominal.disks[0].guaranteed, rel=1e-6)


def test_a_peak_agrees_with_the_response_whatever_the_states(loop) -> None:
    s = feedback_of(*loop).output_sensitivity
    scale = np.geomspace(1.0, 1e12, s.order)
    moved = LinearSystem(
        s.a * scale[:, np.newaxis] / scale, s.b * scale[:, np.newaxis], s.c / scale, s.d, s.sample_time
    )
    peak = peak_gain(moved)
    assert peak.value == pytest.approx(peak_gain(s).value, rel=1e-9)
    assert peak.value == pytest.approx(s.gain(peak.frequency), rel=1e-9)


@pytest.mark.parametrize("change", ["plant", "controller"])
def test_one_sample_time_is_demanded(loop, change: str) -> None:
    feedback = feedback_of(*loop)
    with pytest.raises(RobustnessError, match=r"one sample time: 0.000\d s and 0.000\d s"):
        system = getattr(feedback, change)
        replace(feedback, **{change: LinearSystem(system.a, system.b, system.c, system.d, 3e-4)})
    with pytest.raises(IdentificationError, match="one sample time"):
        assess(replace(loop[0], sample_time=2e-4), loop[1])


def test_a_model_with_fewer_outputs_than_inputs_is_refused_by_name(loop) -> None:
    model = loop[0]
    one = replace(
        model, c=model.c[:1], d=model.d[:1], k=model.k[:, :1], innovation_covariance=np.eye(1),
        output_offset=np.zeros(1), output_names=("x",), output_units=("m",),
    )  # fmt: skip
    with pytest.raises(IdentificationError, match="2 inputs and 1 outputs"):
        assess(one, loop[1])


# -- stability and delay


def test_a_pole_too_close_to_the_unit_circle_is_not_taken_as_stable() -> None:
    """The pole of the loop is 1 - 1e-10: rounding decides on which side it is."""
    with pytest.raises(RobustnessError, match="not stable: pole z = 1"):
        assess_loop(first_order(1.0 - 0.9e-10, [1e-11], [1.0]), SETTINGS)


def test_a_pole_close_to_the_unit_circle_keeps_its_exact_peak() -> None:
    """S = (z - 1 + e)/(z - 1 + e + g k) is largest at half the sample rate: (2 - e)/(2 - e - g k)."""
    e, g = 1e-8, 1e-9
    assessment = assess_loop(first_order(1.0 - e, [g], [0.2]), SETTINGS)
    assert assessment.axes[0].sensitivity.value - 1.0 == pytest.approx(0.2 * g / (2.0 - e - 0.2 * g), rel=1e-6)


def test_a_plant_that_no_constant_current_holds_is_refused() -> None:
    with pytest.raises(RobustnessError, match="pole at z = 1"):
        assess_loop(first_order(1.0, [0.01], [1.0]), SETTINGS)


def test_a_controller_with_an_integrator_is_assessed(loop, nominal) -> None:
    """C (1 + k/(z - 1)) with a slow integral: no static error, and nearly the numbers of C."""
    feedback, slow = feedback_of(*loop), 1e-5
    law = feedback.controller
    n = law.order
    a = np.block([[law.a, np.zeros((n, 2))], [slow * law.c, np.eye(2)]])
    with_integral = LinearSystem(a, np.vstack([law.b, slow * law.d]), np.hstack([law.c, np.eye(2)]), law.d, STEP)
    assessment = assess_loop(Feedback(feedback.plant, with_integral, feedback.axes), SETTINGS)
    static = assessment.feedback.output_sensitivity.response(np.array([0.0]))[0]
    assert np.abs(static).max() < 1e-9
    for one, other in zip(assessment.axes, nominal.axes, strict=True):
        assert one.sensitivity.value == pytest.approx(other.sensitivity.value, rel=1e-2)


@pytest.mark.parametrize("delay", [1, 40])
def test_a_delay_of_many_samples_has_the_margins_of_its_loop(delay: int) -> None:
    assessment = assess_loop(first_order(0.99, [0.01], [2.0], delay), SETTINGS)
    s = assessment.feedback.output_sensitivity
    fine = np.abs(s.response(np.linspace(0.0, 0.5 / STEP, 50_001)))[:, 0, 0].max()
    assert assessment.axes[0].sensitivity.value == pytest.approx(fine, rel=1e-5)
    steps = assessment.axes[0].margins.delay.value / STEP
    if math.isfinite(steps):
        assert first_order(0.99, [0.01], [2.0], delay + math.floor(steps)).stable
        assert not first_order(0.99, [0.01], [2.0], delay + math.ceil(steps)).stable


@pytest.mark.parametrize(("gains", "feedback"), [([0.01, 0.0], [0.5, 0.5]), ([0.01, 0.01], [0.5, 0.0])])
def test_an_axis_without_loop_does_not_disturb_the_other(gains: list[float], feedback: list[float]) -> None:
    both, alone = (
        assess_loop(first_order(0.99, gains, feedback), SETTINGS),
        assess_loop(first_order(0.99, gains[:1], feedback[:1]), SETTINGS),
    )
    assert both.axes[0].sensitivity.value == pytest.approx(alone.axes[0].sensitivity.value, rel=1e-9)
    assert both.axes[1].sensitivity.value == pytest.approx(1.0, rel=1e-9)
    assert both.axes[1].margins.gain_up.value == math.inf
    assert both.mu.lower > 0.0
    assert both.on_circle < 1e-6


def test_an_axis_without_loop_has_infinite_disk_margins_where_its_disk_is_that_of_t() -> None:
    """Skew -1: the disk is that of T, which is 0."""
    assessment = assess_loop(first_order(0.99, [0.01, 0.01], [0.5, 0.0]), SETTINGS.model_copy(update={"skew": -1.0}))
    disk = assessment.axes[1].disk
    assert disk.guaranteed == math.inf
    assert (disk.gain, disk.phase) == ((-math.inf, math.inf), math.pi)
    assert math.isfinite(assessment.axes[0].disk.guaranteed)


def test_a_loop_that_is_not_closed_bears_actuators_of_any_size(loop) -> None:
    model, law = replace(loop[0], a=0.5 * np.eye(len(loop[0].a))), loop[1].model
    open_law = LinearControl(replace(law, c=0.0 * law.c, d=0.0 * law.d), LinearControllerParameters())
    only_actuators = dict.fromkeys(("sensor", "current_gain", "negative_stiffness"), 0.0)
    certificate = certify(model, open_law, settings=SETTINGS.model_copy(update=only_actuators | {"skew": -1.0}))
    assert "stable with any size of the assumed perturbations" in certificate.checks[2].finding
    json.dumps(certificate_values(certificate), allow_nan=False)


# -- at rest


def test_mu_is_that_at_rest_where_no_higher_frequency_has_as_much() -> None:
    """Sensor, actuator and current gain lower the stiffness of the loop while that of the magnets rises."""
    assessment = assess_loop(fast_sampled(6_300.0, 75.0), SETTINGS)
    share = brentq(lambda r: 6_300.0 * FORCE * (1.0 - 0.05 * r) ** 3 - STIFFNESS * (1.0 + 0.1 * r), 0.0, 2.0)
    assert share < 1.0
    assert assessment.mu.lower == pytest.approx(1.0 / share, rel=1e-4)
    assert 1.0 / share <= assessment.mu.upper < 1.001 / share
    assert assessment.on_circle < 1e-6


@pytest.mark.parametrize("proportional", [6_000.0, 6_300.0, 20_000.0])
def test_signals_together_bear_no_more_than_each_alone(proportional: float) -> None:
    assessment = assess_loop(fast_sampled(proportional, 75.0), SETTINGS)
    outputs = {one.where: one for one in assessment.disks}["outputs"]
    assert outputs.guaranteed <= outputs.broken <= min(axis.disk.guaranteed for axis in assessment.axes)


def test_bounds_are_not_below_the_numbers_of_the_model_wherever_they_are() -> None:
    feedback = fast_sampled(6_500.0, 150.0)
    plant, none = feedback.plant, np.zeros(2)
    model = StateSpaceModel(
        plant.a, plant.b, plant.c, plant.d, np.zeros((4, 2)), 1e-16 * np.eye(2), none, none, np.zeros(4), 1e-5
    )
    root = np.zeros((40, 2))
    root[16, 0] = root[18, 1] = 1e-9  # of B
    bounds = assess_loop(feedback, SETTINGS, ModelUncertainty(model, root, 1.0, 0.0, True)).bounds
    for axis, bound in zip(assess_loop(feedback, SETTINGS).axes, bounds.axes, strict=True):
        assert axis.sensitivity.frequency == pytest.approx(0.0, abs=1e-3)
        assert bound.sensitivity.value >= axis.sensitivity.value
        assert bound.complementary.value >= axis.complementary.value
        assert bound.disk.value >= 1.0 / axis.disk.guaranteed
        assert bound.zone == axis.zone == "B"


# -- bounds of mu


@pytest.mark.parametrize("seed", range(4))
def test_bounds_of_mixed_perturbations_meet(seed: int) -> None:
    """Random matrices with as many real as complex perturbations; the upper bound is nearly exact for most."""
    random, kinds = np.random.default_rng(seed), np.arange(6) < 3
    matrix = random.normal(size=(6, 6)) + 1j * random.normal(size=(6, 6))
    system = LinearSystem(np.zeros((0, 0)), np.zeros((0, 6)), np.zeros((6, 0)), matrix, STEP)
    upper = upper_bound(matrix, kinds)
    lower, _, delta = lower_bound(system, kinds, 100.0, upper)
    assert 0.9 * upper < lower <= upper * (1.0 + 1e-9)
    assert np.abs(np.linalg.det(np.eye(6) - matrix * delta)) < 1e-9


def test_a_bound_is_found_where_a_library_does_not_return() -> None:
    """SLICOT's AB13MD does not return for this matrix, and holds the interpreter meanwhile. Nothing drives its rows."""
    matrix = np.zeros((3, 3), dtype=complex)
    matrix[1, 0], matrix[1, 2] = 0.3098449153263464 - 0.6010015120370034j, -0.5960339446779636 - 0.4330552479387257j
    assert upper_bound(matrix, np.zeros(3, dtype=bool)) < 1e-6


def test_the_peak_of_one_complex_perturbation_is_its_largest_gain() -> None:
    system = LinearSystem(np.array([[0.5]]), np.array([[1.0]]), np.array([[0.5]]), np.zeros((1, 1)), STEP)
    peak = mu_peak(system, [Block("gain")], np.geomspace(1.0, 4_000.0, 50))
    assert peak.upper == pytest.approx(system.gain(1.0))


def test_real_perturbations_alone_are_bounded_at_rest_too() -> None:
    """1 - 0.5 delta/(z - 0.5): the pole reaches z = 1 at delta = 1, and no other frequency has a real response."""
    system = LinearSystem(np.array([[0.5]]), np.array([[1.0]]), np.array([[0.5]]), np.zeros((1, 1)), STEP)
    peak = mu_peak(system, [Block("stiffness", True)], np.geomspace(1.0, 4_000.0, 50))
    assert peak.upper == pytest.approx(1.0)
    assert peak.lower == pytest.approx(1.0)
    assert peak.lower_frequency == 0.0
    assert distance_from_circle(system, peak.perturbation, 0.0) < 1e-9


# -- the covariance


def test_without_covariance_the_bounds_are_the_numbers_of_the_model(loop, nominal, uncertainty) -> None:
    assessment = assess(*loop, SETTINGS, replace(uncertainty, root=np.zeros_like(uncertainty.root)))
    for bound, axis in zip(assessment.bounds.axes, nominal.axes, strict=True):
        assert bound.sensitivity.value == pytest.approx(axis.sensitivity.value, rel=1e-6)
        assert bound.replayed == pytest.approx(axis.sensitivity.value, rel=1e-6)
    assert assessment.bounds.gap.worst.value == pytest.approx(0.0, abs=1e-12)


def test_a_singular_covariance_gives_bounds_between_the_model_and_the_whole(loop, nominal, uncertainty) -> None:
    one = replace(uncertainty, root=uncertainty.root * (np.arange(uncertainty.root.shape[1]) == 0))
    few, whole = assess(*loop, SETTINGS, one).bounds, assess(*loop, SETTINGS, uncertainty).bounds
    for axis, some, every in zip(nominal.axes, few.axes, whole.axes, strict=True):
        assert axis.sensitivity.value <= some.sensitivity.value <= every.sensitivity.value


def test_a_covariance_that_holds_unstable_loops_has_no_bound_and_no_certificate(loop, uncertainty) -> None:
    wild = replace(uncertainty, root=1e3 * uncertainty.root)
    certificate = certify(*loop, settings=SETTINGS, uncertainty=wild)
    bounds = certificate.assessment.bounds
    assert all(axis.sensitivity.value == math.inf and axis.zone == "D" for axis in bounds.axes)
    assert bounds.outputs.value == math.inf
    assert not certificate.certified
    failed = [check.name for check in certificate.checks if not check.passed]
    assert "the worst models of the ellipsoid make stable loops, as far as the data reach" in failed
    json.dumps(certificate_values(certificate), allow_nan=False)


def test_a_bound_that_is_not_the_peak_of_a_model_is_shown(loop, uncertainty) -> None:
    certificate = certify(*loop, settings=SETTINGS, uncertainty=uncertainty)
    assert not any("not linear" in warning for warning in certificate.warnings)
    assessment = certificate.assessment
    first = replace(assessment.bounds.axes[0], replayed=0.5 * assessment.bounds.axes[0].sensitivity.value)
    assert (
        "axis x: the models of the ellipsoid reach"
        in _not_linear(replace(assessment, bounds=replace(assessment.bounds, axes=(first,))))[0]
    )


def test_bounds_of_the_unstable_poles_hold_those_of_the_model(loop, uncertainty) -> None:
    poles = assess(*loop, SETTINGS, uncertainty).bounds.poles
    unstable = [abs(pole) for pole in loop[0].poles() if abs(pole) > 1.0]
    assert sum(len(one.poles) for one in poles) == len(unstable)
    assert all(one.lowest < abs(pole) < one.highest for one in poles for pole in one.poles)


# -- repeated


def test_a_certificate_is_repeated_with_all_digits_and_hashes(loop, uncertainty, tmp_path) -> None:
    file = tmp_path / "model.json"
    file.write_text("a model")
    texts = {
        json.dumps(
            certificate_values(
                certify(*loop, settings=SETTINGS, uncertainty=uncertainty, inputs={"model": sha256_of(file)})
            )
        )
        for _ in range(2)
    }
    assert len(texts) == 1
    file.write_text("another model")
    assert sha256_of(file) not in texts.pop()
