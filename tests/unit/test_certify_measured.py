"""A certificate says certified only where the sensitivity of a loop with this controller was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.experiments import detrend
from amb_core.identification import Identification, IdentificationData, identify
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.robustness import Recorded, RobustnessSettings, certify, certify_from_data
from amb_core.robustness.certificate import Certificate
from amb_core.robustness.checks import MEASURED, NOT_RUN, Check, was_measured_check
from amb_core.robustness.displacement import largest_displacements

LAW, OTHER = ControllerParameters(), ControllerParameters(proportional_gain=25_000.0)
SETTINGS = RobustnessSettings(frequencies=60.0, mode_gain=0.02)


@pytest.fixture(scope="module")
def data(bearing) -> IdentificationData:
    record = bearing.experiment(2e-8, "multisine", force=0.1, amplitude=20e-6, duration=1.0, frequency_end=1_500.0)
    return IdentificationData.from_record(record)


@pytest.fixture(scope="module")
def identification(data) -> Identification:
    return identify(data, 6, controller=LAW)


@pytest.fixture(scope="module")
def plain(data, identification) -> Certificate:
    return certify_from_data(identification, LAW, Recorded(data, LAW), settings=SETTINGS)


def measured_of(certificate: Certificate) -> Check:
    (check,) = (one for one in certificate.checks if one.name == MEASURED)
    return check


def test_data_of_the_loop_measure_its_sensitivity(plain) -> None:
    assert measured_of(plain).passed, measured_of(plain).finding


def test_a_sweep_of_another_controller_takes_nothing_away(data, identification, plain) -> None:
    certificate = certify_from_data(
        identification,
        LAW,
        Recorded(data, LAW),
        settings=SETTINGS,
        swept=Recorded(data, OTHER),
        uncertainty=identification.uncertainty,
    )
    assert [check.name for check in certificate.checks] == [check.name for check in plain.checks]
    assert certificate.measured is not None
    assert any("left out: it is not of a loop with this controller" in text for text in certificate.warnings)


def test_data_whose_currents_another_controller_computed_measure_nothing(data, identification) -> None:
    """Nobody said which controller ran; the currents show it."""
    certificate = certify_from_data(identification.model, OTHER, data, Recorded(data, LAW), settings=SETTINGS)
    check = measured_of(certificate)
    assert not check.passed
    assert "does not compute" in check.finding


def test_a_sweep_that_is_said_to_be_of_the_controller_must_show_it(data, identification) -> None:
    certificate = certify_from_data(
        identification,
        OTHER,
        Recorded(data, LAW),
        settings=SETTINGS,
        swept=Recorded(data, OTHER),
        uncertainty=identification.uncertainty,
    )
    assert not any(check.name.startswith("measured by a swept sine") for check in certificate.checks)
    assert any("the swept sine is left out: " in text and "does not compute" in text for text in certificate.warnings)


def test_data_of_the_identification_measure_it_where_those_of_the_validation_are_of_another_loop(
    data, identification
) -> None:
    certificate = certify_from_data(identification, LAW, Recorded(data, LAW), Recorded(data, OTHER), settings=SETTINGS)
    assert measured_of(certificate).passed


def test_no_data_measure_a_loop_with_an_extra_delay(data, identification) -> None:
    loop = Recorded(data, LAW)
    late = SETTINGS.model_copy(update={"extra_delay": 1.0})
    certificate = certify_from_data(
        identification, LAW, loop, settings=late, swept=loop, uncertainty=identification.uncertainty
    )
    assert measured_of(certificate).finding == "no data are of a loop with the extra delay of 1 steps"
    assert certificate.measured is None and not certificate.certified
    assert any(
        "the swept sine is left out: it is of a loop without the extra delay" in text for text in certificate.warnings
    )


def test_without_data_of_the_loop_the_certificate_says_so(identification) -> None:
    check = measured_of(certify(identification.model, LAW, settings=SETTINGS))
    assert (check.passed, check.finding) == (False, NOT_RUN)


def test_what_was_measured_far_from_the_peak_of_an_axis_only_does_not_count(plain) -> None:
    assert plain.measured is not None and plain.assessment is not None
    peak = plain.assessment.axes[1].sensitivity.frequency
    near = np.abs(np.log2(plain.measured.frequency / peak)) < 0.6
    incoherent = np.where(near[:, None] & (np.arange(2) == 1), 0.5, plain.measured.coherence)
    check = was_measured_check(replace(plain.measured, coherence=incoherent), plain.assessment)
    assert not check.passed
    assert "axis y about its peak" in check.finding


def test_all_that_passes_but_the_measurement_is_predicted(plain) -> None:
    passed = tuple(replace(check, passed=True) for check in plain.checks)
    assert replace(plain, checks=passed).statement.startswith("certified")
    unmeasured = (*(one for one in passed if one.name != MEASURED), Check(MEASURED, False, NOT_RUN))
    certificate = replace(plain, checks=unmeasured)
    assert certificate.statement == "predicted" and not certificate.certified
    assert certificate.verdict.startswith(f"Predicted, not certified, since {NOT_RUN}")


def test_displacement_counts_in_all_data_over_the_clearance_of_each_axis(data, identification) -> None:
    plant = PlantParameters()
    largest = np.abs(data.experiments[0].outputs).max(axis=0)
    near = plant.model_copy(
        update={"rotor": plant.rotor.model_copy(update={"backup_bearing_radius": 1.2 * largest.max()})}
    )
    quiet = data.window(0, 5_000)
    of_both = certify_from_data(identification, LAW, Recorded(data, LAW, near), Recorded(quiet, LAW), settings=SETTINGS)
    assert of_both.displacement is not None
    assert max(of_both.displacement.values()) == "D"


def test_displacement_counts_from_the_middle_as_a_radius() -> None:
    plant = PlantParameters()
    sagging = np.tile([3e-5, -4e-5], (100, 1))
    loop = IdentificationData.from_arrays(
        sagging, sagging, 1e-4, input_names=["i_x", "i_y"], output_names=["x", "y"],
        input_units=["A", "A"], output_units=["m", "m"],
    )  # fmt: skip
    share = pytest.approx(5e-5 / plant.rotor.backup_bearing_radius)
    for given in (loop, detrend(loop)):
        assert largest_displacements([Recorded(given, LAW, plant)]) == {"x": share, "y": share}


def test_what_is_not_known_of_displacement_and_operation_is_said(plain) -> None:
    assert any("the zone after ISO 14839-2 is not known" in text for text in plain.warnings)
    assert any("operation_amplitude" in text and "was not checked" in text for text in plain.warnings)


def test_where_the_response_is_not_linear_in_the_parameters_the_data_bound_it(data, identification, plain) -> None:
    """The ellipsoid taken as linear says 3.1 of a model that has 2.0; what the response may be is measured."""
    far = replace(identification.uncertainty, root=200.0 * identification.uncertainty.root)
    certificate = certify_from_data(identification, LAW, Recorded(data, LAW), settings=SETTINGS, uncertainty=far)
    assert certificate.assessment is not None and certificate.assessment.bounds is not None
    assert plain.assessment is not None and plain.assessment.bounds is not None
    for bound, usual in zip(certificate.assessment.bounds.axes, plain.assessment.bounds.axes, strict=True):
        assert bound.by_data and not usual.by_data
        assert bound.replayed <= bound.sensitivity.value < 1.1 * usual.sensitivity.value
    assert any("the bounds are those of the response itself" in warning for warning in certificate.warnings)
    assert any("by the error of the response that the data leave open" in check.finding for check in certificate.checks)
