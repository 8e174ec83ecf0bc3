"""Service `identifier/certify`: a request becomes a certificate, and the certificate an answer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from amb_core.analysis import RecordedLoop
from amb_core.errors import BagError, IdentificationError, RobustnessError
from amb_core.identification import StateSpaceModel
from amb_core.identification.controller_choice import is_named_set
from amb_core.loop.known_controller import KnownController
from amb_core.parameters import part_of
from amb_core.robustness import (
    Recorded,
    RobustnessSettings,
    certify_from_data,
    sha256_of,
    sha256_of_controller,
    sha256_of_data,
    sha256_of_model,
)
from amb_core.robustness.certificate import certificate_json, compared_values
from amb_ident_node.sources import LoopSources

if TYPE_CHECKING:
    from amb_core.robustness import Assessment, Certificate
    from amb_ident_node.identified import Identified
    from amb_msgs import srv

NOTHING_IDENTIFIED = "no model has been identified yet; call ~/identify first or name a file"


@dataclass(frozen=True)
class Source:
    """Where data come from, with the fields of Identify.srv and Validate.srv of the same names."""

    bag: str
    controller: str
    description: str = ""
    first_step: int = -1
    steps: int = 0


class Certifier:
    """Certifies for the service.

    Parameters
    ----------
    sources : LoopSources
        Where data and controllers are found.
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
        inputs: dict[str, str] = {}
        if request.model:
            model, used = StateSpaceModel.load(request.model), None
            inputs[f"model {Path(request.model).name}"] = sha256_of(request.model)
        elif last is not None:
            model, used = last.result.model, None if request.bag else last.loop
            inputs["model identified by the node"] = sha256_of_model(model)
        else:
            raise IdentificationError(NOTHING_IDENTIFIED)
        if used is not None:
            inputs[f"data {used.data.experiments[0].source}"] = sha256_of_data(used.data)
        else:
            used = self._read(request, "bag", inputs)
        judged = (
            self._telemetry(request, inputs) if request.on_telemetry else self._read(request, "validation_bag", inputs)
        )
        swept = self._read(request, "sweep_bag", inputs)
        law = self._law(request, model, judged or used, inputs)
        found = certify_from_data(
            model,
            law,
            _recorded(used),
            _recorded(judged),
            settings=settings_of(request),
            inputs=inputs,
            swept=_recorded(swept),
        )
        if request.out:
            from amb_core.report.certificate import write_certificate  # loads plotly

            response.page = str(write_certificate(found, request.out).absolute())
        return fill_answer(response, found, certificate_json(found))

    def _read(self, request: srv.Certify.Request, field: str, inputs: dict[str, str]) -> RecordedLoop | None:
        """The bag of a field; None if none is named."""
        path = getattr(request, field)
        if not path:
            return None
        inputs[f"{field.replace('_', ' ')} {Path(path).name}"] = sha256_of(path)
        return self._sources.loop(Source(path, request.experiment_controller, request.description), with_plant=True)[0]

    def _telemetry(self, request: srv.Certify.Request, inputs: dict[str, str]) -> RecordedLoop:
        source = Source("", request.experiment_controller, "", request.first_step, request.steps)
        loop, _ = self._sources.loop(source, with_plant=True)
        inputs[f"validation data {loop.data.experiments[0].source}"] = sha256_of_data(loop.data)
        return loop

    def _law(
        self, request: srv.Certify.Request, model: StateSpaceModel, loop: RecordedLoop | None, inputs: dict[str, str]
    ) -> KnownController:
        """The controller to certify."""
        name = request.controller
        if not name:
            if loop is None or loop.controller is None:
                raise IdentificationError("the controller of the experiment is not known; name one in `controller`")
            inputs["controller of the experiment"] = sha256_of_controller(loop.controller)
            return loop.controller
        law = self._sources.named_controller(name, 1.0 / model.sample_time)
        if is_named_set(name) and Path(name).exists():
            inputs[f"controller {Path(name).name}"] = sha256_of(name)
        else:
            inputs[f"controller {name}"] = sha256_of_controller(law)
        return law


def _recorded(loop: RecordedLoop | None) -> Recorded | None:
    return None if loop is None else Recorded(loop.data, loop.controller, loop.plant)


def settings_of(request: srv.Certify.Request) -> RobustnessSettings:
    """What a request assumes and demands; ParameterError if a value is out of its range."""
    return part_of(RobustnessSettings, {name: getattr(request, name) for name in request.get_fields_and_field_types()})


def check_request(request: srv.Certify.Request) -> None:
    """Refuse what contradicts itself, and files that are not there, without reading any."""
    settings_of(request)
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


def _fill_numbers(response: srv.Certify.Response, found: Assessment) -> None:
    axes = found.axes
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
    response.mu_upper, response.mu_lower = found.mu.upper, found.mu.lower
    if found.bounds is None:
        return
    bounds = found.bounds.axes
    response.sensitivity_bound = [one.sensitivity.value for one in bounds]
    response.complementary_bound = [one.complementary.value for one in bounds]
    response.disk_margin_bound = [1.0 / one.disk.value for one in bounds]
    response.zone_bound = [one.zone for one in bounds]
    response.nu_gap, response.stability_margin_b = found.bounds.gap.worst.value, found.bounds.gap.margin
