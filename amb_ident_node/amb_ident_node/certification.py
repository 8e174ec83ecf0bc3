"""Service `identifier/certify`: a request becomes a certificate, and the certificate an answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from amb_core.data.analysis import RecordedLoop
from amb_core.data.controller_choice import NO_CONTROLLER, is_named_set
from amb_core.ground.errors import BagError, IdentificationError, RobustnessError
from amb_core.ground.parameters import part_of
from amb_core.loop.known_controller import KnownController
from amb_core.report.pages.certification import InMemory, Request, certify_request
from amb_core.robustness import RobustnessSettings
from amb_core.robustness.certificate_json import certificate_json, compared_values
from amb_core.robustness.trace import CertificateHeader
from amb_ident_node.sources import LoopSources

if TYPE_CHECKING:
    from amb_core.robustness import Assessment, Certificate
    from amb_ident_node.identified import Identified
    from amb_msgs import srv

NOTHING_IDENTIFIED = "no model has been identified yet; call ~/identify first or name a file"


@dataclass(frozen=True)
class Source:
    """Which telemetry is meant, with the fields of Identify.srv and Validate.srv of the same names."""

    controller: str
    first_step: int
    steps: int
    bag: str = ""
    description: str = ""


class Certifier:
    """Certifies for the service, by the path of `amb certify`.

    Parameters
    ----------
    sources : LoopSources
        Where telemetry and the controllers of running nodes are found.
    """

    def __init__(self, sources: LoopSources) -> None:
        self._sources = sources

    def certify(
        self, request: srv.Certify.Request, response: srv.Certify.Response, last: Identified | None
    ) -> srv.Certify.Response:
        """Fill in the answer; `last` is the last identification.

        Raises
        ------
        AmbError
            If something that the request names is missing or does not fit together.
        """
        check_request(request)
        if not request.model and last is None:
            raise IdentificationError(NOTHING_IDENTIFIED)
        model = last.result.model if last is not None and not request.model else None
        given = InMemory(
            model=model,
            law=self._of_node(request.controller),
            experiment_law=self._of_node(request.experiment_controller),
            used=last.loop if last is not None and model is not None and not request.bag else None,
            judged=self._telemetry(request) if request.on_telemetry else None,
        )
        certificate = certify_request(request_of(request), given)
        if request.out:
            from amb_core.report.pages.certificate import write_certificate  # loads plotly

            response.page = str(write_certificate(certificate, request.out).absolute())
        return fill_answer(response, certificate, certificate_json(certificate))

    def _telemetry(self, request: srv.Certify.Request) -> RecordedLoop:
        source = Source(request.experiment_controller, request.first_step, request.steps)
        return self._sources.loop(source, with_plant=True)[0]

    def _of_node(self, name: str) -> KnownController | None:
        """The controller of a running node; None for one that is named otherwise, or not at all."""
        if not name or name == NO_CONTROLLER or is_named_set(name):
            return None
        return self._sources.named_controller(name, None)


def request_of(request: srv.Certify.Request) -> Request:
    """The request as the command has it; ParameterError if a value is out of its range."""
    names = {item.name for item in fields(Request)} - {"settings", "header"}
    values = {name: getattr(request, name) for name in request.get_fields_and_field_types()}
    return Request(
        **{name: value for name, value in values.items() if name in names},
        settings=part_of(RobustnessSettings, values),
        header=part_of(CertificateHeader, values),
    )


def check_request(request: srv.Certify.Request) -> None:
    """Refuse what contradicts itself, and files that are not there, without reading any."""
    request_of(request)
    if request.on_telemetry and request.validation_bag:
        raise IdentificationError("validation_bag is not allowed with on_telemetry; give one of the two")
    if not request.on_telemetry and (request.first_step != -1 or request.steps):
        raise IdentificationError("first_step and steps are those of the telemetry; set on_telemetry, or leave them")
    for name in ("bag", "validation_bag", "sweep_bag"):
        path = getattr(request, name)
        if path and not _exists(path):
            raise BagError(f"{name} {path}: there is no such file or folder")
    if request.out and _exists(request.out) and not Path(request.out).is_dir():
        raise RobustnessError(f"out {request.out}: cannot be made: there is a file of this name")


def _exists(path: str) -> bool:
    try:
        return Path(path).exists()
    except (OSError, ValueError):  # too long, or a NUL
        return False


def fill_answer(response: srv.Certify.Response, certificate: Certificate, text: str) -> srv.Certify.Response:
    """A certificate as answer; `text` is its JSON."""
    response.success, response.certified = True, certificate.certified
    response.statement = certificate.statement
    response.message = response.verdict = certificate.verdict
    response.reasons = [check.finding for check in certificate.checks if not check.passed]
    response.warnings = list(certificate.warnings)
    response.certificate = text
    response.measured_difference = math.nan
    response.mu_upper = response.mu_lower = response.nu_gap = response.stability_margin_b = math.nan
    if certificate.assessment is not None:
        _fill_numbers(response, certificate.assessment)
        if certificate.measured is not None:
            compared = compared_values(certificate.measured, certificate.assessment)
            response.measured_peak_sensitivity = list(compared["peaks"].values())
            response.measured_difference = compared["worst_difference_db"]
    return response


def _fill_numbers(response: srv.Certify.Response, assessment: Assessment) -> None:
    axes = assessment.axes
    response.axes, response.zone = [one.name for one in axes], [one.zone for one in axes]
    response.peak_sensitivity = [one.sensitivity.value for one in axes]
    response.peak_sensitivity_frequency = [one.sensitivity.frequency for one in axes]
    response.peak_complementary = [one.complementary.value for one in axes]
    response.peak_complementary_frequency = [one.complementary.frequency for one in axes]
    response.gain_margin_up = [one.margins.gain_up.value for one in axes]
    response.gain_margin_down = [one.margins.gain_down.value for one in axes]
    response.phase_margin = [one.margins.phase.value for one in axes]
    response.delay_margin = [one.margins.delay.value for one in axes]
    response.disk_margin = [one.disk.guaranteed for one in axes]
    response.mu_upper, response.mu_lower = assessment.mu.upper, assessment.mu.lower
    if assessment.bounds is None:
        return
    bounds = assessment.bounds.axes
    response.sensitivity_bound = [one.sensitivity.value for one in bounds]
    response.complementary_bound = [one.complementary.value for one in bounds]
    response.disk_margin_bound = [1.0 / one.disk.value for one in bounds]
    response.zone_bound = [one.zone for one in bounds]
    response.nu_gap, response.stability_margin_b = assessment.bounds.gap.worst.value, assessment.bounds.gap.margin
