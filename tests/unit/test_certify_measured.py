"""A certificate says certified only where the sensitivity of a loop with this controller was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.identification import Identification, IdentificationData, identify
from amb_core.loop.control import ControllerParameters
from amb_core.robustness import Recorded, RobustnessSettings, certify, certify_from_data
from amb_core.robustness.certificate import Certificate
from amb_core.robustness.checks import MEASURED, NOT_RUN, Check, was_measured_check

LAW, OTHER = ControllerParameters(), ControllerParameters(proportional_gain=25_000.0)
SETTINGS = RobustnessSettings(frequencies=60.0, mode_gain=0.02)


@pytest.fixture(scope="module")
def data(bearing) -> IdentificationData:
    record = bearing.experiment(2e-8, "multisine", force=0.1, amplitude=20e-6, duration=1.0, frequency_end=1_500.0)
    return IdentificationData.from_record(record)


@pytest.fixture(scope="module")
def found(data) -> Identification:
    return identify(data, 6, controller=LAW)


@pytest.fixture(scope="module")
def plain(data, found) -> Certificate:
    return certify_from_data(found, LAW, Recorded(data, LAW), settings=SETTINGS)


def measured_of(certificate: Certificate) -> Check:
    (check,) = (one for one in certificate.checks if one.name == MEASURED)
    return check


def test_data_of_the_loop_measure_its_sensitivity(plain) -> None:
    assert measured_of(plain).passed, measured_of(plain).finding


def test_a_sweep_of_another_controller_takes_nothing_away(data, found, plain) -> None:
    certificate = certify_from_data(
        found, LAW, Recorded(data, LAW), settings=SETTINGS, swept=Recorded(data, OTHER), uncertainty=found.uncertainty
    )
    assert [check.name for check in certificate.checks] == [check.name for check in plain.checks]
    assert certificate.measured is not None
    assert any("so it is left out" in text for text in certificate.warnings)


def test_data_of_the_identification_measure_it_where_those_of_the_validation_are_of_another_loop(data, found) -> None:
    certificate = certify_from_data(found, LAW, Recorded(data, LAW), Recorded(data, OTHER), settings=SETTINGS)
    assert measured_of(certificate).passed


def test_without_data_of_the_loop_the_certificate_says_so(found) -> None:
    check = measured_of(certify(found.model, LAW, settings=SETTINGS))
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
