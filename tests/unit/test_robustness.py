"""Robustness of a loop: exact peaks, margins of the literature, bounds of mu that are replayed, and the certificate."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import RobustnessError
from amb_core.identification import closed_loop_poles, estimate_uncertainty
from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.report.pages import Prose
from amb_core.report.pages.certificate import certificate_report
from amb_core.report.pages.robustness import robustness_badge
from amb_core.robustness import (
    Block,
    RobustnessSettings,
    assess,
    certificate_values,
    certify,
    classical_margins,
    feedback_of,
    mu_peak,
    peak_gain,
    zone_of,
)
from amb_core.robustness.margins import disk_peak, gain_of, margins_of_loop, phase_of
from amb_core.robustness.mu_lower import lower_bound
from amb_core.robustness.mu_upper import upper_bound
from amb_core.robustness.replay import distance_from_circle, replayed_poles
from amb_core.robustness.structure import bending_modes, uncertain_loop
from tests.lqg_loop import linear_law, rotor

SETTINGS = RobustnessSettings(frequencies=100)


def from_continuous(a, b, c, d, sample_time: float = 1e-3) -> LinearSystem:
    """By the bilinear transform, which keeps every value of the frequency response, at other frequencies."""
    a, b, c, d, _ = cont2discrete((np.array(a), np.array(b), np.array(c), np.array(d)), sample_time, "bilinear")
    return LinearSystem(a, b, c, d, sample_time)


@pytest.fixture(scope="module")
def loop():
    plant = rotor(2)
    return plant.model, LinearControl(plant.lqg(), LinearControllerParameters())


@pytest.fixture(scope="module")
def assessment(loop):
    return assess(*loop, SETTINGS)


# -- the loop


def test_the_loop_has_the_poles_that_the_identification_computes(loop) -> None:
    poles = feedback_of(*loop).closed.poles()
    assert np.sort(np.abs(poles)) == pytest.approx(np.sort(np.abs(closed_loop_poles(*loop))), abs=1e-9)


@pytest.mark.parametrize("on", ["error", "measurement"])
def test_the_pd_law_makes_the_loop_of_the_identification(loop, on: str) -> None:
    law = ControllerParameters(derivative_on=on, derivative_filter=1e-4)
    ours, theirs = feedback_of(loop[0], law).closed.poles(), closed_loop_poles(loop[0], law)
    assert np.abs(ours[0]) == pytest.approx(np.abs(theirs[0]), abs=1e-9)


def test_sensitivities_add_up_to_one_and_invert_the_loop(loop) -> None:
    feedback = feedback_of(*loop)
    at = np.array([10.0, 100.0, 700.0])
    s, p, c = (item.response(at) for item in (feedback.output_sensitivity, feedback.plant, feedback.controller))
    assert s == pytest.approx(np.linalg.inv(np.eye(2) + p @ c))
    assert s + feedback.complementary.response(at) == pytest.approx(np.broadcast_to(np.eye(2), s.shape))
    axis = feedback.at_axis(0).response(at)[:, 0, 0]
    assert 1.0 / (1.0 + axis) == pytest.approx(s[:, 0, 0])


def test_an_unstable_loop_ends_there_by_name(loop) -> None:
    model, control = loop
    wrong = LinearControl(replace(control.model, c=-control.model.c), LinearControllerParameters())
    with pytest.raises(RobustnessError, match=r"not stable: pole z = .* Hz"):
        assess(model, wrong)
    certificate = certify(model, wrong)
    assert not certificate.certified
    assert certificate.assessment is None
    assert "not stable" in certificate.verdict


def test_a_longer_delay_makes_a_loop_unstable_where_the_delay_margin_says(loop) -> None:
    model, control = loop
    worst = min(item.delay.value for item in classical_margins(feedback_of(model, control)))
    steps = worst / model.sample_time
    assert feedback_of(model, control, math.floor(steps) // 2).stable
    assert not feedback_of(model, control, math.ceil(steps) + 1).stable


# -- peaks and margins


def test_a_peak_between_points_of_a_grid_is_exact() -> None:
    damping, natural = 1e-4, 2.0 * np.pi * 37.123
    system = from_continuous(
        [[0.0, 1.0], [-(natural**2), -2.0 * damping * natural]], [[0.0], [natural**2]], [[1.0, 0.0]], [[0.0]]
    )
    exact = 1.0 / (2.0 * damping * math.sqrt(1.0 - damping**2))
    assert peak_gain(system).value == pytest.approx(exact, rel=1e-6)


def test_the_margins_of_the_introduction_to_disk_margins() -> None:
    """Seiler, Packard and Gahinet (2020), section 2: L = 25/(s^3 + 10 s^2 + 10 s + 10)."""
    a = np.array([[-10.0, -10.0, -10.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    b, c = np.array([[1.0], [0.0], [0.0]]), np.array([[0.0, 0.0, 25.0]])
    sensitivity = from_continuous(a - b @ c, b, -c, [[1.0]])
    alpha = 1.0 / disk_peak(sensitivity, np.geomspace(0.01, 400.0, 200)).upper
    low, high = gain_of(alpha)
    assert round(alpha, 2) == 0.46
    assert (round(low, 2), round(high, 2)) == (0.63, 1.59)
    assert round(math.degrees(phase_of(alpha))) == 26


def test_the_classical_margins_of_the_introduction_to_disk_margins() -> None:
    """The same loop: gain margin 3.6, by hand L(j sqrt(10)) = 25/(10 - 100); phase margin 29.1 degrees."""
    a = np.array([[-10.0, -10.0, -10.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    loop = from_continuous(a, [[1.0], [0.0], [0.0]], [[0.0, 0.0, 25.0]], [[0.0]])
    margins = margins_of_loop("L", loop)
    assert margins.gain_up.value == pytest.approx(3.6, rel=1e-6)
    assert margins.gain_down.value == 0.0
    assert round(math.degrees(margins.phase.value), 1) == 29.1


@pytest.mark.parametrize(
    ("alpha", "skew", "low", "high"),
    [(0.75, 0.0, 0.4545, 2.2), (0.75, 1.0, 1.0 / 1.75, 4.0), (0.75, -1.0, 0.25, 1.75)],
)
def test_gains_of_a_disk(alpha: float, skew: float, low: float, high: float) -> None:
    """f = (2 + delta)/(2 - delta), 1/(1 - delta) and 1 + delta for real delta between -0.75 and 0.75."""
    assert gain_of(alpha, skew) == pytest.approx((low, high), abs=5e-4)


def test_the_spinning_satellite_bears_any_change_on_one_axis_and_a_tenth_on_both() -> None:
    """T = 1/(s + 1) [[1, a], [-a, 1]] with a = 10 (Doyle).

    ||T||^2 = 101; mu(S - 1/2)^2 is the largest value of (100.25 + 10 w + w^2/4)/(1 + w^2), (100.5 + sqrt(10100))/2.
    """
    a = 10.0
    coupling = np.array([[1.0, a], [-a, 1.0]])
    sensitivity = from_continuous(-np.eye(2), np.eye(2), -coupling, np.eye(2))
    complementary = LinearSystem(sensitivity.a, sensitivity.b, -sensitivity.c, np.eye(2) - sensitivity.d, 1e-3)
    grid = np.geomspace(1e-4, 499.0, 200)
    one, both = disk_peak(sensitivity.part([0], [0]), grid), disk_peak(sensitivity, grid)
    assert peak_gain(complementary).value == pytest.approx(math.sqrt(101.0), rel=1e-6)
    assert 1.0 / one.upper == pytest.approx(2.0, rel=1e-6)
    assert both.upper == pytest.approx(math.sqrt(0.5 * (100.5 + math.sqrt(10_100.0))), rel=1e-5)
    assert both.lower == pytest.approx(both.upper, rel=1e-5)


def test_a_gain_at_its_margin_puts_a_pole_on_the_unit_circle(loop) -> None:
    feedback = feedback_of(*loop)
    for axis, margins in enumerate(classical_margins(feedback)):
        for factor in (margins.gain_up.value, margins.gain_down.value):
            if math.isfinite(factor) and factor > 0.0:
                one = feedback.at_axis(axis)
                closed = one.a - one.b @ one.c * factor / (1.0 + one.d * factor)
                assert np.abs(np.abs(np.linalg.eigvals(closed)) - 1.0).min() < 1e-6


# -- structured singular value


@pytest.mark.parametrize("real", [0, 2, 4])
def test_bounds_of_mu_enclose_it_on_random_matrices(real: int) -> None:
    random = np.random.default_rng(real)
    kinds = np.arange(4) < real
    for _ in range(3):
        matrix = random.normal(size=(4, 4)) + 1j * random.normal(size=(4, 4))
        upper = upper_bound(matrix, kinds)
        assert upper <= np.linalg.norm(matrix, 2) * (1.0 + 1e-9)
        if real < 4:
            system = LinearSystem(np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((4, 0)), matrix, 1e-4)
            lower, _, delta = lower_bound(system, kinds, 100.0)
            assert lower <= upper * (1.0 + 1e-9)
            assert np.abs(np.linalg.det(np.eye(4) - matrix * delta)) < 1e-9
            assert np.abs(delta[kinds].imag).max(initial=0.0) == 0.0


def test_mu_of_one_real_perturbation_of_an_imaginary_number_is_zero() -> None:
    assert upper_bound(np.array([[1j]]), np.array([True])) == 0.0
    assert upper_bound(np.array([[1j]]), np.array([False])) == 1.0


def test_the_worst_case_is_a_real_system_that_puts_a_pole_on_the_unit_circle(assessment) -> None:
    system, mu = assessment.uncertain.system, assessment.mu
    assert mu.lower <= mu.upper
    assert np.abs(mu.perturbation).max() * mu.lower == pytest.approx(1.0)
    assert distance_from_circle(system, mu.perturbation, mu.lower_frequency) < 1e-6
    smaller = replayed_poles(system, 0.9 * mu.lower / mu.upper * mu.perturbation, mu.lower_frequency)
    assert np.abs(smaller[0]) < 1.0


def test_without_perturbation_the_uncertain_loop_is_the_loop(assessment) -> None:
    poles = replayed_poles(assessment.uncertain.system, np.zeros(len(assessment.uncertain.blocks), dtype=complex), 50.0)
    assert np.abs(poles[0]) == pytest.approx(assessment.feedback.closed.radius)


def test_a_perturbed_negative_stiffness_is_a_spring_at_the_magnets(loop) -> None:
    """The static gain of the plant with a spring r k_s more: P/(1 + r)."""
    feedback, size = feedback_of(*loop), 0.1
    alone = RobustnessSettings(
        actuator=0.0, sensor=0.0, current_gain=0.0, bending_frequency=0.0, bending_damping=0.0, negative_stiffness=size
    )
    system = uncertain_loop(feedback, alone).system
    p = feedback.plant.response(np.array([0.0]))[0].real
    c = feedback.controller.response(np.array([0.0]))[0].real
    static = system.response(np.array([0.0]))[0].real
    spring = -size * np.linalg.inv(p) @ np.linalg.inv(np.eye(2) + p @ c) @ p
    assert static == pytest.approx(spring, abs=1e-9)


def test_a_bending_mode_moves_by_the_change_that_is_asked() -> None:
    angle, size = 0.4, 0.995
    a = size * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    plant = LinearSystem(a, np.array([[0.3], [1.0]]), np.array([[1.0, 0.2]]), np.zeros((1, 1)), 1e-4)
    (mode,) = bending_modes(plant)
    step = 1e-6 * 1j * mode.pole
    moved = np.linalg.eigvals(a + mode.into_states @ mode.row(step))
    assert np.abs(moved - (mode.pole + step)).min() < 1e-10


def test_a_page_without_a_worst_case_says_that_none_was_found(loop, assessment) -> None:
    certificate = certify(*loop, settings=SETTINGS)
    for upper, size in ((0.5, "2.000 times"), (0.0, "any size of")):
        mu = replace(assessment.mu, upper=upper, lower=0.0, perturbation=np.empty(0, complex))
        report = certificate_report(replace(certificate, assessment=replace(assessment, mu=mu, on_circle=math.nan)))
        (text, *_) = next(section for section in report.sections if section.heading.startswith("Structured")).blocks
        assert isinstance(text, Prose)
        assert text.text == (
            f"The loop tolerates {size} the assumed perturbations together. No perturbation was found that makes the "
            "loop unstable."
        )


def test_reports_show_a_refusal_as_the_certificate_does(loop) -> None:
    certificate = certify(*loop, settings=SETTINGS)
    assert certificate.statement == "not certified" and certificate.assessment is not None
    strip = certificate_report(certificate).strip
    assert strip is not None
    assert (strip.verdict.state, robustness_badge(certificate).state) == ("bad", "bad")


def test_mu_needs_a_perturbation_for_each_signal(assessment) -> None:
    with pytest.raises(RobustnessError, match="as many inputs and outputs"):
        mu_peak(assessment.uncertain.system, [Block("one")], np.array([1.0, 2.0]))


# -- zones


def test_a_limit_belongs_to_the_better_zone() -> None:
    assert [zone_of(value, (3.0, 4.0, 5.0)) for value in (3.0, 3.1, 4.0, 4.5, 5.1)] == ["A", "B", "B", "C", "D"]
    assert zone_of(math.nan, (3.0, 4.0, 5.0)) == "D"
    with pytest.raises(RobustnessError, match="must rise"):
        zone_of(1.0, (3.0, 2.0, 5.0))


# -- the uncertainty of the model


@pytest.fixture(scope="module")
def bounded(loop):
    record = rotor(2).record(linear_law(loop[1].model, 2), 4_000)
    return estimate_uncertainty(loop[0], IdentificationData.from_record(record))


def test_the_worst_model_of_the_ellipsoid_has_the_peak_of_the_bound(loop, bounded) -> None:
    assessment = assess(*loop, SETTINGS, bounded)
    for nominal, bound in zip(assessment.axes, assessment.bounds.axes, strict=True):
        assert bound.sensitivity.value > nominal.sensitivity.value
        assert bound.sensitivity_of_all.value > bound.sensitivity.value
        assert bound.replayed == pytest.approx(bound.sensitivity.value, rel=2e-2)
        assert 1.0 / bound.disk.value < nominal.disk.guaranteed
    assert 0.0 < assessment.bounds.gap.worst.value < 1.0
    assert 0.0 < assessment.bounds.gap.margin < 1.0


# -- the certificate


def test_a_model_that_was_not_validated_is_not_certified(loop) -> None:
    certificate = certify(*loop, settings=SETTINGS, inputs={"model": "0" * 64})
    assert not certificate.certified
    assert certificate.verdict.startswith("Not certified: the model was not validated")
    values = json.loads(json.dumps(certificate_values(certificate), allow_nan=False))
    assert values["certified"] is False
    assert values["inputs"] == {"model": {"sha256": "0" * 64}}
    assert values["axes"]["x"]["peak_sensitivity"]["value"] == certificate.assessment.axes[0].sensitivity.value
